"""Samples that stand at the end of the sensor's range: a number there is not what the board felt."""

from __future__ import annotations

from typing import Final

from server.nav.constants import STANDARD_GRAVITY_M_S2
from server.nav.kernel import kernel
from server.nav.preprocess.chain_layout import FULL_SCALE_TOLERANCE
from server.nav.types import Float

GYRO_LEAST_RAD_S: Final = 0.95 * 2.1816615649929116  # ±125 °/s, the narrowest range of MEMS gyros
ACCEL_LEAST_M_S2: Final = 0.95 * 2.0 * STANDARD_GRAVITY_M_S2  # ±2 g likewise


@kernel("boolean(float64, float64, float64, float64[::1], int64)")
def clipped(value: float, full_scale: float, least: float, s: Float, at: int) -> bool:
    """Return whether a number stands at the end of its range.

    With a known full scale it is compared; else the end is where the largest magnitude ever seen comes twice in a row
    to the last bit, which noise does not do.

    Args:
        value: of one axis. full_scale: in its unit; 0 = unknown.
        least: what no sensor's range ends below.
        s: memory; s[at] is the largest magnitude seen, s[at + 1] is 1 when the sample before stood there.
    """
    size = abs(value)
    if full_scale > 0.0:
        return size >= (1.0 - FULL_SCALE_TOLERANCE) * full_scale
    if size < least:
        s[at + 1] = 0.0
        return False
    again = size == s[at] and s[at + 1] == 1.0
    s[at + 1] = 1.0 if size >= s[at] else 0.0
    s[at] = max(s[at], size)
    return bool(again)

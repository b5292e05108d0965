"""Rate limit with re-acceptance ("limit filter") [S1 eq. 3.13]."""

from __future__ import annotations

from server.nav.kernel import kernel
from server.nav.preprocess.chain_layout import Z_LIMIT, Z_REJECTED
from server.nav.types import Float


@kernel("float64(float64[::1], int64, float64, float64, float64)")
def limit(c: Float, z: int, value: float, most: float, count: float) -> float:
    """Return the value, or the last output when it jumped by more than `most` from it.

    After `count` rejections in a row the new level is accepted: without that one step blinds the sensor for good.

    Args:
        c: the chain's array.
        z: where the channel's states begin in it.
        value: the sample. most: in its unit.
    """
    if abs(value - c[z + Z_LIMIT]) > most and c[z + Z_REJECTED] < count:
        c[z + Z_REJECTED] += 1.0
        return float(c[z + Z_LIMIT])
    c[z + Z_REJECTED] = 0.0
    c[z + Z_LIMIT] = value
    return value

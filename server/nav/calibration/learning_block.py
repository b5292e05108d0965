"""A block of the learning: was it rest, was it turning, and what is then learned from it."""

from __future__ import annotations

import math
from typing import Final

from server.nav.calibration.learning_filter import correct, hold_still, judge, predict, widen
from server.nav.calibration.learning_judge import compare, doubt2, suspect, usual2
from server.nav.calibration.learning_layout import (
    C_A_Q,
    C_A_S,
    C_B_DT,
    C_B_N,
    C_B_SIZE,
    C_B_Z,
    C_B_Z2,
    C_BAD_RAD,
    C_JUMP2,
    C_PATCH2,
    C_Q,
    C_STILL,
    C_STILL_S,
    C_SUSPECT,
    C_TURNED,
    C_WHITE2,
    C_WHITE_N,
    F_E,
    FIELD,
    GYRO,
    K_PATCH_MAX,
    K_PATCH_RAD,
    N,
)
from server.nav.calibration.learning_strength import departure2, learn_unevenness, remember_strength
from server.nav.kernel import kernel
from server.nav.rotation import quat_mul, rotvec_from_quat
from server.nav.types import Float

TURN_RAD: Final = 0.1  # an offset is learned from turns of this size, well above the sensor's noise
ZERO_RATE_RAD_S: Final = 0.01  # of one still block; slow turning is not told from a gyro bias by the gyro
GATE: Final = 6.0  # innovation² over what is expected: 2.4 standard deviations on every axis at once
STRENGTH_GATE: Final = 9.0  # of one number: 3 standard deviations
LASTING: Final = 3.0  # the same for its mean …
LASTING_RAD: Final = 5.0  # … over this
FEW_SAMPLES: Final = 3.0
WHITE_BELIEF: Final = 5.0  # samples that the first guess at the white noise counts for
WHITE_SAMPLES: Final = 300.0  # over which it is averaged
SUSPECT_RAD: Final = 0.5  # turning all of which contradicts: no passing thing


@kernel("void(float64[::1], float64[::1])")
def _learn_white(c: Float, par: Float) -> None:
    """Follow the sensor's white noise by the scatter of the samples of a still block."""
    n = c[C_B_N]
    if n < FEW_SAMPLES:
        return
    sum2 = c[C_B_Z] ** 2 + c[C_B_Z + 1] ** 2 + c[C_B_Z + 2] ** 2
    scatter2 = max(0.0, c[C_B_Z2] - sum2 / n) / (3.0 * (n - 1.0))
    c[C_WHITE_N] = min(c[C_WHITE_N] + n - 1.0, WHITE_SAMPLES)
    c[C_WHITE2] += (n - 1.0) / (WHITE_BELIEF + c[C_WHITE_N]) * (min(scatter2, par[K_PATCH_MAX] ** 2) - c[C_WHITE2])


@kernel("void(float64[::1], float64, float64, float64, float64)")
def _count_turn(c: Float, rad: float, x: float, y: float, z: float) -> None:
    """Add a turn of `rad` about the unit axis (x, y, z): it shows the offset across the axis."""
    c[C_TURNED] += rad * (1.0 - x * x)
    c[C_TURNED + 1] += rad * (1.0 - y * y)
    c[C_TURNED + 2] += rad * (1.0 - z * z)
    c[C_TURNED + 3] -= rad * x * y
    c[C_TURNED + 4] -= rad * x * z
    c[C_TURNED + 5] -= rad * y * z


@kernel("void(float64[:, ::1], float64[::1], float64[::1], float64, float64)")
def _turned(s: Float, c: Float, par: Float, rad: float, dt: float) -> None:
    """Use a block after a turn: learn from it, or find out what contradicts."""
    white2 = c[C_WHITE2] / c[C_B_N]
    variance = white2 + c[C_PATCH2] * max(1.0, par[K_PATCH_RAD] / rad)
    if c[C_SUSPECT] == 1.0:
        compare(s, c, par, variance, rad, dt)
        return
    y2, known2 = judge(s[0], c)
    usual, departs2 = usual2(c), departure2(s[0], c)
    uneven = departs2 / (usual / 3.0 + doubt2(s[0]))
    s[0, F_E] += min(1.0, rad / LASTING_RAD) * (uneven - s[0, F_E])
    if y2 > GATE * (usual + known2) or uneven > STRENGTH_GATE or s[0, F_E] > LASTING:
        c[C_BAD_RAD] += rad
        c[C_JUMP2] = max(c[C_JUMP2], y2, departs2)
        if c[C_BAD_RAD] > SUSPECT_RAD:
            c[C_BAD_RAD] = 0.0
            suspect(s, c, max(c[C_JUMP2], 2.0 * usual))
        return
    c[C_BAD_RAD] = max(0.0, c[C_BAD_RAD] - rad)
    if c[C_BAD_RAD] == 0.0:
        c[C_JUMP2] = 0.0
    correct(s[0], c, variance, 0, N)
    remember_strength(c, rad)
    learn_unevenness(s[0], c, par)


@kernel("void(float64[:, ::1], float64[::1], float64[::1], int64)")
def _rested(s: Float, c: Float, par: Float, filters: int) -> None:
    """Use a still block: the gyro tells its bias, the field is followed wherever it goes, the offset is not touched."""
    variance = c[C_WHITE2] / c[C_B_N]
    _learn_white(c, par)
    least2 = 1e9
    for h in range(filters):
        y2, known2 = judge(s[h], c)
        if y2 < GATE * (usual2(c) + known2):
            least2 = 0.0
        least2 = min(least2, y2)
    if least2 > 0.0:  # none explains it
        suspect(s, c, least2)
        filters = 2
    for h in range(filters):
        hold_still(s[h], c, ZERO_RATE_RAD_S)
        correct(s[h], c, variance, FIELD, GYRO)


@kernel("UniTuple(float64, 4)(float64[::1])")
def turned_since(c: Float) -> tuple[float, float, float, float]:
    """Return the angle, rad, and the unit axis, body, since the offset was last learned from."""
    a = C_A_Q
    q = quat_mul(c[a], -c[a + 1], -c[a + 2], -c[a + 3], c[C_Q], c[C_Q + 1], c[C_Q + 2], c[C_Q + 3])
    v = rotvec_from_quat(q[0], q[1], q[2], q[3])
    rad = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    per = 1.0 / max(rad, 1e-12)
    return rad, v[0] * per, v[1] * per, v[2] * per


@kernel("void(float64[::1])")
def _anchor(c: Float) -> None:
    """Count turning from here."""
    c[C_A_S] = 0.0
    for i in range(4):
        c[C_A_Q + i] = c[C_Q + i]


@kernel("void(float64[:, ::1], float64[::1], float64[::1], boolean)")
def close_block(s: Float, c: Float, par: Float, still: bool) -> None:
    """Carry the filters over the open block, use its mean sample, and open the next.

    Args:
        s: shape (2, F_SIZE). c: shape (C_SIZE,). par: shape (K_SIZE,).
        still: the board did not turn in it.
    """
    filters = 2 if c[C_SUSPECT] == 1.0 else 1
    for h in range(filters):
        if c[C_STILL] == 1.0 and not still:  # what rest said of the field holds for that pose
            widen(s[h], FIELD, c[C_PATCH2])
        predict(s[h], c, par, not still)
    c[C_STILL] = 1.0 if still else 0.0
    c[C_STILL_S] = c[C_STILL_S] + c[C_B_DT] if still else 0.0
    c[C_A_S] += c[C_B_DT]
    rad, x, y, z = turned_since(c)
    if still:
        if c[C_B_N] > 0.0:
            _rested(s, c, par, filters)
        _anchor(c)
    elif c[C_B_N] > 0.0 and rad >= TURN_RAD:
        _count_turn(c, rad, x, y, z)
        _turned(s, c, par, rad, c[C_A_S])
        _anchor(c)
    for i in range(C_B_SIZE):
        c[C_B_DT + i] = 0.0

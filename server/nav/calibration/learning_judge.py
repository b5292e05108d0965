"""Is a contradiction fixed to the body or to the room? Two filters are asked; only motion answers.

When the field contradicts the offset, nothing more is learned from it. The first filter keeps its offset and takes
the field for changed; the second takes the offset for changed as well. What explains the readings over enough turning
and time is believed, the first before the second. While neither does, the disturbance is the room's: frozen.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.calibration.learning_filter import NOT_OFFSET, WHOLE, correct, hold_still, judge, predict, widen
from server.nav.calibration.learning_layout import (
    C_A_Q,
    C_A_S,
    C_B_DT,
    C_B_N,
    C_B_RM,
    C_B_SIZE,
    C_B_Z,
    C_BAD_RAD,
    C_CHANGES,
    C_JUMP2,
    C_LEARNED,
    C_PATCH2,
    C_Q,
    C_REFUSED,
    C_RESIDUAL2,
    C_STILL,
    C_STILL_S,
    C_SUSPECT,
    C_T,
    C_T_CHANGED,
    C_T_JUMP,
    C_TRY_RAD,
    C_TRY_S,
    C_TURNED,
    F_E,
    F_E_ALL,
    F_E_RAD,
    F_E_S,
    F_P,
    F_S,
    F_S_RAD,
    F_SIZE,
    F_X,
    FIELD,
    K_NOISE,
    K_PATCH_MAX,
    K_PATCH_MIN,
    K_PATCH_RAD,
    OFFSET,
    N,
)
from server.nav.kernel import kernel
from server.nav.rotation import quat_mul, rotvec_from_quat
from server.nav.types import Float

TURN_RAD: Final = 0.1  # an offset is learned from turns of this size, well above the sensor's noise
STILL_RAD_S: Final = 0.02
ZERO_RATE_RAD_S: Final = 0.01  # of one still block; slow turning is not told from a gyro bias by the gyro
GATE: Final = 6.0  # innovation² over what is expected: 2.4 standard deviations on every axis at once
STRENGTH_GATE: Final = 9.0  # of one number: 3 standard deviations
WORSE: Final = 1.5  # a place that stays uneven is taken for what it is, slowly
SUSPECT_RAD: Final = 0.5  # turning all of which contradicts: no passing thing
MEMORY_RAD: Final = 20.0  # over which the unevenness is averaged
AGREE: Final = 2.0  # innovation² over an undisturbed one's, to be believed …
AGREE_RAD: Final = 2.0  # … over so much turning …
AGREE_S: Final = 2.0  # … and so long
CHANGE_AGREE: Final = 1.5  # another offset must explain better, for longer, the oftener others have failed
CHANGE_RAD: Final = 5.0
CHANGE_S: Final = 3.0
FAILED_MAX: Final = 4.0
TRY_FACTOR: Final = 3.0  # an offset that has not explained the readings after this multiple of it is given up
CHANGE_SIGMA: Final = 4.0  # an offset moved by more than this is a change worth counting


@kernel("float64(float64[::1], float64[::1])")
def _usual2(c: Float, par: Float) -> float:
    """Return |innovation|² that sensor and place have when nothing disturbs."""
    return float(3.0 * (c[C_PATCH2] + par[K_NOISE] ** 2 / c[C_B_N]))


@kernel("float64(float64[::1])")
def _doubt2(s: Float) -> float:
    """Return the offset's mean variance."""
    e = F_P + (N + 1) * OFFSET
    return float((s[e] + s[e + N + 1] + s[e + 2 * N + 2]) / 3.0)


@kernel("float64(float64[::1], float64[::1], float64)")
def departure2(s: Float, c: Float, rad: float) -> float:
    """Return (|m − b| − its mean)² and follow the mean: S0's pair (3.21) over all readings so far, gauss²."""
    size2 = 0.0
    for i in range(3):
        e = c[C_B_Z + i]
        for j in range(3):
            e -= c[C_B_RM + 3 * i + j] * s[F_X + OFFSET + j]
        size2 += (e / c[C_B_N]) ** 2
    s[F_S_RAD] += rad
    departs = math.sqrt(size2) - s[F_S] if s[F_S_RAD] > rad else 0.0
    s[F_S] = math.sqrt(size2) if s[F_S_RAD] <= rad else s[F_S] + max(rad / MEMORY_RAD, rad / s[F_S_RAD]) * departs
    return departs**2


@kernel("void(float64[:, ::1], float64[::1], float64)")
def open_second(s: Float, c: Float, jump2: float) -> None:
    """Let both filters take the field for changed by this much, the second the offset too."""
    widen(s[0], FIELD, jump2)
    for i in range(F_SIZE):
        s[1, i] = s[0, i]
    widen(s[1], OFFSET, jump2)
    for h in range(2):
        s[h, F_E] = s[h, F_E_RAD] = s[h, F_E_S] = s[h, F_S_RAD] = 0.0
    c[C_TRY_RAD] = c[C_TRY_S] = 0.0


@kernel("void(float64[:, ::1], float64[::1], float64)")
def suspect(s: Float, c: Float, jump2: float) -> None:
    """Stop learning: the field contradicts the offset by this much."""
    if c[C_SUSPECT] == 0.0:
        c[C_T_JUMP], c[C_REFUSED], c[C_JUMP2] = c[C_T], 0.0, 0.0
    c[C_SUSPECT] = 1.0
    c[C_JUMP2] = max(c[C_JUMP2], jump2)
    open_second(s, c, c[C_JUMP2])


@kernel("void(float64[:, ::1], float64[::1])")
def _believe_second(s: Float, c: Float) -> None:
    """Take the second filter for the first; a change when its offset is another one."""
    moved2, spread2 = 0.0, 0.0
    for i in range(3):
        moved2 += (s[1, F_X + OFFSET + i] - s[0, F_X + OFFSET + i]) ** 2
        spread2 += s[1, F_P + (N + 1) * (OFFSET + i)] + s[0, F_P + (N + 1) * (OFFSET + i)]
    if moved2 > CHANGE_SIGMA**2 * spread2 / 3.0:
        c[C_CHANGES] += 1.0
        c[C_T_CHANGED] = c[C_T_JUMP]
        for i in range(6):
            c[C_TURNED + i] = 0.0
    for i in range(F_SIZE):
        s[0, i] = s[1, i]


@kernel("void(float64[::1], float64, float64, float64, float64)")
def _account(s: Float, excess: float, told: float, rad: float, dt: float) -> None:
    """Average the contradiction over the turning in which the filter's own doubt is small enough to tell."""
    if told > 0.0:
        s[F_E_RAD] += rad
        s[F_E_S] += dt
        blend = max(rad / AGREE_RAD, rad / s[F_E_RAD])
        s[F_E] += min(1.0, blend) * (excess - s[F_E])
        s[F_E_ALL] += rad / s[F_E_RAD] * (excess - s[F_E_ALL])


@kernel("boolean(float64[::1])")
def _is_room(s: Float) -> bool:
    """True when the offset that was held explains the readings: only the field is another one."""
    return bool(s[F_E_RAD] > AGREE_RAD and s[F_E_S] > AGREE_S and s[F_E] < AGREE)


@kernel("boolean(float64[::1], float64)")
def _is_body(s: Float, factor: float) -> bool:
    """True when another constant offset explains the readings."""
    long_enough = s[F_E_RAD] > CHANGE_RAD * factor and s[F_E_S] > CHANGE_S * factor
    return bool(long_enough and s[F_E] < CHANGE_AGREE and s[F_E_ALL] < CHANGE_AGREE)


@kernel("void(float64[:, ::1], float64[::1], float64[::1], float64, float64, float64)")
def _compare(s: Float, c: Float, par: Float, variance: float, rad: float, dt: float) -> None:
    """Ask both filters; decide when one of them explains the readings."""
    usual2 = _usual2(c, par)
    for h in range(2):
        y2, known2 = judge(s[h], c)
        uneven = departure2(s[h], c, rad) / (usual2 / 3.0 + _doubt2(s[h]))
        _account(s[h], max(y2 / (usual2 + known2), uneven), 4.0 * usual2 - known2, rad, dt)
        correct(s[h], c, variance, WHOLE if h == 1 else NOT_OFFSET)
    c[C_TRY_RAD] += rad
    c[C_TRY_S] += dt
    factor = 1.0 + min(c[C_REFUSED], FAILED_MAX)
    if _is_room(s[0]):
        c[C_SUSPECT] = c[C_BAD_RAD] = 0.0
    elif _is_body(s[1], factor):
        _believe_second(s, c)
        c[C_SUSPECT] = c[C_BAD_RAD] = 0.0
    elif c[C_TRY_RAD] > TRY_FACTOR * CHANGE_RAD * factor and c[C_TRY_S] > TRY_FACTOR * CHANGE_S * factor:
        c[C_REFUSED] += 1.0
        c[C_PATCH2] = min(WORSE * c[C_PATCH2], par[K_PATCH_MAX] ** 2)
        open_second(s, c, c[C_JUMP2])


@kernel("void(float64[::1], float64[::1], float64[::1], float64, float64)")
def _learn_patch(s: Float, c: Float, par: Float, departs2: float, rad: float) -> None:
    """Follow the unevenness: how much the strength varies; it needs no rotation to be known."""
    if _doubt2(s) > c[C_PATCH2]:
        return  # the offset's own error would be taken for the field's
    blend = min(1.0, rad / MEMORY_RAD)
    c[C_RESIDUAL2] += blend * (departs2 - c[C_RESIDUAL2])
    c[C_PATCH2] += blend * (departs2 - par[K_NOISE] ** 2 / c[C_B_N] - c[C_PATCH2])
    c[C_PATCH2] = min(max(c[C_PATCH2], par[K_PATCH_MIN] ** 2), par[K_PATCH_MAX] ** 2)


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
    white2 = par[K_NOISE] ** 2 / c[C_B_N]
    variance = white2 + c[C_PATCH2] * max(1.0, par[K_PATCH_RAD] / rad)
    if c[C_SUSPECT] == 1.0:
        _compare(s, c, par, variance, rad, dt)
        return
    y2, known2 = judge(s[0], c)
    usual2, departs2 = _usual2(c, par), departure2(s[0], c, rad)
    if y2 > GATE * (usual2 + known2) or departs2 > STRENGTH_GATE * (usual2 / 3.0 + _doubt2(s[0])):
        c[C_BAD_RAD] += rad
        c[C_JUMP2] = max(c[C_JUMP2], y2)
        if c[C_BAD_RAD] > SUSPECT_RAD:
            c[C_BAD_RAD] = 0.0
            suspect(s, c, max(y2, 0.5 * c[C_JUMP2]))
        return
    c[C_BAD_RAD] = max(0.0, c[C_BAD_RAD] - rad)
    if c[C_BAD_RAD] == 0.0:
        c[C_JUMP2] = 0.0
    correct(s[0], c, variance, WHOLE)
    _learn_patch(s[0], c, par, departs2, rad)
    c[C_LEARNED] += 1.0


@kernel("void(float64[:, ::1], float64[::1], float64[::1], int64)")
def _rested(s: Float, c: Float, par: Float, filters: int) -> None:
    """Use a still block: the gyro's bias and the field are followed, the offset is not touched."""
    variance = par[K_NOISE] ** 2 / c[C_B_N]
    y2, known2 = judge(s[0], c)
    if y2 > GATE * (_usual2(c, par) + known2):
        suspect(s, c, y2)
        filters = 2
    for h in range(filters):
        hold_still(s[h], c, ZERO_RATE_RAD_S)
        correct(s[h], c, variance, NOT_OFFSET)


@kernel("UniTuple(float64, 4)(float64[::1])")
def turned_since(c: Float) -> tuple[float, float, float, float]:
    """Return the angle, rad, and the unit axis, body, since the offset was last learned from."""
    a = C_A_Q
    q = quat_mul(c[a], -c[a + 1], -c[a + 2], -c[a + 3], c[C_Q], c[C_Q + 1], c[C_Q + 2], c[C_Q + 3])
    v = rotvec_from_quat(q[0], q[1], q[2], q[3])
    rad = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    per = 1.0 / max(rad, 1e-12)
    return rad, v[0] * per, v[1] * per, v[2] * per


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
    if c[C_B_N] > 0.0 and still:
        _rested(s, c, par, filters)
    elif c[C_B_N] > 0.0 and rad >= TURN_RAD:
        _count_turn(c, rad, x, y, z)
        _turned(s, c, par, rad, c[C_A_S])
        c[C_A_S] = 0.0
        for i in range(4):
            c[C_A_Q + i] = c[C_Q + i]
    for i in range(C_B_SIZE):
        c[C_B_DT + i] = 0.0

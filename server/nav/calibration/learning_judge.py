"""Is a contradiction fixed to the body or to the room? Two filters are asked; only motion answers.

When the field contradicts the offset, nothing more is learned from it. The first filter keeps its offset and takes
the field for changed; the second takes the offset for changed as well. What explains the readings over enough turning
and time is believed, the first before the second. While neither does, the disturbance is the room's: frozen.

A reading tells by what the filter expects of it, not by what it knows of the whole offset: turns about the vertical
alone never tell the offset along it from a change of the field there, and need not. When the first is believed, what
no turn so far would have shown stays in doubt, axis by axis, until a tilt shows it.
"""

from __future__ import annotations

from typing import Final

from server.nav.calibration.learning_filter import correct, judge, widen
from server.nav.calibration.learning_layout import (
    C_B_N,
    C_CHANGES,
    C_JUMP2,
    C_PATCH2,
    C_REFUSED,
    C_SUSPECT,
    C_T,
    C_T_CHANGED,
    C_T_JUMP,
    C_T_TRUSTED,
    C_TRY_RAD,
    C_TRY_S,
    C_TURNED,
    C_WHITE2,
    F_E,
    F_E_ALL,
    F_E_RAD,
    F_E_S,
    F_P,
    F_SIZE,
    F_X,
    FIELD,
    K_PATCH_MAX,
    OFFSET,
    N,
)
from server.nav.calibration.learning_strength import departure2, forget_strength, remember_strength
from server.nav.kernel import kernel
from server.nav.types import Float

WORSE: Final = 3.0  # a place that stays uneven is taken for what it is, slowly
AGREE: Final = 2.0  # innovation² over an undisturbed one's, to be believed …
AGREE_RAD: Final = 2.0  # … over so much turning …
AGREE_S: Final = 2.0  # … and so long
AS_WELL: Final = 0.5
BETTER: Final = 2.5  # by less than this, and AS_WELL, the other explanation is no reason to give up the offset
CHANGE_AGREE: Final = 1.5  # another offset must explain better, for longer, the oftener others have failed
CHANGE_RAD: Final = 5.0
CHANGE_S: Final = 4.0
FAR_OFF: Final = 6.0  # innovation² over an undisturbed one's, of the offset that was held
MOST_PROOF: Final = 8.0  # two failures double the turning and time that are asked for, up to this multiple
KNOWN: Final = 6.0  # a reading tells when the filter's own doubt of it is within this multiple of an undisturbed one's
HOPELESS: Final = 4.0  # an offset that explains so little after CHANGE_RAD is given up at once
RELAPSE_S: Final = 30.0  # a contradiction so soon after the last is the same one
TRY_FACTOR: Final = 3.0  # an offset that has not explained the readings after this multiple of it is given up
CHANGE_SIGMA: Final = 4.0  # an offset moved by more than this is a change worth counting


@kernel("float64(float64[::1])")
def usual2(c: Float) -> float:
    """Return |innovation|² that sensor and place have when nothing disturbs."""
    return float(3.0 * (c[C_PATCH2] + c[C_WHITE2] / c[C_B_N]))


@kernel("float64(float64[::1])")
def doubt2(s: Float) -> float:
    """Return the offset's mean variance."""
    e = F_P + (N + 1) * OFFSET
    return float((s[e] + s[e + N + 1] + s[e + 2 * N + 2]) / 3.0)


@kernel("void(float64[:, ::1], float64[::1], float64)")
def open_second(s: Float, c: Float, jump2: float) -> None:
    """Let both filters take the field for changed by this much, the second the offset too."""
    widen(s[0], FIELD, jump2)
    for i in range(F_SIZE):
        s[1, i] = s[0, i]
    widen(s[1], OFFSET, jump2)
    for h in range(2):
        s[h, F_E] = s[h, F_E_RAD] = s[h, F_E_S] = 0.0
    c[C_TRY_RAD] = c[C_TRY_S] = 0.0
    forget_strength(c)


@kernel("void(float64[:, ::1], float64[::1], float64)")
def suspect(s: Float, c: Float, jump2: float) -> None:
    """Stop learning: the field contradicts the offset by this much."""
    if c[C_SUSPECT] == 0.0:
        again = (c[C_T] - c[C_T_TRUSTED]) * 1e-9 < RELAPSE_S
        c[C_REFUSED] = c[C_REFUSED] + 2.0 if again else 0.0
        c[C_T_JUMP], c[C_JUMP2] = c[C_T], 0.0
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


@kernel("void(float64[:, ::1])")
def _doubt_as_second(s: Float) -> None:
    """Keep the first filter's values with the second's covariance: what no turn so far would show may have changed."""
    for i in range(N * N):
        s[0, F_P + i] = s[1, F_P + i]


@kernel("void(float64[::1], float64, float64, float64, float64)")
def _account(s: Float, excess: float, told: float, rad: float, dt: float) -> None:
    """Average the contradiction over the turning in which the filter's own doubt is small enough to tell."""
    if told > 0.0:
        s[F_E_RAD] += rad
        s[F_E_S] += dt
        blend = max(rad / AGREE_RAD, rad / s[F_E_RAD])
        s[F_E] += min(1.0, blend) * (excess - s[F_E])
        s[F_E_ALL] += rad / s[F_E_RAD] * (excess - s[F_E_ALL])


@kernel("boolean(float64[:, ::1], float64)")
def _is_room(s: Float, factor: float) -> bool:
    """True when the offset that was held explains the readings, and another one hardly better."""
    long_enough = s[0, F_E_RAD] > AGREE_RAD * factor and s[0, F_E_S] > AGREE_S * factor
    return bool(long_enough and s[0, F_E] < min(AGREE, AS_WELL + BETTER * s[1, F_E]))


@kernel("boolean(float64[:, ::1], float64)")
def _is_body(s: Float, factor: float) -> bool:
    """True when another constant offset explains the readings; where the held one is far off, less turning tells."""
    rad = CHANGE_RAD * factor * (0.5 if s[0, F_E] > FAR_OFF and s[0, F_E_ALL] > FAR_OFF else 1.0)
    long_enough = s[1, F_E_RAD] > rad and s[1, F_E_S] > CHANGE_S * factor
    return bool(long_enough and s[1, F_E] < CHANGE_AGREE and s[1, F_E_ALL] < CHANGE_AGREE)


@kernel("void(float64[:, ::1], float64[::1], float64[::1], float64, float64, float64)")
def compare(s: Float, c: Float, par: Float, variance: float, rad: float, dt: float) -> None:
    """Ask both filters; decide when one of them explains the readings."""
    usual = usual2(c)
    for h in range(2):
        y2, known2 = judge(s[h], c)
        uneven = departure2(s[h], c) / (usual / 3.0 + doubt2(s[h]))
        _account(s[h], max(y2 / (usual + known2), uneven), KNOWN * usual - known2, rad, dt)
        correct(s[h], c, variance, OFFSET if h == 1 else FIELD, N)
    remember_strength(c, rad)
    c[C_TRY_RAD] += rad
    c[C_TRY_S] += dt
    factor = min(2.0 ** (0.5 * c[C_REFUSED]), MOST_PROOF)
    if _is_room(s, factor):
        _doubt_as_second(s)
        c[C_SUSPECT], c[C_T_TRUSTED] = 0.0, c[C_T]
    elif _is_body(s, factor):
        _believe_second(s, c)
        c[C_SUSPECT], c[C_T_TRUSTED] = 0.0, c[C_T]
    elif (s[1, F_E_RAD] > CHANGE_RAD and s[1, F_E] > HOPELESS) or (
        c[C_TRY_RAD] > TRY_FACTOR * CHANGE_RAD * factor and c[C_TRY_S] > TRY_FACTOR * CHANGE_S * factor
    ):
        c[C_REFUSED] += 1.0
        c[C_T_JUMP] = c[C_T] - 1e9 * c[C_TRY_S]
        c[C_PATCH2] = min(WORSE * c[C_PATCH2], par[K_PATCH_MAX] ** 2)
        open_second(s, c, c[C_JUMP2])

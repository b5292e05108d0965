"""The magnetometer as the filter uses it: first heading, gate, attached magnets, correction.

Three kinds of disturbance, three answers. A field that differs from place to place changes slowly: it is a state, and
holds the heading only in the long run. One that passes is beyond the gate: not used. One that stays fixed in the body
frame is a magnet put on or taken off: the offset becomes unknown by as much, and motion tells it from the field.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf.attitude.layout import (
    ATT,
    D_ATTACHED,
    D_GATE,
    D_NO_MAG,
    D_NONE,
    FIELD,
    H_KNOWN,
    H_PROVISIONAL,
    MAG_OFFSET,
    S_DISTURBED,
    S_H,
    S_HAS_REF,
    S_HEADING,
    S_M_COUNT,
    S_M_MEAN,
    S_M_R,
    S_M_T,
    S_M_Z,
    S_P,
    S_REF,
    S_REST,
    S_T,
    S_X,
    N,
)
from server.nav.ekf.attitude.parameters import (
    K_ATTACH_GATE,
    K_ATTACH_TIME,
    K_FIELD_SIGMA,
    K_GATE,
    K_MAG_NOISE,
    K_PATCH_SIGMA,
    K_PATCH_TIME,
)
from server.nav.ekf.attitude.sample import clear_samples, field_row, innovation, level_field
from server.nav.ekf.attitude.update import clear_row, forget, fuse, inject, project, turn_nominal
from server.nav.kernel import kernel
from server.nav.types import Float

SILENT_S: Final = 1.0
NOISE_TIME_S: Final = 0.05
LEAST_NORTH_GAUSS: Final = 0.02  # below it, within 3° of a magnetic pole, the field shows no direction
LEVEL_RAD: Final = 0.06  # 3.4°: at a dip of 70° such a tilt error makes 9° of heading
REF_TIME_S: Final = 100.0  # of motion
NOTHING_RAD: Final = 100.0
"""Against it even a tilt of a radian is small: what a heading is taken from must not be read as news of the tilt."""


@kernel("void(float64[::1], float64[::1])")
def _first_heading(s: Float, par: Float) -> None:
    """Turn the attitude so that the field points north, and say how sure that is."""
    if level_field(s) < LEAST_NORTH_GAUSS:
        return
    n, f, still = s[S_M_COUNT], S_X + FIELD, s[S_REST] == 1.0
    patch2, noise2 = par[K_PATCH_SIGMA] ** 2, par[K_MAG_NOISE] ** 2
    forget(s, ATT + 2, NOTHING_RAD**2)
    for i in range(3):
        forget(s, FIELD + i, 1.0)
        s[f + i] = s[S_M_Z + i] / n
        for c in range(3):
            s[f + i] -= s[S_M_R + 3 * i + c] / n * s[S_X + MAG_OFFSET + c]
    for i in range(3):
        field_row(s, i)
        fuse(s, 0.0, noise2 if still else noise2 + patch2)
    turn_nominal(s, 0.0, 0.0, -math.atan2(s[f + 1], s[f]))
    clear_row(s)  # the field has no east component on average: 0 = ξ_e + H δθ_d − D δθ_n
    s[S_H + FIELD + 1], s[S_H + ATT + 2], s[S_H + ATT] = 1.0, s[f], -s[f + 2]
    fuse(s, 0.0, par[K_FIELD_SIGMA] ** 2 + (patch2 if still else 0.0))
    inject(s)
    if s[S_HAS_REF] == 0.0:
        s[S_REF], s[S_REF + 1] = s[f], s[f + 2]
    s[S_HEADING] = H_KNOWN if s[S_P] + s[S_P + N + 1] < LEVEL_RAD**2 else H_PROVISIONAL
    s[S_DISTURBED] = D_NONE


@kernel("boolean(float64[::1], float64[::1], float64, float64)")
def _attached(s: Float, par: Float, blend: float, expected2: float) -> bool:
    """Follow the mean contradiction in the body's own frame; what is too much for chance is taken for the offset's.

    A disturbance of the place turns under a moving body and averages out; one fixed to the body does not.
    """
    n, mean2 = s[S_M_COUNT], 0.0
    y0, y1, y2 = innovation(s, 0), innovation(s, 1), innovation(s, 2)
    for i in range(3):
        y = (s[S_M_R + i] * y0 + s[S_M_R + 3 + i] * y1 + s[S_M_R + 6 + i] * y2) / n
        s[S_M_MEAN + i] += blend * (y - s[S_M_MEAN + i])
        mean2 += s[S_M_MEAN + i] ** 2
    excess = mean2 - par[K_ATTACH_GATE] ** 2 * expected2
    if excess <= 0.0:
        return False
    for i in range(3):
        s[S_P + (N + 1) * (MAG_OFFSET + i)] += blend * excess
    return True


@kernel("void(float64[::1], float64)")
def _correct(s: Float, variance: float) -> None:
    for i in range(3):
        field_row(s, i)
        fuse(s, innovation(s, i), variance)
    inject(s)


@kernel("void(float64[::1], float64)")
def _learn_usual(s: Float, dt: float) -> None:
    """Move the usual strength and dip towards what is met."""
    blend = dt / REF_TIME_S
    s[S_REF] += blend * (s[S_X + FIELD] - s[S_REF])
    s[S_REF + 1] += blend * (s[S_X + FIELD + 2] - s[S_REF + 1])


@kernel("void(float64[::1], float64[::1], float64)")
def _use(s: Float, par: Float, dt: float) -> None:
    """Judge the mean sample and correct with it; its noise is correlated over a time in motion, hardly so at rest."""
    still = s[S_REST] == 1.0
    noise2 = par[K_MAG_NOISE] ** 2 / s[S_M_COUNT]
    spread2 = par[K_MAG_NOISE] ** 2 if still else par[K_PATCH_SIGMA] ** 2
    known2 = y2 = 0.0
    for i in range(3):
        field_row(s, i)
        known2 += project(s)
        y2 += innovation(s, i) ** 2
    nis = 3.0 * y2 / (known2 + 3.0 * (spread2 + noise2))  # of the size, so that it is the same whatever way one faces
    averaging = min(1.0, 2.0 * par[K_PATCH_TIME] / par[K_ATTACH_TIME])
    blend = 1.0 - math.exp(-dt / par[K_ATTACH_TIME])
    attached = _attached(s, par, blend, known2 + 3.0 * spread2 * averaging)
    if nis > par[K_GATE] ** 2:
        s[S_DISTURBED] = D_GATE
        return
    s[S_DISTURBED] = D_ATTACHED if attached else D_NONE
    lasting_s = 2.0 * (NOISE_TIME_S if still else par[K_PATCH_TIME])
    _correct(s, (noise2 + spread2 * max(1.0, lasting_s / dt)) * (1.0 + nis / 3.0))
    if s[S_HAS_REF] == 0.0 and not still:
        _learn_usual(s, dt)


@kernel("void(float64[::1], float64[::1])")
def fuse_field(s: Float, par: Float) -> None:
    """Use the magnetic samples collected so far; none for a second is a state of its own."""
    since_s = (s[S_T] - s[S_M_T]) * 1e-9
    if s[S_M_COUNT] == 0.0:
        if since_s > SILENT_S:
            s[S_DISTURBED] = D_NO_MAG
        return
    s[S_M_T] = s[S_T]
    if s[S_HEADING] < H_KNOWN:
        _first_heading(s, par)
    else:
        _use(s, par, min(max(since_s, 1e-3), SILENT_S))
    clear_samples(s)


@kernel("void(float64[::1], float64[::1])")
def lift(s: Float, par: Float) -> None:
    """The board leaves the place where it rested: the field there had its own disturbance."""
    for i in range(3):
        s[S_P + (N + 1) * (FIELD + i)] += par[K_PATCH_SIGMA] ** 2

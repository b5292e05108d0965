"""Rotors and frame brake a multirotor against the air: the specific force across its thrust tells the air speed.

f = −k R_bn (v − w) in the two axes across the thrust [Martin and Salaün 2010, IEEE ICRA: the true role of accelerometer
feedback in quadrotor control], with the drag k over mass as a state of its own. This is an assumption: gusts, a rotor
plane that is not quite the board's and drag that is not linear last for seconds. Its noise counts for as long, and is
tracked, so that an airframe which does not follow the law is left alone.
"""

from __future__ import annotations

from typing import Final

from server.nav.codes import FUSED, REFUSED_GATE
from server.nav.ekf.aiding.gnss import tracked_ratio
from server.nav.ekf.blocks import switch_drag_on
from server.nav.ekf.layout import (
    A_K_DRAG,
    H_STATUS,
    H_VAR,
    HANDLER,
    PAR_DRAG,
    PAR_GATE,
    U_ACCEL_MEAN,
    UNDECIDED,
    W_H,
    W_INNOV,
    W_OBS,
    W_PRED,
    W_RATIO,
    W_VAR,
)
from server.nav.ekf.states import (
    ACCEL_BIAS,
    ATT,
    DRAG,
    VEL,
    WIND,
    X_ACCEL_BIAS,
    X_DRAG,
    X_Q,
    X_VEL,
    X_WIND,
    packed,
)
from server.nav.ekf.update import clear_row, correction_seen, fuse, project
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int

CORRELATION: Final = 30.0  # variance factor: what the law leaves unexplained lasts three seconds, 15 measurements
SHARE: Final = 0.15  # of the force: drag is not linear
LEARN: Final = 0.03


@kernel("float64(float64[::1], float64[::1], int64)")
def observe(x: Float, work: Float, axis: int) -> float:
    """Set the row of H of one body axis; return the specific force in m/s² that drag gives it."""
    un, ue, ud = x[X_VEL] - x[X_WIND], x[X_VEL + 1] - x[X_WIND + 1], x[X_VEL + 2]
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    rn, re, rd = R[axis], R[3 + axis], R[6 + axis]
    k, along = x[X_DRAG], rn * un + re * ue + rd * ud
    clear_row(work)
    work[W_H + ATT] = k * (rd * ue - re * ud)
    work[W_H + ATT + 1] = k * (rn * ud - rd * un)
    work[W_H + ATT + 2] = k * (re * un - rn * ue)
    work[W_H + VEL], work[W_H + VEL + 1], work[W_H + VEL + 2] = -k * rn, -k * re, -k * rd
    work[W_H + WIND], work[W_H + WIND + 1] = k * rn, k * re
    work[W_H + DRAG] = -along
    work[W_H + ACCEL_BIAS + axis] = 1.0
    return float(-k * along)


@kernel("float64(float64[::1], float64[::1], float64[::1], float64)")
def _noise(P: Float, par: Float, aux: Float, force2: float) -> float:
    """Return the variance of the law, m²/s⁴, at the square of a force; errors of drag and wind multiply in it."""
    product = P[packed(DRAG, DRAG)] * max(P[packed(WIND, WIND)], P[packed(WIND + 1, WIND + 1)])
    return float(CORRELATION * (aux[A_K_DRAG] * par[PAR_DRAG] ** 2 + SHARE**2 * force2) + product)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64)")
def _decide(h: Float, P: Float, par: Float, aux: Float, work: Float, own: float) -> None:
    """Gate both axes as one, and track how well the law holds while velocity and wind are known.

    Args:
        own: the filter's own share of the two innovations' variance, summed, m²/s⁴.
    """
    excess = (work[W_INNOV] ** 2 + work[W_INNOV + 1] ** 2 - own) / (2.0 * par[PAR_DRAG] ** 2)
    share = own / (2.0 * par[PAR_DRAG] ** 2)
    tells = aux[A_K_DRAG] / (share + aux[A_K_DRAG])
    for i in range(2):
        work[W_RATIO] = max(work[W_RATIO], work[W_INNOV + i] ** 2 / (par[PAR_GATE] ** 2 * work[W_VAR + i]))
    h[H_STATUS] = FUSED if work[W_RATIO] <= 1.0 else REFUSED_GATE
    aux[A_K_DRAG] = tracked_ratio(aux[A_K_DRAG], excess, LEARN * tells * tells)


@kernel(HANDLER)
def drag(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Correct with the mean specific force of the step, in both axes across the thrust; decide at first use."""
    if not P[packed(DRAG, DRAG)] > 0.0:
        switch_drag_on(x, P, par, work)
    own = 0.0
    for i in range(2):
        work[W_OBS + i] = u[U_ACCEL_MEAN + i] - x[X_ACCEL_BIAS + i]
    if h[H_STATUS] == UNDECIDED:
        h[H_VAR] = _noise(P, par, aux, work[W_OBS] ** 2 + work[W_OBS + 1] ** 2)
    for i in range(2):
        work[W_PRED + i] = observe(x, work, i)
        work[W_INNOV + i] = work[W_OBS + i] - work[W_PRED + i]
        if h[H_STATUS] == UNDECIDED:
            mine = project(P, work)
            work[W_VAR + i] = mine + h[H_VAR]
            own += mine
    if h[H_STATUS] == UNDECIDED:
        _decide(h, P, par, aux, work, own)
    if h[H_STATUS] == FUSED:
        for i in range(2):
            observe(x, work, i)
            total = project(P, work) + h[H_VAR]
            fuse(P, work, work[W_INNOV + i] - correction_seen(work), total)

"""A car neither slides sideways nor jumps: the velocity in the body has a forward part only.

[Dissanayake et al. 2001, IEEE Transactions on Robotics and Automation 17(5): vehicle model constraints]
"""

from __future__ import annotations

from typing import Final

from server.nav.codes import FUSED, REFUSED_GATE
from server.nav.ekf.layout import (
    H_STATUS,
    H_VAR,
    HANDLER,
    PAR_GATE,
    U_GYRO_MEAN,
    UNDECIDED,
    W_H,
    W_INNOV,
    W_OBS,
    W_PRED,
    W_RATIO,
    W_VAR,
)
from server.nav.ekf.states import ATT, VEL, X_GYRO_BIAS, X_Q, X_VEL
from server.nav.ekf.update import clear_row, correction_seen, fuse, project
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int

SLIDE_M_S: Final = 0.15  # suspension and road
MISALIGNED: Final = 0.03  # share of the speed: tyre slip, and a board mounted 2 degrees askew
TURNING_M: Final = 0.5  # distance from the axle that does not steer, times the turn rate
CORRELATION: Final = 2.0  # variance factor: slip lasts about a second, five measurements


@kernel("void(float64[::1], float64[::1], int64, float64, float64, float64)")
def observe(x: Float, work: Float, axis: int, vn: float, ve: float, vd: float) -> None:
    """Set the row of H of one body component of the velocity: R_bn δv + R_bn [v]× δθ."""
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    rn, re, rd = R[axis], R[3 + axis], R[6 + axis]
    clear_row(work)
    work[W_H + VEL], work[W_H + VEL + 1], work[W_H + VEL + 2] = rn, re, rd
    work[W_H + ATT] = re * vd - rd * ve
    work[W_H + ATT + 1] = rd * vn - rn * vd
    work[W_H + ATT + 2] = rn * ve - re * vn


@kernel(HANDLER)
def wheels(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Correct lateral and vertical velocity of a car towards zero; decide at first use."""
    vn, ve, vd = x[X_VEL], x[X_VEL + 1], x[X_VEL + 2]
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    undecided, worst = h[H_STATUS] == UNDECIDED, 0.0
    if undecided:
        turn = u[U_GYRO_MEAN + 2] - x[X_GYRO_BIAS + 2]
        speed2 = vn * vn + ve * ve + vd * vd
        h[H_VAR] = CORRELATION * (SLIDE_M_S**2 + MISALIGNED**2 * speed2 + (TURNING_M * turn) ** 2)
    for i in range(1, 3):
        predicted = R[i] * vn + R[3 + i] * ve + R[6 + i] * vd
        work[W_OBS + i], work[W_PRED + i], work[W_INNOV + i] = 0.0, predicted, -predicted
        if undecided:
            observe(x, work, i, vn, ve, vd)
            work[W_VAR + i] = project(P, work) + h[H_VAR]
            worst = max(worst, predicted**2 / (par[PAR_GATE] ** 2 * work[W_VAR + i]))
    if undecided:
        work[W_RATIO] = worst
        h[H_STATUS] = FUSED if worst <= 1.0 else REFUSED_GATE
    if h[H_STATUS] == FUSED:
        for i in range(1, 3):
            observe(x, work, i, vn, ve, vd)
            total = project(P, work) + h[H_VAR]
            fuse(P, work, work[W_INNOV + i] - correction_seen(work), total)

"""Pseudo-measurements: zero velocity and zero rate while the board is still, gravity while there is no GNSS."""

from __future__ import annotations

import math

from server.nav.codes import FUSED
from server.nav.ekf.layout import (
    H_ACC,
    H_STATUS,
    H_VAR,
    HANDLER,
    PAR_GRAVITY_NOISE,
    PAR_ZERO_RATE,
    U_ACCEL_MEAN,
    U_GYRO_MEAN,
    UNDECIDED,
    W_H,
    W_INNOV,
    W_OBS,
    W_PRED,
    W_RATIO,
    W_VAR,
)
from server.nav.ekf.predict import frame_rate, gravity_here
from server.nav.ekf.states import ACCEL_BIAS, ATT, GYRO_BIAS, VEL, X_ACCEL_BIAS, X_GYRO_BIAS, X_Q, X_VEL
from server.nav.ekf.update import clear_row, correction_seen, fuse, project
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int


@kernel("void(float64[::1], float64[::1], float64[::1], int64, float64, float64)")
def _record(h: Float, P: Float, work: Float, axis: int, observed: float, predicted: float) -> None:
    """Fill the record of one axis; H is in work; a pseudo-measurement is not gated, its detector is."""
    work[W_OBS + axis], work[W_PRED + axis] = observed, predicted
    work[W_INNOV + axis] = observed - predicted
    work[W_VAR + axis] = project(P, work) + h[H_VAR]
    work[W_RATIO] = max(work[W_RATIO], work[W_INNOV + axis] ** 2 / (25.0 * work[W_VAR + axis]))
    fuse(P, work, work[W_INNOV + axis] - correction_seen(work), work[W_VAR + axis])


@kernel(HANDLER)
def zero_velocity(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Correct velocity, NED, towards zero; the caller has found the board at rest."""
    if h[H_STATUS] == UNDECIDED:
        h[H_VAR], h[H_STATUS] = h[H_ACC] ** 2, FUSED
    for i in range(3):
        clear_row(work)
        work[W_H + VEL + i] = 1.0
        _record(h, P, work, i, 0.0, x[X_VEL + i])


@kernel(HANDLER)
def zero_rate(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Correct the gyro bias towards the mean rate less the Earth's; the caller has found the board at rest."""
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    w = frame_rate(x, ctl)
    if h[H_STATUS] == UNDECIDED:
        h[H_VAR], h[H_STATUS] = par[PAR_ZERO_RATE] ** 2, FUSED
    for i in range(3):
        clear_row(work)
        work[W_H + GYRO_BIAS + i] = 1.0
        earth = R[i] * w[0] + R[3 + i] * w[1] + R[6 + i] * w[2]
        _record(h, P, work, i, u[U_GYRO_MEAN + i] - earth, x[X_GYRO_BIAS + i])


@kernel(HANDLER)
def gravity(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Correct tilt (and accelerometer bias) so that the mean specific force points up.

    With z = R_nb (a − b) in NED, a body that does not accelerate gives z = (0, 0, −g); to first order
    z_n = g δθ_e + (R δb)_n and z_e = −g δθ_n + (R δb)_e.
    """
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    ax = u[U_ACCEL_MEAN] - x[X_ACCEL_BIAS]
    ay = u[U_ACCEL_MEAN + 1] - x[X_ACCEL_BIAS + 1]
    az = u[U_ACCEL_MEAN + 2] - x[X_ACCEL_BIAS + 2]
    g = gravity_here(x, aux, ctl)
    if h[H_STATUS] == UNDECIDED:
        excess = abs(math.sqrt(ax * ax + ay * ay + az * az) - g)
        h[H_VAR], h[H_STATUS] = (par[PAR_GRAVITY_NOISE] + 3.0 * excess) ** 2, FUSED
    for i in range(2):
        clear_row(work)
        work[W_H + ATT + (1 - i)] = g if i == 0 else -g
        for j in range(3):
            work[W_H + ACCEL_BIAS + j] = R[3 * i + j]
        _record(h, P, work, i, R[3 * i] * ax + R[3 * i + 1] * ay + R[3 * i + 2] * az, 0.0)
    work[W_OBS + 2], work[W_PRED + 2] = R[6] * ax + R[7] * ay + R[8] * az, -g
    work[W_INNOV + 2], work[W_VAR + 2] = work[W_OBS + 2] + g, math.nan

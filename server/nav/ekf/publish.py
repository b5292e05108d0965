"""The filter's state as the row that leaves it."""

from __future__ import annotations

import math

from server.nav.codes import DEAD_RECKONING
from server.nav.earth import ned_from_lla
from server.nav.ekf.layout import (
    A_SITE,
    A_T_GNSS,
    C_MODE,
    C_POSITIONED,
    PAR_IMU_DELAY,
    U_ACCEL,
    U_GYRO,
    U_T,
)
from server.nav.ekf.predict import gravity_here
from server.nav.ekf.states import ATT, POS, VEL, X_ACCEL_BIAS, X_GYRO_BIAS, X_POS, X_Q, X_VEL, packed
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float, Int


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])")
def publish(x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, out: Float) -> None:
    """Write one row of LANE_COLUMNS: the state carried on from the IMU's own delay to the step's stamp."""
    d = par[PAR_IMU_DELAY]
    w = (u[U_GYRO] - x[X_GYRO_BIAS], u[U_GYRO + 1] - x[X_GYRO_BIAS + 1], u[U_GYRO + 2] - x[X_GYRO_BIAS + 2])
    f = (u[U_ACCEL] - x[X_ACCEL_BIAS], u[U_ACCEL + 1] - x[X_ACCEL_BIAS + 1], u[U_ACCEL + 2] - x[X_ACCEL_BIAS + 2])
    turn = quat_from_rotvec(w[0] * d, w[1] * d, w[2] * d)
    q = quat_mul(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3], turn[0], turn[1], turn[2], turn[3])
    sign = -1.0 if q[0] < 0.0 else 1.0
    for i in range(out.shape[0]):
        out[i] = math.nan
    for i in range(4):
        out[i] = sign * q[i]
    for i in range(3):
        out[10 + i] = math.sqrt(P[packed(ATT + i, ATT + i)])
        out[19 + i], out[22 + i] = x[X_GYRO_BIAS + i], x[X_ACCEL_BIAS + i]
    out[25], out[29] = ctl[C_MODE], 0.0
    if not ctl[C_POSITIONED]:
        return
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    g = gravity_here(x, aux, ctl)
    a = (
        R[0] * f[0] + R[1] * f[1] + R[2] * f[2],
        R[3] * f[0] + R[4] * f[1] + R[5] * f[2],
        R[6] * f[0] + R[7] * f[1] + R[8] * f[2] + g,
    )
    ned = ned_from_lla(x[X_POS], x[X_POS + 1], x[X_POS + 2], aux[A_SITE], aux[A_SITE + 1], aux[A_SITE + 2])
    per_rad = ned_from_lla(x[X_POS] + 1e-6, x[X_POS + 1] + 1e-6, 0.0, x[X_POS], x[X_POS + 1], 0.0)
    for i in range(3):
        step = d * x[X_VEL + i] + 0.5 * d * d * a[i]
        out[4 + i] = x[X_VEL + i] + d * a[i]
        out[26 + i] = ned[i] + step
        out[7 + i] = math.degrees(x[X_POS + i] + step / per_rad[i] * 1e-6) if i < 2 else x[X_POS + 2] - step
        out[13 + i] = math.sqrt(P[packed(VEL + i, VEL + i)])
        out[16 + i] = math.sqrt(P[packed(POS + i, POS + i)])
    out[8] = (out[8] + 180.0) % 360.0 - 180.0
    out[29] = max(0.0, (u[U_T] - aux[A_T_GNSS]) * 1e-9) if ctl[C_MODE] == DEAD_RECKONING else 0.0

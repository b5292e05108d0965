"""Prediction of the nominal state at every navigation step; what the covariance needs is collected for its block."""

from __future__ import annotations

import math

from server.nav.ekf.attitude.layout import (
    ACCEL_BIAS,
    GYRO_BIAS,
    GYRO_SCALE,
    S_B_ACCEL,
    S_B_DT,
    S_B_GAP,
    S_B_GYRO,
    S_B_R,
    S_B_RW,
    S_B_TURN,
    S_B_VIBRATION,
    S_GRAVITY,
    S_Q,
    S_T,
    S_W,
    S_X,
    VEL,
)
from server.nav.ekf.layout import (
    U_ACCEL_MEAN,
    U_DT,
    U_DTHETA,
    U_DVEL,
    U_GAP_S,
    U_GYRO_MEAN,
    U_T,
    U_VIBRATION,
)
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float


@kernel("void(float64[::1], float64[::1])")
def _collect(u: Float, s: Float) -> None:
    dt = u[U_DT]
    s[S_B_DT] += dt
    for i in range(3):
        s[S_B_GYRO + i] += u[U_GYRO_MEAN + i] * dt
        s[S_B_ACCEL + i] += u[U_ACCEL_MEAN + i] * dt
    s[S_B_VIBRATION] = max(s[S_B_VIBRATION], u[U_VIBRATION])
    s[S_B_GAP] = max(s[S_B_GAP], u[U_GAP_S])


@kernel("void(float64[::1], float64[::1])")
def integrate(u: Float, s: Float) -> None:
    """Advance attitude and velocity by one navigation step [Solà 2017, eq. 260].

    Args:
        u: shape (U_SIZE,), the step.
        s: shape (S_SIZE,), memory.
    """
    dt = u[U_DT]
    w0 = u[U_DTHETA] - s[S_X + GYRO_BIAS] * dt
    w1 = u[U_DTHETA + 1] - s[S_X + GYRO_BIAS + 1] * dt
    w2 = u[U_DTHETA + 2] - s[S_X + GYRO_BIAS + 2] * dt
    m, a = S_X + GYRO_SCALE, S_X + ACCEL_BIAS
    x = w0 - s[m] * w0 - s[m + 1] * w1 - s[m + 2] * w2
    y = w1 - s[m + 3] * w0 - s[m + 4] * w1 - s[m + 5] * w2
    z = w2 - s[m + 6] * w0 - s[m + 7] * w1 - s[m + 8] * w2
    q = (s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3])
    half = quat_from_rotvec(0.5 * x, 0.5 * y, 0.5 * z)
    mid = quat_mul(q[0], q[1], q[2], q[3], half[0], half[1], half[2], half[3])
    end = quat_mul(mid[0], mid[1], mid[2], mid[3], half[0], half[1], half[2], half[3])
    R0, R = matrix_entries(q[0], q[1], q[2], q[3]), matrix_entries(mid[0], mid[1], mid[2], mid[3])
    w = (w0, w1, w2)
    for i in range(3):
        force = R0[3 * i] * u[U_DVEL] + R0[3 * i + 1] * u[U_DVEL + 1] + R0[3 * i + 2] * u[U_DVEL + 2]
        force -= (R[3 * i] * s[a] + R[3 * i + 1] * s[a + 1] + R[3 * i + 2] * s[a + 2]) * dt
        s[S_X + VEL + i] += force + (s[S_GRAVITY] * dt if i == 2 else 0.0)
        for j in range(3):
            s[S_B_R + 3 * i + j] += R[3 * i + j] * dt
            for k in range(3):
                s[S_B_RW + 9 * i + 3 * j + k] += R[3 * i + j] * w[k]
    scale = 1.0 / math.sqrt(end[0] ** 2 + end[1] ** 2 + end[2] ** 2 + end[3] ** 2)
    for i in range(4):
        s[S_Q + i] = end[i] * scale
    s[S_W], s[S_W + 1], s[S_W + 2], s[S_T] = x / dt, y / dt, z / dt, u[U_T]
    s[S_B_TURN] += math.sqrt(x * x + y * y + z * z)
    _collect(u, s)

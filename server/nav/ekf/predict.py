"""One navigation step of the nominal state and of the covariance."""

from __future__ import annotations

import math
from typing import Final

from numba import njit

from server.nav.constants import EARTH_RATE_RAD_S
from server.nav.earth import curvature_radii, normal_gravity
from server.nav.ekf.covariance import predict_covariance
from server.nav.ekf.layout import (
    A_GRAVITY,
    C_HAS_SITE,
    C_POSITIONED,
    PAR_ACCEL_NOISE,
    PAR_ACCEL_WALK,
    PAR_DECLINATION_WALK,
    PAR_GYRO_NOISE,
    PAR_GYRO_WALK,
    U_DT,
    U_DTHETA,
    U_DVEL,
    U_GAP_S,
    U_VIBRATION,
    W_U,
)
from server.nav.ekf.states import X_ACCEL_BIAS, X_GYRO_BIAS, X_POS, X_Q, X_VEL
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float, Int

VIBRATION_BANDWIDTH_HZ: Final = 100.0
"""Vibration measured over this bandwidth is taken as white: propellers alias into the navigation band. White noise of
0.5 m/s² at 333 Hz is then over-estimated by 1.8, a board's own 20 Hz low-pass under-estimated by as much."""


@njit("UniTuple(float64, 3)(float64[::1], int64[::1])", cache=True)
def frame_rate(x: Float, ctl: Int) -> tuple[float, float, float]:
    """Return ω_in in NED, rad/s: Earth rate plus transport rate; zero where the place is unknown."""
    if ctl[C_HAS_SITE] == 0:
        return 0.0, 0.0, 0.0
    lat = x[X_POS]
    meridian, prime = curvature_radii(lat)
    ve = x[X_VEL + 1] / (prime + x[X_POS + 2])
    vn = x[X_VEL] / (meridian + x[X_POS + 2])
    return EARTH_RATE_RAD_S * math.cos(lat) + ve, -vn, -EARTH_RATE_RAD_S * math.sin(lat) - ve * math.tan(lat)


@njit("float64(float64[::1], float64[::1], int64[::1])", cache=True)
def gravity_here(x: Float, aux: Float, ctl: Int) -> float:
    """Return gravity in m/s²: normal gravity at the position, the standard value where the place is unknown."""
    return normal_gravity(x[X_POS], x[X_POS + 2]) if ctl[C_HAS_SITE] else aux[A_GRAVITY]


@njit("void(float64[::1], float64, float64, float64)", cache=True)
def move_position(x: Float, north_m: float, east_m: float, down_m: float) -> None:
    """Shift latitude, longitude and height by metres in NED."""
    meridian, prime = curvature_radii(x[X_POS])
    x[X_POS + 1] += east_m / ((prime + x[X_POS + 2]) * math.cos(x[X_POS]))
    x[X_POS] += north_m / (meridian + x[X_POS + 2])
    x[X_POS + 2] -= down_m


@njit(
    "void(float64[::1], UniTuple(float64, 9), UniTuple(float64, 3), float64[::1], float64[::1], float64[::1])",
    cache=True,
)
def _predict_errors(
    P: Float,
    R: tuple[float, float, float, float, float, float, float, float, float],
    fn: tuple[float, float, float],
    u: Float,
    par: Float,
    row: Float,
) -> None:
    """Advance the covariance; a bridged gap adds what may have happened unseen in it."""
    dt, gap = u[U_DT], u[U_GAP_S]
    for i in range(3):
        row[i] = fn[i]
    for i in range(9):
        row[3 + i] = R[i] * dt
    row[12] = dt
    row[13] = par[PAR_GYRO_NOISE] ** 2 * dt + (0.5 * gap) ** 2
    shaking = u[U_VIBRATION] ** 2 / (3.0 * VIBRATION_BANDWIDTH_HZ)
    row[14] = (par[PAR_ACCEL_NOISE] ** 2 + shaking) * dt + (3.0 * gap) ** 2
    row[15] = 0.0
    row[16] = par[PAR_GYRO_WALK] ** 2 * dt
    row[17] = par[PAR_ACCEL_WALK] ** 2 * dt
    row[18] = par[PAR_DECLINATION_WALK] ** 2 * dt
    predict_covariance(P, row)


@njit(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])", cache=True
)
def predict(x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Advance state and covariance in place by one step [Solà 2017, eq. 260 and 268, attitude error in NED].

    Args:
        x: shape (X_SIZE,), nominal state.
        P: shape (PACKED,), covariance.
        u: shape (U_SIZE,), the step.
        par, aux, ctl, work: parameters, memory and scratch, `layout`.
    """
    dt = u[U_DT]
    win = frame_rate(x, ctl)
    q = (x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    R = matrix_entries(q[0], q[1], q[2], q[3])
    dv = (
        u[U_DVEL] - x[X_ACCEL_BIAS] * dt,
        u[U_DVEL + 1] - x[X_ACCEL_BIAS + 1] * dt,
        u[U_DVEL + 2] - x[X_ACCEL_BIAS + 2] * dt,
    )
    fn = (
        R[0] * dv[0] + R[1] * dv[1] + R[2] * dv[2],
        R[3] * dv[0] + R[4] * dv[1] + R[5] * dv[2],
        R[6] * dv[0] + R[7] * dv[1] + R[8] * dv[2],
    )
    # Attitude: body rotation on the right, rotation of the local frame on the left.
    turn = quat_from_rotvec(
        u[U_DTHETA] - x[X_GYRO_BIAS] * dt,
        u[U_DTHETA + 1] - x[X_GYRO_BIAS + 1] * dt,
        u[U_DTHETA + 2] - x[X_GYRO_BIAS + 2] * dt,
    )
    frame = quat_from_rotvec(-win[0] * dt, -win[1] * dt, -win[2] * dt)
    new = quat_mul(q[0], q[1], q[2], q[3], turn[0], turn[1], turn[2], turn[3])
    new = quat_mul(frame[0], frame[1], frame[2], frame[3], new[0], new[1], new[2], new[3])
    scale = 1.0 / math.sqrt(new[0] ** 2 + new[1] ** 2 + new[2] ** 2 + new[3] ** 2)
    for i in range(4):
        x[X_Q + i] = new[i] * scale

    if ctl[C_POSITIONED]:
        g = gravity_here(x, aux, ctl)
        earth = (EARTH_RATE_RAD_S * math.cos(x[X_POS]), -EARTH_RATE_RAD_S * math.sin(x[X_POS]))
        w = (win[0] + earth[0], win[1], win[2] + earth[1])  # 2 ω_ie + ω_en
        vn, ve, vd = x[X_VEL], x[X_VEL + 1], x[X_VEL + 2]
        x[X_VEL] += fn[0] - (w[1] * vd - w[2] * ve) * dt
        x[X_VEL + 1] += fn[1] - (w[2] * vn - w[0] * vd) * dt
        x[X_VEL + 2] += fn[2] + (g - (w[0] * ve - w[1] * vn)) * dt
        half = 0.5 * dt
        move_position(x, half * (vn + x[X_VEL]), half * (ve + x[X_VEL + 1]), half * (vd + x[X_VEL + 2]))
    _predict_errors(P, R, fn, u, par, work[W_U : W_U + 19])

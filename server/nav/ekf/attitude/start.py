"""The first attitude, from one step; rest is not needed, and nothing is averaged first."""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf.attitude.layout import (
    ACCEL_BIAS,
    ATT,
    D_NO_MAG,
    FIELD,
    GYRO_BIAS,
    GYRO_SCALE,
    H_NONE,
    MAG_DELAY,
    MAG_OFFSET,
    S_AGAIN,
    S_B_DT,
    S_B_SIZE,
    S_DISTURBED,
    S_DX,
    S_GRAVITY,
    S_HAS_REF,
    S_HEADING,
    S_M_MEAN,
    S_M_T,
    S_Q,
    S_R_ACCEL,
    S_R_ACCEL_VAR,
    S_R_GYRO,
    S_R_GYRO_VAR,
    S_R_STILL_S,
    S_REF,
    S_REST,
    S_STARTED,
    S_T,
    S_W,
    S_X,
    VEL,
    N,
)
from server.nav.ekf.attitude.parameters import (
    K_ACCEL_BIAS_SIGMA,
    K_DELAY_SIGMA,
    K_GYRO_BIAS_SIGMA,
    K_OFFSET_SIGMA,
    K_SCALE_SIGMA,
)
from server.nav.ekf.attitude.sample import clear_samples
from server.nav.ekf.attitude.update import forget
from server.nav.ekf.layout import NEVER_NS, U_ACCEL_MEAN, U_GYRO_MEAN, U_T
from server.nav.kernel import kernel
from server.nav.types import Float

TILT_RAD: Final = 0.15
TILT_S: Final = 0.2  # rad for every rad/s: who turns a board also shoves it
MOST_TILT_RAD: Final = 0.7
SPEED_M_S: Final = 1.0
LEAST_FORCE: Final = 0.3  # of gravity; below it the board falls and shows no down


@kernel("void(float64[::1], float64[::1])")
def _unknown(s: Float, par: Float) -> None:
    """Set what a board is not known by at power-up; kept over a hole in the data."""
    for i in range(N):
        s[S_X + i] = 0.0
    for i in range(3):
        forget(s, GYRO_BIAS + i, par[K_GYRO_BIAS_SIGMA] ** 2)
        forget(s, ACCEL_BIAS + i, par[K_ACCEL_BIAS_SIGMA] ** 2)
        forget(s, MAG_OFFSET + i, par[K_OFFSET_SIGMA] ** 2)
    for i in range(9):
        forget(s, GYRO_SCALE + i, par[K_SCALE_SIGMA] ** 2)
    forget(s, MAG_DELAY, par[K_DELAY_SIGMA] ** 2)


@kernel("void(float64[::1], float64[::1], float64)")
def _fresh(u: Float, s: Float, tilt_rad: float) -> None:
    """Set what every start begins anew."""
    for i in range(3):
        forget(s, ATT + i, tilt_rad**2 if i < 2 else math.pi**2)
        forget(s, VEL + i, SPEED_M_S**2)
        forget(s, FIELD + i, 1.0)
        s[S_X + VEL + i] = s[S_X + FIELD + i] = s[S_M_MEAN + i] = 0.0
        s[S_R_GYRO + i], s[S_R_ACCEL + i] = u[U_GYRO_MEAN + i], u[U_ACCEL_MEAN + i]
        s[S_W + i] = u[U_GYRO_MEAN + i] - s[S_X + GYRO_BIAS + i]
    for i in range(N):
        s[S_DX + i] = 0.0
    for i in range(S_B_SIZE):
        s[S_B_DT + i] = 0.0
    clear_samples(s)
    s[S_R_GYRO_VAR] = s[S_R_ACCEL_VAR] = s[S_R_STILL_S] = s[S_REST] = 0.0
    s[S_HEADING], s[S_DISTURBED], s[S_M_T] = H_NONE, D_NO_MAG, NEVER_NS


@kernel("boolean(float64[::1], float64[::1], float64[::1])")
def start(u: Float, s: Float, par: Float) -> bool:
    """Set the first attitude from one step's specific force, heading unknown; return False in free fall.

    Args:
        u: shape (U_SIZE,), the step; at its end the attitude is valid.
        s, par: shapes (S_SIZE,) and (K_SIZE,), memory and parameters.
    """
    ax, ay, az = u[U_ACCEL_MEAN], u[U_ACCEL_MEAN + 1], u[U_ACCEL_MEAN + 2]
    norm = math.sqrt(ax * ax + ay * ay + az * az)
    if not norm > LEAST_FORCE * s[S_GRAVITY]:
        return False
    roll, pitch = math.atan2(-ay, -az), math.atan2(ax, math.hypot(ay, az))
    cr, sr, cp, sp = math.cos(roll / 2), math.sin(roll / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3] = cr * cp, sr * cp, cr * sp, -sr * sp
    if s[S_AGAIN] == 0.0:
        _unknown(s, par)
    rate = math.sqrt(u[U_GYRO_MEAN] ** 2 + u[U_GYRO_MEAN + 1] ** 2 + u[U_GYRO_MEAN + 2] ** 2)
    _fresh(u, s, min(TILT_RAD + abs(norm / s[S_GRAVITY] - 1.0) + TILT_S * rate, MOST_TILT_RAD))
    s[S_T], s[S_STARTED], s[S_AGAIN] = u[U_T], 1.0, 1.0
    return True


@kernel("void(float64[::1], float64, float64)")
def set_field(s: Float, norm_gauss: float, dip_rad: float) -> None:
    """Take strength and dip (positive down) of the usual field from a model; without it they are learned."""
    s[S_REF], s[S_REF + 1] = norm_gauss * math.cos(dip_rad), norm_gauss * math.sin(dip_rad)
    s[S_HAS_REF] = 1.0

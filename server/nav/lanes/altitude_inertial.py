"""`altitude_inertial`: predict by the accelerometer, correct by the barometer, feed its bias back [S3, algorithm 2].

The filter of the early Pixhawk firmware: with e = zero − baro height − down, every step takes height by w·e·dt, speed
by w²·e·dt, and moves the accelerometer's bias, in the body frame, by w²·e·w_bias·dt along the vertical. The third-order
loop s³ + w s² + w² s + w² w_bias is stable while w_bias < w; a bias is learned with a time constant of 1/w_bias.

What this lane does with a baro spike: it follows by w·e for as long as the value is the newest one.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

from server.nav.codes import FAILED
from server.nav.ekf.layout import M_DATA, M_STEP, U_DT, U_DVEL, U_T
from server.nav.kernel import kernel
from server.nav.lanes.altitude_base import ZERO_PARAMETERS, AltitudeLane
from server.nav.lanes.base import Parameter
from server.nav.lanes.vertical import (
    BARO_LOST_S,
    BROKEN,
    COMPUTING,
    P_IMU_DELAY,
    P_OWN,
    V_A,
    V_D,
    V_G,
    V_OWN,
    V_RUN,
    V_SIZE,
    V_T_BARO,
    V_V,
    V_ZERO,
    altitude_row,
    baro_time,
    begin_step,
    down_at,
    down_axis,
    empty_row,
    forget,
    is_baro,
    remember,
    sane,
    slot_at,
    starts,
)
from server.nav.types import Float, Int

P_WEIGHT: Final = P_OWN  # w, 1/s
P_BIAS_WEIGHT: Final = P_OWN + 1  # w_bias, 1/s
S_BIAS: Final = V_OWN  # (3) accelerometer bias, body, m/s²
S_CORR: Final = V_OWN + 3  # S3's corr_baro: what the newest baro height wants of the height, m down
S_INTERVAL: Final = V_OWN + 4  # between the last two baro heights, s

MOST_OF_AN_INTERVAL: Final = 0.5
"""A correction held from one baro height to the next may make up this share of it: above 1 it would overshoot."""

PARAMETERS: Final = (
    *ZERO_PARAMETERS,
    Parameter(
        name="baro_weight_per_s", unit="1/s", default=0.5, minimum=0.01, maximum=10.0,
        meaning="Weight w of the barometer against the accelerometer; larger follows the barometer faster.",
    ),
    Parameter(
        name="accel_bias_weight_per_s", unit="1/s", default=0.05, minimum=0.0, maximum=1.0,
        meaning="How fast the accelerometer's bias is learned; keep it well under the barometer's weight.",
    ),
)  # fmt: skip
"""Defaults: INAV_W_Z_BARO and INAV_W_ACC_BIAS of the firmware that S3 describes."""


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def _predict_correct(u: Float, att: Float, s: Float, par: Float) -> None:
    """Take one step: bias, then height and speed by the acceleration, then by the barometer, in S3's order."""
    z = down_axis(u, att, par[P_IMU_DELAY])
    dt = u[U_DT]
    waited = (u[U_T] - s[V_T_BARO]) * 1e-9
    e = s[S_CORR] if waited < BARO_LOST_S else 0.0
    w = par[P_WEIGHT]
    if s[S_INTERVAL] > 0.0:
        w = min(w, MOST_OF_AN_INTERVAL / s[S_INTERVAL])
    down = s[V_G]
    for i in range(3):
        s[S_BIAS + i] -= z[i] * e * w * w * par[P_BIAS_WEIGHT] * dt
        down += z[i] * (u[U_DVEL + i] / dt - s[S_BIAS + i])
    s[V_A] = down
    s[V_D] += s[V_V] * dt + 0.5 * down * dt * dt + w * e * dt
    s[V_V] += down * dt + w * w * e * dt


@kernel("void(float64, float64, float64[::1], float64[::1], float64[:, ::1], int64[::1])")
def _compare(height_m: float, t_ns: float, s: Float, par: Float, r: Float, c: Int) -> None:
    """Set the correction from a baro height and the lane's own height at that time."""
    back = slot_at(t_ns, r, c)
    if back == 0 or t_ns <= s[V_T_BARO]:
        return
    s[S_CORR] = s[V_ZERO] - height_m - down_at(t_ns, back, r, c)
    s[S_INTERVAL] = min(BARO_LOST_S, (t_ns - s[V_T_BARO]) * 1e-9)
    s[V_T_BARO] = t_ns


@kernel(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1], int64[::1],"
    " float64[:, ::1])"
)
def run_inertial(steps: Float, meas: Float, att: Float, s: Float, par: Float, r: Float, c: Int, out: Float) -> None:
    """Advance over a block of steps; arguments as `altitude_complementary.run_complementary`."""
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        mode = begin_step(u, att[n], s, c)
        level = mode != BROKEN and math.isfinite(att[n, 0]) and u[U_DT] > 0.0
        if mode == COMPUTING:
            _predict_correct(u, att[n], s, par)
            remember(u[U_T] - par[P_IMU_DELAY] * 1e9, s, r, c)
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            m = meas[k]
            k += 1
            if mode == BROKEN or not is_baro(m):
                continue
            if s[V_RUN] == 1.0:
                _compare(m[M_DATA + 1], baro_time(m, par), s, par, r, c)
            elif starts(m[M_DATA + 1], baro_time(m, par), level, s, par):
                s[S_CORR] = 0.0
                remember(u[U_T] - par[P_IMU_DELAY] * 1e9, s, r, c)
        if mode == BROKEN or not sane(s, V_SIZE):
            forget(s, c)
            empty_row(FAILED, out[n])
            continue
        altitude_row(u[U_T], s, par, out[n])
        if s[V_RUN] == 1.0:
            for i in range(3):
                out[n, 22 + i] = s[S_BIAS + i]


class AltitudeInertial(AltitudeLane):
    """S3's second algorithm; attitude from its own `complementary`."""

    name: ClassVar[str] = "altitude_inertial"
    parameters: ClassVar[tuple[Parameter, ...]] = PARAMETERS

    def _run(self, steps: Float, meas: Float, attitude: Float, rows: Float) -> None:
        run_inertial(steps, meas, attitude, self._s, self._par, self._r, self._c, rows)

"""`altitude_complementary`: vertical acceleration integrated twice, blended with the barometer [S3, algorithm 1].

What this lane does with a baro spike: it follows, by its weight; the rate limit of S1 belongs to the preprocessing.
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
    correct_past,
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

S3_RATE_HZ: Final = 50.0
"""S3 names no rate. Taken: the 50 Hz of S0's navigation step, at which its three weights make sense."""
S3_WEIGHT: Final = 0.2
BARO_TAU_S: Final = round(-1.0 / (S3_RATE_HZ * math.log(1.0 - S3_WEIGHT)), 4)
"""(1 − 0.2) a step of 20 ms is exp(−t/τ) with this τ, 0.09 s; S3's 0.9 is 0.009 s and its 0.05 is 0.39 s."""

P_TAU: Final = P_OWN
P_VEL_TAU: Final = P_OWN + 1
P_CUTOFF: Final = P_OWN + 2
P_OFFSET_TAU: Final = P_OWN + 3
S_LOW: Final = V_OWN  # low-passed vertical acceleration, m/s² down
S_OFFSET: Final = V_OWN + 1  # its offset
S_ELAPSED: Final = V_OWN + 2  # s of offset averaged so far

PARAMETERS: Final = (
    *ZERO_PARAMETERS,
    Parameter(
        name="baro_tau_s", unit="s", default=BARO_TAU_S, minimum=0.005, maximum=20.0,
        meaning="Time in which the height comes to the barometer's; longer is smoother and trusts the accelerometer.",
    ),
    Parameter(
        name="velocity_tau_s", unit="s", default=1.0, minimum=0.05, maximum=20.0,
        meaning="Time in which the speed comes to what the barometer shows; longer is smoother, errors last longer.",
    ),
    Parameter(
        name="accel_cutoff_hz", unit="Hz", default=10.0, minimum=0.5, maximum=200.0,
        meaning="Cut-off of the low-pass on the vertical acceleration; lower takes out vibration and adds delay.",
    ),
    Parameter(
        name="offset_tau_s", unit="s", default=20.0, minimum=1.0, maximum=600.0,
        meaning="Time over which the acceleration's offset is averaged; shorter learns faster and forgets real motion.",
    ),
)  # fmt: skip


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def _predict(u: Float, att: Float, s: Float, par: Float) -> None:
    """Low-pass the vertical acceleration, update its offset, and integrate the rest twice when computing."""
    z = down_axis(u, att, par[P_IMU_DELAY])
    dt = u[U_DT]
    raw = (z[0] * u[U_DVEL] + z[1] * u[U_DVEL + 1] + z[2] * u[U_DVEL + 2]) / dt + s[V_G]
    if s[S_ELAPSED] == 0.0:
        s[S_LOW] = raw
    s[S_LOW] += (1.0 - math.exp(-2.0 * math.pi * par[P_CUTOFF] * dt)) * (raw - s[S_LOW])
    s[S_ELAPSED] = min(s[S_ELAPSED] + dt, par[P_OFFSET_TAU])  # a plain mean at first
    s[S_OFFSET] += (1.0 - math.exp(-dt / s[S_ELAPSED])) * (s[S_LOW] - s[S_OFFSET])
    if s[V_RUN] == 1.0:
        s[V_A] = s[S_LOW] - s[S_OFFSET]
        s[V_D] += s[V_V] * dt + 0.5 * s[V_A] * dt * dt
        s[V_V] += s[V_A] * dt


@kernel("void(float64, float64, float64[::1], float64[::1], float64[:, ::1], int64[::1])")
def _blend(height_m: float, t_ns: float, s: Float, par: Float, r: Float, c: Int) -> None:
    """Blend a baro height of time t_ns in: weight 1 − exp(−T/τ) for the interval T since the last one.

    The speed takes the same share of what the height lacked, per velocity time constant.
    """
    back = slot_at(t_ns, r, c)
    interval = (t_ns - s[V_T_BARO]) * 1e-9
    if back == 0 or interval <= 0.0:
        return
    error = s[V_ZERO] - height_m - down_at(t_ns, back, r, c)
    dd = (1.0 - math.exp(-interval / par[P_TAU])) * error
    dv = dd / par[P_VEL_TAU]
    newest = (c[0] - 1) % r.shape[0]
    s[V_D] += dd + dv * (r[newest, 0] - t_ns) * 1e-9
    s[V_V] += dv
    correct_past(t_ns, back, dd, dv, r, c)
    s[V_T_BARO] = t_ns


@kernel(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1], int64[::1],"
    " float64[:, ::1])"
)
def run_complementary(
    steps: Float, meas: Float, att: Float, s: Float, par: Float, r: Float, c: Int, out: Float
) -> None:
    """Advance over a block of steps.

    Args:
        steps: shape (n, U_SIZE). meas: shape (k, M_SIZE), M_STEP ascending.
        att: shape (n, len(LANE_COLUMNS)), the attitude lane's rows.
        s, par, r, c: memory, parameters and past, `vertical`.
        out: shape (n, len(LANE_COLUMNS)), written.
    """
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        mode = begin_step(u, att[n], s, c)
        level = mode != BROKEN and math.isfinite(att[n, 0]) and u[U_DT] > 0.0
        if level:
            _predict(u, att[n], s, par)
            if mode == COMPUTING:
                remember(u[U_T] - par[P_IMU_DELAY] * 1e9, s, r, c)
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            m = meas[k]
            k += 1
            if mode == BROKEN or not is_baro(m):
                continue
            if s[V_RUN] == 1.0:
                _blend(m[M_DATA + 1], baro_time(m, par), s, par, r, c)
            elif starts(m[M_DATA + 1], baro_time(m, par), level, s, par):
                remember(u[U_T] - par[P_IMU_DELAY] * 1e9, s, r, c)
        if mode == BROKEN or not sane(s, V_SIZE):
            forget(s, c)
            empty_row(FAILED, out[n])
            continue
        altitude_row(u[U_T], s, par, out[n])
        if s[V_RUN] == 1.0:
            z = down_axis(u, att[n], par[P_IMU_DELAY])
            for i in range(3):
                out[n, 22 + i] = z[i] * s[S_OFFSET]


class AltitudeComplementary(AltitudeLane):
    """S3's first algorithm; attitude from its own `complementary`."""

    name: ClassVar[str] = "altitude_complementary"
    parameters: ClassVar[tuple[Parameter, ...]] = PARAMETERS

    def _run(self, steps: Float, meas: Float, attitude: Float, rows: Float) -> None:
        run_complementary(steps, meas, attitude, self._s, self._par, self._r, self._c, rows)

"""`nav_position`: late, slow, noisy GNSS made smooth by acceleration and barometer, in a given attitude [S1 §3.4].

The stored text of S1 ends before its equations, so these are ours: one four-state filter an axis (`axis_filter`) on
the acceleration that the attitude of an own `ahrs_fixed_gain` turns into NED. A GNSS fix is compared with the state at
its own time, and what that finds corrects the states since. A fix or baro height outside the gate is refused; one that
stays there for `reaccept_s` is accepted.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from server.nav.constants import STANDARD_GRAVITY_M_S2
from server.nav.ekf.defaults import BARO_DRIFT_M_RTS, GNSS_CORRELATION
from server.nav.ekf.layout import NEVER_NS
from server.nav.lanes.ahrs_fixed_gain import AhrsFixedGain
from server.nav.lanes.altitude_base import HISTORY_S, own_defaults
from server.nav.lanes.axis_filter import N
from server.nav.lanes.base import LaneContext, LaneResult, Parameter, Provides
from server.nav.lanes.nav_position_layout import (
    F_BARO,
    F_GRAVITY,
    F_INTERVAL,
    F_SITE,
    F_SIZE,
    F_T_GNSS,
    G_BARO_DELAY,
    G_CORRELATION,
    G_DRIFT,
    G_GNSS_DELAY,
    G_IMU_DELAY,
    G_LEVER,
    G_OWN,
    G_SIZE,
    H_SIZE,
)
from server.nav.lanes.nav_position_run import run_position
from server.nav.types import LANE_COLUMNS, Float, Int, LaneRows, Site

PARAMETERS: Final = (
    Parameter(
        name="accel_noise_m_s2_rthz", unit="m/s²/√Hz", default=0.03, minimum=1e-4, maximum=10.0,
        meaning="Noise density of the acceleration, vibration included; larger trusts GNSS more.",
    ),
    Parameter(
        name="accel_error_m_s2", unit="m/s²", default=0.3, minimum=1e-3, maximum=5.0,
        meaning="Size of the horizontal acceleration error that a wrong tilt leaves: 0.17 for one degree.",
    ),
    Parameter(
        name="accel_error_tau_s", unit="s", default=30.0, minimum=0.1, maximum=1000.0,
        meaning="Time over which that error stays alike.",
    ),
    Parameter(
        name="accel_error_down_m_s2", unit="m/s²", default=0.1, minimum=1e-3, maximum=5.0,
        meaning="Size of the vertical acceleration error: the accelerometer's bias and scale.",
    ),
    Parameter(
        name="gnss_position_m", unit="m", default=math.nan, minimum=0.001, maximum=100.0,
        meaning="Horizontal position error of the receiver; unset takes its own word.",
    ),
    Parameter(
        name="gnss_height_m", unit="m", default=math.nan, minimum=0.001, maximum=100.0,
        meaning="Height error of the receiver; unset takes its own word.",
    ),
    Parameter(
        name="gnss_velocity_m_s", unit="m/s", default=math.nan, minimum=0.001, maximum=50.0,
        meaning="Velocity error of the receiver; unset takes its own word, but not under 0.03 m/s.",
    ),
    Parameter(
        name="baro_noise_m", unit="m", default=0.2, minimum=0.01, maximum=50.0,
        meaning="Noise of a baro height; larger trusts it less.",
    ),
    Parameter(
        name="gate_sigma", unit="", default=5.0, minimum=2.0, maximum=100.0,
        meaning="A measurement further from its prediction than this many standard deviations is refused.",
    ),
    Parameter(
        name="reaccept_s", unit="s", default=5.0, minimum=0.1, maximum=60.0,
        meaning="So long after the last one that was taken, three refused in a row are right: start again from them.",
    ),
)  # fmt: skip


class NavPosition:
    """S1's integrated navigation; attitude from its own `ahrs_fixed_gain`."""

    name: ClassVar[str] = "nav_position"
    provides: ClassVar[Provides] = "full"
    parameters: ClassVar[tuple[Parameter, ...]] = PARAMETERS

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        self._attitude = AhrsFixedGain(own_defaults(context, AhrsFixedGain.parameters))
        self._x, self._P, self._f = np.zeros((3, N)), np.zeros((3, N, N)), np.zeros(F_SIZE)
        for index in (F_T_GNSS, F_BARO):
            self._f[index] = NEVER_NS
        self._f[F_GRAVITY], self._f[F_INTERVAL] = STANDARD_GRAVITY_M_S2, 1.0
        self._f[F_SITE : F_SITE + 3] = math.nan
        slots = max(16, math.ceil(HISTORY_S * context.settings.nav_rate_hz))
        self._r, self._c = np.zeros((slots, H_SIZE)), np.zeros(2, dtype=np.int64)
        self._w = np.zeros(9)
        self._par = self._kernel_parameters(context)

    def _kernel_parameters(self, context: LaneContext) -> Float:
        par = np.zeros(G_SIZE)
        imu, _, gnss, baro = (0.0 if math.isnan(delay) else delay for delay in context.delays_s)
        par[G_IMU_DELAY], par[G_GNSS_DELAY], par[G_BARO_DELAY] = imu, gnss, baro
        par[G_LEVER : G_LEVER + 3] = context.settings.lever_arm_b_m
        par[G_CORRELATION], par[G_DRIFT] = GNSS_CORRELATION, BARO_DRIFT_M_RTS
        par[G_OWN : G_OWN + len(self.parameters)] = [context.values[one.name] for one in self.parameters]
        return par

    def configure(self, context: LaneContext) -> None:
        """Take other parameters or delays from the next step on; the state stays."""
        self._par = self._kernel_parameters(context)
        self._attitude.configure(own_defaults(context, AhrsFixedGain.parameters))

    def set_site(self, site: Site) -> None:
        """Take the origin and its gravity; the first fix after it starts the navigation."""
        place = (math.radians(site.lat_deg), math.radians(site.lon_deg), site.alt_m)
        self._f[F_SITE : F_SITE + 3], self._f[F_GRAVITY] = place, site.gravity_m_s2
        self._attitude.set_site(site)

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance over steps and measurements; see `Lane.step`."""
        attitude = self._attitude.step(steps, meas, t_ns).rows.data
        rows = np.empty((len(steps), len(LANE_COLUMNS)))
        run_position(steps, meas, attitude, self._x, self._P, self._f, self._par, self._r, self._c, self._w, rows)
        return LaneResult(rows=LaneRows(lane=self.name, t_ns=t_ns, data=rows))

"""The thin class of the three altitude lanes: it owns the arrays and an attitude of its own, a kernel computes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from server.nav.constants import STANDARD_GRAVITY_M_S2
from server.nav.ekf.layout import NEVER_NS
from server.nav.lanes import vertical as at
from server.nav.lanes.base import LaneContext, LaneResult, Parameter, Provides
from server.nav.lanes.complementary import Complementary
from server.nav.types import LANE_COLUMNS, Float, Int, LaneRows, Site

HISTORY_S: Final = 1.0
"""Longest baro delay that is still compared with the height of its own time."""

ZERO_PARAMETERS: Final = (
    Parameter(
        name="baro_zero_samples", unit="", default=200.0, minimum=1.0, maximum=10000.0,
        meaning="Baro heights averaged into the zero at the start; more make it steadier.",
    ),
    Parameter(
        name="baro_zero_s", unit="s", default=4.0, minimum=0.1, maximum=60.0,
        meaning="Longest time the zero is averaged over, however slow the barometer is.",
    ),
)  # fmt: skip
"""S3 takes 200 samples, which at the 50 Hz of S0's navigation step are 4 s."""


def own_defaults(context: LaneContext, parameters: tuple[Parameter, ...]) -> LaneContext:
    """Return the context for a lane inside a lane: the same delays and settings, its own defaults."""
    return replace(context, values={parameter.name: parameter.default for parameter in parameters})


class AltitudeLane:
    """Height and vertical speed from accelerometer and barometer, in an attitude of its own."""

    provides: ClassVar[Provides] = "altitude"
    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        self._attitude = Complementary(own_defaults(context, Complementary.parameters))
        self._s, self._c = np.zeros(at.V_SIZE), np.zeros(2, dtype=np.int64)
        self._s[at.V_T_BARO] = self._s[at.V_T_ZERO] = NEVER_NS
        self._s[at.V_SITE], self._s[at.V_G] = math.nan, STANDARD_GRAVITY_M_S2
        slots = max(16, math.ceil(HISTORY_S * context.settings.nav_rate_hz))
        self._r = np.zeros((slots, at.R_SIZE))
        self._par = self._kernel_parameters(context)

    def _kernel_parameters(self, context: LaneContext) -> Float:
        """Return the kernel's parameter array: delays, the zero's, then the lane's own in their order."""
        par = np.zeros(at.P_SIZE)
        imu, _, _, baro = (0.0 if math.isnan(delay) else delay for delay in context.delays_s)
        par[at.P_IMU_DELAY], par[at.P_BARO_DELAY] = imu, baro
        values = [context.values[parameter.name] for parameter in self.parameters]
        par[at.P_ZERO_SAMPLES : at.P_ZERO_SAMPLES + len(values)] = values
        return par

    def configure(self, context: LaneContext) -> None:
        """Take other parameters or delays from the next step on; the state stays."""
        self._par = self._kernel_parameters(context)
        self._attitude.configure(own_defaults(context, Complementary.parameters))

    def set_site(self, site: Site) -> None:
        """Take the site's height and gravity."""
        self._s[at.V_SITE], self._s[at.V_G] = site.alt_m, site.gravity_m_s2
        self._attitude.set_site(site)

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance over steps and measurements; see `Lane.step`."""
        attitude = self._attitude.step(steps, meas, t_ns).rows.data
        rows = np.empty((len(steps), len(LANE_COLUMNS)))
        self._run(steps, meas, attitude, rows)
        return LaneResult(rows=LaneRows(lane=self.name, t_ns=t_ns, data=rows))

    def _run(self, steps: Float, meas: Float, attitude: Float, rows: Float) -> None:
        """Run the lane's kernel over steps; write rows."""
        raise NotImplementedError

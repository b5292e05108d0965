"""The thin class of the attitude lanes: it owns one state array and one of parameters, a kernel computes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar, Final

import numpy as np

from server.nav.lanes.attitude import MAGNETIC, S_DECLINATION, S_HEADING, S_STARTED, turn_n
from server.nav.lanes.base import LaneContext, LaneResult, Parameter
from server.nav.types import LANE_COLUMNS, Float, Int, LaneRows, Site

ARRAYS: Final = "void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1])"
"""Signature of a lane's kernel: (steps, meas, par, s, rows)."""


def delays_of(context: LaneContext) -> list[float]:
    """Return the delays of IMU, magnetometer and GNSS in s; unknown = 0."""
    return [0.0 if math.isnan(delay) else delay for delay in context.delays_s[:3]]


class KernelLane:
    """Owns one lane's state array and parameters; the subclass names the kernel that computes."""

    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    size: ClassVar[int]
    kernel: ClassVar[Callable[..., Any]]

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        self._s = np.zeros(self.size)
        self.configure(context)

    def configure(self, context: LaneContext) -> None:
        """Take other parameters or delays from the next step on; the state stays."""
        values = [context.values[parameter.name] for parameter in self.parameters]
        self._par = np.array(delays_of(context) + values)

    def set_site(self, site: Site) -> None:
        """Take the declination; a heading held against magnetic north turns by it at once."""
        turn_rad = site.declination_rad - float(self._s[S_DECLINATION])
        self._s[S_DECLINATION] = site.declination_rad
        if self._s[S_STARTED] and self._s[S_HEADING] == MAGNETIC:
            self._turn(turn_rad)

    def _turn(self, angle_rad: float) -> None:
        turn_n(self._s, 0.0, 0.0, angle_rad)

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance over steps and measurements; see `Lane.step`."""
        rows = np.empty((len(steps), len(LANE_COLUMNS)))
        type(self).kernel(steps, meas, self._par, self._s, rows)
        return LaneResult(rows=LaneRows(lane=self.name, t_ns=t_ns, data=rows))

"""Attitude reference of S1 §3.3: the EKF's structure, its weights fixed at their steady state.

Around each NED axis the error state is [angle, gyro bias] with the transition of S1 (3.17); gravity measures the two
tilts, the field and the motion over ground the heading. The weights solve the discrete algebraic Riccati equation once
per configuration (`fixed_gain`) and stay, but for the start (`attitude.weights`). S1's stored text stops there; how
GNSS corrects tilt and heading is this project's design (`ground_heading`). Beside a field what motion shows of the
heading weighs less by the ratio of the noises: both share one variance, K = P Hᵀ R⁻¹.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from server.nav.codes import CAR, FIXED_WING
from server.nav.lanes.ahrs_fixed_gain_run import run
from server.nav.lanes.base import LaneContext, LaneResult, Parameter, Provides
from server.nav.lanes.fixed_gain import steady_gains
from server.nav.lanes.ground_heading import HISTORY_S, O_SIZE, R_SIZE, SIZE, forget_motion
from server.nav.lanes.kernel_lane import KernelLane, delays_of
from server.nav.types import LANE_COLUMNS, Float, Int, LaneRows

ANGLES: Final = ("accel", "mag", "motion", "level")
COURSE_NOISE: Final = {CAR: 0.1, FIXED_WING: 3.0}
"""rad/√Hz. Wheels go where they point to a few degrees; an aircraft's crab angle lasts for minutes."""


class AhrsFixedGain(KernelLane):
    """Cheap enough for the smallest processor, with the accuracy of an EKF that has settled."""

    name: ClassVar[str] = "ahrs_fixed_gain"
    provides: ClassVar[Provides] = "attitude"
    size: ClassVar[int] = SIZE
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            name="gyro_noise_rad_s_rthz", unit="rad/s/√Hz", default=5e-3, minimum=1e-7, maximum=0.1,
            meaning="Gyro noise density, scale errors included; larger follows gravity, field and motion sooner.",
        ),
        Parameter(
            name="gyro_bias_walk_rad_s2_rthz", unit="rad/s²/√Hz", default=3e-5, minimum=1e-9, maximum=0.01,
            meaning="How fast the gyro bias may wander; larger learns it sooner and takes more motion for bias.",
        ),
        Parameter(
            name="accel_angle_noise_rad_rthz", unit="rad/√Hz", default=0.05, minimum=1e-3, maximum=100.0,
            meaning="Noise density of the accelerometer's tilt, accelerations included; larger trusts it less.",
        ),
        Parameter(
            name="mag_angle_noise_rad_rthz", unit="rad/√Hz", default=0.07, minimum=1e-3, maximum=100.0,
            meaning="Noise density of the magnetic heading; larger trusts it less.",
        ),
        Parameter(
            name="motion_angle_noise_rad_rthz", unit="rad/√Hz", default=0.15, minimum=1e-3, maximum=1000.0,
            meaning="Noise density of the heading that 2 m/s² of acceleration show; larger trusts it less.",
        ),
        Parameter(
            name="level_angle_noise_rad_rthz", unit="rad/√Hz", default=0.03, minimum=1e-3, maximum=100.0,
            meaning="Noise density of the tilt with GNSS accelerations taken out; larger trusts it less.",
        ),
        Parameter(
            name="course_angle_noise_rad_rthz", unit="rad/√Hz", default=math.nan, minimum=1e-3, maximum=1000.0,
            meaning="Noise density of the GNSS course as a heading; for vehicles that go where they point only.",
        ),
        Parameter(
            name="course_speed_m_s", unit="m/s", default=3.0, minimum=0.1, maximum=100.0,
            meaning="Slowest ground speed whose course is taken as heading.",
        ),
    )  # fmt: skip

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        super().__init__(context)
        self._ring = np.zeros((max(16, math.ceil(HISTORY_S * context.settings.nav_rate_hz)), R_SIZE))
        self._shown = np.zeros(O_SIZE)

    def configure(self, context: LaneContext) -> None:
        """Solve for the weights that the parameters mean; the state stays."""
        values = context.values
        gyro, walk = values["gyro_noise_rad_s_rthz"], values["gyro_bias_walk_rad_s2_rthz"]
        course = values["course_angle_noise_rad_rthz"]
        if math.isnan(course):
            course = COURSE_NOISE.get(context.vehicle, math.nan)
        dt_s = 1.0 / context.settings.nav_rate_hz
        par = delays_of(context)
        accel, mag, motion, level = (values[f"{name}_angle_noise_rad_rthz"] for name in ANGLES)
        for angle in (accel, mag, motion, course, level):
            par += [0.0, 0.0] if math.isnan(angle) else _per_second(dt_s, gyro, walk, angle)
        beside = [min(1.0, mag / motion), 0.0 if math.isnan(course) else min(1.0, mag / course)]
        self._par = np.array([*par, 0.0 if math.isnan(course) else 1.0, values["course_speed_m_s"], *beside])

    def _turn(self, angle_rad: float) -> None:
        super()._turn(angle_rad)
        forget_motion(self._s)

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance over steps and measurements; see `Lane.step`."""
        rows = np.empty((len(steps), len(LANE_COLUMNS)))
        run(steps, meas, self._par, self._s, rows, self._ring, self._shown)
        return LaneResult(rows=LaneRows(lane=self.name, t_ns=t_ns, data=rows))


def _per_second(dt_s: float, gyro: float, walk: float, angle: float) -> list[float]:
    """Return the steady weights as rates, so that steps and pauses of any length use the same."""
    K_angle, K_bias = steady_gains(dt_s, gyro, walk, angle)
    return [-math.log1p(-K_angle) / dt_s, K_bias / dt_s]

"""VQF [Laidig and Seel 2023], through its authors' library with its default parameters: the yardstick.

The library counts in samples of one period, so every navigation step is one sample: rotation vector and velocity
increment over that period, which keeps the integral exact where steps are uneven. When the steps' mean length turns
out another (an IMU slower than the navigation rate), the filter goes on with that period. Between magnetic samples
the last one is held in the local frame, turned back by the gyro, so any rate of them means the same.
"""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np
from vqf import VQF  # it ships stubs, but no py.typed

from server.nav.codes import ALIGNING, FAILED
from server.nav.ekf.layout import U_DT
from server.nav.lanes.attitude import (
    MAGNETIC,
    NO_HEADING,
    PAR_IMU,
    S_DECLINATION,
    S_HEADING,
    S_OWN,
    S_SINCE_FIELD,
    blank,
)
from server.nav.lanes.base import LaneContext, LaneResult, Parameter, Provides
from server.nav.lanes.kernel_lane import delays_of
from server.nav.lanes.vqf_steps import FIELD, HOLE, OLDEST_HELD_S, prepare, publish_all
from server.nav.types import LANE_COLUMNS, Float, Int, LaneRows, Site

WINDOW_STEPS: Final = 64  # the steps' mean length is looked at this often …
WINDOWS: Final = 8  # … and averaged over so many: real boards' spacing wanders by a quarter from one to the next
PERIOD_TOLERANCE: Final = 0.1  # the library's time constants are wrong by no more than this
PERIOD_FAR: Final = 0.5  # past this one window is enough
KEPT: Final = (
    "gyrQuat", "accQuat", "delta", "biasP", "kMagInit", "magDistDetected", "magRefNorm", "magRefDip",
    "magUndisturbedT", "magRejectT", "magCandidateNorm", "magCandidateDip", "magCandidateT",
)  # fmt: skip
"""What of the library's state does not depend on the period; its low-pass filters do, and fill again."""
EAST: Final = 0.5 * math.pi
STATUS: Final = LANE_COLUMNS.index("status")


class Vqf:
    """Owns one filter of the library; numbers go in and out by whole blocks."""

    name: ClassVar[str] = "vqf"
    provides: ClassVar[Provides] = "attitude"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            name="tau_accel_s", unit="s", default=3.0, minimum=0.05, maximum=100.0,
            meaning="Time constant of the inclination correction; larger takes less acceleration for tilt.",
        ),
        Parameter(
            name="tau_mag_s", unit="s", default=9.0, minimum=0.05, maximum=1000.0,
            meaning="Time constant of the magnetic heading correction; larger ignores short disturbances.",
        ),
        Parameter(
            name="motion_bias", unit="", default=1.0, minimum=0.0, maximum=1.0,
            meaning="Past 0.5 the gyro bias is estimated in motion, else not.",
        ),
        Parameter(
            name="rest_bias", unit="", default=1.0, minimum=0.0, maximum=1.0,
            meaning="Past 0.5 the gyro bias is estimated at rest, else not.",
        ),
        Parameter(
            name="mag_rejection", unit="", default=1.0, minimum=0.0, maximum=1.0,
            meaning="Past 0.5 a field of unusual strength or dip is ignored, else not.",
        ),
        Parameter(
            name="rest_gyro_rad_s", unit="rad/s", default=math.radians(2.0), minimum=1e-4, maximum=1.0,
            meaning="Largest change of the rate that still counts as rest; larger sees rest sooner.",
        ),
        Parameter(
            name="rest_accel_m_s2", unit="m/s²", default=0.5, minimum=1e-3, maximum=10.0,
            meaning="Largest change of the specific force that still counts as rest; larger sees rest sooner.",
        ),
    )  # fmt: skip

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        self._s = np.zeros(S_OWN)
        self._s[S_SINCE_FIELD] = 2.0 * OLDEST_HELD_S
        self._period_s = 1.0 / context.settings.nav_rate_hz
        self._lengths_s: list[float] = []  # of the steps since the mean was looked at
        self._mean_s, self._windows = math.nan, 0
        self._filter = _made(self._period_s, context)
        self.configure(context)

    def configure(self, context: LaneContext) -> None:
        """Take other parameters or delays from the next step on; the state stays."""
        self._context, self._par = context, np.array(delays_of(context))
        v = context.values
        self._filter.setTauAcc(v["tau_accel_s"])
        self._filter.setTauMag(v["tau_mag_s"])
        self._filter.setMotionBiasEstEnabled(v["motion_bias"] > 0.5)
        self._filter.setRestBiasEstEnabled(v["rest_bias"] > 0.5)
        self._filter.setMagDistRejectionEnabled(v["mag_rejection"] > 0.5)
        self._filter.setRestDetectionThresholds(math.degrees(v["rest_gyro_rad_s"]), v["rest_accel_m_s2"])

    def set_site(self, site: Site) -> None:
        """Take the declination, which turns a magnetic heading at once."""
        self._s[S_DECLINATION] = site.declination_rad

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance over steps and measurements; see `Lane.step`."""
        n = len(steps)
        rows = np.empty((n, len(LANE_COLUMNS)))
        turn, force, field, flag = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
        prepare(steps, meas, self._par, self._s, turn, force, field, flag)
        changes = [*(np.flatnonzero(np.diff(flag)) + 1).tolist(), n]
        begin = 0
        for change in changes:
            while begin < change:
                end = min(change, begin + WINDOW_STEPS - len(self._lengths_s))
                if flag[begin] >= HOLE:
                    self._restart(flag[begin] == HOLE, rows[begin:end])
                else:
                    held = field[begin:end] if flag[begin] == FIELD else None
                    self._advance(steps[begin:end], turn[begin:end], force[begin:end], held, rows[begin:end])
                begin = end
        return LaneResult(rows=LaneRows(lane=self.name, t_ns=t_ns, data=rows))

    def _restart(self, keep_bias: bool, rows: Float) -> None:
        """Start the attitude again; after a hole the bias is still good."""
        bias, sigma = self._filter.getBiasEstimate()
        self._filter.resetState()
        if keep_bias:
            self._filter.setBiasEstimate(bias, sigma)
        self._s[S_HEADING] = NO_HEADING
        self._lengths_s = []
        for row in rows:
            blank(row, ALIGNING if keep_bias else FAILED)

    def _advance(self, steps: Float, turn: Float, force: Float, field: Float | None, rows: Float) -> None:
        """Run the library over steps that are alike."""
        gyro = turn / self._period_s
        if field is not None:
            out = self._filter.updateBatch(gyro, force, field)
            self._s[S_HEADING] = MAGNETIC
            q, turn_rad = out["quat9D"], float(self._s[S_DECLINATION])
        else:  # the library's ENU angle counts the other way; an unknown heading starts at zero, where ENU says east
            out = self._filter.updateBatch(gyro, force)
            magnetic = self._s[S_HEADING] == MAGNETIC
            q, turn_rad = out["quat6D"], self._s[S_DECLINATION] - self._filter.getDelta() if magnetic else -EAST
        publish_all(steps, q, out["bias"], self._par[PAR_IMU], turn_rad, rows)
        if (rows[:, STATUS] == FAILED).any():
            self._restart(False, rows)
            return
        self._lengths_s += steps[:, U_DT].tolist()
        if len(self._lengths_s) == WINDOW_STEPS:
            self._check_period()

    def _check_period(self) -> None:
        """Go on with another period when the steps' mean length, less the longest (a hole), is another."""
        window_s = (sum(self._lengths_s) - max(self._lengths_s)) / (WINDOW_STEPS - 1)
        self._lengths_s = []
        self._windows += 1
        first = self._windows == 1 or abs(window_s / self._mean_s - 1.0) > PERIOD_FAR
        self._mean_s = window_s if first else self._mean_s + (window_s - self._mean_s) / min(self._windows, WINDOWS)
        off = abs(self._mean_s / self._period_s - 1.0)
        if off > PERIOD_FAR or (off > PERIOD_TOLERANCE and self._windows >= WINDOWS):
            self._go_on_with(self._mean_s)

    def _go_on_with(self, mean_s: float) -> None:
        """Hand the state to a filter of another period."""
        before = self._filter.state
        self._filter = _made(mean_s, self._context)
        kept = {name: before[name] for name in KEPT}
        bias = (np.asarray(before["bias"]) * self._period_s / mean_s).tolist()
        self._filter.state = {**self._filter.state, **kept, "bias": bias}
        self._period_s, self._windows = mean_s, 0


def _made(period_s: float, context: LaneContext) -> VQF:
    """Return a filter of the library; what `configure` cannot set without its memory is set here."""
    v = context.values
    return VQF(
        period_s,
        tauAcc=v["tau_accel_s"],
        tauMag=v["tau_mag_s"],
        motionBiasEstEnabled=v["motion_bias"] > 0.5,
        restBiasEstEnabled=v["rest_bias"] > 0.5,
        magDistRejectionEnabled=v["mag_rejection"] > 0.5,
        restThGyr=math.degrees(v["rest_gyro_rad_s"]),
        restThAcc=v["rest_accel_m_s2"],
    )

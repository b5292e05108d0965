"""The main lane without GNSS: the 9-axis attitude filter fills the rows that the navigation filter cannot.

It runs only while there is no position and costs nothing afterwards. Its heading is magnetic; once the site is known
the declination is added.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.ekf.attitude.block import run_block
from server.nav.ekf.attitude.layout import (
    H_NONE,
    O_ATT_SIGMA,
    O_GYRO_BIAS,
    O_HEADING,
    O_Q,
    O_SIZE,
    S_GRAVITY,
    S_STARTED,
    new_memory,
)
from server.nav.ekf.attitude.parameters import K_IMU_DELAY, default_parameters
from server.nav.ekf.attitude.start import set_field
from server.nav.ekf.layout import M_STEP, U_T
from server.nav.lanes.base import LaneContext
from server.nav.types import LANE_COLUMNS, Float, LaneStatus, Site

HEADING_WAIT_NS: Final = 1e9  # then the board has no magnetometer, and the attitude is shown with any heading
STATUS: Final = LANE_COLUMNS.index("status")
SIGMA: Final = LANE_COLUMNS.index("sigma_att_x_rad")
BIAS: Final = LANE_COLUMNS.index("gyro_bias_x_rad_s")


class AttitudeMode:
    """Owns the attitude filter's memory."""

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        self._s = new_memory()
        self._half_declination_rad = 0.0
        self._running = True
        self._t_first_ns = math.nan
        self._last = np.full(4, np.nan)
        self.configure(context)

    def configure(self, context: LaneContext) -> None:
        """Take other delays from the next step on; an unknown delay of the IMU is that of its own low-pass."""
        imu_s, mag_s = context.delays_s[:2]
        self._par = default_parameters()
        if not math.isnan(imu_s):
            self._par[K_IMU_DELAY] = imu_s
        self._mag_delay_s = 0.0 if math.isnan(mag_s) else mag_s

    @property
    def memory(self) -> Float:
        """The filter's memory, `ekf.attitude.layout`, for a change of calibration to be carried over."""
        return self._s

    def set_site(self, site: Site) -> None:
        """Take gravity, the declination, and the usual strength and dip of the field."""
        self._s[S_GRAVITY] = site.gravity_m_s2
        self._half_declination_rad = 0.5 * site.declination_rad
        if site.field_n_gauss:
            north, east, down = site.field_n_gauss
            level = math.hypot(north, east)
            set_field(self._s, math.hypot(level, down), math.atan2(down, level))

    def fill(self, steps: Float, meas: Float, rows: Float) -> tuple[int, float] | None:
        """Fill the rows of a block that have no position; return where GNSS took over and by what angle it differs.

        Args:
            steps, meas: as `Lane.step` takes them.
            rows: shape (n, len(LANE_COLUMNS)), of the navigation filter; attitude, σ and gyro bias are replaced.
        """
        status = rows[:, STATUS]
        without = (status == LaneStatus.ALIGNING) | (status == LaneStatus.ATTITUDE)
        found = None
        edges = np.flatnonzero(np.diff(without)) + 1
        for begin, end in zip((0, *edges.tolist()), (*edges.tolist(), len(rows)), strict=True):
            if without[begin]:
                self._fill_some(steps, meas, rows, begin, end)
            elif self._running:
                self._running = False
                found = (begin, _angle(self._last, rows[begin, :4]))
        return found

    def _fill_some(self, steps: Float, meas: Float, rows: Float, begin: int, end: int) -> None:
        if not self._running:  # what it knew of the attitude is old
            self._s[S_STARTED], self._running, self._t_first_ns = 0.0, True, math.nan
        first, last = np.searchsorted(meas[:, M_STEP], (begin, end))
        own = meas[first:last]
        if begin:
            own = own.copy()
            own[:, M_STEP] -= begin
        out = np.empty((end - begin, O_SIZE))
        run_block(steps[begin:end], np.ascontiguousarray(own), self._mag_delay_s, self._s, self._par, out)
        c, s = math.cos(self._half_declination_rad), math.sin(self._half_declination_rad)
        w, x, y, z = out[:, O_Q : O_Q + 4].T
        q = np.stack((c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w), axis=1)
        part = rows[begin:end]
        part[:, :4] = np.where(q[:, :1] < 0.0, -q, q)
        part[:, SIGMA : SIGMA + 3] = out[:, O_ATT_SIGMA : O_ATT_SIGMA + 3]
        part[:, BIAS : BIAS + 3] = out[:, O_GYRO_BIAS : O_GYRO_BIAS + 3]
        t_ns = steps[begin:end, U_T]
        if math.isnan(self._t_first_ns):
            self._t_first_ns = float(t_ns[0])
        blind = (out[:, O_HEADING] == H_NONE) & (t_ns - self._t_first_ns < HEADING_WAIT_NS)
        known = np.isfinite(q[:, 0]) & ~blind
        part[blind] = np.nan
        part[:, STATUS] = np.where(known, LaneStatus.ATTITUDE, LaneStatus.ALIGNING)
        self._last = part[-1, :4].copy()


def _angle(a: Float, b: Float) -> float:
    """Return the angle between two attitudes, rad; NaN when one is unknown."""
    return 2.0 * math.acos(min(1.0, abs(float(a @ b)))) if np.isfinite(a).all() else math.nan

"""Learning the magnetometer's offset in flight, as the engine runs it: *run* and *apply* are separate switches."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.calibration.mag_learning import MagLearner, MagLearnState
from server.nav.codes import MAG
from server.nav.ekf import layout as at
from server.nav.types import Byte, Float, Int, Kind

APPLY_EVERY_NS: Final = 1_000_000_000
MOST_GAUSS: Final = 0.02
"""Largest move of the offset in use per second: 3° of heading in a horizontal field of 0.4 gauss, not a jump."""
LEAST_GAUSS: Final = 0.001
"""Smaller moves are not worth it."""


class FieldLearning:
    """Owns the learner and its two switches, which outlive a reboot of the board; what was learned does not."""

    def __init__(self) -> None:
        self.run = self.apply = False
        self._learner: MagLearner | None = None
        self._second = -1

    def restart(self) -> None:
        """Forget what was learned: the board has started again."""
        self._learner, self._second = None, -1

    def choose(self, run: bool, apply: bool) -> None:
        """Set the switches; what runs again starts from nothing."""
        if not run:
            self._learner = None
        self.run, self.apply = run, apply

    def take(self, steps: Float, meas: Float, learned_gauss: Float, t0_ns: int, mag_delay_s: float) -> None:
        """Let the learner see the calibrated field without what is taken off already.

        Args:
            steps: shape (n, U_SIZE). meas: shape (k, M_SIZE), as the lanes get them.
            learned_gauss: shape (3,), taken off the field in meas.
            t0_ns: board time that the steps count from. mag_delay_s: as told; NaN = unknown.
        """
        if self._learner is None:
            self._learner = MagLearner(t0_ns=t0_ns, mag_delay_s=mag_delay_s)
        self._learner.set_mag_delay(mag_delay_s)
        if learned_gauss.any():
            meas = meas.copy()
            meas[meas[:, at.M_KIND] == MAG, at.M_DATA : at.M_DATA + 3] += learned_gauss
        self._learner.step(steps, meas)

    def state(self) -> MagLearnState | None:
        """Return what has been learned; None when it does not run or has seen nothing."""
        return self._learner.state() if self._learner is not None else None

    def moved(self, present_gauss: Float) -> Float | None:
        """Return the offset to take off from now on, shape (3,); None when it stays.

        Only a converged offset is used, and it is approached by at most `MOST_GAUSS` at a time; switched off, the way
        back is as gentle.
        """
        target = np.zeros(3)
        if self.run and self.apply:
            state = self.state()
            if state is None or not state.converged:
                return None
            target = state.offset_gauss
        way = target - present_gauss
        length = math.sqrt(float(way @ way))
        if length == 0.0 or (length < LEAST_GAUSS and target.any()):
            return None
        return np.asarray(target if length <= MOST_GAUSS else present_gauss + way * (MOST_GAUSS / length))

    def cuts(self, kind: Byte, t_ns: Int) -> list[int]:
        """Return the samples before which the offset may move: the first of the IMU in each second of board time.

        They depend on the board's stamps only, so the result does not depend on how samples come in blocks.
        """
        imu = np.flatnonzero(kind == Kind.IMU)
        seconds = np.maximum.accumulate(np.append(self._second, t_ns[imu] // APPLY_EVERY_NS))
        if len(imu):
            self._second = int(seconds[-1])
        found: list[int] = imu[np.diff(seconds) > 0].tolist()
        return found

"""Preprocessing of one board as an object: memory, counters and chain of the kernels, their results as tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from server.nav.calibration.applied import Calibration
from server.nav.ekf import layout as cols
from server.nav.preprocess import chain_layout as at
from server.nav.preprocess import memory as acc
from server.nav.preprocess.accumulate import NO_STAGES, condition
from server.nav.preprocess.chain import Chain
from server.nav.preprocess.rebase import Rebase, move_measurements, move_open_step
from server.nav.types import STAGE_COLUMNS, Byte, Float, Int, SampleBlock, StageRows, ToldDelay

CARRIED_ROWS: Final = 2048
DELAYS: Final = (("imu", at.GYRO), ("mag", at.MAG), ("baro", at.BARO), ("airspeed", at.AIRSPEED))


class Conditioned(NamedTuple):
    """What one run of samples gave.

    Attributes:
        end: number of the first sample that was not consumed.
        steps: shape (n, U_SIZE). meas: shape (k, M_SIZE), those of these steps.
        seen: shape (j, M_SIZE), all measurements of these samples.
        stages: the sensors whose chain is on.
    """

    end: int
    steps: Float
    meas: Float
    seen: Float
    stages: tuple[StageRows, ...]


class Conditioning:
    """Owns what the preprocessing remembers. Settings outlive a reboot of the board."""

    def __init__(self, chain: Mapping[str, Mapping[str, float]], calibration: Calibration | None) -> None:
        """Start before the first sample.

        Raises:
            ValueError: a sensor or parameter that does not exist, or a value outside its limits.
        """
        self.chain = Chain(chain, calibration or Calibration())
        self.restart()

    def restart(self) -> None:
        """Forget everything that belongs to one power-up."""
        self.memory, self.counters = acc.new_memory()
        self.chain.restart()
        self._carried = np.empty((0, cols.M_SIZE))

    def run(self, block: SampleBlock, begin: int, end: int, t0_ns: int, rate_hz: float) -> Conditioned:
        """Consume samples [begin, end), or fewer when the IMU's filters have just changed their delay."""
        n = end - begin
        kind, t_ns, data = block.kind[begin:end], block.t_ns[begin:end], block.data[begin:end]
        steps, meas = np.empty((n, cols.U_SIZE)), np.empty((n, cols.M_SIZE))
        stages = np.zeros((n, at.G_SIZE)) if self.chain.is_on else NO_STAGES
        c = self.chain.array
        used, n_steps, n_meas = condition(
            kind, t_ns, data, t0_ns, rate_hz, self.memory, self.counters, c, steps, meas, stages
        )
        steps, seen = steps[:n_steps], meas[:n_meas]
        rows = self._stage_rows(kind, t_ns, stages) if self.chain.is_on else ()
        return Conditioned(begin + used, steps, self._due(seen, n_steps), seen, rows)

    def _due(self, meas: Float, n_steps: int) -> Float:
        """Return the measurements whose step has ended; the rest waits for a step that is still open."""
        if len(self._carried):
            meas = np.concatenate((self._carried, meas))
        ready = int(np.searchsorted(meas[:, cols.M_STEP], n_steps))
        self._carried = meas[ready:].copy()
        self._carried[:, cols.M_STEP] = 0.0
        if len(self._carried) > 2 * CARRIED_ROWS:  # no IMU: older ones would be stale anyway
            self._carried = self._carried[-CARRIED_ROWS:]
        return np.ascontiguousarray(meas[:ready])

    def _stage_rows(self, kind: Byte, t_ns: Int, stages: Float) -> tuple[StageRows, ...]:
        used = stages[:, at.G_USED] > 0.0
        found = []
        for sensor, name in enumerate(at.SENSORS):
            if not self.chain.on(sensor):
                continue
            rows = np.flatnonzero(used & (kind == at.KIND_OF[sensor]))
            if len(rows):
                found.append(StageRows(sensor=name, t_ns=t_ns[rows], data=stages[rows[:, None], _places(sensor)]))
        return tuple(found)

    def take_changed(self) -> bool:
        """Return whether the delay of the IMU's filters has changed since it was asked last."""
        if not self.chain.is_on:
            return False
        changed = bool(self.chain.array[at.K_CHANGED])
        self.chain.array[at.K_CHANGED] = 0.0
        return changed

    def calibrate(self, calibration: Calibration) -> Rebase:
        """Put a calibration in force from the next sample on; what is under way is carried over."""
        return self._carry_over(self.chain.apply(calibration, float(self.memory[acc.S_TEMPERATURE])))

    def learn(self, offset_gauss: Float) -> Rebase:
        """Take another magnetic offset off from the next sample on, shape (3,), calibrated body frame."""
        return self._carry_over(self.chain.learn(offset_gauss))

    def _carry_over(self, change: Rebase) -> Rebase:
        move_open_step(self.memory, change)
        move_measurements(self._carried, change)
        return change

    def set_chain(self, sensor: str, values: Mapping[str, float]) -> bool:
        """Change parameters; return whether the unit or the axes of the sensor are others now.

        Raises:
            ValueError: unknown sensor or parameter, or a value outside its limits; nothing is changed then.
        """
        turned = self.chain.set(sensor, values)
        if turned and sensor == "mag":
            self.memory[acc.S_MAG_SCALE] = self.memory[acc.S_MAG_BAD] = self.memory[acc.S_MAG_GOOD] = 0.0
        return turned

    def delays(self) -> tuple[ToldDelay, ...]:
        """Return what the filters delay, those that do."""
        found = ((name, self.imu_delay_s if name == "imu" else self.chain.delay_s(one)) for name, one in DELAYS)
        return tuple(ToldDelay(name=name, delay_s=delay, source="filter") for name, delay in found if delay > 0.0)

    @property
    def imu_delay_s(self) -> float:
        """Delay of the IMU's filters."""
        return self.chain.imu_delay_s


def _places(sensor: int) -> list[int]:
    """Return where a sensor's columns of `STAGE_COLUMNS` stand in a row of stages."""
    first = at.G_SECOND if sensor == at.ACCEL else at.G_FIRST
    if at.CHANNELS[sensor] == 3:
        return list(range(first, first + 9))
    places = [first, first + 3, first + 6, first + 1]  # the airspeed stands beside its calibrated pressure
    return places[: len(STAGE_COLUMNS[at.SENSORS[sensor]])]

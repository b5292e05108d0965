"""The chain as the engine holds it: what is asked of each sensor, the calibration in force, and the kernels' array."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from server.nav.calibration.applied import CAL_SIZE, Calibration
from server.nav.preprocess import chain_layout as at
from server.nav.preprocess.chain_calibration import check_calibration, move_states
from server.nav.preprocess.chain_parameters import AXES, CHAIN_PARAMETERS, ChainInfo, chain_defaults, check_chain
from server.nav.preprocess.chain_run import align_imu, retime
from server.nav.preprocess.clipping import ACCEL_LEAST_M_S2, GYRO_LEAST_RAD_S
from server.nav.preprocess.rebase import Rebase, rebase_between
from server.nav.preprocess.units import mounting_matrix
from server.nav.types import Float, Kind

_CAL_OF: Final = {
    at.GYRO: (*range(12), 36, 37, 38),
    at.ACCEL: (*range(12, 24), 39, 40, 41),
    at.MAG: tuple(range(24, 36)),
    at.BARO: (44,),
    at.AIRSPEED: (43,),
}
"""Sensor → its places in `Calibration.flat()`."""
_NEUTRAL: Final = Calibration().flat()


class Chain:
    """Owns the kernels' array. What was set outlives a reboot of the board; the filters' states do not.

    Attributes:
        calibration: in force. array: shape (K_SIZE,), `chain_layout`.
        is_on: any sensor's samples go through the chain. has_learned: a learned magnetic offset is taken off.
    """

    def __init__(self, values: Mapping[str, Mapping[str, float]], calibration: Calibration) -> None:
        """Start before the first sample.

        Raises:
            ValueError: a sensor or parameter that does not exist, or a value outside its limits.
        """
        for sensor, own in values.items():
            check_chain(sensor, own)
        self._values = {sensor: chain_defaults(sensor) | dict(values.get(sensor, {})) for sensor in at.SENSORS}
        check_calibration(calibration)
        self.calibration = calibration
        self.array = np.zeros(at.K_SIZE)
        self.is_on = self.has_learned = False  # asked at every call of the engine
        self.restart()

    def restart(self) -> None:
        """Forget all states: the board has started again."""
        self.array[:] = 0.0
        self.array[at.K_CAL : at.K_CAL + CAL_SIZE] = self.calibration.flat()
        for sensor in range(len(at.SENSORS)):
            self._write(sensor)
            retime(self.array, sensor)
        self._switch()

    def _write(self, sensor: int) -> None:
        """Write what is asked of one sensor; its states stay as they are."""
        name, b, c = at.SENSORS[sensor], at.block_at(sensor), self.array
        values = self._values[name]
        mount = np.eye(3)
        if sensor <= at.MAG:
            zero = [values[f"zero_{axis}_counts"] for axis in AXES]
            scale = next(value for key, value in values.items() if key.endswith("_per_count"))
            mount = mounting_matrix(values["roll_deg"], values["pitch_deg"], values["yaw_deg"])
        else:
            zero, scale = [values["zero_counts"], 0.0, 0.0], values["pa_per_count"]
        counts = any(zero) or scale != 1.0
        c[b + at.B_UNITS] = 2.0 if counts else float(not np.array_equal(mount, np.eye(3)))
        c[b + at.B_ZERO : b + at.B_ZERO + 3], c[b + at.B_SCALE] = zero, scale
        c[b + at.B_MOUNT : b + at.B_MOUNT + 9] = mount.ravel()
        c[b + at.B_LIMIT] = next(
            value for key, value in values.items() if key.startswith("limit_") and key != "limit_count"
        )
        c[b + at.B_LIMIT_COUNT], c[b + at.B_ORDER] = values["limit_count"], values["butterworth_order"]
        c[b + at.B_CUTOFF], c[b + at.B_LOWPASS] = values["butterworth_hz"], values["lowpass_hz"]
        c[b + at.B_WINDOW] = values["window_samples"]
        c[b + at.B_FULL_SCALE] = next(value for key, value in values.items() if key.startswith("full_scale_"))
        if sensor <= at.ACCEL:
            least = GYRO_LEAST_RAD_S if sensor == at.GYRO else ACCEL_LEAST_M_S2
            full = (1.0 - at.FULL_SCALE_TOLERANCE) * c[b + at.B_FULL_SCALE]
            c[at.K_CLIP_GYRO + sensor] = full if full > 0.0 else least
        c[b + at.B_CONVERT] = values.get("convert", 0.0)

    def _switch(self) -> None:
        """Send a sensor's samples through the chain where that would change anything."""
        c = self.array
        for sensor in range(len(at.SENSORS)):
            b = at.block_at(sensor)
            asked = (
                c[b + at.B_UNITS] + c[b + at.B_LIMIT] + c[b + at.B_CUTOFF] + c[b + at.B_LOWPASS] + c[b + at.B_CONVERT]
            )
            asked += c[b + at.B_WINDOW] - 1.0 + c[b + at.B_LAG]
            if sensor in {at.MAG, at.BARO, at.AIRSPEED}:
                asked += c[b + at.B_FULL_SCALE]
            places = list(_CAL_OF[sensor])
            changed = not np.array_equal(c[at.K_CAL : at.K_CAL + CAL_SIZE][places], _NEUTRAL[places])
            learned = sensor == at.MAG and bool(c[at.K_LEARNED : at.K_LEARNED + 3].any())
            self._turn(sensor, asked > 0.0 or changed or learned)
        either = self.on(at.GYRO) or self.on(at.ACCEL)  # one row, one way
        self._turn(at.GYRO, either)
        self._turn(at.ACCEL, either)
        self.is_on = bool(c[at.K_ON : at.K_ON + len(at.SENSORS)].any())
        self.has_learned = bool(c[at.K_LEARNED : at.K_LEARNED + 3].any())

    def _turn(self, sensor: int, on: bool) -> None:
        """Switch one sensor; what its filters remember of long ago is forgotten."""
        if on and not self.on(sensor):
            self.array[at.block_at(sensor) + at.B_FILLED] = 0.0
        self.array[at.K_ON + sensor] = float(on)

    def set(self, sensor: str, values: Mapping[str, float]) -> bool:
        """Change parameters of one sensor from the next sample on; its filters start anew.

        Returns:
            Whether its unit or its axes are others now.

        Raises:
            ValueError: unknown sensor or parameter, or a value outside its limits; nothing is changed then.
        """
        check_chain(sensor, values)
        self._values[sensor] |= dict(values)
        number = at.SENSORS.index(sensor)
        b = at.block_at(number)
        before = self.array[b + at.B_UNITS : b + at.B_LIMIT].copy()
        self._write(number)
        both = (at.GYRO, at.ACCEL) if number <= at.ACCEL else (number,)
        for one in both:
            self.array[at.block_at(one) + at.B_FILLED] = 0.0
            retime(self.array, one)
        if number <= at.ACCEL:
            align_imu(self.array)
        self._switch()
        return not np.array_equal(before, self.array[b + at.B_UNITS : b + at.B_LIMIT])

    def apply(self, calibration: Calibration, temperature_degc: float) -> Rebase:
        """Put another calibration in force from the next sample on; return what it does to calibrated values.

        Args:
            calibration: the new one.
            temperature_degc: of the IMU now; NaN unknown.

        Raises:
            ValueError: a number that is none, or a matrix that cannot be inverted; nothing is changed then.
        """
        check_calibration(calibration)
        learned, kept = self.learned_gauss, self.learned_gauss
        old = self.calibration
        if not (
            np.array_equal(old.mag_matrix, calibration.mag_matrix)
            and np.array_equal(old.mag_offset, calibration.mag_offset)
            and np.array_equal(old.level, calibration.level)
        ):
            kept = np.zeros(3)  # what was learned was learned on top of the old one
        change = rebase_between(old, calibration, learned, kept, temperature_degc)
        self.calibration = calibration
        self.array[at.K_LEARNED : at.K_LEARNED + 3] = kept
        self.array[at.K_CAL : at.K_CAL + CAL_SIZE] = calibration.flat()
        self._moved(change)
        return change

    def learn(self, offset_gauss: Float) -> Rebase:
        """Take off another magnetic offset, calibrated body frame, shape (3,), from the next sample on."""
        before = self.array[at.K_LEARNED : at.K_LEARNED + 3].copy()
        change = rebase_between(self.calibration, self.calibration, before, offset_gauss, float("nan"))
        self.array[at.K_LEARNED : at.K_LEARNED + 3] = offset_gauss
        self._moved(change)
        return change

    def _moved(self, change: Rebase) -> None:
        """Carry the filters' states over, so that they go on as if the new calibration had always been there."""
        for sensor, (A, d) in change.by_sensor().items():
            move_states(self.array, sensor, A, d)
        self._switch()

    def converted(self, kind: Kind, rows: Float) -> Float:
        """Return raw rows, shape (n, ROW_WIDTH), in SI and body axes: what calibrations are made of.

        A copy where counts or a mounting are set, else the rows themselves.
        """
        sensors = [sensor for sensor, of in enumerate(at.KIND_OF) if of == kind]
        if not any(self.array[at.block_at(sensor) + at.B_UNITS] for sensor in sensors):
            return rows
        out = rows.copy()
        for sensor in sensors:
            b, first = at.block_at(sensor), 3 if sensor == at.ACCEL else 0
            n = at.CHANNELS[sensor]
            block = self.array[b : b + at.B_LIMIT]
            values = block[at.B_SCALE] * (rows[:, first : first + n] - block[at.B_ZERO : at.B_ZERO + n])
            mount = block[at.B_MOUNT : at.B_MOUNT + 9].reshape(3, 3)
            out[:, first : first + n] = values @ mount.T if n == 3 else values
            if n == 1 and block[at.B_UNITS] > 0.0:
                out[:, 1] = np.nan  # follows from the pressure
        return out

    @property
    def learned_gauss(self) -> Float:
        """The magnetic offset that is taken off beside the calibration, shape (3,)."""
        return self.array[at.K_LEARNED : at.K_LEARNED + 3].copy()

    def on(self, sensor: int) -> bool:
        """Return whether this sensor's samples go through the chain."""
        return bool(self.array[at.K_ON + sensor])

    def delay_s(self, sensor: int) -> float:
        """Return what the sensor's filters delay; for the IMU's two the same to half a sample."""
        return float(self.array[at.block_at(sensor) + at.B_DELAY]) if self.on(sensor) else 0.0

    @property
    def imu_delay_s(self) -> float:
        """Delay of the IMU's filters: gyro and accelerometer wait for each other."""
        return 0.5 * (self.delay_s(at.GYRO) + self.delay_s(at.ACCEL))

    def infos(self) -> tuple[ChainInfo, ...]:
        """Return every sensor's chain with its parameters as they are set."""
        return tuple(
            ChainInfo(
                name=name,
                active=self.on(sensor),
                delay_s=self.delay_s(sensor),
                parameters=CHAIN_PARAMETERS[name],
                values=dict(self._values[name]),
            )
            for sensor, name in enumerate(at.SENSORS)
        )

"""The calibration in force: what preprocessing does to a raw sample before anything else looks at it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from server.nav.calibration.types import SENSOR_OF, CalKind, Sensor, Value
from server.nav.types import Float, Kind

# Flat layout for kernels: calibrated = matrix · (raw − offset − per_k · (T − reference)).
C_GYRO: Final = 0  # (9) row-major matrix, level included; then (3) offset
C_ACCEL: Final = 12
C_MAG: Final = 24
C_GYRO_PER_K: Final = 36  # (3) rad/s per K
C_ACCEL_PER_K: Final = 39  # (3) m/s² per K
C_REFERENCE_DEGC: Final = 42
C_DIFF_PRESSURE: Final = 43  # bias, Pa
C_BARO: Final = 44  # bias, m
CAL_SIZE: Final = 45


OFFSET_ONLY: Final = frozenset({CalKind.MAG_FIXED_HEADING, CalKind.MAG_IN_FLIGHT})


def _eye() -> Float:
    return np.eye(3)


def _zero() -> Float:
    return np.zeros(3)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """Everything in force on one board; the default changes nothing.

    Attributes:
        *_matrix: shape (3, 3), *_offset: shape (3,): calibrated = matrix · (raw − offset); rad/s, m/s², gauss.
        level: shape (3, 3), R from the board's axes to the vehicle's body FRD, after the matrices.
        gyro_per_k, accel_per_k: shape (3,), change of the offset per kelvin from `reference_degc`; used when the
            temperature is known.
        diff_pressure_bias_pa, baro_bias_m: subtracted from the reading.
    """

    gyro_matrix: Float = field(default_factory=_eye)
    gyro_offset: Float = field(default_factory=_zero)
    accel_matrix: Float = field(default_factory=_eye)
    accel_offset: Float = field(default_factory=_zero)
    mag_matrix: Float = field(default_factory=_eye)
    mag_offset: Float = field(default_factory=_zero)
    level: Float = field(default_factory=_eye)
    gyro_per_k: Float = field(default_factory=_zero)
    accel_per_k: Float = field(default_factory=_zero)
    reference_degc: float = 25.0
    diff_pressure_bias_pa: float = 0.0
    baro_bias_m: float = 0.0

    def flat(self) -> Float:
        """Return shape (CAL_SIZE,) as kernels take it."""
        out = np.zeros(CAL_SIZE)
        pairs = (
            (C_GYRO, self.gyro_matrix, self.gyro_offset),
            (C_ACCEL, self.accel_matrix, self.accel_offset),
            (C_MAG, self.mag_matrix, self.mag_offset),
        )
        for at, matrix, offset in pairs:
            out[at : at + 9] = (self.level @ matrix).ravel()
            out[at + 9 : at + 12] = offset
        out[C_GYRO_PER_K : C_GYRO_PER_K + 3], out[C_ACCEL_PER_K : C_ACCEL_PER_K + 3] = self.gyro_per_k, self.accel_per_k
        out[C_REFERENCE_DEGC] = self.reference_degc
        out[C_DIFF_PRESSURE], out[C_BARO] = self.diff_pressure_bias_pa, self.baro_bias_m
        return out

    @property
    def is_identity(self) -> bool:
        """True when it changes nothing."""
        return bool(np.array_equal(self.flat(), Calibration(reference_degc=self.reference_degc).flat()))

    def rows(self, kind: Kind, rows: Float) -> Float:
        """Return a calibrated copy of raw rows, shape (n, ROW_WIDTH); the magnetometer's must be in gauss."""
        out = rows.copy()
        if kind == Kind.IMU:
            warm_k = np.nan_to_num(rows[:, 6:7] - self.reference_degc)
            gyro = rows[:, :3] - self.gyro_offset - warm_k * self.gyro_per_k
            accel = rows[:, 3:6] - self.accel_offset - warm_k * self.accel_per_k
            out[:, :3] = gyro @ (self.level @ self.gyro_matrix).T
            out[:, 3:6] = accel @ (self.level @ self.accel_matrix).T
        elif kind == Kind.MAG:
            out[:, :3] = (rows[:, :3] - self.mag_offset) @ (self.level @ self.mag_matrix).T
        elif kind == Kind.AIRSPEED:
            out[:, 0] = rows[:, 0] - self.diff_pressure_bias_pa
        elif kind == Kind.BARO:
            out[:, 1] = rows[:, 1] - self.baro_bias_m
        return out

    def having(self, sensor: Sensor, parameters: Mapping[str, Value]) -> Calibration:
        """Return it with one sensor's parameters replaced; {} takes that sensor's calibration off.

        Args:
            sensor: whose they are.
            parameters: names and shapes as in `types.Fit.parameters`, in SI and gauss.
        """
        blank = Calibration()
        given = {name: np.asarray(value, dtype=np.float64) for name, value in parameters.items()}
        if sensor is Sensor.GYRO:
            scale = given.get("scale", np.ones(3))
            matrix = given.get("matrix", np.diag(np.broadcast_to(scale, (3,))))
            return replace(self, gyro_matrix=matrix, gyro_offset=given.get("bias", np.zeros(3)))
        if sensor is Sensor.ACCEL:
            matrix, offset = given.get("matrix", blank.accel_matrix), given.get("offset", blank.accel_offset)
            return replace(self, accel_matrix=matrix, accel_offset=offset)
        if sensor is Sensor.MAG:
            matrix, offset = given.get("matrix", blank.mag_matrix), given.get("offset", blank.mag_offset)
            return replace(self, mag_matrix=matrix, mag_offset=offset)
        if sensor is Sensor.BOARD:
            return replace(self, level=given.get("matrix", blank.level))
        if sensor is Sensor.AIRSPEED:
            return replace(self, diff_pressure_bias_pa=float(given.get("bias", 0.0)))
        return replace(self, baro_bias_m=float(given.get("bias", 0.0)))

    def of(self, sensor: Sensor) -> dict[str, Value]:
        """Return one sensor's parameters in force, as `having` takes them."""
        table: dict[Sensor, dict[str, Value]] = {
            Sensor.GYRO: {**self._gyro_shape(), "bias": self.gyro_offset},
            Sensor.ACCEL: {"matrix": self.accel_matrix, "offset": self.accel_offset},
            Sensor.MAG: {"matrix": self.mag_matrix, "offset": self.mag_offset},
            Sensor.BOARD: {"matrix": self.level},
            Sensor.AIRSPEED: {"bias": self.diff_pressure_bias_pa},
            Sensor.BARO: {"bias": self.baro_bias_m},
        }
        return table[sensor]

    def _gyro_shape(self) -> dict[str, Value]:
        """Return the scale, or the matrix where an import gave one that is more than that."""
        scale = np.diag(self.gyro_matrix).copy()
        return {"scale": scale} if np.array_equal(np.diag(scale), self.gyro_matrix) else {"matrix": self.gyro_matrix}


def conditioned(job: CalKind, kind: Kind, rows: Float, present: Calibration) -> Float:
    """Return raw samples as a collector of this kind wants them.

    Most want them raw. What works from gravity wants the accelerometer calibrated (LEVEL: but not levelled). What finds
    a magnetic offset alone wants the matrix in force applied (MAG_FIXED_HEADING), or all of it (MAG_IN_FLIGHT, which
    finds what is left); `merged` turns the offset back.

    Args:
        job: the kind of calibration.
        kind: of the samples.
        rows: shape (n, ROW_WIDTH), raw, the magnetometer's in gauss.
        present: what is in force.
    """
    if kind is Kind.IMU and job is CalKind.LEVEL:
        return replace(present, level=np.eye(3)).rows(kind, rows)
    if kind is Kind.IMU and job in OFFSET_ONLY:
        return present.rows(kind, rows)
    if kind is Kind.MAG and job in OFFSET_ONLY:
        return _without(present, job).rows(kind, rows)
    return rows


def _without(present: Calibration, job: CalKind) -> Calibration:
    return replace(present, mag_offset=np.zeros(3)) if job is CalKind.MAG_FIXED_HEADING else present


def merged(
    kind: CalKind, found: Mapping[str, Value], sigma: Mapping[str, Value], present: Calibration
) -> dict[str, Value]:
    """Return the sensor's whole parameters after a calibration that finds only part of them.

    A gyro bias keeps the scale or matrix in force, and so does a turntable for axes that were not turned (their σ is
    NaN). A magnetic offset b found after the matrix M in force, from M (raw − o), is taken off as M (raw − o − M⁻¹ b).
    """
    if kind is CalKind.GYRO_BIAS:
        return {**present.of(Sensor.GYRO), **found}
    if kind is CalKind.GYRO_SCALE:
        turned = np.isfinite(np.asarray(sigma["scale"]))
        return {**found, "scale": np.where(turned, found["scale"], np.diag(present.gyro_matrix))}
    if kind in OFFSET_ONLY:
        before = _without(present, kind)
        offset = before.mag_offset + np.linalg.solve(present.level @ present.mag_matrix, np.asarray(found["offset"]))
        return {"matrix": present.mag_matrix, "offset": offset}
    return {name: value for name, value in found.items() if name in {"offset", "matrix", "scale", "bias"}}


def in_words_of(kind: CalKind, present: Calibration) -> dict[str, Value]:
    """Return the calibration in force in the parameters that this kind finds, so that its check can judge them."""
    own = present.of(SENSOR_OF[kind])
    if kind in OFFSET_ONLY:
        before = _without(present, kind)
        return {"offset": present.level @ present.mag_matrix @ (present.mag_offset - before.mag_offset)}
    return own


__all__ = ["CAL_SIZE", "Calibration", "conditioned", "in_words_of", "merged"]

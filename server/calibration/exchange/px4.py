"""PX4's parameters: composed with what the board applies already, and back.

What PX4 sends as HIGHRES_IMU went through these parameters, in this order (file and function of PX4's source):

- accelerometer: `rotation * ((data - CAL_ACC0_?OFF) * CAL_ACC0_?SCALE)` (src/lib/sensor_calibration/
  Accelerometer.hpp, `Correct`); gyroscope: `rotation * (data - CAL_GYRO0_?OFF)`, no scale (Gyroscope.hpp);
- magnetometer, gauss: `rotation * (S * (data - CAL_MAG0_?OFF))`, S symmetric of CAL_MAG0_?SCALE and CAL_MAG0_?ODIAG
  (xy, xz, yz) (Magnetometer.hpp, Magnetometer.cpp);
- rotation = Dcm(SENS_BOARD_X_OFF, SENS_BOARD_Y_OFF, SENS_BOARD_Z_OFF in degrees) · SENS_BOARD_ROT; a sensor outside
  the board has its own CAL_?0_ROT instead of the latter (Accelerometer.cpp `set_rotation`, Utilities.cpp);
- the differential pressure is sent as measured; SENS_DPRES_OFF, Pa, is taken off later
  (src/modules/mavlink/streams/HIGHRES_IMU.hpp, src/modules/sensors).

HIGHRES_IMU has the estimator's own biases taken off on top; they change in flight and are in no parameter.
With the board's own parameters, new = ours ∘ board's; without them the board is taken to apply nothing yet.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import numpy as np

from server.calibration.exchange.affine import (
    Affine,
    board_rotation,
    euler_from_rotation,
    off_diagonal,
    rotation_from_euler,
    symmetric,
)
from server.calibration.exchange.limits import warn_cross_axis, warn_lost_scale, warn_skew
from server.calibration.exchange.parameters import Found, Parameters, axes, has_any, vector
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import Sensor
from server.nav.types import Float

ACC_OFFSET: Final = axes("CAL_ACC0_", "OFF")
ACC_SCALE: Final = axes("CAL_ACC0_", "SCALE")
GYRO_OFFSET: Final = axes("CAL_GYRO0_", "OFF")
MAG_OFFSET: Final = axes("CAL_MAG0_", "OFF")
MAG_DIAGONAL: Final = axes("CAL_MAG0_", "SCALE")
MAG_OFF_DIAGONAL: Final = axes("CAL_MAG0_", "ODIAG")
LEVEL: Final = axes("SENS_BOARD_", "_OFF")
AIRSPEED: Final = "SENS_DPRES_OFF"
ORIENTATION: Final = "SENS_BOARD_ROT"
_OWN_ROTATION: Final = {Sensor.ACCEL: "CAL_ACC0_ROT", Sensor.GYRO: "CAL_GYRO0_ROT", Sensor.MAG: "CAL_MAG0_ROT"}
_SEA_LEVEL_PA_M: Final = 12.013  # ρ g of the standard atmosphere at 0 m, kg/m³ · m/s²


def written(ours: Calibration, sensors: Collection[Sensor], board: Parameters | None) -> Found:
    """Return PX4's parameters with which the board does itself what `ours` does to its present output.

    Args:
        ours: what is in force, relative to what the board sends now.
        sensors: whose parameters are wanted; the others stay as they are on the board.
        board: the board's present parameters; None = it applies nothing.
    """
    found, now = Found(), board or {}
    if Sensor.ACCEL in sensors and (R := _axes_of(found, now, Sensor.ACCEL)) is not None:
        whole = Affine(matrix=ours.accel_matrix, offset=ours.accel_offset).in_axes(R).after(_accel(now))
        found.put(ACC_OFFSET, whole.offset)
        found.put(ACC_SCALE, np.diag(whole.matrix))
        warn_cross_axis(found, Sensor.ACCEL, whole.matrix)
    if Sensor.GYRO in sensors and (R := _axes_of(found, now, Sensor.GYRO)) is not None:
        found.put(GYRO_OFFSET, vector(now, GYRO_OFFSET, 0.0) + R.T @ ours.gyro_offset)
        warn_lost_scale(found, ours.gyro_matrix)
    if Sensor.MAG in sensors and (R := _axes_of(found, now, Sensor.MAG)) is not None:
        _write_mag(found, Affine(matrix=ours.mag_matrix, offset=ours.mag_offset).in_axes(R).after(_mag(now)))
    if Sensor.BOARD in sensors:
        found.put(LEVEL, np.degrees(euler_from_rotation(ours.level @ _level(now))))
    if Sensor.AIRSPEED in sensors:
        found.put([AIRSPEED], [ours.diff_pressure_bias_pa])
    if Sensor.BARO in sensors and ours.baro_bias_m:
        text = (
            f"The height's bias of {ours.baro_bias_m:.2f} m is lost: PX4 has a pressure offset (CAL_BARO0_OFF) only, "
            f"at sea level about {-_SEA_LEVEL_PA_M * ours.baro_bias_m:.1f} Pa."
        )
        found.warn("baro-lost", text, Sensor.BARO, ours.baro_bias_m, "m")
    return found


def read(parameters: Parameters, board: Parameters | None) -> Found:
    """Return what a file's parameters would do to what the board sends now, by sensor as `having` takes it."""
    found, now = Found(), board or {}
    then = {**now, **parameters}  # what a file does not name stays on the board
    axes_from = board or {name: value for name, value in parameters.items() if name not in LEVEL}
    if has_any(parameters, ACC_OFFSET, ACC_SCALE) and (R := _axes_of(found, axes_from, Sensor.ACCEL)) is not None:
        change = _accel(then).after(_accel(now).inverse()).in_axes(R.T)
        found.sensors[Sensor.ACCEL] = {"matrix": change.matrix, "offset": change.offset}
    if has_any(parameters, GYRO_OFFSET) and (R := _axes_of(found, axes_from, Sensor.GYRO)) is not None:
        bias = R @ (vector(then, GYRO_OFFSET, 0.0) - vector(now, GYRO_OFFSET, 0.0))
        found.sensors[Sensor.GYRO] = {"scale": np.ones(3), "bias": bias}
    if has_any(parameters, MAG_OFFSET, MAG_DIAGONAL, MAG_OFF_DIAGONAL):
        R = _axes_of(found, axes_from, Sensor.MAG)
        if R is not None:
            change = _mag(then).after(_mag(now).inverse()).in_axes(R.T)
            found.sensors[Sensor.MAG] = {"matrix": change.matrix, "offset": change.offset}
    if has_any(parameters, LEVEL):
        found.sensors[Sensor.BOARD] = {"matrix": _level(then) @ _level(now).T}
    if AIRSPEED in parameters:
        found.sensors[Sensor.AIRSPEED] = {"bias": parameters[AIRSPEED]}
    return found


def _axes_of(found: Found, parameters: Parameters, sensor: Sensor) -> Float | None:
    """Return the rotation from a sensor's axes to the body, the level included; None with a warning."""
    own = parameters.get(_OWN_ROTATION[sensor], -1.0)
    number = own if own >= 0 else parameters.get(ORIENTATION, 0.0)
    rotation = board_rotation(number)
    if rotation is None:
        text = f"The rotation {number:g} of the {sensor} is not one of the fixed ones: it was left out."
        found.warn("orientation-unknown", text, sensor, number)
        return None
    return _level(parameters) @ rotation


def _level(parameters: Parameters) -> Float:
    return rotation_from_euler(*np.radians(vector(parameters, LEVEL, 0.0)).tolist())


def _accel(parameters: Parameters) -> Affine:
    return Affine(matrix=np.diag(vector(parameters, ACC_SCALE, 1.0)), offset=vector(parameters, ACC_OFFSET, 0.0))


def _mag(parameters: Parameters) -> Affine:
    matrix = symmetric(vector(parameters, MAG_DIAGONAL, 1.0), vector(parameters, MAG_OFF_DIAGONAL, 0.0))
    return Affine(matrix=matrix, offset=vector(parameters, MAG_OFFSET, 0.0))


def _write_mag(found: Found, whole: Affine) -> None:
    matrix = (whole.matrix + whole.matrix.T) / 2
    found.put(MAG_OFFSET, whole.offset)
    found.put(MAG_DIAGONAL, np.diag(matrix))
    found.put(MAG_OFF_DIAGONAL, off_diagonal(matrix))
    warn_skew(found, whole.matrix)

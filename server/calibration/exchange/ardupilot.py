"""ArduPilot's parameters: composed with what the board applies already, and back.

What ArduPilot sends as raw went through these parameters, in this order (file and function of ArduPilot's source):

- accelerometer, in the axes before AHRS_ORIENTATION: `accel -= INS_ACCOFFS; accel *= INS_ACCSCAL`, then the rotation
  (libraries/AP_InertialSensor/AP_InertialSensor_Backend.cpp, `_rotate_and_correct_accel`);
- gyroscope: `gyro -= INS_GYROFFS`, then the rotation; no scale (there, `_rotate_and_correct_gyro`);
- magnetometer, in body axes, milligauss: `mag += COMPASS_OFS`, times COMPASS_SCALE where that is believable, times the
  symmetric matrix of COMPASS_DIA and COMPASS_ODI (libraries/AP_Compass/AP_Compass_Backend.cpp, `rotate_field` before
  `correct_field`). ArduPilot *adds* its offsets: COMPASS_OFS = −1000 · our offset;
- AHRS_TRIM turns the estimated attitude only, after everything, and not what is sent
  (libraries/AP_AHRS/AP_AHRS.cpp: `_rotation_autopilot_body_to_vehicle_body.from_euler(trim)`);
- differential pressure, Pa: `raw - ARSPD_OFFSET` (libraries/AP_Airspeed/AP_Airspeed.cpp, `read`);
- height: `+ BARO_ALT_OFFSET` in metres (libraries/AP_Baro/AP_Baro.cpp, `update`).

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
from server.calibration.exchange.limits import (
    warn_cross_axis,
    warn_lost_scale,
    warn_outside,
    warn_rotation,
    warn_skew,
)
from server.calibration.exchange.parameters import Found, Parameters, axes, has_any, vector
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import Sensor
from server.nav.types import Float

ACC_OFFSET: Final = axes("INS_ACCOFFS_")
ACC_SCALE: Final = axes("INS_ACCSCAL_")
GYRO_OFFSET: Final = axes("INS_GYROFFS_")
MAG_OFFSET: Final = axes("COMPASS_OFS_")
MAG_DIAGONAL: Final = axes("COMPASS_DIA_")
MAG_OFF_DIAGONAL: Final = axes("COMPASS_ODI_")
MAG_SCALE: Final = "COMPASS_SCALE"
TRIM: Final = axes("AHRS_TRIM_")
AIRSPEED: Final = "ARSPD_OFFSET"
BARO: Final = "BARO_ALT_OFFSET"
ORIENTATION: Final = "AHRS_ORIENTATION"
LIMITS: Final = {
    ACC_OFFSET: (-3.5, 3.5),
    ACC_SCALE: (0.8, 1.2),
    MAG_OFFSET: (-1800.0, 1800.0),
    MAG_DIAGONAL: (0.2, 5.0),
    MAG_OFF_DIAGONAL: (-1.0, 1.0),
    TRIM: (-0.1745, 0.1745),
}
"""What ArduPilot accepts: INS calibration checks, COMPASS_OFFS_MAX, the calibrator's limits, AHRS_TRIM ±10°."""
_SCALE_RANGE: Final = (0.85, 1.4)  # CompassCalibrator.h: COMPASS_MIN_SCALE_FACTOR, COMPASS_MAX_SCALE_FACTOR
_MILLIGAUSS: Final = 1000.0


def written(ours: Calibration, sensors: Collection[Sensor], board: Parameters | None) -> Found:
    """Return ArduPilot's parameters with which the board does itself what `ours` does to its present output.

    Args:
        ours: what is in force, relative to what the board sends now.
        sensors: whose parameters are wanted; the others stay as they are on the board.
        board: the board's present parameters; None = it applies nothing.
    """
    found, now = Found(), board or {}
    rotation = _rotation(found, now, sensors)
    if Sensor.ACCEL in sensors and rotation is not None:
        _write_accel(found, Affine(matrix=ours.accel_matrix, offset=ours.accel_offset).in_axes(rotation), now)
    if Sensor.GYRO in sensors and rotation is not None:
        _write_gyro(found, Affine(matrix=ours.gyro_matrix, offset=ours.gyro_offset).in_axes(rotation), now)
    if Sensor.MAG in sensors:
        _write_mag(found, Affine(matrix=ours.mag_matrix, offset=ours.mag_offset), now, known=board is not None)
    if Sensor.BOARD in sensors:
        roll, pitch, yaw = euler_from_rotation(ours.level)
        found.put(TRIM[:2], (roll, pitch))
        warn_rotation(found, yaw)
    if Sensor.AIRSPEED in sensors:
        found.put([AIRSPEED], [now.get(AIRSPEED, 0.0) + ours.diff_pressure_bias_pa])
    if Sensor.BARO in sensors:
        found.put([BARO], [now.get(BARO, 0.0) - ours.baro_bias_m])
    warn_outside(found, LIMITS)
    _warn_relearned(found, now)
    return found


def read(parameters: Parameters, board: Parameters | None) -> Found:
    """Return what a file's parameters would do to what the board sends now, by sensor as `having` takes it."""
    found, now = Found(), board or {}
    then = {**now, **parameters}  # what a file does not name stays on the board
    rotation = _rotation(found, board or parameters, {Sensor.ACCEL, Sensor.GYRO})
    if has_any(parameters, ACC_OFFSET, ACC_SCALE) and rotation is not None:
        change = _accel(then).after(_accel(now).inverse()).in_axes(rotation.T)
        found.sensors[Sensor.ACCEL] = {"matrix": change.matrix, "offset": change.offset}
    if has_any(parameters, GYRO_OFFSET) and rotation is not None:
        bias = rotation @ (vector(then, GYRO_OFFSET, 0.0) - vector(now, GYRO_OFFSET, 0.0))
        found.sensors[Sensor.GYRO] = {"scale": np.ones(3), "bias": bias}
    if has_any(parameters, MAG_OFFSET, MAG_DIAGONAL, MAG_OFF_DIAGONAL):
        change = _mag(then).after(_mag(now).inverse())
        found.sensors[Sensor.MAG] = {"matrix": change.matrix, "offset": change.offset}
    if has_any(parameters, TRIM):
        found.sensors[Sensor.BOARD] = {"matrix": rotation_from_euler(*vector(then, TRIM, 0.0).tolist())}
    if AIRSPEED in parameters:
        found.sensors[Sensor.AIRSPEED] = {"bias": parameters[AIRSPEED] - now.get(AIRSPEED, 0.0)}
    if BARO in parameters:
        found.sensors[Sensor.BARO] = {"bias": now.get(BARO, 0.0) - parameters[BARO]}
    return found


def _rotation(found: Found, parameters: Parameters, sensors: Collection[Sensor]) -> Float | None:
    """Return the rotation of AHRS_ORIENTATION, or None with a warning for each sensor that needs it."""
    number = parameters.get(ORIENTATION, 0.0)
    rotation = board_rotation(number)
    if rotation is None:
        for sensor in {Sensor.ACCEL, Sensor.GYRO} & set(sensors):
            text = f"{ORIENTATION} {number:g} is not a fixed rotation: the {sensor} was left out."
            found.warn("orientation-unknown", text, sensor, number)
    return rotation


def _or_ones(values: Float) -> Float:
    return values if values.any() else np.ones(3)


def _accel(parameters: Parameters) -> Affine:
    scale = _or_ones(vector(parameters, ACC_SCALE, 1.0))
    return Affine(matrix=np.diag(scale), offset=vector(parameters, ACC_OFFSET, 0.0))


def _mag(parameters: Parameters) -> Affine:
    """Return the board's own correction in gauss."""
    diagonal = _or_ones(vector(parameters, MAG_DIAGONAL, 1.0))
    matrix = symmetric(diagonal, vector(parameters, MAG_OFF_DIAGONAL, 0.0)) * _mag_scale(parameters)
    return Affine(matrix=matrix, offset=-vector(parameters, MAG_OFFSET, 0.0) / _MILLIGAUSS)


def _mag_scale(parameters: Parameters) -> float:
    scale = parameters.get(MAG_SCALE, 1.0)
    return scale if _SCALE_RANGE[0] <= scale <= _SCALE_RANGE[1] else 1.0


def _write_accel(found: Found, ours: Affine, now: Parameters) -> None:
    whole = ours.after(_accel(now))
    found.put(ACC_OFFSET, whole.offset)
    found.put(ACC_SCALE, np.diag(whole.matrix))
    warn_cross_axis(found, Sensor.ACCEL, whole.matrix)


def _write_gyro(found: Found, ours: Affine, now: Parameters) -> None:
    found.put(GYRO_OFFSET, vector(now, GYRO_OFFSET, 0.0) + ours.offset)
    warn_lost_scale(found, ours.matrix)


def _write_mag(found: Found, ours: Affine, now: Parameters, *, known: bool) -> None:
    whole = ours.after(_mag(now))
    matrix = (whole.matrix + whole.matrix.T) / 2 / _mag_scale(now)
    found.put(MAG_OFFSET, -_MILLIGAUSS * whole.offset)
    found.put(MAG_DIAGONAL, np.diag(matrix))
    found.put(MAG_OFF_DIAGONAL, off_diagonal(matrix))
    if not known:
        found.put([MAG_SCALE], [1.0])  # a scale the board had would come on top
    warn_skew(found, whole.matrix)
    if now.get("COMPASS_MOTCT", 0.0):
        text = "The board also corrects the magnetometer for its motors (COMPASS_MOTCT); that stays as it is."
        found.warn("motor-compensation", text, Sensor.MAG)


def _warn_relearned(found: Found, now: Parameters) -> None:
    if GYRO_OFFSET[0] in found.parameters and now.get("INS_GYR_CAL", 1.0):
        text = "ArduPilot measures its gyro offsets at every start (INS_GYR_CAL 1) and replaces these."
        found.warn("relearned", text, Sensor.GYRO)
    if AIRSPEED in found.parameters and not now.get("ARSPD_SKIP_CAL", 0.0):
        text = "ArduPilot measures its airspeed offset at every start (ARSPD_SKIP_CAL 0) and replaces this one."
        found.warn("relearned", text, Sensor.AIRSPEED)
    if BARO in found.parameters:
        text = "ArduPilot sets its height to zero at every start; BARO_ALT_OFFSET is on top of that."
        found.warn("relearned", text, Sensor.BARO)

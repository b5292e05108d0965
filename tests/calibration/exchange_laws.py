"""The autopilots' own formulas, written from their source in float32, and sets to put through them."""

import numpy as np

from server.calibration.records import CalibrationSet
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import Sensor

BOARD = "board-1"
COMMON = {"board_id": BOARD, "software_version": "0.1.0", "now_utc": "2026-11-22T12:00:00Z"}


def dcm(roll, pitch, yaw):
    """`Matrix3::from_euler` of ArduPilot, `Dcm(Euler)` of PX4: R = Rz Ry Rx."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def three(parameters, pattern, default=0.0):
    return np.array([parameters.get(pattern.replace("?", axis), default) for axis in "XYZ"])


def sym(diagonal, off):
    x, y, z = off
    return np.array([[diagonal[0], x, y], [x, diagonal[1], z], [y, z, diagonal[2]]])


def ardupilot_accel(parameters, raw, rotation):
    """`_rotate_and_correct_accel`: minus offset, times scale, then the board's rotation."""
    out = (raw - three(parameters, "INS_ACCOFFS_?")) * three(parameters, "INS_ACCSCAL_?", 1.0)
    return out @ rotation.T


def ardupilot_gyro(parameters, raw, rotation):
    return (raw - three(parameters, "INS_GYROFFS_?")) @ rotation.T


def ardupilot_mag(parameters, raw_mgauss):
    """`correct_field`: plus offset, times scale factor, times the symmetric matrix."""
    out = raw_mgauss + three(parameters, "COMPASS_OFS_?")
    out = out * parameters.get("COMPASS_SCALE", 1.0)
    return out @ sym(three(parameters, "COMPASS_DIA_?", 1.0), three(parameters, "COMPASS_ODI_?")).T


def px4_rotation(parameters, board):
    return dcm(*np.radians(three(parameters, "SENS_BOARD_?_OFF"))) @ board


def px4_accel(parameters, raw, board):
    """`Accelerometer::Correct`."""
    out = (raw - three(parameters, "CAL_ACC0_?OFF")) * three(parameters, "CAL_ACC0_?SCALE", 1.0)
    return out @ px4_rotation(parameters, board).T


def px4_gyro(parameters, raw, board):
    return (raw - three(parameters, "CAL_GYRO0_?OFF")) @ px4_rotation(parameters, board).T


def px4_mag(parameters, raw, board):
    matrix = sym(three(parameters, "CAL_MAG0_?SCALE", 1.0), three(parameters, "CAL_MAG0_?ODIAG"))
    return (raw - three(parameters, "CAL_MAG0_?OFF")) @ matrix.T @ px4_rotation(parameters, board).T


def a_set(sensor, **parameters):
    values = {name: np.asarray(value) if np.ndim(value) else value for name, value in parameters.items()}
    return CalibrationSet(board_id=BOARD, sensor=sensor, kind="import", parameters=values, id=f"id-{sensor}")


def in_force(*sets):
    return {kept.sensor: kept for kept in sets}


def calibration(sets):
    whole = Calibration()
    for kept in sets.values():
        whole = whole.having(kept.sensor, kept.parameters)
    return whole


MAG = a_set(
    Sensor.MAG,
    offset=[0.12, -0.31, 0.05],
    matrix=[[1.05, 0.02, -0.01], [0.02, 0.93, 0.03], [-0.01, 0.03, 1.1]],
)
ACCEL = a_set(Sensor.ACCEL, offset=[0.2, -0.4, 0.31], matrix=np.diag([0.97, 1.02, 0.99]))
ACCEL_CROSS = a_set(  # the board of S0, its offset a hundred times as large
    Sensor.ACCEL,
    offset=[-0.39, 0.06, 0.34],
    matrix=[[0.9638, -0.0090, 0.0018], [0.0142, 0.9666, -0.0143], [-0.0132, 0.0047, 0.9801]],
)
GYRO = a_set(Sensor.GYRO, bias=[0.0093, -0.0128, -0.0056], scale=[1.0, 1.0, 1.0])
GYRO_SCALED = a_set(Sensor.GYRO, bias=[0.0093, -0.0128, -0.0056], scale=[1.01, 0.99, 1.02])
LEVEL = a_set(Sensor.BOARD, matrix=dcm(0.02, -0.03, 0.0))
AIRSPEED = a_set(Sensor.AIRSPEED, bias=12.5)
BARO = a_set(Sensor.BARO, bias=3.25)

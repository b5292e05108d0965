"""Parameters of the attitude mode: one set for hand-held and indoor boards with consumer MEMS sensors."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.types import Float

K_GYRO_NOISE: Final = 0  # rad/s/√Hz
K_GYRO_WALK_REST: Final = 1  # rad/s²/√Hz
K_GYRO_WALK_MOVING: Final = 2  # rad/s²/√Hz
K_TURN_NOISE: Final = 3  # rad per √(rad of turn): what scale and misalignment do not explain
K_SCALE_SIGMA: Final = 4  # 1
K_ACCEL_NOISE: Final = 5  # m/s²/√Hz
K_ACCEL_BIAS_SIGMA: Final = 6  # m/s²
K_ACCEL_BIAS_WALK: Final = 7  # m/s³/√Hz
K_SPEED_SIGMA: Final = 8  # m/s
K_SPEED_TIME: Final = 9  # s
K_REST_SPEED: Final = 10  # m/s
K_MAG_NOISE: Final = 11  # gauss
K_PATCH_SIGMA: Final = 12  # gauss, field differences within a hand's reach
K_PATCH_TIME: Final = 13  # s of motion between independent ones
K_FIELD_SIGMA: Final = 14  # gauss, field differences within a room
K_FIELD_TIME: Final = 15  # s of motion
K_OFFSET_SIGMA: Final = 16  # gauss
K_OFFSET_WALK: Final = 17  # gauss/√s of motion
K_DELAY_SIGMA: Final = 18  # s
K_GATE: Final = 19  # standard deviations
K_ATTACH_TIME: Final = 20  # s over which a contradiction fixed to the body is averaged
K_ATTACH_GATE: Final = 21  # standard deviations of that average
K_REST_GYRO: Final = 22  # rad/s, spread of 20 ms means
K_REST_ACCEL: Final = 23  # m/s²
K_REST_TIME: Final = 24  # s
K_GYRO_BIAS_SIGMA: Final = 25  # rad/s
K_IMU_DELAY: Final = 26  # s
K_SIZE: Final = 27


def default_parameters() -> Float:
    """Return the defaults, shape (K_SIZE,). Orders of magnitude of data sheets; none is finely tuned."""
    k = np.zeros(K_SIZE)
    k[K_GYRO_NOISE] = 2.5e-4  # 0.015 °/s/√Hz; a resting board shows half of it
    k[K_GYRO_WALK_REST] = 1e-5
    k[K_GYRO_WALK_MOVING] = 1e-4  # as `ekf.defaults`
    k[K_TURN_NOISE] = 1e-3
    k[K_SCALE_SIGMA] = 0.005  # factory-trimmed MEMS: 0.5 to 1 %
    k[K_ACCEL_NOISE] = 0.05  # scale error of 1 % in changing poses, not the sensor's white noise
    k[K_ACCEL_BIAS_SIGMA] = 0.1  # 10 mg
    k[K_ACCEL_BIAS_WALK] = 1e-4
    k[K_SPEED_SIGMA] = 0.5  # a hand's movement
    k[K_SPEED_TIME] = 0.5
    k[K_REST_SPEED] = 0.02
    k[K_MAG_NOISE] = 0.007
    k[K_PATCH_SIGMA] = 0.02  # 2 µT within a hand's reach indoors
    k[K_PATCH_TIME] = 1.0
    k[K_FIELD_SIGMA] = 0.02
    k[K_FIELD_TIME] = 200.0
    k[K_OFFSET_SIGMA] = 0.005  # what a fair calibration leaves
    k[K_OFFSET_WALK] = 3e-4
    k[K_DELAY_SIGMA] = 0.02
    k[K_GATE] = 4.0
    k[K_ATTACH_TIME] = 2.0
    k[K_ATTACH_GATE] = 1.0
    k[K_REST_GYRO] = math.radians(2.0)
    k[K_REST_ACCEL] = 0.4
    k[K_REST_TIME] = 1.0
    k[K_GYRO_BIAS_SIGMA] = 0.03  # 1.7 °/s at power-up
    k[K_IMU_DELAY] = 0.0035  # low-pass of a MEMS IMU at about 100 Hz, and half a sample
    return k

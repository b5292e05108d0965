"""Columns of the flat array that the chain's kernels share: what is switched on, calibration, filters and their states.

Raw counts → unit and mounting → plausibility → calibration → rate limit → Butterworth → first-order low-pass → moving
window → steps. One block per sensor, the same columns in each; a sensor of one number uses the first channel.
"""

from __future__ import annotations

from typing import Final

from server.nav.calibration.applied import CAL_SIZE
from server.nav.types import ROW_WIDTH, Kind

GYRO: Final = 0
ACCEL: Final = 1
MAG: Final = 2
BARO: Final = 3
AIRSPEED: Final = 4
SENSORS: Final = ("gyro", "accel", "mag", "baro", "airspeed")
CHANNELS: Final = (3, 3, 3, 1, 1)
KIND_OF: Final = (Kind.IMU, Kind.IMU, Kind.MAG, Kind.BARO, Kind.AIRSPEED)
WINDOW_MAX: Final = 64  # samples, the wait for a slower sensor included
SECTIONS: Final = 2  # second-order sections: order 4 at most

FULL_SCALE_TOLERANCE: Final = 0.002  # of the full scale: a count or two below it

# Of the whole chain.
K_ON: Final = 0  # (5) 1 = this sensor's samples take the way through the chain
K_CHANGED: Final = 5  # 1 = the delay of gyro or accelerometer has just changed: the lanes have to be told
K_CAL: Final = 6  # (CAL_SIZE) the calibration in force, `calibration.applied`
K_LEARNED: Final = K_CAL + CAL_SIZE  # (3) magnetic offset learned in flight, calibrated body frame, gauss
K_PRESSURE: Final = K_LEARNED + 3  # newest static pressure, Pa; NaN before the first
K_ROW: Final = K_PRESSURE + 1  # (ROW_WIDTH) scratch: the IMU row at hand
K_CLIP_GYRO: Final = K_ROW + ROW_WIDTH  # magnitudes from which a sample may be clipped, rad/s and m/s²
K_CLIP_ACCEL: Final = K_CLIP_GYRO + 1
K_BLOCKS: Final = K_CLIP_ACCEL + 1

# One sensor's block: what is asked …
B_UNITS: Final = 0  # 1 = there is a mounting, 2 = there are counts as well
B_ZERO: Final = 1  # (3) counts
B_SCALE: Final = 4  # unit per count
B_MOUNT: Final = 5  # (9) R from the sensor's axes to the body, row by row
B_LIMIT: Final = 14  # unit of the sensor; 0 = off
B_LIMIT_COUNT: Final = 15
B_ORDER: Final = 16
B_CUTOFF: Final = 17  # Hz; 0 = off
B_LOWPASS: Final = 18  # Hz; 0 = off
B_WINDOW: Final = 19  # samples; 1 = off
B_FULL_SCALE: Final = 20  # unit of the sensor; 0 = found out
B_CONVERT: Final = 21  # airspeed: 1 = from the differential pressure and the air's density
# … what follows from the measured rate …
B_T_LAST: Final = 22  # previous sample, ns
B_INTERVAL: Final = 23  # mean, s; 0 before the second sample
B_INTERVALS: Final = 24  # how many it is the mean of
B_DESIGNED: Final = 25  # interval that the coefficients are for, s; 0 = there are none
B_COEFFICIENTS: Final = 26  # (SECTIONS, 5) b0 b1 b2 a1 a2
B_SECTIONS: Final = B_COEFFICIENTS + 5 * SECTIONS  # in use
B_LAG: Final = B_SECTIONS + 1  # samples that a quicker sensor waits for a slower one
B_DELAY: Final = B_LAG + 1  # of all filters and the wait, s
# … and states.
B_FILLED: Final = B_DELAY + 1  # samples since the last reset, up to WINDOW_MAX; 0 = the next one starts everything
B_HEAD: Final = B_FILLED + 1  # where the next one goes in the ring
B_QUANTITY: Final = B_HEAD + 1  # airspeed: 0 = pressure, 1 = speed, whichever the board sends
B_STATES: Final = B_QUANTITY + 1
# States of one channel.
Z_SECTIONS: Final = 0  # (SECTIONS, 2)
Z_LOWPASS: Final = 2 * SECTIONS
Z_LIMIT: Final = Z_LOWPASS + 1  # last output of the rate limit
Z_REJECTED: Final = Z_LIMIT + 1  # rejections in a row
Z_RING: Final = Z_REJECTED + 1  # (WINDOW_MAX)
Z_SIZE: Final = Z_RING + WINDOW_MAX
B_SIZE: Final = B_STATES + 3 * Z_SIZE
K_SIZE: Final = K_BLOCKS + len(SENSORS) * B_SIZE

# One row of stages per sample: first whether it was used, then calibrated, limited, filtered; the second sensor of an
# IMU row stands behind the first.
G_USED: Final = 0
G_FIRST: Final = 1
G_SECOND: Final = 10
G_SIZE: Final = 19


def block_at(sensor: int) -> int:
    """Return where a sensor's block begins."""
    return K_BLOCKS + sensor * B_SIZE

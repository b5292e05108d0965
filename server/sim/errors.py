"""What sensors err by before anybody has calibrated them: the demo board with `errors=raw`.

Sizes are those of data sheets before trimming (TDK ICM-42688-P: ±20 mg, ±0.5 °/s; Bosch BMX055: ±80 mg, ±1 °/s) and
of a compass beside a battery lead, toward their upper ends, so that every calibration has something to find.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from server.nav.types import Float
from server.sim import quaternion as quat

ACCEL_OFFSET_M_S2: Final = (0.2, 0.35)
ACCEL_SCALE: Final = (0.02, 0.03)
ACCEL_CROSS: Final = (0.005, 0.02)
GYRO_OFFSET_RAD_S: Final = (math.radians(1.0), math.radians(2.0))
GYRO_SCALE: Final = (0.01, 0.03)
MAG_OFFSET_GAUSS: Final = (0.1, 0.2)
MAG_SCALE: Final = (0.05, 0.10)
MAG_CROSS: Final = (0.02, 0.05)
TILT_RAD: Final = (math.radians(2.0), math.radians(3.0))
DIFF_PRESSURE_PA: Final = 35.0
BARO_PA: Final = 120.0
"""About 10 m of height."""


def _zero() -> Float:
    return np.zeros(3)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawErrors:
    """raw = matrix · (R_sb · true) + offset for three-axis sensors; the default errs by nothing.

    Attributes:
        *_matrix: shape (3, 3); the magnetometer's is symmetric (soft iron). *_offset: shape (3,); rad/s, m/s², gauss.
        R_bs: shape (3, 3), from the board's axes, in which the sensors sit, to the vehicle's body FRD: a tilt.
        diff_pressure_pa, baro_pa: added to the reading.
    """

    gyro_matrix: Float = field(default_factory=lambda: np.eye(3))
    gyro_offset: Float = field(default_factory=_zero)
    accel_matrix: Float = field(default_factory=lambda: np.eye(3))
    accel_offset: Float = field(default_factory=_zero)
    mag_matrix: Float = field(default_factory=lambda: np.eye(3))
    mag_offset: Float = field(default_factory=_zero)
    R_bs: Float = field(default_factory=lambda: np.eye(3))
    diff_pressure_pa: float = 0.0
    baro_pa: float = 0.0


def raw_errors(seed: int) -> RawErrors:
    """Return the errors of the board of this seed; `noise` does not scale them."""
    rng = np.random.default_rng([seed, 4])

    def some(limits: tuple[float, float]) -> Float:
        return np.asarray(rng.uniform(*limits, 3) * rng.choice([-1.0, 1.0], 3))

    cross = np.zeros((3, 3))
    cross[~np.eye(3, dtype=bool)] = np.concatenate([some(ACCEL_CROSS), some(ACCEL_CROSS)])
    x, y, z = some(MAG_CROSS)
    heading = rng.uniform(0.0, 2.0 * math.pi)
    tilt = rng.uniform(*TILT_RAD) * np.array([math.cos(heading), math.sin(heading), 0.0])
    return RawErrors(
        gyro_matrix=np.diag(1.0 + some(GYRO_SCALE)),
        gyro_offset=some(GYRO_OFFSET_RAD_S),
        accel_matrix=np.diag(1.0 + some(ACCEL_SCALE)) + cross,
        accel_offset=some(ACCEL_OFFSET_M_S2),
        mag_matrix=np.diag(1.0 + some(MAG_SCALE)) + np.array([[0.0, x, y], [x, 0.0, z], [y, z, 0.0]]),
        mag_offset=some(MAG_OFFSET_GAUSS),
        R_bs=quat.matrices(quat.turned(tilt[None]))[0],
        diff_pressure_pa=DIFF_PRESSURE_PA,
        baro_pa=BARO_PA,
    )

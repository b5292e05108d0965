"""What the sensors say of a vehicle that is held still, for boards whose lanes know no attitude."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.types import SAMPLE_COLUMNS, Kind, SampleBlock
from server.view3d.feed import Quat, Vec3
from server.view3d.held import quat_from_gravity

_ACCEL: Final = SAMPLE_COLUMNS[Kind.IMU].index("accel_x_m_s2")
_MAG: Final = SAMPLE_COLUMNS[Kind.MAG].index("mag_x_gauss")


class Senses:
    """The newest specific force and magnetic field, body FRD."""

    def __init__(self) -> None:
        self._accel_b_m_s2: Vec3 | None = None
        self._mag_b: Vec3 | None = None

    @property
    def q_nb(self) -> Quat | None:
        """Attitude by gravity; None before the first sample."""
        return None if self._accel_b_m_s2 is None else quat_from_gravity(self._accel_b_m_s2)

    def mag_b_gauss(self, scale: float) -> Vec3 | None:
        """Return the present field; `scale` to gauss, 0 = not known, and then nothing is."""
        if self._mag_b is None or scale == 0.0:
            return None
        x, y, z = self._mag_b
        return scale * x, scale * y, scale * z

    def take(self, block: SampleBlock) -> None:
        """Take a step's samples: the mean of its specific force, its last field."""
        self._accel_b_m_s2 = _mean(block, Kind.IMU, _ACCEL) or self._accel_b_m_s2
        self._mag_b = _mean(block, Kind.MAG, _MAG) or self._mag_b


def _mean(block: SampleBlock, kind: Kind, column: int) -> Vec3 | None:
    rows = block.data[block.kind == kind, column : column + 3]
    if not len(rows):
        return None
    x, y, z = np.asarray(rows).mean(axis=0).tolist()
    return (x, y, z) if math.isfinite(x + y + z) else None

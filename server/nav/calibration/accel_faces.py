"""Which of the six faces a pose is."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.accel_fit import REFERENCES
from server.nav.types import Float

BOTH_ENDS: Final = 1.2  # of g: an axis that spans more has seen both of its faces


def face_frame(means: Float, radius: float, unit: str) -> tuple[Float, Float]:
    """Return centre and half span of each axis, shapes (3,), as far as the poses show them.

    An axis with both faces taken has its centre in the middle. Before that it is 0 in SI (offsets are small against g),
    and in counts the median, because most poses have most axes level.

    Args:
        means: shape (k, 3), mean readings of the poses.
        radius: 1 g in the unit of the data.
        unit: "si" or "raw".
    """
    low, high = means.min(axis=0), means.max(axis=0)
    both = (high - low) > BOTH_ENDS * radius
    fallback = np.median(means, axis=0) if unit == "raw" else np.zeros(3)
    centre = np.where(both, (high + low) / 2.0, fallback)
    return centre, np.where(both, (high - low) / 2.0, radius)


def nearest_face(mean: Float, centre: Float, half: Float) -> tuple[int, float]:
    """Return the number in `types.FACES` of the face nearest to a reading, and the angle to it, rad."""
    away = (mean - centre) / np.where(half > 0.0, half, 1.0)
    length = float(np.linalg.norm(away))
    if not length > 0.0:
        return 0, float(np.pi)
    share = REFERENCES @ away / length
    face = int(np.argmax(share))
    return face, float(np.arccos(np.clip(share[face], -1.0, 1.0)))


def faces_of(means: Float, centre: Float, half: Float) -> list[int]:
    """Return each pose's face, −1 where it is too far from every axis."""
    found = [nearest_face(mean, centre, half) for mean in means]
    return [face if angle <= grades.FACE_TILT_RAD else -1 for face, angle in found]

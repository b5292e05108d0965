"""Which of the six faces a pose is."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.accel_fit import REFERENCES
from server.nav.types import Float

TURN_STEPS: Final = 8
TURN_MAX_RAD: Final = 0.698  # 40°: at 45° two ways to name the faces are equally near
TURN_TILT_RAD: Final = 0.14  # 8°: the six poses must be right angles apart
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


def turned_faces(means: Float, centre: Float, half: Float) -> list[int]:
    """Return the faces of a board that sits turned in its box, the same way in every pose; [] when that is not so.

    The six positions are then those of the box. The nearest way to name them is taken, which is the only one up to
    45°; the fit's matrix turns the board's axes to the box's.
    """
    away = (means - centre) / np.where(half > 0.0, half, 1.0)
    length = np.linalg.norm(away, axis=1, keepdims=True)
    unit = away / np.where(length > 0.0, length, 1.0)
    rotation = np.eye(3)
    faces = np.argmax(unit @ REFERENCES.T, axis=1)
    for _ in range(TURN_STEPS):
        left, _, right = np.linalg.svd(REFERENCES[faces].T @ unit)
        rotation = left @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(left @ right)))]) @ right
        faces = np.argmax(unit @ rotation.T @ REFERENCES.T, axis=1)
    angle = float(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)))
    share = np.einsum("ij,ij->i", unit @ rotation.T, REFERENCES[faces])
    fits = bool((share >= np.cos(TURN_TILT_RAD)).all()) and len(set(faces.tolist())) == 6
    return [int(face) for face in faces] if fits and angle <= TURN_MAX_RAD else []

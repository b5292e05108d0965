"""Where things stand in the calibration scene and where its camera: one or two places, side by side or stacked.

Drawing units: 1 is the radius of a sphere of points. The camera looks across the vehicle from its right rear, as
somebody who stands beside it, so that its nose points away to the right.
"""

from __future__ import annotations

import math
from typing import Final

from server.view3d.camera import FOV_RAD
from server.view3d.feed import Vec3

REACH: Final = 1.35
"""Half of what a place needs, its label included."""

LOOK_RAD: Final = math.radians(-38.0)
HEIGHT_RAD: Final = math.radians(20.0)
FLOOR: Final = 1.2
LABEL_HEIGHT: Final = 1.38
PLAIN_ASPECT: Final = 4.0 / 3.0


def distance(aspect: float, across: float, upwards: float) -> float:
    """Return how far the camera must be to see half extents `across` and `upwards` in a picture of this aspect."""
    tangent = math.tan(0.5 * FOV_RAD)
    return max(upwards / tangent, across / (tangent * aspect)) + 0.55 * REACH


def places(count: int, aspect: float) -> tuple[Vec3, ...]:
    """Return the middles of one or two places (forward, right, down of the scene), whichever way shows more."""
    if count < 2:
        return ((0.0, 0.0, 0.0),)
    right = LOOK_RAD + math.pi / 2.0
    if distance(aspect, 2.0 * REACH, REACH) <= distance(aspect, REACH, 2.0 * REACH):
        x, y = REACH * math.cos(right), REACH * math.sin(right)
        return (-x, -y, 0.0), (x, y, 0.0)
    return (0.0, 0.0, -1.08 * REACH), (0.0, 0.0, 1.08 * REACH)


def camera_place(count: int, aspect: float) -> tuple[Vec3, Vec3]:
    """Return camera position and target in viser's world (forward, left, up)."""
    beside = count > 1 and places(count, aspect)[0][2] == 0.0
    stacked = count > 1 and not beside
    away = distance(aspect, (2.0 if beside else 1.0) * REACH, (2.2 if stacked else 1.0) * REACH)
    level = away * math.cos(HEIGHT_RAD)
    position = (-level * math.cos(LOOK_RAD), level * math.sin(LOOK_RAD), away * math.sin(HEIGHT_RAD))
    return position, (0.0, 0.0, 0.0)

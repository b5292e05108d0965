"""The four cameras. A camera stands still in the anchor's frame; what follows the vehicle is the anchor."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Final

import numpy as np

from server.nav.types import Float
from server.view3d.feed import Quat, Vec3
from server.view3d.geometry import Anchor, world_from_ned, wrap_rad, yaw_from_quat

FOV_RAD: Final = math.radians(55.0)
NEAR_M: Final = 0.02
FAR_M: Final = 40_000.0
TURN_S: Final = 0.35
"""Time constant with which the chase camera follows a turn: short enough to stay behind, long enough to see it."""


class Camera(StrEnum):
    """How a viewer's camera moves."""

    CHASE = "chase"  # behind the vehicle, turning with it
    FOLLOW = "follow"  # moves along, north stays where it is, orbit free
    TOP = "top"  # from above, north up, moves along
    FREE = "free"  # stands still over the ground


_PLACES: Final[dict[Camera, tuple[Vec3, Vec3]]] = {
    Camera.CHASE: ((-3.1, 0.75, 1.35), (0.8, 0.0, 0.05)),  # beside the path: on it one would not see it
    Camera.FOLLOW: ((-2.6, -1.8, 1.4), (0.0, 0.0, 0.0)),
    Camera.TOP: ((-0.02, 0.0, 20.0), (0.0, 0.0, 0.0)),
    Camera.FREE: ((-9.0, -6.0, 5.0), (0.0, 0.0, 0.0)),
}
"""Position and target about the vehicle: forward (or north), left (west), up; in vehicle spans."""

PLAIN_SPAN_M: Final = 0.69
"""The span for which the page starts its camera, before it has heard from the server."""


def place_m(camera: Camera, span_m: float) -> tuple[Vec3, Vec3]:
    """Return where the camera starts and what it looks at, viser world, m."""
    position, target = _PLACES[camera]
    return _scaled(position, span_m), _scaled(target, span_m)


def _scaled(v: Vec3, by: float) -> Vec3:
    return v[0] * by, v[1] * by, v[2] * by


def next_anchor(camera: Camera, anchor: Anchor, pos_n_m: Vec3, q_nb: Quat, dt_s: float) -> Anchor:
    """Return the anchor for a newer pose of the vehicle.

    Args:
        camera: free leaves the anchor where it is.
        anchor: the one before.
        pos_n_m: the vehicle, NED from the site.
        q_nb: body to NED.
        dt_s: since the one before; infinite to jump.
    """
    if camera == Camera.FREE:
        return anchor
    if camera != Camera.CHASE:
        return Anchor(pos_n_m)
    behind = wrap_rad(yaw_from_quat(q_nb) - anchor.yaw_rad)
    return Anchor(pos_n_m, wrap_rad(anchor.yaw_rad + behind * -math.expm1(-dt_s / TURN_S)))


def fit_m(points_n_m: Float, anchor: Anchor, aspect: float) -> tuple[Vec3, Vec3]:
    """Return camera position and target (viser world, m) that show every point.

    Args:
        points_n_m: shape (n, 3), NED, at least one.
        anchor: the frame the scene stands in.
        aspect: width over height of the picture.
    """
    low, high = points_n_m.min(axis=0), points_n_m.max(axis=0)
    middle: list[float] = (0.5 * (low + high)).tolist()
    n, e, d = anchor.locate((middle[0], middle[1], middle[2]))
    radius_m = max(0.5 * float(np.linalg.norm(high - low)), 2.0)
    half_rad = math.atan(math.tan(0.5 * FOV_RAD) * min(aspect, 1.0))
    away_m = 1.05 * radius_m / math.sin(half_rad)
    up = math.radians(38.0)
    north, west, high_m = world_from_ned((n, e, d))
    level_m = away_m * math.cos(up)
    return (north - 0.85 * level_m, west - 0.53 * level_m, high_m + away_m * math.sin(up)), (north, west, high_m)

"""How a vehicle is held and how it shall be held: attitudes from directions, for the calibration scene."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.rotation import quat_mul
from server.view3d.feed import IDENTITY, Quat, Vec3
from server.view3d.geometry import rotate

DOWN_N: Final[Vec3] = (0.0, 0.0, 1.0)
UP_N: Final[Vec3] = (0.0, 0.0, -1.0)
OPPOSITE: Final = math.cos(math.radians(150.0))
"""Beyond this angle the shortest turn to a target jumps about with every small movement: then it is not followed."""


def quat_between(start: Vec3, end: Vec3) -> Quat:
    """Return the shortest rotation that turns one direction into another; half a turn about x or y when opposite."""
    a, b = np.array(start) / math.hypot(*start), np.array(end) / math.hypot(*end)
    w = 1.0 + float(a @ b)
    axis = np.cross(a, b)
    if w < 1e-9:
        w, axis = 0.0, np.eye(3)[0 if abs(a[0]) < 0.7 else 1]
        axis = axis - (axis @ a) * a
    x, y, z = axis.tolist()
    return _unit((w, x, y, z))


def quat_from_gravity(accel_b_m_s2: Vec3) -> Quat:
    """Return q_nb of a vehicle at rest from its specific force alone; the heading is that of the shortest turn."""
    if not 0.0 < math.hypot(*accel_b_m_s2) < math.inf:
        return IDENTITY
    return quat_between(accel_b_m_s2, UP_N)


def heading_rad(q_nb: Quat) -> float:
    """Return where the vehicle would head if it were laid level the shortest way; defined with the nose up too."""
    nose, belly = rotate(q_nb, (1.0, 0.0, 0.0)), rotate(q_nb, (0.0, 0.0, 1.0))
    if math.hypot(nose[0], nose[1]) > 0.5:
        return math.atan2(nose[1], nose[0])
    sign = 1.0 if nose[2] < 0.0 else -1.0
    return math.atan2(sign * belly[1], sign * belly[0])


def quat_of_target(q_nb: Quat, target_b: Vec3, before: Quat | None) -> Quat:
    """Return q_nb of the pose to take: the target points down, reached by the shortest turn from the present pose.

    Args:
        q_nb: body to NED, now.
        target_b: direction that shall point down, body FRD, any length but zero.
        before: what was returned for this target last; kept while the vehicle is nearly opposite to it, where the
            shortest turn means nothing.
    """
    now_n = rotate(q_nb, target_b)
    if now_n[2] > OPPOSITE * math.hypot(*target_b):
        return _unit(quat_mul(*quat_between(now_n, DOWN_N), *q_nb))
    return before or _turned_over(q_nb, target_b)


def _turned_over(q_nb: Quat, target_b: Vec3) -> Quat:
    """Return the pose half a turn away, rolled about the nose where that is possible."""
    opposite = quat_mul(*quat_between(rotate(q_nb, target_b), UP_N), *q_nb)
    target = np.array(target_b) / math.hypot(*target_b)
    axis = np.eye(3)[0 if abs(target[0]) < 0.7 else 1]
    axis = axis - (axis @ target) * target
    x, y, z = (axis / np.linalg.norm(axis)).tolist()
    return _unit(quat_mul(*opposite, 0.0, x, y, z))


def _unit(q: Quat) -> Quat:
    size = math.hypot(*q)
    return q[0] / size, q[1] / size, q[2] / size, q[3] / size

"""Frames and shapes of uncertainty: pure functions, no viser.

The scene hangs under `/ned`; no other code knows viser's world w (up is +z). What moves is the anchor: the point and
heading of NED that lies at the origin under `/ned`, so that a following camera stands still and the world passes by.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from server.nav.rotation import matrix_from_quat, quat_mul
from server.nav.types import Float
from server.view3d.feed import ORIGIN, Quat, Vec3

NED_WXYZ: Final[Quat] = (0.0, 1.0, 0.0, 0.0)
"""q_wn of the node `/ned`: half a turn about north, so that down becomes viser's −z."""

SIGMAS: Final = 3.0
"""Ellipsoid and cones are drawn at 3 σ: about 99 % of a true normal error lies inside each axis."""

WIDEST_RAD: Final = math.radians(80.0)
RIM: Final = 36


@dataclass(frozen=True, slots=True)
class Anchor:
    """Pose of a moving frame in NED: its origin (m) and its heading (rad, clockwise from north); level."""

    origin_n_m: Vec3 = ORIGIN
    yaw_rad: float = 0.0

    def turn(self) -> Quat:
        """Return the rotation from NED into the anchor's frame: −yaw about down."""
        return (math.cos(0.5 * self.yaw_rad), 0.0, 0.0, -math.sin(0.5 * self.yaw_rad))

    def locate(self, point_n_m: Vec3) -> Vec3:
        """Return a point of NED (m) in the anchor's frame (m)."""
        n, e, d = (p - o for p, o in zip(point_n_m, self.origin_n_m, strict=True))
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return c * n + s * e, c * e - s * n, d


def world_from_ned(point_m: Vec3) -> Vec3:
    """Return a point below `/ned` (m) in viser's world, for cameras, which know no other frame."""
    return point_m[0], -point_m[1], -point_m[2]


def yaw_from_quat(q_nb: Quat) -> float:
    """Return the heading of body x, rad clockwise from north, in (−π, π]."""
    w, x, y, z = q_nb
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def wrap_rad(angle_rad: float) -> float:
    """Return the same angle in [−π, π)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def rotate(q: Quat, v: Vec3) -> Vec3:
    """Return q ⊗ v ⊗ q*: the vector in the frame that q maps to."""
    w, x, y, z = quat_mul(*q, 0.0, *v)
    _, rx, ry, rz = quat_mul(w, x, y, z, q[0], -q[1], -q[2], -q[3])
    return rx, ry, rz


def quat_from_x(towards: Float) -> Quat:
    """Return the shortest rotation that turns the x axis into a direction, shape (3,), any length but zero."""
    x, y, z = (towards / np.linalg.norm(towards)).tolist()
    if x < -0.999999:
        return 0.0, 0.0, 1.0, 0.0
    length = math.sqrt(2.0 * (1.0 + x))
    return 0.5 * length, 0.0, -z / length, y / length


def ellipsoid_axes_m(sigma_pos_n_m: Vec3) -> Vec3 | None:
    """Return the half axes along north, east, down (m), `SIGMAS` wide; None while unknown."""
    n, e, d = (SIGMAS * sigma for sigma in sigma_pos_n_m)
    return (n, e, d) if math.isfinite(n + e + d) else None


def cone_spread_rad(q_nb: Quat, sigma_att_rad: Vec3, axis_b: Vec3) -> Float | None:
    """Return how far a body axis may point elsewhere: a 2-D covariance, `SIGMAS`² wide.

    A small error rotation δ (NED) moves the axis a by δ × a, so its covariance is [a]× diag(σ²) [a]×ᵀ, here in body
    axes and in the plane spanned by the two body axes that follow `axis_b` cyclically.

    Args:
        q_nb: body to NED.
        sigma_att_rad: 1 σ of the error rotation vector in NED, rad.
        axis_b: a unit vector along a body axis, either sign.

    Returns:
        Shape (2, 2), rad²; None while unknown.
    """
    if not all(map(math.isfinite, sigma_att_rad)):
        return None
    R_nb = matrix_from_quat(np.array(q_nb) / math.hypot(*q_nb))
    cov_b = R_nb.T @ np.diag(np.square(sigma_att_rad)) @ R_nb
    x, y, z = axis_b
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    moved = cross @ cov_b @ cross.T
    along = int(np.argmax(np.abs(axis_b)))
    plane = [(along + 1) % 3, (along + 2) % 3]
    return np.ascontiguousarray(SIGMAS**2 * moved[np.ix_(plane, plane)])


def cone_vertices_m(axis_b: Vec3, spread_rad2: Float, length_m: float) -> Float:
    """Return apex and rim of a cone about a body axis: shape (1 + RIM, 3), body frame, m.

    Args:
        axis_b: unit vector along a body axis.
        spread_rad2: shape (2, 2), as from `cone_spread_rad`.
        length_m: from apex to rim.
    """
    values, vectors = np.linalg.eigh(spread_rad2)
    half_rad = np.minimum(np.sqrt(np.maximum(values, 0.0)), WIDEST_RAD)
    phase = np.linspace(0.0, 2.0 * math.pi, RIM, endpoint=False)
    tilt = vectors @ (half_rad[:, None] * np.stack([np.cos(phase), np.sin(phase)]))
    angle = np.maximum(np.hypot(tilt[0], tilt[1]), 1e-12)
    along = int(np.argmax(np.abs(axis_b)))
    rim = np.cos(angle)[:, None] * np.array(axis_b)
    rim[:, (along + 1) % 3] += np.sin(angle) * tilt[0] / angle
    rim[:, (along + 2) % 3] += np.sin(angle) * tilt[1] / angle
    return np.vstack([np.zeros(3), length_m * rim])


def cone_faces() -> Float:
    """Return the triangles of `cone_vertices_m`: shape (RIM, 3), indices."""
    rim = np.arange(RIM)
    return np.stack([np.zeros(RIM), 1 + rim, 1 + (rim + 1) % RIM], axis=1)

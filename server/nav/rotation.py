"""Rotations as Hamilton quaternions [w, x, y, z] and matrices; the small kernels everything else is made of.

Scalars in, tuples out: the compiler keeps them in registers, and a caller cannot pass a wrong stride.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.kernel import kernel
from server.nav.types import Float

SMALL_ANGLE_RAD2: Final = 0.04
"""Below this squared angle the series is exact to float64: the next term is angle⁴/1920."""


@kernel("UniTuple(float64, 4)(float64, float64, float64)")
def quat_from_rotvec(x_rad: float, y_rad: float, z_rad: float) -> tuple[float, float, float, float]:
    """Return Exp of a rotation vector, rad, as a quaternion [Solà 2017, eq. 101]."""
    angle2 = x_rad * x_rad + y_rad * y_rad + z_rad * z_rad
    if angle2 < SMALL_ANGLE_RAD2:  # series to rounding: next terms are angle¹⁰/8.2e10 and angle¹⁰/3.7e9
        a = angle2 * 0.25
        scale = 0.5 * (1.0 - a / 6.0 * (1.0 - a / 20.0 * (1.0 - a / 42.0 * (1.0 - a / 72.0))))
        w = 1.0 - a / 2.0 * (1.0 - a / 12.0 * (1.0 - a / 30.0 * (1.0 - a / 56.0)))
        return w, scale * x_rad, scale * y_rad, scale * z_rad
    angle = math.sqrt(angle2)
    scale = math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), scale * x_rad, scale * y_rad, scale * z_rad


@kernel("UniTuple(float64, 4)(float64, float64, float64, float64, float64, float64, float64, float64)")
def quat_mul(
    aw: float, ax: float, ay: float, az: float, bw: float, bx: float, by: float, bz: float
) -> tuple[float, float, float, float]:
    """Return a ⊗ b [Solà 2017, eq. 12]."""
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@kernel("UniTuple(float64, 3)(float64, float64, float64, float64)")
def rotvec_from_quat(w: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return Log of a unit quaternion as a rotation vector, rad, of at most π [Solà 2017, eq. 105]."""
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    norm = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(norm, w) / norm if norm > 1e-9 else 2.0
    return scale * x, scale * y, scale * z


@kernel("UniTuple(float64, 9)(float64, float64, float64, float64)")
def matrix_entries(
    w: float, x: float, y: float, z: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return R_nb row by row for q_nb, so that v_n = R_nb v_b [Solà 2017, eq. 115]."""
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


def _require_unit(q_nb: Float) -> None:
    if q_nb.shape != (4,) or not np.isfinite(q_nb).all() or abs(float(q_nb @ q_nb) - 1.0) > 2e-6:
        raise ValueError(f"q_nb must be 4 finite numbers of unit norm, got {q_nb}; reset the filter, do not rescale")


def matrix_from_quat(q_nb: Float) -> Float:
    """Return R_nb, shape (3, 3), with v_n = R_nb @ v_b [Solà 2017, eq. 115].

    Args:
        q_nb: shape (4,), [w, x, y, z], body to local, unit norm within 1e-6.

    Raises:
        ValueError: q_nb is not finite or not of unit norm; reset the filter, do not rescale.
    """
    _require_unit(q_nb)
    return np.array(matrix_entries(q_nb[0], q_nb[1], q_nb[2], q_nb[3])).reshape(3, 3)


def euler_from_quat(q_nb: Float) -> tuple[float, float, float]:
    """Return (roll, pitch, yaw) in rad, ZYX, yaw clockwise from north in [0, 2π): for people, never for state.

    Args:
        q_nb: shape (4,), [w, x, y, z], body to NED, unit norm within 1e-6.

    Raises:
        ValueError: q_nb is not finite or not of unit norm.
    """
    R = matrix_from_quat(q_nb)
    pitch_rad = math.asin(max(-1.0, min(1.0, -float(R[2, 0]))))
    yaw_rad = math.atan2(R[1, 0], R[0, 0]) % (2.0 * math.pi)
    return math.atan2(R[2, 1], R[2, 2]), pitch_rad, yaw_rad


def quat_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Float:
    """Return q_nb, shape (4,), w ≥ 0, of the ZYX angles in rad (yaw from north, clockwise)."""
    cr, sr = math.cos(roll_rad / 2), math.sin(roll_rad / 2)
    cp, sp = math.cos(pitch_rad / 2), math.sin(pitch_rad / 2)
    cy, sy = math.cos(yaw_rad / 2), math.sin(yaw_rad / 2)
    q = np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )
    return q if q[0] >= 0.0 else -q

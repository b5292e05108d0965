"""Corrections of a three-axis sensor put one after the other: what a board's own parameters and ours come to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from server.nav.rotation import matrix_from_quat, quat_from_euler
from server.nav.types import Float

_EULER_DEG: Final = (
    *((0, 0, yaw) for yaw in range(0, 360, 45)),
    *((180, 0, yaw) for yaw in (0, 45, 90, 135)),
    (0, 180, 0),
    *((180, 0, yaw) for yaw in (225, 270, 315)),
    *((90, 0, yaw) for yaw in (0, 45, 90, 135)),
    *((270, 0, yaw) for yaw in (0, 45, 90, 135)),
    (0, 90, 0),
    (0, 270, 0),
    (0, 180, 90),
    (0, 180, 270),
    *((roll, 90, 0) for roll in (90, 180, 270)),
    *((roll, 180, 0) for roll in (90, 270)),
    *((roll, 270, 0) for roll in (90, 180, 270)),
    (90, 180, 90),
    (90, 0, 270),
)
"""(roll, pitch, yaw) of MAV_SENSOR_ORIENTATION 0 to 37, which ArduPilot and PX4 share."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Affine:
    """out = matrix · (raw − offset); matrix (3, 3), offset (3,) in the unit of the sensor."""

    matrix: Float = field(default_factory=lambda: np.eye(3))
    offset: Float = field(default_factory=lambda: np.zeros(3))

    def after(self, first: Affine) -> Affine:
        """Return the one correction that is `first` and then this one."""
        offset: Float = first.offset + np.linalg.solve(first.matrix, self.offset)
        return Affine(matrix=self.matrix @ first.matrix, offset=offset)

    def inverse(self) -> Affine:
        """Return the correction that undoes this one."""
        matrix: Float = np.linalg.inv(self.matrix).astype(np.float64)
        return Affine(matrix=matrix, offset=-self.matrix @ self.offset)

    def in_axes(self, R_ba: Float) -> Affine:  # b = body, a = the other axes
        """Return the same correction of body vectors for vectors in the axes a, with v_b = R_ba @ v_a."""
        return Affine(matrix=R_ba.T @ self.matrix @ R_ba, offset=R_ba.T @ self.offset)


def rotation_from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Float:
    """Return R = Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3), turned axes to body, as both autopilots' `from_euler`."""
    return matrix_from_quat(quat_from_euler(roll_rad, pitch_rad, yaw_rad))


def euler_from_rotation(R: Float) -> tuple[float, float, float]:
    """Return (roll, pitch, yaw) in rad, yaw in (−π, π], of R = Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = float(np.arcsin(np.clip(-R[2, 0], -1.0, 1.0)))
    return float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))


def board_rotation(number: float) -> Float | None:
    """Return the rotation from sensor to body axes of MAV_SENSOR_ORIENTATION, shape (3, 3); None = not in the table."""
    if number != int(number) or not 0 <= number < len(_EULER_DEG):
        return None
    return rotation_from_euler(*np.radians(_EULER_DEG[int(number)]).tolist()).round(15)


def symmetric(xx_yy_zz: Float, xy_xz_yz: Float) -> Float:
    """Return the symmetric matrix, shape (3, 3), of its diagonal and off-diagonal terms, shape (3,) each."""
    a, b, c = xy_xz_yz
    matrix: Float = np.diag(xx_yy_zz) + np.array([[0.0, a, b], [a, 0.0, c], [b, c, 0.0]])
    return matrix


def off_diagonal(matrix: Float) -> Float:
    """Return (xy, xz, yz), shape (3,), of a symmetric matrix, shape (3, 3)."""
    return np.array([matrix[0, 1], matrix[0, 2], matrix[1, 2]])

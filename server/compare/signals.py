"""What is compared: lane rows as reference rows, angles between attitudes, and when the board was quiet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import uniform_filter1d

from server.nav.types import ROW_WIDTH, Float, Int

QUIET_GYRO_RAD_S: Final = 0.05
QUIET_ACCEL_M_S2: Final = 1.0
"""Standard deviations over a second, below which a second difference shows the estimator and not the motion."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """States by ascending stamp, one row each.

    Attributes:
        t_ns: shape (n,), strictly ascending.
        data: shape (n, ROW_WIDTH), columns as in SAMPLE_COLUMNS[Kind.REFERENCE].
    """

    t_ns: Int
    data: Float

    def within(self, start_ns: int, stop_ns: int) -> Rows:
        """Return the rows with start_ns ≤ t_ns < stop_ns."""
        part = slice(*np.searchsorted(self.t_ns, [start_ns, stop_ns]))
        return Rows(t_ns=self.t_ns[part], data=self.data[part])


def rows_of_lane(t_ns: Int, lane: Float) -> Rows:
    """Return a lane's rows (LANE_COLUMNS) as reference rows; of equal stamps the first stays."""
    unique_ns, first = np.unique(t_ns, return_index=True)
    data = np.full((len(first), ROW_WIDTH), np.nan)
    data[:, :4], data[:, 4:7], data[:, 7:10] = lane[first, :4], lane[first, 7:10], lane[first, 4:7]
    return Rows(t_ns=unique_ns, data=data)


def roll_pitch_yaw(q_nb: Float) -> Float:
    """Return ZYX angles in rad, shape (n, 3), yaw clockwise from north."""
    w, x, y, z = q_nb.T
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    return np.stack([roll, pitch, np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))], axis=1)


def wrapped(angle_rad: Float) -> Float:
    """Return the angles in [−π, π)."""
    return np.asarray(np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi)


def tilt_of(rotation_n_rad: Float) -> Float:
    """Return the angle between the verticals of two attitudes from the NED rotation vector between them.

    cos = R_zz of Exp(φ n) = 1 − (1 − cos φ)(1 − n_z²); unlike the vector's own x and y it does not depend on heading.
    """
    angle = np.linalg.norm(rotation_n_rad, axis=1)
    level = np.hypot(rotation_n_rad[:, 0], rotation_n_rad[:, 1])
    share = np.divide(level, angle, out=np.zeros_like(level), where=angle > 0.0)
    return np.where(np.isnan(angle), np.nan, 2.0 * np.arcsin(np.minimum(np.sin(0.5 * angle) * share, 1.0)))


def body_rates(q_nb: Float, spacing_s: float) -> Float:
    """Return the mean body rates between successive attitudes, shape (n − 1, 3), rad/s."""
    w, v = q_nb[:-1, :1], -q_nb[:-1, 1:]
    W, V = q_nb[1:, :1], q_nb[1:, 1:]
    scalar = w * W - (v * V).sum(axis=1, keepdims=True)
    vector = (w * V + W * v + np.cross(v, V)) * np.where(scalar < 0.0, -1.0, 1.0)
    return np.asarray(2.0 * vector / spacing_s)


def quiet_steps(t_ns: Int, gyro_rad_s: Float, accel_m_s2: Float) -> Float:
    """Return 1 for each navigation step in a quiet second, else 0.

    Args:
        t_ns: shape (n,), stamps of the steps.
        gyro_rad_s: shape (n, 3), body.
        accel_m_s2: shape (n, 3), body.
    """
    if len(t_ns) < 3:
        return np.zeros(len(t_ns))
    length = max(3, round(1e9 / float(np.median(np.diff(t_ns)))))
    calm = [
        _moving_deviation(np.nan_to_num(values, nan=1e3), length) < limit
        for values, limit in ((gyro_rad_s, QUIET_GYRO_RAD_S), (accel_m_s2, QUIET_ACCEL_M_S2))
    ]
    return np.where(calm[0] & calm[1], 1.0, 0.0)


def _moving_deviation(values: Float, length: int) -> Float:
    """Return the standard deviation over a moving window, all axes together."""
    mean = uniform_filter1d(values, length, axis=0, mode="nearest")
    square = uniform_filter1d(values * values, length, axis=0, mode="nearest")
    return np.asarray(np.sqrt(np.maximum(square - mean * mean, 0.0).sum(axis=1)))

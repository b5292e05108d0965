"""Where a board is and how it lies, over time, as sums of smooth strokes with exact derivatives; and the six motions.

A stroke is s(u) = 35u⁴ − 84u⁵ + 70u⁶ − 20u⁷ for u from 0 to 1: speed, acceleration and jerk are zero at both ends, so
the rates of a body that leans into its acceleration are continuous too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.polynomial import Polynomial

from server.nav.types import Float

_STROKE: Final = Polynomial([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
_DERIVATIVES: Final = tuple(_STROKE.deriv(order) if order else _STROKE for order in range(4))


@dataclass(frozen=True, slots=True, kw_only=True)
class Stroke:
    """A change by `size` (m or rad) that begins at `start_s` and takes `length_s`."""

    start_s: float
    length_s: float
    size: float


Channel = tuple[Stroke, ...]


def value(channel: Channel, t_s: Float, order: int = 0) -> Float:
    """Return a channel's value (order 0) or its derivative up to the third at the times, shape (n,)."""
    total = np.zeros_like(t_s)
    for stroke in channel:
        u = np.clip((t_s - stroke.start_s) / stroke.length_s, 0.0, 1.0)
        total += stroke.size / stroke.length_s**order * _DERIVATIVES[order](u)
    return total


def there_and_back(start_s: float, length_s: float, hold_s: float, size: float) -> Channel:
    """Return a stroke, a pause, and the stroke back."""
    away = Stroke(start_s=start_s, length_s=length_s, size=size)
    return away, Stroke(start_s=start_s + length_s + hold_s, length_s=length_s, size=-size)


def repeated(start_s: float, length_s: float, hold_s: float, size: float, times: int, rest_s: float = 0.0) -> Channel:
    """Return `times` strokes there and back, `rest_s` apart."""
    period_s = 2.0 * (length_s + hold_s) + rest_s
    pairs = (there_and_back(start_s + k * period_s, length_s, hold_s, size) for k in range(times))
    return tuple(stroke for pair in pairs for stroke in pair)


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """One motion: place NED in m from the site, roll, pitch and heading in rad.

    Attributes:
        leaning: a multirotor's: pitch is not given but follows from the acceleration along north and down, because
            it can push along its own −z only.
    """

    duration_s: float
    north: Channel = ()
    east: Channel = ()
    down: Channel = ()
    roll: Channel = ()
    pitch: Channel = ()
    yaw: Channel = ()
    leaning: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kinematics:
    """A path at given times, one row each.

    Attributes:
        pos_n_m, vel_n_m_s, accel_n_m_s2: shape (n, 3), NED from the site.
        q_nb: shape (n, 4), continuous in sign.
        R_nb: shape (n, 3, 3).
        rate_b_rad_s: shape (n, 3), of the body against NED.
    """

    pos_n_m: Float
    vel_n_m_s: Float
    accel_n_m_s2: Float
    q_nb: Float
    R_nb: Float
    rate_b_rad_s: Float


def kinematics(path: Path, t_s: Float, gravity_m_s2: float) -> Kinematics:
    """Return the path's place, attitude and exact derivatives at the times, shape (n,)."""
    place = (path.north, path.east, path.down)
    accel = np.column_stack([value(channel, t_s, 2) for channel in place])
    roll, roll_rate = value(path.roll, t_s), value(path.roll, t_s, 1)
    yaw, yaw_rate = value(path.yaw, t_s), value(path.yaw, t_s, 1)
    pitch, pitch_rate = value(path.pitch, t_s), value(path.pitch, t_s, 1)
    if path.leaning:  # f_n = −T (sin θ, 0, cos θ): θ = atan2(−a_n, g − a_d), and its derivative by the jerk
        x, y = gravity_m_s2 - accel[:, 2], -accel[:, 0]
        pitch = np.arctan2(y, x)
        pitch_rate = (-x * value(path.north, t_s, 3) + y * value(path.down, t_s, 3)) / (x * x + y * y)
    rate = np.column_stack([  # ZYX angles' rates in the body [Titterton & Weston, eq. 3.54 solved for ω]
        roll_rate - yaw_rate * np.sin(pitch),
        pitch_rate * np.cos(roll) + yaw_rate * np.cos(pitch) * np.sin(roll),
        yaw_rate * np.cos(pitch) * np.cos(roll) - pitch_rate * np.sin(roll),
    ])  # fmt: skip
    q = _quaternions(roll, pitch, yaw)
    return Kinematics(
        pos_n_m=np.column_stack([value(channel, t_s) for channel in place]),
        vel_n_m_s=np.column_stack([value(channel, t_s, 1) for channel in place]),
        accel_n_m_s2=accel,
        q_nb=q,
        R_nb=_matrices(q),
        rate_b_rad_s=rate,
    )


def _quaternions(roll: Float, pitch: Float, yaw: Float) -> Float:
    """Return q_nb of ZYX angles in rad, shape (n, 4)."""
    cr, sr, cp, sp = np.cos(roll / 2), np.sin(roll / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    cy, sy = np.cos(yaw / 2), np.sin(yaw / 2)
    return np.column_stack([
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ])  # fmt: skip


def _matrices(q: Float) -> Float:
    """Return R_nb of unit quaternions, shape (n, 3, 3)."""
    w, x, y, z = q.T
    return np.stack([
        np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)]),
        np.column_stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)]),
        np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]),
    ], axis=1)  # fmt: skip


REST_S: Final = 12.0
"""At rest first, for the alignment and the zeros, and about as long at the end."""


def _alternating(start_s: float, length_s: float, size: float, times: int) -> Channel:
    """Return swings between −size and +size, which half swings lead to and from."""
    swings = (
        Stroke(start_s=start_s + (k + 1) * length_s, length_s=length_s, size=2.0 * size * (-1.0) ** (k + 1))
        for k in range(2 * times - 1)
    )
    first = Stroke(start_s=start_s, length_s=length_s, size=size)
    return first, *swings, Stroke(start_s=start_s + 2 * times * length_s, length_s=length_s, size=size)


def _aggressive() -> Path:
    """Climb to 20 m; 40 s of dashes of 12 m back and forth and bobs of 1 m about the height held; down again."""
    dashes_s = REST_S + 14.0
    climb = there_and_back(REST_S, 10.0, 48.0, -20.0)
    return Path(
        duration_s=REST_S + 68.0 + REST_S,
        north=repeated(dashes_s, 2.5, 0.0, 12.0, 8),
        down=(*climb, *repeated(dashes_s, 1.25, 0.0, -1.0, 16)),
        leaning=True,
    )


PATHS: Final[dict[str, Path]] = {
    "slow_tilt": Path(
        duration_s=76.0,
        roll=there_and_back(REST_S, 8.0, 4.0, math.radians(60.0)),
        pitch=there_and_back(REST_S + 26.0, 8.0, 4.0, math.radians(60.0)),
    ),
    "fast_tilt": Path(
        duration_s=64.0,
        roll=repeated(REST_S, 0.3, 2.0, math.radians(60.0), 4, rest_s=2.0),
        pitch=repeated(REST_S + 28.0, 0.3, 2.0, math.radians(-60.0), 2, rest_s=2.0),
    ),
    "translation": Path(
        duration_s=60.0,
        north=repeated(REST_S, 0.8, 0.4, 0.5, 6, rest_s=0.5),
        east=repeated(REST_S + 19.0, 0.8, 0.4, 0.5, 6, rest_s=0.5),
    ),
    "repeated_tilt": Path(
        duration_s=56.0,
        roll=_alternating(REST_S, 0.5, math.radians(35.0), 12),
        pitch=_alternating(REST_S + 15.0, 0.5, math.radians(35.0), 12),
    ),
    "repeated_lift": Path(
        duration_s=60.0,
        down=repeated(REST_S, 0.6, 0.6, -0.4, 10, rest_s=1.0),
        roll=repeated(REST_S, 0.6, 0.6, math.radians(6.0), 10, rest_s=1.0),
    ),
    "altitude": _aggressive(),
}
"""S4's five motions, in the order of its table, and S3's flight."""

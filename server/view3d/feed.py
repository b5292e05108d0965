"""What the 3D view needs of a board, and one lane's state as the scene wants it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Protocol

from server.hub import Hub
from server.nav.types import LANE_COLUMNS, Float, Snapshot

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]

MAIN_LANE: Final = "ins_ekf"
"""The estimator that stands in where the chosen main lane has no position."""

PASS_THROUGH: Final = frozenset({"onboard", "reference"})
"""Lanes that estimate nothing: unless chosen as the main one, followed only while no estimator has a position."""

IDENTITY: Final[Quat] = (1.0, 0.0, 0.0, 0.0)
ORIGIN: Final[Vec3] = (0.0, 0.0, 0.0)
_Q = LANE_COLUMNS.index("q_w")
_VEL = LANE_COLUMNS.index("vel_n_m_s")
_SIGMA_ATT = LANE_COLUMNS.index("sigma_att_x_rad")
_SIGMA_POS = LANE_COLUMNS.index("sigma_pos_n_m")
_POS = LANE_COLUMNS.index("pos_n_m")


class BoardFeed(Protocol):
    """The part of a board that the 3D view reads."""

    @property
    def id(self) -> str:
        """Stable key of the board, as in URLs."""
        ...

    @property
    def hub(self) -> Hub:
        """The board's topics; `results` is subscribed to only while somebody looks."""
        ...

    @property
    def main_lane(self) -> str:
        """The lane chosen as the main one; it may have no position, or not run yet."""
        ...

    @property
    def mag_scale(self) -> float:
        """Factor from the board's magnetic field to gauss; 0 while it is not known."""
        ...

    def snapshot(self) -> Snapshot | None:
        """The newest state of every lane; None before the first."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """State of one lane, unknown values NaN.

    Attributes:
        q_nb: body to NED; the identity while unknown.
        turned: whether the attitude is known.
        pos_n_m: NED from the site; the origin while unknown.
        sigma_att_rad: 1 σ of the error rotation vector in NED; z is heading.
        sigma_pos_n_m: 1 σ along north, east, down.
        known: whether position is known.
    """

    q_nb: Quat
    pos_n_m: Vec3
    speed_m_s: float
    sigma_att_rad: Vec3
    sigma_pos_n_m: Vec3
    known: bool
    turned: bool = True


def pose_from_row(row: Float) -> Pose:
    """Return the pose in one row of `LANE_COLUMNS`, shape (len(LANE_COLUMNS),)."""
    values: list[float] = row.tolist()
    q_nb, pos_n_m = tuple(values[_Q : _Q + 4]), _vec3(values, _POS)
    known, turned = all(map(math.isfinite, pos_n_m)), all(map(math.isfinite, q_nb))
    return Pose(
        q_nb=(q_nb[0], q_nb[1], q_nb[2], q_nb[3]) if turned else IDENTITY,
        pos_n_m=pos_n_m if known else ORIGIN,
        speed_m_s=math.hypot(*_vec3(values, _VEL)),
        sigma_att_rad=_vec3(values, _SIGMA_ATT),
        sigma_pos_n_m=_vec3(values, _SIGMA_POS),
        known=known,
        turned=turned,
    )


def _vec3(values: list[float], start: int) -> Vec3:
    return values[start], values[start + 1], values[start + 2]

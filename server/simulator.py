"""What the demo board may be told while it runs, and what it says of itself. Light: loads nothing of the board.

Angles and directions are those of the body (forward, right, down); times are board seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Literal

from server.nav.calibration.types import FACES

AxisName = Literal["x", "y", "z"]
Mode = Literal["flying", "in-hand"]

_DOWN: Final = ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (0.0, 0.0, 1.0))
DOWN_OF: Final[dict[str, tuple[float, float, float]]] = dict(zip(FACES, _DOWN, strict=True))
"""Direction that points down in each face; the specific force there is g the other way, as `FACES` says."""

MAGNET_B_GAUSS: Final = (-0.03, 0.05, 0.26)
"""A screwdriver's worth beside the compass: half the Earth's field, and still to be learned."""
ROOM_N_GAUSS: Final = (0.12, -0.09, 0.10)
"""A loudspeaker in the room, NED: bends and strengthens the field by a third."""
MAX_GAUSS: Final = 2.0
MAX_POSE_NUMBER: Final = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Lay the board so that `down_b` points down, by the shortest way.

    Attributes:
        down_b: any length but 0, body FRD.
        name: a face of `FACES`, or how else people call it; only shown.
        is_held: it stays in the hand, which trembles, instead of on the table.
    """

    down_b: tuple[float, float, float]
    name: str = ""
    is_held: bool = False

    def __post_init__(self) -> None:
        """Refuse what is no direction."""
        _need(_finite(self.down_b) and math.hypot(*self.down_b) > 1e-6, "down_b", self.down_b, "a direction, not zero")


@dataclass(frozen=True, slots=True, kw_only=True)
class Spin:
    """Turn the board on one spot for the magnetometer.

    Attributes:
        duration_s: at most; a rest of it too short for another spiral is left out.
        about: "" = every direction of the field in the body within 40 s; an axis = that one only, kept upright.
    """

    duration_s: float = 40.0
    about: Literal["x", "y", "z", ""] = ""

    def __post_init__(self) -> None:
        """Refuse what no hand does."""
        _between("duration_s", self.duration_s, 5.0, 300.0, "s")


@dataclass(frozen=True, slots=True, kw_only=True)
class Turntable:
    """Lay the board with an axis upright, rest, turn by whole turns, rest.

    Attributes:
        turns: positive about +axis, negative the other way; not 0.
        rest_s: how long it lies still before the turning.
    """

    axis: AxisName = "z"
    turns: int = 2
    rate_rad_s: float = 1.5
    rest_s: float = 5.0

    def __post_init__(self) -> None:
        """Refuse what the table cannot do."""
        _need(self.turns != 0 and abs(self.turns) <= 50, "turns", self.turns, "a whole number from -50 to 50, not 0")
        _between("rate_rad_s", self.rate_rad_s, 0.1, 10.0, "rad/s")
        _between("rest_s", self.rest_s, 0.0, 60.0, "s")


@dataclass(frozen=True, slots=True, kw_only=True)
class Shake:
    """Shake the board in the hand, in the pose in which it is; `strength_m_s2` RMS per axis."""

    duration_s: float = 5.0
    strength_m_s2: float = 2.0

    def __post_init__(self) -> None:
        """Refuse what no hand does."""
        _between("duration_s", self.duration_s, 0.5, 120.0, "s")
        _between("strength_m_s2", self.strength_m_s2, 0.05, 20.0, "m/s²")


@dataclass(frozen=True, slots=True, kw_only=True)
class Magnet:
    """Stick a magnet to the body, or take it off; flying or not."""

    is_on: bool
    field_b_gauss: tuple[float, float, float] = MAGNET_B_GAUSS

    def __post_init__(self) -> None:
        """Refuse what is no field."""
        _field("field_b_gauss", self.field_b_gauss)


@dataclass(frozen=True, slots=True, kw_only=True)
class RoomMagnet:
    """Bring iron near that stays where it is when the board turns, or take it away; flying or not."""

    is_on: bool
    field_n_gauss: tuple[float, float, float] = ROOM_N_GAUSS

    def __post_init__(self) -> None:
        """Refuse what is no field."""
        _field("field_n_gauss", self.field_n_gauss)


@dataclass(frozen=True, slots=True, kw_only=True)
class WindOnPitot:
    """Have gusts blow into the pressure tube, or cover it."""

    is_on: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Fly:
    """Put the board back on its place of departure and begin the flight anew; the clock goes on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DropLink:
    """Hear and say nothing for a while, as a board out of radio range; it lives on meanwhile. Host seconds."""

    duration_s: float = 6.0

    def __post_init__(self) -> None:
        """Refuse what would look like a dead board."""
        _between("duration_s", self.duration_s, 0.1, 60.0, "s")


Motion = Pose | Spin | Turntable | Shake | Fly
Surrounding = Magnet | RoomMagnet | WindOnPitot
Command = Motion | Surrounding | DropLink


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatorState:
    """What the demo board does now.

    Attributes:
        mode: "flying" its endless flight, or "in-hand" at the place of departure.
        action: the newest motion asked for: "pose", "spin", "turntable", "shake", "fly"; "" before the first.
        name: of the pose that it has or is going to, "" when it has none.
        is_moving: by a hand or on the table; False at rest and while flying.
        remaining_s: until the action is done, 0 when it is.
        q_nb: attitude, shape (4,), w ≥ 0.
        down_b: direction that points down, body FRD.
        magnet_b_gauss, room_n_gauss: () = off.
        has_airspeed: it has a pressure tube (`errors=raw`).
        is_uncalibrated: its sensors have the errors they left the factory with (`errors=raw`).
        link_back_s: host seconds until it speaks again, 0 when it does.
    """

    mode: Mode = "flying"
    action: str = ""
    name: str = ""
    is_moving: bool = False
    remaining_s: float = 0.0
    q_nb: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)
    down_b: tuple[float, ...] = (0.0, 0.0, 1.0)
    magnet_b_gauss: tuple[float, ...] = field(default=())
    room_n_gauss: tuple[float, ...] = field(default=())
    is_wind_on_pitot: bool = False
    has_airspeed: bool = False
    is_uncalibrated: bool = False
    link_back_s: float = 0.0


def face_pose(face: str, *, is_held: bool = False) -> Pose:
    """Return the pose of one of `FACES`.

    Raises:
        ValueError: there is no such face.
    """
    _need(face in DOWN_OF, "face", face, f"one of {', '.join(FACES)}")
    return Pose(down_b=DOWN_OF[face], name=face, is_held=is_held)


def numbered_pose(number: int, *, is_held: bool = False) -> Pose:
    """Return one of a row of poses whose first n, for any n, are spread over all directions.

    The points of the R2 sequence, carried to the sphere by the map that keeps areas.

    Raises:
        ValueError: the number is not from 1 to 1000.
    """
    _need(1 <= number <= MAX_POSE_NUMBER, "number", number, f"a whole number from 1 to {MAX_POSE_NUMBER}")
    z = 1.0 - 2.0 * ((0.5 + number * 0.7548776662466927) % 1.0)
    angle, r = 2.0 * math.pi * ((number * 0.5698402909980532) % 1.0), math.sqrt(1.0 - z * z)
    return Pose(down_b=(r * math.cos(angle), r * math.sin(angle), z), name=f"pose {number}", is_held=is_held)


def _finite(values: tuple[float, ...]) -> bool:
    return all(math.isfinite(value) for value in values)


def _field(name: str, field_gauss: tuple[float, ...]) -> None:
    good = _finite(field_gauss) and math.hypot(*field_gauss) <= MAX_GAUSS
    _need(good, name, field_gauss, f"a field of at most {MAX_GAUSS:g} gauss")


def _between(name: str, value: float, least: float, most: float, unit: str) -> None:
    _need(least <= value <= most, name, value, f"from {least:g} to {most:g} {unit}")


def _need(holds: bool, name: str, value: object, allowed: str) -> None:
    if not holds:
        raise ValueError(f"{name} = {value!r} is not {allowed}")

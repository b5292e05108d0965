"""Bodies about the demo board in the hand: what it may be told, and what it does."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from server.simulator import (
    MAGNET_B_GAUSS,
    MAX_GAUSS,
    MAX_POSE_NUMBER,
    ROOM_N_GAUSS,
    AxisName,
    Command,
    DropLink,
    Fly,
    Magnet,
    Mode,
    Pose,
    RoomMagnet,
    Shake,
    Spin,
    Turntable,
    WindOnPitot,
    face_pose,
    numbered_pose,
)
from server.wire_base import In, Out

FaceName = Literal["nose-up", "nose-down", "right-up", "left-up", "upside-down", "level"]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Vector = tuple[Number, Number, Number]
Component = Annotated[float, Field(strict=True, ge=-MAX_GAUSS / 2, le=MAX_GAUSS / 2)]
Field3 = tuple[Component, Component, Component]


class PoseIn(In):
    """Lay the board: on a face, with a direction down, or in the n-th of a row of poses spread over all directions."""

    action: Literal["pose"]
    face: FaceName | None = None
    down_b: Vector | None = Field(None, description="points down then; body FRD, any length but 0")
    number: int | None = Field(None, strict=True, ge=1, le=MAX_POSE_NUMBER)
    is_held: bool = Field(False, description="stay in the hand, which trembles, instead of on the table")

    @model_validator(mode="after")
    def _one_of_three(self) -> Self:
        if sum(one is not None for one in (self.face, self.down_b, self.number)) != 1:
            raise ValueError("give exactly one of face, down_b and number")
        if self.down_b is not None:
            self.command()
        return self

    def command(self) -> Command:
        """Return what it asks for."""
        if self.face is not None:
            return face_pose(self.face, is_held=self.is_held)
        if self.number is not None:
            return numbered_pose(self.number, is_held=self.is_held)
        return Pose(down_b=self.down_b or (0.0, 0.0, 0.0), name="direction", is_held=self.is_held)


class SpinIn(In):
    """Turn the board for the magnetometer: all ways within 40 s, or about one axis only."""

    action: Literal["spin"]
    duration_s: float = Field(40.0, strict=True, ge=5.0, le=300.0)
    about: AxisName | None = Field(None, description="null = every direction")

    def command(self) -> Command:
        """Return what it asks for."""
        return Spin(duration_s=self.duration_s, about=self.about or "")


class TurntableIn(In):
    """Lay the board with an axis upright, rest, turn by whole turns, rest."""

    action: Literal["turntable"]
    axis: AxisName = "z"
    turns: int = Field(2, strict=True, ge=-50, le=50, description="negative = the other way; not 0")
    rate_rad_s: float = Field(1.5, strict=True, ge=0.1, le=10.0)
    rest_s: float = Field(5.0, strict=True, ge=0.0, le=60.0, description="before the turning")

    @model_validator(mode="after")
    def _turns(self) -> Self:
        self.command()
        return self

    def command(self) -> Command:
        """Return what it asks for."""
        return Turntable(axis=self.axis, turns=self.turns, rate_rad_s=self.rate_rad_s, rest_s=self.rest_s)


class ShakeIn(In):
    """Shake the board in the pose in which it is."""

    action: Literal["shake"]
    duration_s: float = Field(5.0, strict=True, ge=0.5, le=120.0)
    strength_m_s2: float = Field(2.0, strict=True, ge=0.05, le=20.0, description="RMS per axis")

    def command(self) -> Command:
        """Return what it asks for."""
        return Shake(duration_s=self.duration_s, strength_m_s2=self.strength_m_s2)


class MagnetIn(In):
    """Stick a magnet to the body, or take it off; in flight as well."""

    action: Literal["magnet"]
    is_on: bool = Field(strict=True)
    field_b_gauss: Field3 = MAGNET_B_GAUSS

    def command(self) -> Command:
        """Return what it asks for."""
        return Magnet(is_on=self.is_on, field_b_gauss=self.field_b_gauss)


class RoomMagnetIn(In):
    """Bring iron near that stays where it is when the board turns, or take it away; in flight as well."""

    action: Literal["room_magnet"]
    is_on: bool = Field(strict=True)
    field_n_gauss: Field3 = ROOM_N_GAUSS

    def command(self) -> Command:
        """Return what it asks for."""
        return RoomMagnet(is_on=self.is_on, field_n_gauss=self.field_n_gauss)


class WindOnPitotIn(In):
    """Have gusts blow into the pressure tube, or cover it; `sim:?errors=raw` only."""

    action: Literal["wind_on_pitot"]
    is_on: bool = Field(strict=True)

    def command(self) -> Command:
        """Return what it asks for."""
        return WindOnPitot(is_on=self.is_on)


class FlyIn(In):
    """Put the board back on its place of departure and begin the flight anew; nothing while it flies."""

    action: Literal["fly"]

    def command(self) -> Command:
        """Return what it asks for."""
        return Fly()


class DropLinkIn(In):
    """Have the board hear and say nothing for a while; it lives on meanwhile."""

    action: Literal["drop_link"]
    duration_s: float = Field(6.0, strict=True, ge=0.1, le=60.0)

    def command(self) -> Command:
        """Return what it asks for."""
        return DropLink(duration_s=self.duration_s)


SimulatorIn = Annotated[
    PoseIn | SpinIn | TurntableIn | ShakeIn | MagnetIn | RoomMagnetIn | WindOnPitotIn | FlyIn | DropLinkIn,
    Field(discriminator="action"),
]
"""One thing to do; motions take the board out of its flight, the others do not."""


class SimulatorOut(Out):
    """What the demo board does now; times in board seconds unless said."""

    board_id: str
    mode: Mode = Field(description="its endless flight, or in the hand at the place of departure")
    action: str = Field(description='newest motion asked for: pose, spin, turntable, shake, fly; "" before the first')
    name: str = Field(description='of the pose it has or goes to, "" = none')
    is_moving: bool = Field(description="by hand or table; false at rest and while flying")
    remaining_s: float = Field(description="until the action is done; 0 = it is")
    q_nb: tuple[float, ...] = Field(description="true attitude")
    down_b: tuple[float, ...] = Field(description="direction that points down, body FRD")
    magnet_b_gauss: tuple[float, ...] = Field(description="[] = off")
    room_n_gauss: tuple[float, ...] = Field(description="[] = off")
    is_wind_on_pitot: bool
    has_airspeed: bool = Field(description="it has a pressure tube: sim:?errors=raw")
    is_uncalibrated: bool = Field(description="its sensors err as they left the factory: sim:?errors=raw")
    link_back_s: float = Field(description="host seconds until it speaks again; 0 = it does")

"""Bodies about the service itself: who is asking, ports, settings, doctor."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from server.wire_base import In, Out, Role


class InfoOut(Out):
    """The service and who is asking."""

    name: str = "navdeck"
    version: str
    role: Role
    auth_required: bool = Field(description="tokens are configured, so a session can be closed again")
    view3d: bool = Field(description="the 3D scene is served at /view/")
    uptime_s: float
    ready: bool


class SessionIn(In):
    """The token a person typed once."""

    token: str = Field(min_length=1, max_length=512)


class SessionOut(Out):
    """What the cookie that came with this answer allows."""

    role: Role
    expires_s: float


class PortOut(Out):
    """A serial port of the host and, if it cannot be used, why not."""

    device: str
    by_id: str
    description: str
    in_use_by: str
    usable: bool
    code: str
    cause: str
    remedy: str
    url: str = Field(description="what to send to POST /api/v1/boards")


class PortsOut(Out):
    """The serial ports of the host."""

    ports: tuple[PortOut, ...]


class SettingOut(Out):
    """One setting; a secret shows only whether it is set."""

    name: str
    value: Any
    default: Any
    unit: str
    description: str
    source: Literal["default", "file", "environment", "flag"]


class SettingsOut(Out):
    """Every setting as this process runs with it."""

    settings: tuple[SettingOut, ...]
    file: str = Field(description='the settings file that was read; "" when none')


class CheckOut(Out):
    """One line of the doctor."""

    name: str
    state: Literal["ok", "caution", "problem"]
    cause: str
    remedy: str


class DoctorOut(Out):
    """What is wrong with this set-up."""

    state: Literal["ok", "caution", "problem"]
    checks: tuple[CheckOut, ...]

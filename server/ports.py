"""Every serial port of this machine and why it is not in use; looks only, opens none (opening may reset a board)."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports as pyserial_ports
from serial.tools.list_ports_common import ListPortInfo

from server.link.causes import explain
from server.link.find import Finder, name_of


@dataclass(frozen=True, slots=True, kw_only=True)
class PortInfo:
    """One serial port.

    Attributes:
        device: its name, e.g. /dev/ttyACM0.
        by_id: its lasting name under /dev/serial/by-id, "" without one: the one to use in a link.
        vid, pid: USB vendor and product, -1 when it is not on USB.
        in_use_by: who holds it, as far as this user may see; "navdeck itself" for this very process.
        usable: it may be opened now. Another user's program that holds it is not visible here.
        code, cause, remedy: why it is not usable (a key of `server.link.causes.CAUSES`); empty when it is.
    """

    device: str
    by_id: str = ""
    description: str = ""
    vid: int = -1
    pid: int = -1
    serial_number: str = ""
    in_use_by: str = ""
    usable: bool = True
    code: str = ""
    cause: str = ""
    remedy: str = ""

    @property
    def url(self) -> str:
        """The link that opens it, by its lasting name where it has one."""
        return f"serial://{self.by_id or self.device}"


def list_ports(finder: Finder | None = None) -> list[PortInfo]:
    """Return every port, boards first; blocks for some milliseconds (reads /proc and /sys)."""
    finder = finder or Finder()
    known = {os.path.realpath(port.device): port for port in pyserial_ports.comports()} if finder == Finder() else {}
    links = {link.resolve(): link for link in reversed(finder.by_id_links())}
    devices = list(dict.fromkeys([*(device.resolve() for device in finder.boards()), *map(Path, known)]))
    return [_port(device, links.get(device), known.get(str(device)), finder) for device in devices]


def _port(device: Path, by_id: Path | None, known: ListPortInfo | None, finder: Finder) -> PortInfo:
    holders = finder.holders(device)
    holder = ", ".join(name_of(pid, name) for pid, name in holders)
    code, details = _refusal(device, holders)
    _, cause, remedy = explain(code, details) if code else (None, "", "")
    return PortInfo(
        device=str(device),
        by_id=str(by_id or ""),
        description=_description(known, by_id),
        vid=_number(known.vid if known else None),
        pid=_number(known.pid if known else None),
        serial_number=(known.serial_number or "") if known else "",
        in_use_by=holder,
        usable=not code,
        code=code,
        cause=cause,
        remedy=remedy,
    )


def _refusal(device: Path, holders: list[tuple[int, str]]) -> tuple[str, dict[str, str]]:
    """Return why a port cannot be opened, as a code with details; "" when it can."""
    if not device.exists():
        return "port-missing", {"device": str(device)}
    if not os.access(device, os.R_OK | os.W_OK, effective_ids=os.access in os.supports_effective_ids):
        from server.link.tty import group_of

        return "no-permission", {"device": str(device), "group": group_of(device)}
    if any(pid == os.getpid() for pid, _ in holders):
        return "in-use-here", {"device": str(device)}
    if holders:
        return "port-busy", {"device": str(device), "holder": ", ".join(name_of(*holder) for holder in holders)}
    return "", {}


def _description(known: ListPortInfo | None, by_id: Path | None) -> str:
    if known is not None and known.description not in ("", "n/a"):
        return str(known.description)
    return by_id.name.removeprefix("usb-") if by_id else ""


def _number(value: object) -> int:
    return value if isinstance(value, int) else -1

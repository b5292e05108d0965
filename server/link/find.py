"""Which serial devices there are, which of them is the one that was unplugged, and who holds a port.

A board is known again by what does not change when it gets another port name: its entry in /dev/serial/by-id, else
(no udev, as in most containers) its USB vendor, product, serial number and interface from sysfs.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_BOARD_PORTS: Final = ("ttyACM*", "ttyUSB*", "cu.usbmodem*", "cu.usbserial*")
_FLIGHT_NAMES: Final = re.compile("ardupilot|px4|pixhawk|cube|holybro|cuav|matek|3d_?robotics|autopilot|kakute", re.I)
"""Names that autopilots give themselves on USB: `auto` tries these before any other serial device."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finder:
    """Looks for devices; the folders are arguments so that tests can stand in for a machine.

    Attributes:
        by_id: folder of links named after the device, made by udev.
        dev: folder of the device nodes.
        sys_tty: folder where the kernel describes every tty.
        proc: folder where the kernel describes every process.
    """

    by_id: Path = Path("/dev/serial/by-id")
    dev: Path = Path("/dev")
    sys_tty: Path = Path("/sys/class/tty")
    proc: Path = Path("/proc")

    def by_id_links(self) -> list[Path]:
        """Return the udev links in order of name, dangling ones left out."""
        try:
            return sorted(link for link in self.by_id.iterdir() if link.exists())
        except OSError:
            return []

    def identity(self, device: Path) -> str:
        """Return what stays the same under another port name: a by-id name, `usb:…`, or "" when nothing is known."""
        real = device.resolve()
        for link in self.by_id_links():
            if link.resolve() == real:
                return link.name
        return self._usb_identity(real)

    def find(self, identity: str) -> Path | None:
        """Return the device of this identity under its present name, or None when it is not plugged in."""
        for device in (*self.by_id_links(), *self.plain_ports()):
            if identity in (device.name, self._usb_identity(device.resolve())):
                return device
        return None

    def plain_ports(self) -> list[Path]:
        """Return the device nodes of USB serial ports, with or without udev's links."""
        return [node for pattern in _BOARD_PORTS for node in sorted(self.dev.glob(pattern), key=_natural)]

    def boards(self) -> list[Path]:
        """Return what may be a board, likeliest first and each device once: autopilots by name, other links, nodes."""
        links = sorted(self.by_id_links(), key=lambda link: (not _FLIGHT_NAMES.search(link.name), link.name))
        found: dict[Path, Path] = {}
        for device in (*links, *self.plain_ports()):
            found.setdefault(device.resolve(), device)
        return list(found.values())

    def holder(self, device: Path) -> str:
        """Return who has the device open, e.g. "mavproxy.py (process 812)"; "" when nobody this user may see."""
        return ", ".join(name_of(pid, name) for pid, name in self.holders(device))

    def holders(self, device: Path) -> list[tuple[int, str]]:
        """Return (pid, name) of each process that has the device open, as far as this user may see."""
        real = os.path.realpath(device)
        return [(int(process.name), _name(process)) for process in self._processes() if real in _open_files(process)]

    def _processes(self) -> Iterator[Path]:
        try:
            yield from (entry for entry in self.proc.iterdir() if entry.name.isdecimal())
        except OSError:
            return

    def _usb_identity(self, real: Path) -> str:
        interface = (self.sys_tty / real.name / "device").resolve()
        for usb in (interface.parent, interface.parent.parent):  # cdc-acm, usb-serial
            serial = _line(usb / "serial")
            if serial:
                vendor, product = _line(usb / "idVendor"), _line(usb / "idProduct")
                number = _line(interface / "bInterfaceNumber") or _line(interface.parent / "bInterfaceNumber")
                return f"usb:{vendor}:{product}:{serial}:{number}"
        return ""


def name_of(pid: int, name: str) -> str:
    """Return a process in words."""
    return "navdeck itself" if pid == os.getpid() else f"{name} (process {pid})"


def _natural(node: Path) -> list[str | int]:
    """Sort ttyACM2 before ttyACM10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", node.name)]


def _line(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""


def _name(process: Path) -> str:
    return _line(process / "comm") or "a process"


def _open_files(process: Path) -> Iterator[str]:
    try:
        entries = list((process / "fd").iterdir())
    except OSError:  # another user's, or gone meanwhile
        return
    for entry in entries:
        try:
            yield os.readlink(entry)
        except OSError:
            continue

"""A serial device opened for a board: exclusive, raw, 8N1, without stale input, and without resetting the board.

DTR and RTS are raised by opening and stay as they are: many boards send on USB only while DTR is up, and boards that
reset do so when it falls. So it is never lowered here, not even by closing (HUPCL is cleared); what remains is that
the very first opening after plugging in may reset an Arduino-like board once, as any program would.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import grp
import os
import termios
import time
from pathlib import Path
from typing import Final

import serial

from server.link.causes import Trouble
from server.link.find import Finder

_READ_ROOM: Final = 16_384
_SETTLE_S: Final = 0.02
"""What arrives this soon after opening was waiting in the device or the kernel; it is old and is thrown away."""

_GONE: Final = {errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO}
_DENIED: Final = {errno.EACCES, errno.EPERM}
_HELD: Final = {errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK}


class Tty:
    """An open serial device as a non-blocking `Source`."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self._fd: int = port.fileno()

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._fd

    def read_now(self) -> bytes:
        """Return what is there; empty after a hang-up."""
        return os.read(self._fd, _READ_ROOM)

    def write_now(self, data: bytes) -> int:
        """Return how many bytes the kernel took."""
        return os.write(self._fd, data)

    def close(self) -> None:
        """Release the port at once: what is not sent yet is not waited for."""
        with contextlib.suppress(OSError, termios.error):
            fcntl.ioctl(self._fd, termios.TIOCNXCL)
            termios.tcflush(self._fd, termios.TCOFLUSH)
        self._port.close()


def open_tty(device: Path, baud: int, finder: Finder) -> Tty:
    """Return the device, open and quiet; blocks for about 20 ms.

    Raises:
        Trouble: it cannot be opened; says why, and who holds it.
    """
    port = serial.Serial(None, baudrate=baud, timeout=0, write_timeout=0, exclusive=True)
    port.port = str(device)
    try:
        port.open()
    except (serial.SerialException, OSError, ValueError, termios.error) as error:
        raise _trouble(error, device, baud, finder) from error
    try:
        _configure(port.fileno())
        discard_stale(port.fileno())
    except (OSError, termios.error) as error:
        port.close()
        raise _trouble(error, device, baud, finder) from error
    return Tty(port)


def _configure(fd: int) -> None:
    """Take the port for us alone; keep DTR when closing; let an empty read say "nothing yet", not "gone"."""
    fcntl.ioctl(fd, termios.TIOCEXCL)
    settings = termios.tcgetattr(fd)
    settings[2] &= ~termios.HUPCL
    settings[6][termios.VMIN] = 1  # pyserial's 0 makes a non-blocking read of nothing look like a hang-up
    settings[6][termios.VTIME] = 0
    termios.tcsetattr(fd, termios.TCSANOW, settings)


def discard_stale(fd: int) -> None:
    """Throw away what waits in the kernel and what the device still had in its own buffers."""
    termios.tcflush(fd, termios.TCIFLUSH)
    until = time.monotonic() + _SETTLE_S
    while time.monotonic() < until:
        try:
            if not os.read(fd, _READ_ROOM):
                raise OSError(errno.EIO, "hung up")
        except BlockingIOError:
            time.sleep(_SETTLE_S / 10)


def _trouble(error: Exception, device: Path, baud: int, finder: Finder) -> Trouble:
    number = getattr(error, "errno", None) or 0
    name = str(device)
    if number in _HELD:
        return Trouble("port-busy", device=name, holder=finder.holder(device) or "another program")
    if number in _DENIED:
        return Trouble("no-permission", device=name, group=group_of(device))
    if number in _GONE:
        return Trouble("port-missing", device=name)
    if isinstance(error, ValueError):
        return Trouble("baud-refused", device=name, baud=str(baud))
    return Trouble("not-a-port", device=name, error=str(error))


def group_of(device: Path) -> str:
    """Return the name of the group that may use the device; Debian's own when it cannot be told."""
    try:
        group = grp.getgrgid(device.stat().st_gid).gr_name
    except (OSError, KeyError):
        return "dialout"
    return "dialout" if group == "root" else group

"""A board on the desk without a board: a pseudo-terminal that says what a recorded board said, at its pace."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import math
import os
import select
import struct
import termios
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np

from server.link.tlog import read_tlog, schedule_s

_SLEEP_S: Final = 0.002
"""Shortest sleep. Frames due within it leave one after another, each in a write of its own as a board does."""

_CHECK_S: Final = 0.1
"""How often a long wait looks whether it should stop."""

_PAUSED_S: Final = 1.0
"""Later than this, nobody is reading: the schedule moves, so that a reader that comes back gets no hour in a burst."""

_QUIET_LOOKS: Final = 20  # 10 ms apart: bytes may wait in the kernel where FIONREAD does not see them
_DRAIN_S: Final = 5.0
_FAST_WRITE: Final = 4096


@dataclass(slots=True)
class EmulatorStats:
    """What was said so far.

    Attributes:
        bytes_sent, bytes_received: to the reader, and from it (read and thrown away).
        passes: times the log was played to its end.
        late_s: the latest a frame left after its time, because the reader or the machine was slow.
        paused_s: time the schedule stood still because nobody read.
    """

    bytes_sent: int = 0
    bytes_received: int = 0
    passes: int = 0
    late_s: float = 0.0
    paused_s: float = 0.0


class Emulator:
    """Plays a .tlog through a pseudo-terminal; not a byte is lost, none is echoed.

    It waits for the first byte of its reader unless told to begin at once. It keeps the reader's end open too, so
    readers may come and go; while nobody reads, the terminal fills and the board stands still.
    """

    def __init__(
        self, path: Path | str, *, speed: float = 1.0, loop: bool = False, now: bool = False, link: Path | None = None
    ) -> None:
        """Read the log and open the pseudo-terminal.

        Args:
            path: the .tlog.
            speed: board seconds per second; 0 or infinity is as fast as the reader takes it.
            loop: begin again at the end.
            now: do not wait for the first byte of a reader.
            link: a stable name for the terminal: a symbolic link made here and removed by `close`.

        Raises:
            OSError: the log cannot be read, or the link cannot be made.
            ValueError: it is not a .tlog, or the speed is negative.
        """
        if not speed >= 0.0:
            raise ValueError(f"speed {speed!r} is negative: give a factor such as 1 or 4, or 0 for as fast as it goes.")
        log = read_tlog(path)
        self._data = memoryview(log.data)
        self._fast = speed == 0.0 or math.isinf(speed)
        self._ends = _pieces(log.offsets) if self._fast else log.offsets[1:].tolist()
        self._due_s = np.zeros(len(self._ends)) if self._fast else schedule_s(log.stamps_us) / speed
        self._loop, self._now = loop, now
        self.stats = EmulatorStats()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        self._poll = select.poll()
        self._stop = threading.Event()
        self._tended_s = 0.0
        self._link = link
        if link is not None:
            self._make_link(link)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def run(self, stop: threading.Event | None = None) -> EmulatorStats:
        """Play until the end, or until `stop` is set; returns when the reader has taken everything."""
        self._stop = stop or threading.Event()
        if not self._now:
            self._wait_for_reader()
        while not self._stop.is_set():
            self._play()
            if not self._loop:
                break
        self._wait_until_taken()
        return self.stats

    def close(self) -> None:
        """Unplug: the reader sees its port go away."""
        if self._link is not None and self._link.is_symlink() and os.readlink(self._link) == self.device:
            self._link.unlink()
        for descriptor in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)
        self._master = self._slave = -1

    def _make_link(self, link: Path) -> None:
        if link.is_symlink():
            link.unlink()
        try:
            link.symlink_to(self.device)
        except OSError:
            self._link = None
            self.close()
            raise

    def _wait_for_reader(self) -> None:
        while not self._stop.is_set() and not self.stats.bytes_received:
            self._wait(_CHECK_S)

    def _play(self) -> None:
        """Write every frame once it is due, and sleep between."""
        start_s, count, place = time.monotonic(), len(self._ends), 0
        begun = 0
        while place < count and not self._stop.is_set():
            elapsed_s = time.monotonic() - start_s
            late_s = elapsed_s - float(self._due_s[place])
            if late_s < 0.0:
                self._wait(max(-late_s, _SLEEP_S))
                continue
            if late_s > _PAUSED_S and not self._fast:
                self.stats.paused_s += late_s
                start_s += late_s
                continue
            if not self._fast:
                self.stats.late_s = max(self.stats.late_s, late_s)
            due = int(self._due_s.searchsorted(elapsed_s, side="right"))
            while place < due and not self._stop.is_set():
                self._write(self._data[begun : self._ends[place]])
                begun, place = self._ends[place], place + 1
        self.stats.passes += place == count

    def _write(self, frame: memoryview) -> None:
        """Write all of a frame; while the terminal is full, wait for its reader."""
        while frame and not self._stop.is_set():
            try:
                sent = os.write(self._master, frame)
            except BlockingIOError:
                self._wait(_SLEEP_S, writing=True)
                continue
            self.stats.bytes_sent += sent
            frame = frame[sent:]

    def _wait(self, time_s: float, *, writing: bool = False) -> None:
        """Sleep until there is room or the time is over, throwing away what the reader says meanwhile."""
        self._poll.register(self._master, select.POLLIN | (select.POLLOUT if writing else 0))
        if self._poll.poll(math.ceil(min(time_s, _CHECK_S) * 1e3)):
            self._discard()
        if time.monotonic() - self._tended_s > _CHECK_S:
            self._tend()

    def _discard(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self.stats.bytes_received += len(os.read(self._master, 65_536))

    def _tend(self) -> None:
        """Undo what a reader left behind: an echo would answer with the board's own words; a lock, keep others out."""
        self._tended_s = time.monotonic()
        if termios.tcgetattr(self._slave)[3] & (termios.ECHO | termios.ICANON):
            tty.setraw(self._slave, termios.TCSANOW)
        fcntl.ioctl(self._slave, termios.TIOCNXCL)

    def _wait_until_taken(self) -> None:
        """Closing throws away what the reader has not read yet: let it finish, if there is one."""
        until_s, quiet = time.monotonic() + _DRAIN_S, 0
        while quiet < _QUIET_LOOKS and time.monotonic() < until_s and not self._stop.is_set():
            quiet = quiet + 1 if self._unread() == 0 else 0
            self._stop.wait(0.01)

    def _unread(self) -> int:
        try:
            return int(struct.unpack("i", fcntl.ioctl(self._slave, termios.FIONREAD, b"\0" * 4))[0])
        except OSError as error:
            if error.errno == errno.EIO:
                return 0
            raise


def _pieces(offsets: np.ndarray[tuple[int], np.dtype[np.int64]]) -> list[int]:
    """Return the ends of large writes made of whole frames, for playing without a pace."""
    steps = np.arange(_FAST_WRITE, int(offsets[-1]) + _FAST_WRITE, _FAST_WRITE)
    return [int(end) for end in np.unique(offsets[np.clip(offsets.searchsorted(steps), 0, len(offsets) - 1)])]


def emulate(
    path: Path | str,
    *,
    speed: float = 1.0,
    loop: bool = False,
    now: bool = False,
    link: Path | None = None,
    on_ready: Callable[[Emulator], None] | None = None,
    stop: threading.Event | None = None,
) -> EmulatorStats:
    """Play a log through a new pseudo-terminal until it ends or `stop` is set; blocks. See `Emulator`.

    `on_ready` is called once the terminal exists: its `device` is what a reader opens.
    """
    with Emulator(path, speed=speed, loop=loop, now=now, link=link) as emulator:
        if on_ready is not None:
            on_ready(emulator)
        return emulator.run(stop)

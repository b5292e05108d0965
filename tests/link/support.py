"""A board on a real pseudo-terminal that can be unplugged, and a task that listens to a link."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import subprocess
import sys
import tty
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

from server.link.base import Chunk, Link
from server.link.find import Finder

PATIENCE_S = 15.0


class FakeMachine:
    """Folders that stand in for /dev and /dev/serial/by-id."""

    def __init__(self, root: Path) -> None:
        self.dev, self.by_id = root / "dev", root / "by-id"
        self.dev.mkdir()
        self.by_id.mkdir()
        self.finder = Finder(by_id=self.by_id, dev=self.dev, sys_tty=root / "none")


class PtyBoard:
    """A serial board: plugged in it has a port name and an id, unplugged it has neither."""

    def __init__(self, machine: FakeMachine, identity: str = "usb-Board_1-if00") -> None:
        self._machine, self._identity = machine, identity
        self._ends: tuple[int, int] | None = None
        self._names: list[Path] = []

    def plug(self, name: str, *, by_id: bool = True) -> Path:
        """Appear as `name`; return its path."""
        master, slave = os.openpty()
        tty.setraw(slave)
        self._ends = master, slave
        node = self._machine.dev / name
        node.symlink_to(os.ttyname(slave))
        self._names = [node]
        if by_id:
            link = self._machine.by_id / self._identity
            link.symlink_to(node)
            self._names.append(link)
        return node

    @property
    def tty(self) -> str:
        """The real device."""
        assert self._ends
        return os.ttyname(self._ends[1])

    def say(self, data: bytes) -> None:
        """Send to whoever reads."""
        assert self._ends
        assert os.write(self._ends[0], data) == len(data)

    def hear(self, size: int) -> bytes:
        """Return what was sent to the board; blocks until there is something."""
        assert self._ends
        return os.read(self._ends[0], size)

    def unplug(self) -> None:
        """Disappear."""
        for name in self._names:
            name.unlink()
        self._names = []
        for end in self._ends or ():
            os.close(end)
        self._ends = None


class Listener:
    """Everything a link yielded so far."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.chunks: list[Chunk] = []
        self.ended = False

    @property
    def data(self) -> bytes:
        return b"".join(chunk.data for chunk in self.chunks)

    async def listen(self) -> None:
        async for chunk in self.link.chunks():
            self.chunks.append(chunk)
        self.ended = True

    async def until(self, holds: Callable[[], bool]) -> None:
        """Wait until something holds."""
        async with asyncio.timeout(PATIENCE_S):
            while not holds():  # noqa: ASYNC110 - what is waited for has no event
                await asyncio.sleep(0.005)

    async def until_data(self, data: bytes) -> None:
        """Wait until the last bytes that arrived are these."""
        await self.until(lambda: self.data.endswith(data))

    async def until_code(self, code: str) -> None:
        """Wait until the link's state has this cause."""
        await self.until(lambda: self.link.status.code == code)


@asynccontextmanager
async def listening(link: Link) -> AsyncIterator[Listener]:
    """Listen to a link for as long as the block runs, then close it; its task must end by itself."""
    listener = Listener(link)
    task = asyncio.create_task(listener.listen())
    try:
        yield listener
    finally:
        await link.close()
        async with asyncio.timeout(PATIENCE_S):
            await task


HOLD = "import fcntl,sys; f=open(sys.argv[1],'rb+',0); fcntl.flock(f,2); print('held',flush=True); sys.stdin.read()"


@contextlib.contextmanager
def locked(*devices: str) -> Iterator[None]:
    """Hold devices as another program would."""
    with contextlib.ExitStack() as stack:
        for device in devices:
            fcntl.flock(stack.enter_context(open(device, "rb+", buffering=0)), fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def other_program(device: str) -> Iterator[subprocess.Popen[bytes]]:
    """Hold a device in a process of its own, until its standard input is closed."""
    command = [sys.executable, "-c", HOLD, device]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        yield holder


def exists(device: str) -> bool:
    """Tell whether there is such a device."""
    return Path(device).is_char_device()


@contextlib.contextmanager
def ordinary_user() -> Iterator[None]:
    """Drop root's rights for the block: what is forbidden to others is not to root."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65_534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)

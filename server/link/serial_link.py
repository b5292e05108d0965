"""A board on a serial device, found again after it was unplugged, also under another name."""

from __future__ import annotations

import asyncio
from pathlib import Path

from server.link.causes import Trouble
from server.link.find import Finder
from server.link.pipe import PipeConnection
from server.link.retry import RetryLink
from server.link.tty import Tty, open_tty


async def connect_tty(device: Path, baud: int, finder: Finder) -> PipeConnection:
    """Return a connection to an open serial device; raise `Trouble` when it cannot be opened."""
    opening = asyncio.get_running_loop().run_in_executor(None, open_tty, device, baud, finder)
    try:
        tty = await asyncio.shield(opening)
    except asyncio.CancelledError:
        opening.add_done_callback(_close_unused)
        raise
    return PipeConnection(tty, Trouble("unplugged", device=str(device)))


def _close_unused(opening: asyncio.Future[Tty]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()


class SerialLink(RetryLink):
    """`serial:///dev/ttyACM0?baud=921600` on Linux and macOS; see `server.link.serial_url` for other ports."""

    def __init__(self, url: str, device: Path, baud: int, finder: Finder) -> None:
        super().__init__(url)
        self._device, self._baud, self._finder = device, baud, finder
        self._identity = ""
        self._found = device

    def _open_details(self) -> dict[str, str]:
        return {"device": str(self._found), "baud": str(self._baud)}

    async def _connect(self) -> PipeConnection:
        self._found = self._look()
        connection = await connect_tty(self._found, self._baud, self._finder)
        self._identity = self._identity or self._finder.identity(self._found)
        return connection

    def _look(self) -> Path:
        """Return where the board is now; once opened, only the same board will do."""
        if not self._identity:
            return self._device
        found = self._finder.find(self._identity)
        if found is not None:
            return found
        if self._device.exists() and self._finder.identity(self._device) not in ("", self._identity):
            raise Trouble("other-device", identity=self._identity, device=str(self._device))
        return self._device

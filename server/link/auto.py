"""`auto`: the first board that is plugged in, without naming a port."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Final

from server.link.causes import Trouble
from server.link.find import Finder
from server.link.pipe import PipeConnection
from server.link.retry import RetryLink
from server.link.serial_link import connect_tty

TRIAL_S: Final = 5.0
"""A port that says nothing for this long after opening gives way to the next one, when there is one."""


class Trial:
    """A `Connection` that gives up when nothing at all arrives and another port could be tried instead."""

    def __init__(self, inner: PipeConnection, give_up: Callable[[], bool], silent: Trouble, trial_s: float) -> None:
        self._inner, self._give_up, self._silent, self._trial_s = inner, give_up, silent, trial_s
        self._heard = False
        self.fresh = True

    @property
    def bytes_out(self) -> int:
        """Bytes sent."""
        return self._inner.bytes_out

    async def read(self) -> bytes:
        """Return the next batch; before the first one, wait only as long as there is nothing else to try."""
        while not self._heard:
            try:
                async with asyncio.timeout(self._trial_s):
                    data = await self._inner.read()
            except TimeoutError:
                if self._give_up():
                    raise self._silent from None
            else:
                self._heard = True
                return data
        return await self._inner.read()

    def write(self, data: bytes) -> None:
        """Send without blocking, or drop."""
        self._inner.write(data)

    def close(self) -> None:
        """Release the port."""
        self._inner.close()


class AutoLink(RetryLink):
    """Opens the likeliest port that is free; after a loss the same board first, then any other."""

    def __init__(self, url: str, baud: int, finder: Finder, trial_s: float = TRIAL_S) -> None:
        super().__init__(url)
        self._baud, self._finder, self._trial_s = baud, finder, trial_s
        self._device = Path()
        self._identity = ""
        self._mute: set[Path] = set()

    def _open_details(self) -> dict[str, str]:
        return {"device": str(self._device), "baud": str(self._baud)}

    async def _connect(self) -> Trial:
        refusals: list[Trouble] = []
        for device in self._candidates():
            try:
                connection = await connect_tty(device, self._baud, self._finder)
            except Trouble as refusal:
                refusals.append(refusal)
            else:
                return self._take(device, connection)
        if not refusals:
            raise Trouble("no-board")
        if len(refusals) == 1:
            raise refusals[0]
        raise Trouble("all-unusable", ports="; ".join(str(refusal).rstrip(".") for refusal in refusals))

    def _candidates(self) -> list[Path]:
        """Return the devices to try: those that said nothing last, the board of before first."""
        devices = self._finder.boards()
        if self._mute.issuperset(devices):
            self._mute.clear()
        return sorted(devices, key=lambda device: (device in self._mute, not self._is_same(device)))

    def _is_same(self, device: Path) -> bool:
        return bool(self._identity) and self._finder.identity(device) == self._identity

    def _take(self, device: Path, connection: PipeConnection) -> Trial:
        self._device, self._identity = device, self._finder.identity(device)
        return Trial(connection, self._give_up, Trouble("silent", **self._open_details()), self._trial_s)

    def _give_up(self) -> bool:
        """Tell whether another port may be tried instead of the one that says nothing."""
        others = [device for device in self._finder.boards() if device != self._device]
        if others:
            self._mute.add(self._device)
        return bool(others)

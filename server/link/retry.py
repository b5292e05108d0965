"""What all links share: open, yield, notice the loss, wait a little, open again; and a status that is cheap to read."""

from __future__ import annotations

import asyncio
import time
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator
from typing import ClassVar, Final, Protocol

from server.link.base import Chunk, LinkState, LinkStatus
from server.link.causes import Trouble, explain

SILENT_AFTER_NS: Final = 3_000_000_000
"""An open link without a byte for this long is silent: three of a board's heartbeats."""

FIRST_PAUSE_S: Final = 0.2
LONGEST_PAUSE_S: Final = 1.0
"""Pauses between attempts grow from the first to the longest, which keeps a replugged board under 2 s."""


class Connection(Protocol):
    """One open connection; after `close` a pending `read` raises `Trouble`."""

    fresh: bool
    """The next bytes do not continue the ones before; set at the start, cleared by the link."""

    @property
    def bytes_out(self) -> int:
        """Bytes the other side was given."""
        ...

    async def read(self) -> bytes:
        """Return what arrived, at least one byte; raise `Trouble` when the connection is over."""
        ...

    def write(self, data: bytes) -> None:
        """Send without blocking, or drop."""
        ...

    def close(self) -> None:
        """Release it; a second call does nothing."""
        ...


class RetryLink(ABC):
    """A `Link` made of connections; a kind of link says only how one is opened."""

    silent_code: ClassVar[str] = "silent"

    def __init__(self, url: str) -> None:
        self._url = url
        self._state, self._code = LinkState.OPENING, "opening"
        self._details: dict[str, str] = {}
        self._since_ns = time.monotonic_ns()
        self._bytes_in = self._bytes_out = self._opened = 0
        self._t_rx_ns = -1
        self._closing = asyncio.Event()
        self._connection: Connection | None = None

    @abstractmethod
    async def _connect(self) -> Connection:
        """Return an open connection, or raise `Trouble`."""

    def _open_details(self) -> dict[str, str]:
        """Return what is known of the open link, such as its device; sentences about it are filled with this."""
        return {}

    async def _release(self) -> None:  # noqa: B027 - most kinds hold nothing else
        """Let go of what outlives a connection (a listening socket, the demo board)."""

    @property
    def status(self) -> LinkStatus:
        """The present state; silence is found here, by looking at the clock."""
        state, code, details, since_ns = self._state, self._code, self._details, self._since_ns
        quiet_ns = max(self._t_rx_ns, since_ns) + SILENT_AFTER_NS
        if state is LinkState.OPEN and time.monotonic_ns() >= quiet_ns:
            state, code, details, since_ns = LinkState.SILENT, self.silent_code, self._open_details(), quiet_ns
        _, cause, remedy = explain(code, details) if code else (state, "", "")
        return LinkStatus(
            url=self._url,
            state=state,
            code=code,
            cause=cause,
            remedy=remedy,
            since_ns=since_ns,
            bytes_in=self._bytes_in,
            bytes_out=self._bytes_out + (self._connection.bytes_out if self._connection else 0),
            reconnects=max(0, self._opened - 1),
            t_last_rx_ns=self._t_rx_ns,
            details=dict(details),
        )

    async def chunks(self) -> AsyncIterator[Chunk]:
        """Open, reconnect as long as needed, and yield what arrives."""
        self._closing.clear()
        failures = 0
        try:
            while not self._closing.is_set():
                try:
                    connection = await self._open()
                    failures = 0
                    while True:
                        data = await connection.read()
                        self._t_rx_ns = t_rx_ns = time.monotonic_ns()
                        self._bytes_in += len(data)
                        fresh, connection.fresh = connection.fresh, False
                        yield Chunk(data, t_rx_ns, fresh)
                except Trouble as trouble:
                    self._note(Trouble("closed") if self._closing.is_set() else trouble)
                finally:
                    self._drop()
                if self._state is LinkState.ENDED:
                    return
                await self._pause(failures)
                failures += 1
        finally:
            await self._release()

    def write(self, data: bytes) -> None:
        """Send without blocking; dropped when there is no connection."""
        if self._connection is not None:
            self._connection.write(data)

    async def close(self) -> None:
        """Release the port; `chunks` then ends."""
        self._closing.set()
        self._drop()
        await self._release()
        self._note(Trouble("closed"))

    async def _open(self) -> Connection:
        connection = self._connection = await self._connect_unless_closed()
        self._opened += 1
        self._enter(LinkState.OPEN, "", self._open_details())
        return connection

    async def _connect_unless_closed(self) -> Connection:
        """Return an open connection; `close` interrupts one that takes long."""
        connecting = asyncio.ensure_future(self._connect())
        closing = asyncio.ensure_future(self._closing.wait())
        try:
            await asyncio.wait((connecting, closing), return_when=asyncio.FIRST_COMPLETED)
        finally:
            closing.cancel()
            connecting.add_done_callback(self._close_unused)
            if not connecting.done():
                connecting.cancel()
        if self._closing.is_set():
            raise Trouble("closed")
        return connecting.result()

    def _close_unused(self, connecting: asyncio.Future[Connection]) -> None:
        """Close what was opened after nobody wanted it any more."""
        if connecting.cancelled() or connecting.exception() is not None:
            return
        if connecting.result() is not self._connection:
            connecting.result().close()

    def _drop(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            self._bytes_out += connection.bytes_out
            connection.close()

    async def _pause(self, failures: int) -> None:
        """Wait before the next attempt, or until `close`."""
        pause_s = min(LONGEST_PAUSE_S, FIRST_PAUSE_S * (1 + failures))
        try:
            await asyncio.wait_for(self._closing.wait(), pause_s)
        except TimeoutError:
            return

    def _note(self, trouble: Trouble) -> None:
        code, details = trouble.code, trouble.details
        if code == "port-missing" and self._opened:
            code = "unplugged"
        self._enter(explain(code, details)[0], code, details)

    def _enter(self, state: LinkState, code: str, details: dict[str, str]) -> None:
        if (state, code) != (self._state, self._code):
            self._since_ns = time.monotonic_ns()
        self._state, self._code, self._details = state, code, details

"""A non-blocking file descriptor as a connection: read in batches by the clock, because a wake-up is what costs.

A board writes a thousand small frames a second, and waking for each costs more than handling it. While bytes flow,
the descriptor is read by a timer, with no poll and no thread; only when a read finds nothing is it polled again.
`tests/bench/bench_link.py` compares this with a blocking thread and with a wake-up per write.
"""

from __future__ import annotations

import asyncio
from typing import Final, Protocol

from server.link.causes import Trouble

DRAIN_S: Final = 0.008
"""Longest time a byte waits for its batch. At 63 kB/s a batch is 0.5 kB, far under the 4 kB a tty holds."""

_DRAIN_MIN_S: Final = 0.001
_LARGE: Final = 2048
"""A batch this large, half of what a tty holds, halves the drain time of the next one."""

_SMALL: Final = 1024
_WRITE_ROOM: Final = 16_384
"""Bytes that may wait to be written, about a second of requests; a write that does not fit is dropped whole."""


class Source(Protocol):
    """A non-blocking descriptor: a tty, a socket."""

    def fileno(self) -> int:
        """Return the descriptor."""
        ...

    def read_now(self) -> bytes:
        """Return what is there; empty when the other side is gone.

        Raises:
            BlockingIOError: nothing is there now.
            OSError: it is gone for good.
        """
        ...

    def write_now(self, data: bytes) -> int:
        """Return how many bytes were taken; raise as `read_now` does."""
        ...

    def close(self) -> None:
        """Close the descriptor."""
        ...


class PipeConnection:
    """A `Connection` over a `Source`, driven by the event loop."""

    def __init__(self, source: Source, lost: Trouble, drain_s: float = DRAIN_S) -> None:
        self._source, self._lost = source, lost
        self._longest_s = self._drain_s = drain_s
        self._loop = asyncio.get_running_loop()
        self._polled: asyncio.Future[None] | None = None
        self._pending = bytearray()
        self._idle = True
        self._closed = False
        self.fresh = True
        self.bytes_out = 0

    async def read(self) -> bytes:
        """Return one batch; raise the `Trouble` given at construction when it is over."""
        while True:
            if self._idle:
                await self._readable()
            await asyncio.sleep(self._drain_s)
            if self._closed:
                raise self._lost
            try:
                data = self._source.read_now()
            except BlockingIOError:
                self._idle = True
                continue
            except OSError as error:
                raise self._lost from error
            if not data:
                raise self._lost
            self._adapt(len(data))
            return data

    def _adapt(self, size: int) -> None:
        """Keep batches under what a tty holds: a fast stream is read more often, down to without a pause."""
        self._idle = False
        if size >= _LARGE:
            self._drain_s = self._drain_s / 2 if self._drain_s > _DRAIN_MIN_S else 0.0
        elif size < _SMALL and self._drain_s < self._longest_s:
            self._drain_s = min(self._longest_s, max(_DRAIN_MIN_S, self._drain_s * 2))

    async def _readable(self) -> None:
        if self._closed:
            return
        self._polled = polled = self._loop.create_future()
        descriptor = self._source.fileno()
        self._loop.add_reader(descriptor, self._wake)
        try:
            await polled
        finally:
            if not self._closed:
                self._loop.remove_reader(descriptor)
            self._polled = None

    def _wake(self) -> None:
        if self._polled is not None and not self._polled.done():
            self._polled.set_result(None)

    def write(self, data: bytes) -> None:
        """Send now what the descriptor takes and the rest as it drains; drop all of it when too much waits."""
        if self._closed or len(self._pending) + len(data) > _WRITE_ROOM:
            return
        if self._pending:
            self._pending += data
            return
        self._pending += data[self._send(data) :]
        if self._pending:
            self._loop.add_writer(self._source.fileno(), self._flush)

    def _flush(self) -> None:
        del self._pending[: self._send(bytes(self._pending))]
        if not self._pending:
            self._loop.remove_writer(self._source.fileno())

    def _send(self, data: bytes) -> int:
        """Return how many bytes are dealt with: written, or lost with the other side (reading will notice)."""
        try:
            sent = self._source.write_now(data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)
        self.bytes_out += sent
        return sent

    def close(self) -> None:
        """Close the descriptor and end a pending read; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        self._loop.remove_reader(self._source.fileno())
        self._loop.remove_writer(self._source.fileno())
        self._source.close()
        self._wake()

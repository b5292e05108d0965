"""Any other pyserial URL (rfc2217://, socket://, loop://, …) and Windows ports: a thread that blocks in pyserial."""

from __future__ import annotations

import asyncio
import threading
from typing import Final

import serial

from server.link.causes import Trouble
from server.link.pipe import DRAIN_S
from server.link.retry import RetryLink

_WAIT_S: Final = 0.25
"""How long the thread blocks for a first byte: `close` waits for it no longer than this."""

_BATCH: Final = 4096
_ROOM: Final = 64
"""Batches that may wait for the event loop; when full the thread stops reading, and the bytes wait in the port."""

_WRITE_ROOM: Final = 16_384
"""Bytes that may wait to be written; a write that does not fit is dropped whole."""


class PyserialConnection:
    """A `Connection` over any object with pyserial's interface: one thread reads, another one writes."""

    def __init__(self, port: serial.SerialBase, lost: Trouble) -> None:
        self._port, self._lost = port, lost
        self._loop = asyncio.get_running_loop()
        self._batches: asyncio.Queue[bytes] = asyncio.Queue()
        self._room = threading.Semaphore(_ROOM)
        self._outgoing = bytearray()
        self._may_write = threading.Condition()
        self._closed = False
        self.fresh = True
        self.bytes_out = 0
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._read_on, self._write_on)]
        for thread in self._threads:
            thread.start()

    async def read(self) -> bytes:
        """Return one batch; raise `Trouble` when the port is gone or closed."""
        data = await self._batches.get()
        self._room.release()
        if data:
            return data
        raise Trouble("closed") if self._closed else self._lost

    def write(self, data: bytes) -> None:
        """Hand to the writing thread, or drop when too much waits."""
        with self._may_write:
            if not self._closed and len(self._outgoing) + len(data) <= _WRITE_ROOM:
                self._outgoing += data
                self._may_write.notify()

    def close(self) -> None:
        """Let both threads end; the reading one closes the port."""
        with self._may_write:
            self._closed = True
            self._may_write.notify()
        self._batches.put_nowait(b"")

    def _read_on(self) -> None:
        try:
            while not self._closed:
                data = self._read_batch()
                if data:
                    self._offer(data)
        except (OSError, TypeError, ValueError):  # pyserial reads a closed port in its own ways
            self._offer(b"")
        finally:
            self._port.close()

    def _read_batch(self) -> bytes:
        """Return the first byte and what follows within the drain time; empty when nothing came."""
        self._port.timeout = _WAIT_S
        first = bytes(self._port.read(1))
        if not first:
            return b""
        self._port.timeout = DRAIN_S
        return first + bytes(self._port.read(_BATCH - 1))

    def _offer(self, data: bytes) -> None:
        while not self._room.acquire(timeout=_WAIT_S):
            if self._closed:
                return
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._batches.put_nowait, data)

    def _write_on(self) -> None:
        while True:
            with self._may_write:
                self._may_write.wait_for(lambda: self._closed or self._outgoing)
                if self._closed:
                    return
                data = bytes(self._outgoing)
                self._outgoing.clear()
            try:
                self.bytes_out += int(self._port.write(data) or 0)
            except (OSError, TypeError, ValueError):  # the reading thread reports it
                return


class SerialUrlLink(RetryLink):
    """`rfc2217://host:port`, `socket://host:port`, `loop://`, `COM3`: whatever pyserial can open."""

    def __init__(self, url: str, port_url: str, baud: int) -> None:
        super().__init__(url)
        self._port_url, self._baud = port_url, baud

    def _open_details(self) -> dict[str, str]:
        return {"device": self._port_url, "baud": str(self._baud)}

    async def _connect(self) -> PyserialConnection:
        opening = asyncio.get_running_loop().run_in_executor(None, self._open_port)
        try:
            port = await asyncio.shield(opening)
        except asyncio.CancelledError:
            opening.add_done_callback(_close_unused)
            raise
        return PyserialConnection(port, Trouble("connection-lost", address=self._port_url))

    def _open_port(self) -> serial.SerialBase:
        try:
            port = serial.serial_for_url(self._port_url, baudrate=self._baud, timeout=_WAIT_S, write_timeout=1.0)
            port.reset_input_buffer()
        except (serial.SerialException, OSError) as error:
            raise _trouble(error, self._port_url) from error
        except ValueError as error:
            raise Trouble("not-a-port", device=self._port_url, error=str(error)) from error
        return port


def _close_unused(opening: asyncio.Future[serial.SerialBase]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()


def _trouble(error: Exception, url: str) -> Trouble:
    """Name the cause by the error below pyserial's own, which carries text only."""
    below = error.__context__ or error
    if isinstance(below, ConnectionRefusedError):
        return Trouble("refused", address=url)
    if isinstance(below, FileNotFoundError):
        return Trouble("port-missing", device=url)
    if isinstance(below, PermissionError):  # Windows says this of a port that is held
        return Trouble("port-busy", device=url, holder="another program")
    return Trouble("unreachable", address=url, error=str(error))

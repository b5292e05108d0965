"""UDP as ground stations use it: listen at a port, answer whoever spoke last."""

from __future__ import annotations

import socket
import time
from typing import Any

from server.link.causes import Trouble
from server.link.pipe import PipeConnection
from server.link.retry import SILENT_AFTER_NS, RetryLink
from server.link.tcp import address_text, bound_socket

_DATAGRAM_ROOM = 65_535
_BATCH_ROOM = 65_536


class DatagramSource:
    """A bound UDP socket as a non-blocking `Source`; a batch is the datagrams that wait, joined."""

    def __init__(self, bound: socket.socket) -> None:
        self._bound = bound
        self._peer: Any = None
        self._t_rx_ns = 0
        self.changed = False

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._bound.fileno()

    def read_now(self) -> bytes:
        """Return the datagrams that wait, joined; `BlockingIOError` when none does."""
        batch = bytearray()
        while len(batch) < _BATCH_ROOM:
            try:
                data, peer = self._bound.recvfrom(_DATAGRAM_ROOM)
            except BlockingIOError:
                break
            except ConnectionError:  # an answer of ours was refused: the peer left, another may come
                continue
            self._meet(peer)
            batch += data
        if not batch:
            raise BlockingIOError
        return bytes(batch)

    def _meet(self, peer: object) -> None:
        """Remember whom to answer; one that speaks after a silence of the last one is a new session."""
        now_ns = time.monotonic_ns()
        if peer != self._peer and now_ns - self._t_rx_ns > SILENT_AFTER_NS:
            self.changed = True
        self._peer, self._t_rx_ns = peer, now_ns

    def write_now(self, data: bytes) -> int:
        """Send to the last peer; dropped before the first datagram arrived."""
        if self._peer is None:
            raise ConnectionError("no peer yet")
        return self._bound.sendto(data, self._peer)

    def close(self) -> None:
        """Close the socket."""
        self._bound.close()


class DatagramConnection(PipeConnection):
    """A connection that starts a new session when another peer takes over."""

    def __init__(self, source: DatagramSource, lost: Trouble) -> None:
        super().__init__(source, lost)
        self._datagrams = source

    async def read(self) -> bytes:
        """Return the next batch of datagrams."""
        data = await super().read()
        self.fresh, self._datagrams.changed = self.fresh or self._datagrams.changed, False
        return data


class UdpLink(RetryLink):
    """`udp://[host]:port`; without a host only this machine is heard (127.0.0.1), 0.0.0.0 hears the network."""

    silent_code = "silent-udp"

    def __init__(self, url: str, host: str, port: int) -> None:
        super().__init__(url)
        self._host, self._port = host, port

    @property
    def port(self) -> int:
        """The port listened at: the one given, or the one the system chose for 0."""
        return self._port

    def _open_details(self) -> dict[str, str]:
        return {"address": address_text(self._host, self._port), "port": str(self._port)}

    async def _connect(self) -> DatagramConnection:
        bound = bound_socket(self._host, self._port, socket.SOCK_DGRAM)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._port = int(bound.getsockname()[1])
        return DatagramConnection(DatagramSource(bound), Trouble("connection-lost", **self._open_details()))

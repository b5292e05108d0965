"""TCP links: one that connects, one that lets the board connect."""

from __future__ import annotations

import asyncio
import errno
import socket

from server.link.causes import Trouble
from server.link.pipe import PipeConnection
from server.link.retry import RetryLink

_CONNECT_S = 5.0
_READ_ROOM = 65_536
_ALIVE_S = 8
"""A peer that vanished without a word is noticed after this long."""


class StreamSource:
    """A connected TCP socket as a non-blocking `Source`."""

    def __init__(self, stream: socket.socket) -> None:
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        _notice_dead_peer(stream)
        self._stream = stream

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._stream.fileno()

    def read_now(self) -> bytes:
        """Return what is there; empty when the peer closed."""
        return self._stream.recv(_READ_ROOM)

    def write_now(self, data: bytes) -> int:
        """Return how many bytes the kernel took."""
        return self._stream.send(data)

    def close(self) -> None:
        """Close the socket."""
        self._stream.close()


def _notice_dead_peer(stream: socket.socket) -> None:
    stream.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (
        ("TCP_KEEPIDLE", 3),
        ("TCP_KEEPINTVL", 2),
        ("TCP_KEEPCNT", 2),
        ("TCP_USER_TIMEOUT", _ALIVE_S * 1000),
    ):
        if hasattr(socket, name):
            stream.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def address_text(host: str, port: int) -> str:
    """Return host:port, an IPv6 host in brackets."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


class TcpLink(RetryLink):
    """`tcp://host:port`: connects, and connects again."""

    silent_code = "silent-network"

    def __init__(self, url: str, host: str, port: int) -> None:
        super().__init__(url)
        self._host, self._port = host, port
        self._address = address_text(host, port)

    def _open_details(self) -> dict[str, str]:
        return {"address": self._address, "port": str(self._port)}

    async def _connect(self) -> PipeConnection:
        try:
            async with asyncio.timeout(_CONNECT_S):
                stream = await self._connect_any()
        except socket.gaierror as error:
            raise Trouble("host-not-found", host=self._host) from error
        except ConnectionRefusedError as error:
            raise Trouble("refused", address=self._address) from error
        except TimeoutError as error:
            raise Trouble("unreachable", address=self._address, error=f"no answer within {_CONNECT_S:g} s") from error
        except OSError as error:
            raise Trouble("unreachable", address=self._address, error=error.strerror or str(error)) from error
        return PipeConnection(StreamSource(stream), Trouble("connection-lost", address=self._address))

    async def _connect_any(self) -> socket.socket:
        """Return a socket connected to the first address of the host that answers."""
        loop = asyncio.get_running_loop()
        failure: OSError = OSError(errno.EADDRNOTAVAIL, "no address")
        for family, kind, protocol, _, address in await loop.getaddrinfo(
            self._host, self._port, type=socket.SOCK_STREAM
        ):
            stream = socket.socket(family, kind, protocol)
            stream.setblocking(False)
            try:
                await loop.sock_connect(stream, address)
            except BaseException as error:
                stream.close()
                if not isinstance(error, OSError):
                    raise
                failure = error
            else:
                return stream
        raise failure


def listening_trouble(error: OSError, address: str) -> Trouble:
    """Name why an address cannot be listened at."""
    if error.errno == errno.EADDRINUSE:
        return Trouble("address-in-use", address=address)
    return Trouble("address-not-here", address=address, error=error.strerror or str(error))


def bound_socket(host: str, port: int, kind: socket.SocketKind) -> socket.socket:
    """Return a non-blocking socket bound to host:port; raise `Trouble` when the address is taken or not ours."""
    bound = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, kind)
    try:
        if kind == socket.SOCK_STREAM:
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.setblocking(False)
        bound.bind((host, port))
    except socket.gaierror as error:
        bound.close()
        raise Trouble("host-not-found", host=host) from error
    except OSError as error:
        bound.close()
        raise listening_trouble(error, address_text(host, port)) from error
    return bound


class TcpListenLink(RetryLink):
    """`tcp-listen://[host]:port`: one board at a time connects here; a newer connection replaces an older one.

    A board that restarted does not say goodbye, so the newest connection is the one that lives.
    """

    silent_code = "silent-network"

    def __init__(self, url: str, host: str, port: int) -> None:
        super().__init__(url)
        self._host, self._port = host, port
        self._listener: socket.socket | None = None
        self._waiting: asyncio.Future[None] | None = None
        self._accepted: socket.socket | None = None

    @property
    def port(self) -> int:
        """The port listened at: the one given, or the one the system chose for 0."""
        return int(self._listener.getsockname()[1]) if self._listener else self._port

    def _open_details(self) -> dict[str, str]:
        return {"address": address_text(self._host, self.port), "port": str(self.port)}

    async def _connect(self) -> PipeConnection:
        if self._listener is None:
            self._listen()
        if self._accepted is None:
            self._note(Trouble("waiting-for-peer", **self._open_details()))
            self._waiting = asyncio.get_running_loop().create_future()
            await self._waiting
        stream, self._accepted = self._accepted, None
        if stream is None:
            raise Trouble("closed")
        return PipeConnection(StreamSource(stream), Trouble("connection-lost", **self._open_details()))

    def _listen(self) -> None:
        listener = bound_socket(self._host, self._port, socket.SOCK_STREAM)
        try:
            listener.listen(1)
        except OSError as error:
            listener.close()
            raise listening_trouble(error, address_text(self._host, self._port)) from error
        self._listener = listener
        asyncio.get_running_loop().add_reader(listener.fileno(), self._accept)

    def _accept(self) -> None:
        if self._listener is None:
            return
        try:
            stream, _ = self._listener.accept()
        except OSError:  # the peer gave up meanwhile
            return
        if self._accepted is not None:
            self._accepted.close()
        self._accepted = stream
        if self._connection is not None:
            self._connection.close()
        if self._waiting is not None and not self._waiting.done():
            self._waiting.set_result(None)

    async def _release(self) -> None:
        listener, self._listener = self._listener, None
        if listener is not None:
            asyncio.get_running_loop().remove_reader(listener.fileno())
            listener.close()
        if self._accepted is not None:
            self._accepted.close()
            self._accepted = None

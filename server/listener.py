"""The listening socket of the one port, and why there is none."""

from __future__ import annotations

import errno
import socket
from typing import Final

BAD_INPUT: Final = 2
FAILED: Final = 1


class StartError(Exception):
    """The service cannot start; the text says why and what to do."""

    def __init__(self, text: str, exit_status: int) -> None:
        super().__init__(text)
        self.exit_status = exit_status


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a bound socket with the options that accepted ones inherit.

    A client that stops reading is dropped by the kernel after 8 s, and at most 128 kB wait for it: by default some
    4 MB of stale data would. Both measured against a browser that never reads.

    Raises:
        OSError: the address cannot be used.
    """
    family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 8000)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 131_072)
        listener.bind(address)
    except OSError:
        listener.close()
        raise
    return listener


def bound_socket(host: str, port: int) -> socket.socket:
    """Return `listening_socket`, or say as a `StartError` why there is none."""
    try:
        return listening_socket(host, port)
    except socket.gaierror as error:
        text = f"host = {host!r} is no address of this machine: {error.strerror}. Remedy: use 127.0.0.1."
        raise StartError(text, BAD_INPUT) from None
    except OSError as error:
        remedies = {
            errno.EADDRINUSE: "stop the program that holds it (another navdeck?), or choose another port: "
            f"navdeck --port {port % 65535 + 1}",
            errno.EACCES: "ports below 1024 need rights; choose a higher one: navdeck --port 8080",
            errno.EADDRNOTAVAIL: "use an address of this machine, such as 127.0.0.1",
        }
        remedy = remedies.get(error.errno or 0, "choose another host or port")
        text = f"{host}:{port} cannot be used: {error.strerror}. Remedy: {remedy}."
        raise StartError(text, FAILED) from None


def url_of(listener: socket.socket) -> str:
    """Return where a browser on this machine finds the page."""
    host, port = listener.getsockname()[:2]
    name = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)  # noqa: S104
    return f"http://{name}:{port}"

"""A link's URL becomes a link: every kind, its options and their limits are named here."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Final
from urllib.parse import parse_qsl, unquote, urlencode, urlsplit

from server.link.base import Link
from server.link.find import Finder

KINDS: Final = (
    "auto",
    "sim:",
    "serial:///dev/ttyACM0?baud=921600",
    "tcp://host:port",
    "tcp-listen://[host]:port",
    "udp://[host]:port",
    "file://path?speed=1&loop=1",
    "rfc2217://host:port and other pyserial URLs",
    "a port by its name (/dev/ttyUSB0, COM3)",
)

DEFAULT_BAUD: Final = 115_200
"""Ignored by boards on USB; the rate of a board's second telemetry port elsewhere."""

DEFAULT_BYTES_PER_S: Final = 11_520.0
"""A byte dump without stamps plays like 115200 baud."""

_LOOPBACK: Final = "127.0.0.1"
_PYSERIAL: Final = ("rfc2217", "socket", "loop", "hwgrep", "spy", "alt", "cp2110")
_WINDOWS_PORT: Final = re.compile(r"COM\d+$", re.I)


def open_link(url: str, *, finder: Finder | None = None) -> Link:
    """Return the link a URL asks for; nothing is opened before its chunks are read.

    Without a host, `udp:` and `tcp-listen:` hear this machine only (127.0.0.1); 0.0.0.0 hears the network.

    Args:
        url: one of `KINDS`.
        finder: where devices are looked for; the machine's own folders by default.

    Raises:
        ValueError: the URL is not understood; the message names the value, what is allowed and the remedy.
    """
    text = url.strip()
    finder = finder or Finder()
    scheme = re.split("[:?]", text, maxsplit=1)[0].lower()
    if scheme in _PYSERIAL:
        return _pyserial(text)
    maker = _MAKERS.get(scheme)
    if maker is not None:
        return maker(text, finder)
    if text.startswith("/") or _WINDOWS_PORT.match(text.partition("?")[0]):
        return _bare(text, finder)
    raise _refusal(url, "is not a link", f"Write one of: {'; '.join(KINDS)}.")


def _refusal(url: str, what: str, remedy: str) -> ValueError:
    return ValueError(f"{url!r} {what}. {remedy}")


def _options(url: str, query: str, allowed: dict[str, tuple[float, float]]) -> dict[str, float]:
    """Return the numbers in a URL's query, each within its limits."""
    values: dict[str, float] = {}
    for name, written in parse_qsl(query, keep_blank_values=True):
        if name not in allowed:
            raise _refusal(url, f"has the unknown option {name!r}", f"Allowed: {', '.join(allowed) or 'none'}.")
        least, most = allowed[name]
        try:
            values[name] = float(written)
        except ValueError:
            values[name] = float("nan")
        if not least <= values[name] <= most:
            raise _refusal(url, f"has {name}={written!r}", f"{name} is a number from {least:g} to {most:g}.")
    return values


_BAUD: Final[dict[str, tuple[float, float]]] = {"baud": (50, 16_000_000)}
_FILE: Final[dict[str, tuple[float, float]]] = {"speed": (0, 1e6), "loop": (0, 1), "bytes_per_s": (1, 1e9)}


def _baud(url: str, query: str) -> int:
    return int(_options(url, query, _BAUD).get("baud", DEFAULT_BAUD))


def _serial(url: str, finder: Finder) -> Link:
    rest, _, query = url.partition(":")[2].partition("?")
    device = unquote(re.sub("^//", "", rest))
    if not device:
        raise _refusal(
            url, "names no port", "Write serial:///dev/ttyACM0?baud=921600, or auto for the first board found."
        )
    return _device(url, device, _baud(url, query), finder)


def _bare(url: str, finder: Finder) -> Link:
    device, _, query = url.partition("?")
    if device.lower().endswith((".tlog", ".bin", ".ulg", ".log")):
        raise _refusal(url, "is a file, not a port", f"Write file://{device} to play it as a link.")
    return _device(url, device, _baud(url, query), finder)


def _device(url: str, device: str, baud: int, finder: Finder) -> Link:
    if os.name != "posix":
        from server.link.serial_url import SerialUrlLink

        return SerialUrlLink(url, device, baud)
    if not device.startswith("/"):
        raise _refusal(
            url, f"names the port {device!r}", "Give its whole path, such as /dev/ttyACM0; see navdeck ports."
        )
    from server.link.serial_link import SerialLink

    return SerialLink(url, Path(device), baud, finder)


def _pyserial(url: str) -> Link:
    from server.link.serial_url import SerialUrlLink

    base, _, query = url.partition("?")
    options = parse_qsl(query, keep_blank_values=True)
    own = urlencode([(name, text) for name, text in options if name == "baud"])
    others = [f"{name}={text}" if text else name for name, text in options if name != "baud"]
    if base.startswith("spy:") and any(option.startswith("file=") for option in others):
        raise _refusal(url, "would write a file", "Leave out file=: what is spied goes to the standard error output.")
    return SerialUrlLink(url, base + ("?" + "&".join(others) if others else ""), _baud(url, own))


def _address(url: str, *, need_host: bool) -> tuple[str, int]:
    scheme = url.partition(":")[0]
    example = f"{scheme}://{'192.168.4.1' if need_host else ''}:14550"
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port
    except ValueError as error:
        raise _refusal(url, f"has no valid address ({error})", f"A port is 0 to 65535; write {example}.") from error
    if port is None or (need_host and not (host and port)) or parts.path not in ("", "/") or parts.username is not None:
        raise _refusal(url, "is not an address", f"Write host and port, such as {example}.")
    _options(url, parts.query, {})
    return host or _LOOPBACK, port


def _tcp(url: str, _: Finder) -> Link:
    from server.link.tcp import TcpLink

    return TcpLink(url, *_address(url, need_host=True))


def _tcp_listen(url: str, _: Finder) -> Link:
    from server.link.tcp import TcpListenLink

    return TcpListenLink(url, *_address(url, need_host=False))


def _udp(url: str, _: Finder) -> Link:
    from server.link.udp import UdpLink

    return UdpLink(url, *_address(url, need_host=False))


def _file(url: str, _: Finder) -> Link:
    from server.link.playback import FileLink

    rest, query = url.partition(":")[2].partition("?")[::2]
    name = unquote(re.sub("^//", "", rest))
    if not name:
        raise _refusal(url, "names no file", "Write file:///path/to/flight.tlog?speed=1.")
    options = _options(url, query, _FILE)
    pace = options.get("bytes_per_s", DEFAULT_BYTES_PER_S)
    return FileLink(url, Path(name).expanduser(), options.get("speed", 1.0), bool(options.get("loop")), pace)


def _sim(url: str, finder: Finder) -> Link:
    from server.link.simulated import SimLink
    from server.sim.settings import sim_settings

    full = url if url.startswith("sim:") else url.replace("sim", "sim:", 1)
    sim_settings(full)
    return SimLink(full, finder)


def _auto(url: str, finder: Finder) -> Link:
    from server.link.auto import AutoLink

    rest, _, query = url.partition("?")
    if rest.rstrip(":/").lower() != "auto":
        raise _refusal(url, "names a port", "auto finds it by itself; write auto, or serial:///dev/ttyACM0.")
    return AutoLink(url, _baud(url, query), finder)


_MAKERS: Final[dict[str, Callable[[str, Finder], Link]]] = {
    "serial": _serial,
    "tcp": _tcp,
    "tcp-listen": _tcp_listen,
    "udp": _udp,
    "file": _file,
    "sim": _sim,
    "auto": _auto,
}

"""Reads what the demo board says through pymavlink, another implementation of the protocol."""

from collections import defaultdict
from collections.abc import Iterable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from server.nav.types import Float
from server.sim import SimStream

MS = 1_000_000
HIGHRES_IMU, GPS_RAW_INT = 105, 24


def decoded(data: bytes) -> list[Any]:
    """Every message; a frame that pymavlink refuses or a byte left over fails the test."""
    parser = dialect.MAVLink(None)
    messages = parser.parse_buffer(data) or []
    assert sum(len(m.get_msgbuf()) for m in messages) == len(data)
    return list(messages)


def by_type(data: bytes) -> dict[str, list[Any]]:
    found = defaultdict(list)
    for message in decoded(data):
        found[message.get_type()].append(message)
    return found


def column(messages: Iterable[Any], *names: str) -> Float:
    return np.array([[getattr(m, name) for name in names] for m in messages], dtype=np.float64)


def sent(stream: SimStream, seconds: float) -> bytes:
    return b"".join(part for _, part in stream.run(seconds))


def ask(kind: str, *args: Any, system: int = 255) -> bytes:
    ground = dialect.MAVLink(None, srcSystem=system, srcComponent=190)
    return bytes(getattr(ground, f"{kind}_encode")(*args).pack(ground))


def ask_interval(message_id: int, interval_us: float, target: int = 1) -> bytes:
    return ask("command_long", target, 1, 511, 0, message_id, interval_us, 0, 0, 0, 0, 0)

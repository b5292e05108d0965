"""Small .tlog files, written as a ground station writes them."""

from __future__ import annotations

import struct

START_US = 1_760_000_000_000_000


def frame(sequence: int, *, payload: int = 20, version: int = 2, signed: bool = False) -> bytes:
    """A MAVLink frame in form: right magic and length; the payload and checksum may be anything."""
    body = bytes((sequence * 7 + i) % 251 for i in range(payload))
    if version == 1:
        return bytes([0xFE, payload, sequence % 256, 1, 1, 30]) + body + b"\xaa\xbb"
    head = bytes([0xFD, payload, int(signed), 0, sequence % 256, 1, 1, 30, 0, 0])
    return head + body + b"\xaa\xbb" + (b"\x01" * 13 if signed else b"")


def frames(count: int) -> list[bytes]:
    """`count` different frames of one size."""
    return [frame(k) for k in range(count)]


def tlog(parts: list[bytes], *, step_us: int) -> bytes:
    """The frames with their stamps, `step_us` apart."""
    return b"".join(struct.pack(">Q", START_US + k * step_us) + part for k, part in enumerate(parts))

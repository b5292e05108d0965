"""How much of some bytes is whole, checked messages of other protocols: one function each, bytes covered out."""

from __future__ import annotations

import binascii
import re
from collections.abc import Callable
from functools import reduce
from operator import xor
from typing import Final

Coverage = Callable[[bytes], int]
"""Takes the bytes; returns how many of them belong to messages whose check sum is right."""

MAX_FAILED: Final = 50
"""Check sums that may fail before the search ends: a bound on the time that hostile bytes can cost."""
_NMEA: Final = re.compile(rb"[$!]([A-Z][A-Z0-9]{2,}[^$!*\r\n]{0,200})\*([0-9A-Fa-f]{2})")


def nmea(data: bytes) -> int:
    """NMEA 0183: $…*hh, exclusive or of what is between."""
    found = _NMEA.finditer(data)
    return sum(len(m[0]) for m in found if reduce(xor, m[1]) == int(m[2], 16))


def _framed(data: bytes, sync: bytes, length: Callable[[bytes], int], good: Callable[[bytes], bool]) -> int:
    """Sum the lengths of frames that begin with `sync`, have a claimed length (0 = not one) and check."""
    covered, failed, at = 0, 0, data.find(sync)
    while at >= 0 and failed < MAX_FAILED:
        size = length(data[at : at + 8])
        frame = data[at : at + size]
        whole = size > 0 and len(frame) == size and good(frame)
        covered += size if whole else 0
        failed += size > 0 and not whole
        at = data.find(sync, at + (size if whole else 1))
    return covered


def _fletcher_good(frame: bytes) -> bool:
    a = b = 0
    for byte in frame[2:-2]:
        a = (a + byte) & 255
        b = (b + a) & 255
    return frame[-2:] == bytes((a, b))


def ubx(data: bytes) -> int:
    """u-blox UBX: B5 62, class, id, length, payload, Fletcher-8."""
    return _framed(
        data,
        b"\xb5\x62",
        lambda head: 8 + int.from_bytes(head[4:6], "little") if len(head) >= 6 else 0,
        _fletcher_good,
    )


def sbf(data: bytes) -> int:
    """Septentrio SBF: $@, CRC-16/XMODEM over what follows it, id, length (a multiple of 4)."""

    def length(head: bytes) -> int:
        size = int.from_bytes(head[6:8], "little") if len(head) == 8 else 0
        return size if size >= 8 and size % 4 == 0 else 0

    return _framed(data, b"$@", length, lambda f: binascii.crc_hqx(f[4:], 0) == int.from_bytes(f[2:4], "little"))


def crc24q(data: bytes) -> int:
    """CRC-24Q of RTCM 3 (polynomial 0x1864CFB, start 0)."""
    crc = 0
    for byte in data:
        crc ^= byte << 16
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1864CFB if crc & 0x800000 else crc << 1) & 0xFFFFFF
    return crc


def rtcm3(data: bytes) -> int:
    """RTCM 3 corrections: D3, ten bits of length, CRC-24Q."""
    return _framed(
        data,
        b"\xd3",
        lambda head: 6 + int.from_bytes(head[1:3], "big") if len(head) >= 3 and head[1] < 4 else 0,
        lambda frame: crc24q(frame[:-3]) == int.from_bytes(frame[-3:], "big"),
    )


def crc8_dvb_s2(data: bytes) -> int:
    """CRC-8/DVB-S2 (polynomial 0xD5, start 0)."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ 0xD5 if crc & 0x80 else crc << 1) & 0xFF
    return crc


def msp(data: bytes) -> int:
    """MultiWii/Betaflight MSP 1 ($M, exclusive or) and 2 ($X, CRC-8/DVB-S2)."""
    first = _framed(
        data,
        b"$M",
        lambda head: 6 + head[3] if len(head) >= 4 and head[2] in b"<>!" else 0,
        lambda frame: reduce(xor, frame[3:-1]) == frame[-1],
    )
    second = _framed(
        data,
        b"$X",
        lambda head: 9 + int.from_bytes(head[6:8], "little") if len(head) == 8 and head[2] in b"<>!" else 0,
        lambda frame: crc8_dvb_s2(frame[3:-1]) == frame[-1],
    )
    return first + second


def crsf(data: bytes) -> int:
    """Crossfire/ExpressLRS CRSF: C8, length, type, payload, CRC-8 over type and payload."""
    return _framed(
        data,
        b"\xc8",
        lambda head: 2 + head[1] if len(head) >= 3 and 2 <= head[1] <= 62 else 0,
        lambda frame: crc8_dvb_s2(frame[2:-1]) == frame[-1],
    )


def text(data: bytes) -> int:
    """Plain text: printable characters and line ends."""
    return sum(byte in b"\t\r\n\x1b" or 32 <= byte < 127 for byte in data)

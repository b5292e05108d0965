"""A .tlog cut into its parts: 8-byte big-endian microseconds, then one MAVLink frame as on the wire, repeated."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

DAY_US: Final = 86_400_000_000
"""Two stamps further apart than this do not follow each other: this is what finds the record boundary in damage."""

_STAMP: Final = 8
_HEAD: Final = _STAMP + 3
"""Bytes that tell where a record ends; a shorter tail tells nothing, also not against the record before."""

_MAGIC_V1: Final = 0xFE
_MAGIC_V2: Final = 0xFD
_SIGNED: Final = 1

_Raw = NDArray[Any]
"""Bytes whose elements count as int: Numba adds uint8 to int64 as int64, no conversion needed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TlogBytes:
    """The serial stream of a log with its arrival times.

    Attributes:
        stamps_us: shape (n,), the recorder's wall clock of each record, as written.
        offsets: shape (n + 1,), record i is data[offsets[i]:offsets[i + 1]].
        data: every byte of the file except the stamps: the pure serial stream.
        damaged: records whose header or end was not where it should be; their bytes are kept.
    """

    stamps_us: NDArray[np.int64]
    offsets: NDArray[np.int64]
    data: bytes
    damaged: int = 0

    def __len__(self) -> int:
        return len(self.stamps_us)


@njit("int64(uint8[::1], int64)", cache=True)
def _stamp_at(raw: _Raw, at: int) -> int:
    value = 0
    for k in range(at, at + _STAMP):
        value = (value << 8) | raw[k]
    return value


@njit("int64(uint8[::1], int64)", cache=True)
def _end_at(raw: _Raw, at: int) -> int:
    """Return where the record that starts at `at` ends, or -1 when none starts there."""
    if at + _HEAD > len(raw):
        return -1
    head = at + _STAMP
    at = -1
    if raw[head] == _MAGIC_V2:
        at = head + 12 + raw[head + 1] + (13 if raw[head + 2] & _SIGNED else 0)
    if raw[head] == _MAGIC_V1:
        at = head + 8 + raw[head + 1]
    return at


@njit("boolean(uint8[::1], int64, int64)", cache=True)
def _follows(raw: _Raw, stamp_us: int, at: int) -> bool:
    """Tell whether a record with a stamp within a day of `stamp_us` starts at `at`."""
    return _end_at(raw, at) > 0 and abs(_stamp_at(raw, at) - stamp_us) < DAY_US


@njit("boolean(uint8[::1], int64)", cache=True)
def _chained(raw: _Raw, at: int) -> bool:
    """Tell whether a record starts at `at` and another one follows it."""
    end = _end_at(raw, at)
    return end > 0 and _follows(raw, _stamp_at(raw, at), end)


@njit("int64(uint8[::1], int64, int64)", cache=True)
def _resync(raw: _Raw, stamp_us: int, at: int) -> int:
    """Return the next place at or after `at` where a record starts, or the length of the file."""
    for place in range(at, len(raw)):
        if _follows(raw, stamp_us, place) or _chained(raw, place):
            return place
    return len(raw)


@njit("int64[::1](uint8[::1], int64[::1], int64[::1], uint8[::1])", cache=True)
def _cut(
    raw: _Raw, stamps_us: NDArray[np.int64], offsets: NDArray[np.int64], out: NDArray[np.uint8]
) -> NDArray[np.int64]:
    """Fill the tables from the file's bytes; return [records, stream bytes, damaged records]."""
    size = len(raw)
    count, filled, damaged = 0, 0, 0
    at = 0
    stamp_us = -2 * DAY_US
    if not _chained(raw, 0) and _end_at(raw, 0) != size:
        at = _resync(raw, stamp_us, 1)
        damaged += 1
    while at + _STAMP < size:
        own_us = _stamp_at(raw, at)
        end = _end_at(raw, at)
        if abs(own_us - stamp_us) >= DAY_US and count > 0 and not _chained(raw, at):
            own_us = stamp_us  # the stamp itself is damaged
        whole = (end > 0 and end <= size < end + _HEAD) or (
            end > 0 and end < size and (_follows(raw, own_us, end) or _chained(raw, end))
        )
        if not whole and end > 0 and end < size:
            after = _end_at(raw, end)
            whole = after == size or (after > 0 and _follows(raw, own_us, after))  # only the next stamp is damaged
        if not whole:
            end = _resync(raw, own_us, at + _STAMP + 1)
            damaged += 1
        stamps_us[count] = own_us
        offsets[count] = filled
        for k in range(at + _STAMP, end):
            out[filled] = raw[k]
            filled += 1
        count += 1
        stamp_us = own_us
        at = end
    offsets[count] = filled
    return np.array([count, filled, damaged], dtype=np.int64)


def split_tlog(raw: NDArray[np.uint8]) -> TlogBytes:
    """Cut the bytes of a .tlog into stamps and serial stream; what is damaged stays in the stream.

    Raises:
        ValueError: not one whole record in it.
    """
    raw = np.require(raw, np.uint8, ["C", "W"])
    room = len(raw) // (_STAMP + 1) + 2
    stamps_us, offsets = np.empty(room, np.int64), np.empty(room, np.int64)
    out = np.empty(len(raw), np.uint8)
    count, filled, damaged = (int(v) for v in _cut(raw, stamps_us, offsets, out))
    if count in (0, damaged):
        raise ValueError("no MAVLink record in it")
    return TlogBytes(
        stamps_us=stamps_us[:count].copy(),
        offsets=offsets[: count + 1].copy(),
        data=out[:filled].tobytes(),
        damaged=damaged,
    )


def read_tlog(path: Path | str) -> TlogBytes:
    """Return the serial stream of a .tlog with its stamps.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not a .tlog; the message names the file, what is expected and the remedy.
    """
    try:
        return split_tlog(np.fromfile(path, dtype=np.uint8))
    except ValueError as error:
        raise ValueError(
            f"{path} is not a .tlog ({error}): expected 8-byte microsecond stamps, each before one MAVLink frame. "
            "Use the telemetry log a ground station writes; a DataFlash .bin is another format."
        ) from error


def schedule_s(stamps_us: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return when each record is due, in seconds after the first, never decreasing.

    A single stamp outside its neighbours (damage) takes the one before it; a clock set back counts as no time.
    """
    stamps = stamps_us.astype(np.int64, copy=True)
    if len(stamps) > 2:
        before, here, after = stamps[:-2], stamps[1:-1], stamps[2:]
        odd = (before <= after) & ((here < before) | (here > after))
        stamps[1:-1][odd] = before[odd]
    steps_us = np.clip(np.diff(stamps, prepend=stamps[:1]), 0, None)
    return np.asarray(np.cumsum(steps_us) * 1e-6)

"""Compiled search for MAVLink 1 and 2 frames in a byte stream, with exactly pymavlink's idea of what a frame is.

What pymavlink 2.4's `parse_buffer` (robust_parsing) does, and so does this scanner; a test compares them byte for byte:

- bytes before 0xFE or 0xFD are junk, at once;
- a frame is looked at when its claimed length is there: payload + 8 (MAVLink 1) or + 12, + 13 more when signed;
- a wrong check sum, or an incompatibility flag other than "signed", makes the *whole claimed length* junk: the search
  goes on behind it, not one byte further. A false 0xFD can so swallow good frames; pymavlink loses the same ones;
- an unknown id has no check byte, so it is taken unchecked with its claimed length, counted, and never decoded;
- payloads shorter or longer than the definition are valid: missing bytes are zero, surplus ones ignored;
- signatures are not verified (pymavlink without a key does not either).

Cuts do not matter: what is not complete stays pending.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.kernel import kernel
from server.protocol.mavlink.table import ID_SPACE, MessageTable, message_table

MAGIC_V1: Final = 0xFE
MAGIC_V2: Final = 0xFD
FLAG_SIGNED: Final = 1
SIGNATURE_BYTES: Final = 13
MAX_FRAME: Final = 280
MIN_FRAME: Final = 8

# Columns of the frame table (int64).
F_OFFSET: Final = 0
F_LENGTH: Final = 1  # header, payload, check sum and signature
F_ID: Final = 2
F_SYSTEM: Final = 3
F_COMPONENT: Final = 4
F_SEQ: Final = 5
F_VERSION: Final = 6  # 1 or 2
F_INDEX: Final = 7  # into the message table; -1 = unknown id, unchecked
FRAME_WIDTH: Final = 8

# Counters (int64).
C_FRAMES: Final = 0  # frames written by the last call
C_NEXT: Final = 1  # where the search goes on: all bytes before it are frames or junk
C_FRAME_BYTES: Final = 2  # from here on: totals over all calls
C_JUNK_BYTES: Final = 3
C_CRC_ERRORS: Final = 4
C_UNKNOWN: Final = 5
C_TOTAL_FRAMES: Final = 6
COUNTERS: Final = 7


def _crc_table() -> NDArray[np.uint16]:
    table = np.zeros(256, np.uint16)
    for value in range(256):
        crc = value
        for _ in range(8):
            crc = (crc >> 1) ^ (0x8408 if crc & 1 else 0)
        table[value] = crc
    return table


CRC_TABLE: Final = _crc_table()
"""CRC-16/MCRF4XX (X.25 without the final inversion), reflected polynomial 0x8408, start 0xFFFF."""


@kernel("uint16(uint8[::1], int64, int64, uint8, uint16[::1])")
def crc_x25(data: NDArray[np.uint8], start: int, end: int, extra: int, table: NDArray[np.uint16]) -> int:
    """Return MAVLink's check sum over data[start:end] and the message's extra byte."""
    crc = np.uint32(0xFFFF)
    for k in range(np.uint64(start), np.uint64(end)):  # unsigned: no test for negative indices
        crc = (crc >> np.uint32(8)) ^ np.uint32(table[(crc ^ np.uint32(data[k])) & np.uint32(0xFF)])
    crc = (crc >> np.uint32(8)) ^ np.uint32(table[(crc ^ np.uint32(extra)) & np.uint32(0xFF)])
    return int(crc)


@kernel("void(uint8[::1], int64, int16[::1], uint8[::1], uint16[::1], int64[:,::1], int64[::1])")
def scan(
    data: NDArray[np.uint8],
    start: int,
    index_of_id: NDArray[np.int16],
    crc_extra: NDArray[np.uint8],
    crc_table: NDArray[np.uint16],
    frames: NDArray[np.int64],
    counters: NDArray[np.int64],
) -> None:
    """Find frames in data[start:] until it ends or `frames` is full; see the module for what counts as one.

    Args:
        data: the stream; what lies behind `counters[C_NEXT]` afterwards is to be given again, with more behind it.
        start: first byte not looked at yet.
        index_of_id: of the message table.
        crc_extra: of the message table.
        crc_table: `CRC_TABLE`.
        frames: output, shape (capacity, FRAME_WIDTH).
        counters: shape (COUNTERS,); the totals are added to.
    """
    size = len(data)
    at = start
    n = 0
    while at < size and n < len(frames):
        magic = data[at]
        if magic not in (MAGIC_V1, MAGIC_V2):
            counters[C_JUNK_BYTES] += 1
            at += 1
            continue
        if at + 3 > size:
            break
        header = 10 if magic == MAGIC_V2 else 6
        flags = int(np.int64(data[at + 2])) if magic == MAGIC_V2 else 0
        end = at + header + int(np.int64(data[at + 1])) + 2
        length = end - at + (SIGNATURE_BYTES if flags & FLAG_SIGNED else 0)
        if at + length > size:
            break
        if magic == MAGIC_V2:
            message = np.int64(data[at + 7]) | (np.int64(data[at + 8]) << 8) | (np.int64(data[at + 9]) << 16)
        else:
            message = np.int64(data[at + 5])
        index = np.int64(index_of_id[message]) if message < ID_SPACE else -1
        good = flags & ~FLAG_SIGNED == 0
        if good and index >= 0:
            wanted = np.int64(data[end - 2]) | (np.int64(data[end - 1]) << 8)
            good = np.int64(crc_x25(data, at + 1, end - 2, crc_extra[index], crc_table)) == wanted
        if good:
            head = at + 4 if magic == MAGIC_V2 else at + 2
            frames[n, F_OFFSET] = at
            frames[n, F_LENGTH] = length
            frames[n, F_ID] = message
            frames[n, F_SYSTEM] = data[head + 1]
            frames[n, F_COMPONENT] = data[head + 2]
            frames[n, F_SEQ] = data[head]
            frames[n, F_VERSION] = 2 if magic == MAGIC_V2 else 1
            frames[n, F_INDEX] = index
            counters[C_UNKNOWN] += index < 0
            counters[C_FRAME_BYTES] += length
            n += 1
        else:
            counters[C_CRC_ERRORS] += 1
            counters[C_JUNK_BYTES] += length
        at += length
    counters[C_FRAMES] = n
    counters[C_NEXT] = at
    counters[C_TOTAL_FRAMES] += n


class FrameScanner:
    """Turn a byte stream, cut anywhere, into frame tables; the protocol and the benches stand on it."""

    def __init__(self, capacity: int = 2048, table: MessageTable | None = None) -> None:
        self.table = table or message_table()
        self.counters = np.zeros(COUNTERS, np.int64)
        self.frames = np.zeros((capacity, FRAME_WIDTH), np.int64)
        self.data = np.zeros(0, np.uint8)
        self._pending = b""
        self._start = 0

    @property
    def pending(self) -> int:
        """Bytes of a frame that is not complete yet, at most MAX_FRAME - 1 between calls of `push`."""
        return len(self._pending)

    def push(self, data: bytes) -> None:
        """Take more of the stream; call `next_frames` until it returns none."""
        self.data = np.frombuffer(bytearray(self._pending + data), np.uint8)
        self._start = 0

    def next_frames(self) -> NDArray[np.int64]:
        """Return the next frames, shape (n, FRAME_WIDTH), offsets into `self.data`; n = 0 when all are found.

        The array is a view, overwritten by the next call.
        """
        table = self.table
        scan(self.data, self._start, table.index_of_id, table.crc_extra, CRC_TABLE, self.frames, self.counters)
        self._start = int(self.counters[C_NEXT])
        count = int(self.counters[C_FRAMES])
        if count < len(self.frames):
            self._pending = self.data[self._start :].tobytes()
        return self.frames[:count]

    def forget(self) -> None:
        """Count what is pending as junk: the rest of that frame will never come."""
        self.counters[C_JUNK_BYTES] += len(self._pending)
        self._pending = b""

"""Bytes to sample blocks: owns the arrays the kernels work on."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.types import ROW_WIDTH, Byte, Float, Int, SampleBlock
from server.protocol.base import SenderStats
from server.protocol.mavlink.decode import PAYLOAD_BYTES, ROWS_PER_FRAME, decode
from server.protocol.mavlink.layout import (
    NONE,
    S_BOOT,
    S_BOOT_FIRST_SLOT,
    S_CANDIDATE_SYSTEM,
    S_COMPONENT,
    S_PY,
    S_ROWS,
    S_SIZE,
    S_SYSTEM,
    S_WANT_COMPONENT,
    S_WANT_SYSTEM,
    V_SIZE,
)
from server.protocol.mavlink.rates import MessageRates
from server.protocol.mavlink.rows import H_BOOT, H_KIND, H_T, HEADS, forget_boot
from server.protocol.mavlink.scanner import F_ID, F_OFFSET, F_VERSION, FrameScanner
from server.protocol.mavlink.senders import N_FRAMES, N_LOST, N_SEQ, SENDER_WIDTH, SENDERS

CAPACITY: Final = 1024
"""Frames per compiled call: more than any live chunk holds; a replay's big chunks take several calls."""

Part = tuple[Byte, Int, int | Int, Float]
"""Kinds, stamps, boot_id (one, or per row when it changes) and values of the rows of one compiled call."""


class MavlinkDecoder:
    """Turn the stream, cut anywhere, into blocks of samples of one sender; results depend on the bytes alone."""

    def __init__(self, system: int | None, component: int | None) -> None:
        self.scanner = FrameScanner(CAPACITY)
        self.rates = MessageRates(self.scanner.table)
        self.ints = np.zeros(S_SIZE, np.int64)
        self._values = np.full(V_SIZE, np.nan)
        self.ints[[S_SYSTEM, S_COMPONENT]] = NONE
        self.ints[S_WANT_SYSTEM] = NONE if system is None else system
        self.ints[S_WANT_COMPONENT] = NONE if component is None else component
        self.ints[S_CANDIDATE_SYSTEM:S_BOOT_FIRST_SLOT] = NONE
        _start_lock(self.ints, system, component)
        forget_boot(self.ints, self._values)
        self._senders = np.zeros((SENDERS, SENDER_WIDTH), np.int64)
        self._senders[:, N_SEQ] = NONE
        self._heads = np.zeros((HEADS, CAPACITY * ROWS_PER_FRAME), np.int64)
        self._rows = np.zeros((CAPACITY * ROWS_PER_FRAME, ROW_WIDTH))
        self._for_python = np.zeros(CAPACITY, np.int64)
        self._payload = np.zeros(PAYLOAD_BYTES, np.uint8)

    def feed(self, data: bytes, t_rx_ns: int) -> tuple[tuple[SampleBlock, ...], list[tuple[int, bytes]]]:
        """Take bytes; return the blocks and the (id, payload) of messages that are not samples."""
        scanner, ints = self.scanner, self.ints
        parts: list[Part] = []
        others: list[tuple[int, bytes]] = []
        scanner.push(data)
        while True:
            frames = scanner.next_frames()
            count = len(frames)
            if count:
                decode(
                    scanner.data, scanner.frames, count, self._senders, self.rates.counts, ints, self._values,
                    self._heads, self._rows, self._for_python, self._payload,
                )  # fmt: skip
                if n := int(ints[S_ROWS]):
                    parts.append(self._part(n))
                if n := int(ints[S_PY]):
                    others.extend(self._other(frames[k]) for k in self._for_python[:n])
            if count < CAPACITY:
                return blocks_of(parts, t_rx_ns), others

    def _part(self, count: int) -> Part:
        heads = self._heads
        first, last = int(heads[H_BOOT, 0]), int(heads[H_BOOT, count - 1])
        boots = first if first == last else heads[H_BOOT, :count].copy()
        return heads[H_KIND, :count].astype(np.uint8), heads[H_T, :count].copy(), boots, self._rows[:count].copy()

    def _other(self, frame: NDArray[np.int64]) -> tuple[int, bytes]:
        offset = int(frame[F_OFFSET])
        start = offset + (10 if frame[F_VERSION] == 2 else 6)
        return int(frame[F_ID]), self.scanner.data[start : start + int(self.scanner.data[offset + 1])].tobytes()

    def reconnect(self) -> None:
        """Forget half a frame and the sequence numbers: what was sent meanwhile was never on this link."""
        self.scanner.forget()
        self._senders[:, N_SEQ] = NONE

    @property
    def boot_id(self) -> int:
        """Power-ups seen so far, from 0."""
        return int(self.ints[S_BOOT])

    @property
    def senders(self) -> tuple[SenderStats, ...]:
        """Everyone who sent a checked frame, by system and component."""
        return tuple(
            SenderStats(
                system=int(key) >> 8,
                component=int(key) & 255,
                frames=int(self._senders[key, N_FRAMES]),
                lost=int(self._senders[key, N_LOST]),
            )
            for key in np.flatnonzero(self._senders[:, N_FRAMES])
        )


def _start_lock(ints: NDArray[np.int64], system: int | None, component: int | None) -> None:
    """With both ids given there is nothing to find out."""
    if system is not None and component is not None:
        ints[S_SYSTEM], ints[S_COMPONENT] = system, component


def blocks_of(parts: list[Part], t_rx_ns: int) -> tuple[SampleBlock, ...]:
    """Return one block per boot_id."""
    if not parts:
        return ()
    kind, t_ns, boot, data = parts[0]
    if len(parts) == 1 and isinstance(boot, int):
        return (_block(kind, t_ns, boot, data, t_rx_ns),)
    kind, t_ns, data = (np.concatenate([part[k] for part in parts]) for k in (0, 1, 3))
    boots = np.concatenate([np.broadcast_to(part[2], len(part[0])) for part in parts])
    cuts = [0, *(np.flatnonzero(np.diff(boots)) + 1).tolist(), len(boots)]
    return tuple(_block(kind[a:b], t_ns[a:b], int(boots[a]), data[a:b], t_rx_ns) for a, b in pairwise(cuts))


def _block(kind: Byte, t_ns: Int, boot_id: int, data: Float, t_rx_ns: int) -> SampleBlock:
    arrival = np.empty(len(kind), np.int64)
    arrival.fill(t_rx_ns)
    return SampleBlock(kind=kind, t_ns=t_ns, t_rx_ns=arrival, data=data, boot_id=boot_id)

"""Bytes to sample blocks: owns the arrays the kernels work on."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.types import ROW_WIDTH, SampleBlock
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
from server.protocol.mavlink.rows import H_BOOT, H_KIND, H_T, HEAD_WIDTH, forget_boot
from server.protocol.mavlink.scanner import F_ID, F_OFFSET, F_VERSION, FrameScanner
from server.protocol.mavlink.senders import N_FRAMES, N_LOST, N_SEQ, SENDER_WIDTH, SENDERS

CAPACITY: Final = 1024
"""Frames per compiled call: more than any live chunk holds; a replay's big chunks take several calls."""


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
        self._heads = np.zeros((CAPACITY * ROWS_PER_FRAME, HEAD_WIDTH), np.int64)
        self._rows = np.zeros((CAPACITY * ROWS_PER_FRAME, ROW_WIDTH))
        self._for_python = np.zeros(CAPACITY, np.int64)
        self._payload = np.zeros(PAYLOAD_BYTES, np.uint8)

    def feed(self, data: bytes, t_rx_ns: int) -> tuple[tuple[SampleBlock, ...], list[tuple[int, bytes]]]:
        """Take bytes; return the blocks and the (id, payload) of messages that are not samples."""
        scanner, ints = self.scanner, self.ints
        parts: list[tuple[NDArray[np.int64], NDArray[np.float64]]] = []
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
                    parts.append((self._heads[:n].copy(), self._rows[:n].copy()))
                if n := int(ints[S_PY]):
                    others.extend(self._other(frames[k]) for k in self._for_python[:n])
            if count < CAPACITY:
                return blocks_of(parts, t_rx_ns), others

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


def blocks_of(parts: list[tuple[NDArray[np.int64], NDArray[np.float64]]], t_rx_ns: int) -> tuple[SampleBlock, ...]:
    """Return one block per boot_id."""
    if not parts:
        return ()
    heads, rows = parts[0] if len(parts) == 1 else (np.concatenate(item) for item in zip(*parts, strict=True))
    boots = heads[:, H_BOOT]
    if boots[0] == boots[-1]:
        return (_block(heads, rows, t_rx_ns),)
    cuts = [0, *(np.flatnonzero(np.diff(boots)) + 1).tolist(), len(boots)]
    return tuple(_block(heads[a:b], rows[a:b], t_rx_ns) for a, b in pairwise(cuts))


def _block(heads: NDArray[np.int64], rows: NDArray[np.float64], t_rx_ns: int) -> SampleBlock:
    return SampleBlock(
        kind=heads[:, H_KIND].astype(np.uint8),
        t_ns=heads[:, H_T].copy(),
        t_rx_ns=np.full(len(heads), t_rx_ns, np.int64),
        data=rows,
        boot_id=int(heads[0, H_BOOT]),
    )

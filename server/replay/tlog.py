"""A ground station's .tlog: the serial stream of a board through the very same decoder as live."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np

from server.link.tlog import read_tlog
from server.nav.types import Kind, SampleBlock
from server.protocol.mavlink import MavlinkProtocol
from server.replay.errors import ReplayError
from server.replay.source import Account

FEED_BYTES: Final = 16384
"""Bytes a call of the decoder: its cost per call is then nothing, and arrival times stay good to a quarter second."""

_NOT_SAMPLES: Final = (Kind.DATE, Kind.PROFILE)


class TlogLog:
    """A .tlog; decoded while it is replayed."""

    kind = "tlog"

    def __init__(self, path: Path) -> None:
        self.path = path
        self.overrides: dict[str, Any] = {}
        try:
            self._log = read_tlog(path)
        except (OSError, ValueError) as error:
            raise ReplayError(str(error)) from error
        self._protocol = MavlinkProtocol(talk=False)
        self._fed = 0
        self._first: list[SampleBlock] = []
        self._decoded = self._decode()

    def _decode(self) -> Iterator[SampleBlock]:
        """Yield what each piece of the stream gives; pieces end where a record ends."""
        offsets, stamps_us = self._log.offsets, self._log.stamps_us
        last, end = 0, len(stamps_us)
        while last < end:
            until = int(np.searchsorted(offsets, offsets[last] + FEED_BYTES, side="right")) - 1
            until = min(max(until, last + 1), end)
            t_rx_ns = int(stamps_us[until - 1] - stamps_us[0]) * 1000
            decoded = self._protocol.feed(self._log.data[int(offsets[last]) : int(offsets[until])], t_rx_ns)
            self._fed = last = until
            yield from (block for block in decoded.blocks if len(block.t_ns))

    @cached_property
    def t_origin_ns(self) -> int:
        """The stamp of the first sample the stream gives; -1 when it gives none."""
        for block in self._decoded:
            self._first.append(block)
            sample = ~np.isin(block.kind, _NOT_SAMPLES)
            if sample.any():
                return int(block.t_ns[int(np.argmax(sample))])
        return -1

    def blocks(self, rows: int) -> Iterator[SampleBlock]:
        """Yield the samples in order of arrival, at most `rows` a block and one power-up a block."""
        if self.t_origin_ns < 0:
            raise ReplayError(
                f"{self.path}: {self._protocol.stats.frames} MAVLink frames, but no sample among them. "
                "Ask the board for HIGHRES_IMU or RAW_IMU, GPS_RAW_INT and SYSTEM_TIME while recording."
            )
        waiting: list[SampleBlock] = []
        for block in chain(self._first, self._decoded):
            if waiting and waiting[0].boot_id != block.boot_id:
                yield from _cut(waiting, rows)
                waiting = []
            waiting.append(block)
            if sum(len(part.t_ns) for part in waiting) >= rows:
                *whole, rest = _cut(waiting, rows)
                yield from whole
                waiting = [rest]
        yield from _cut(waiting, rows)

    def fraction(self) -> float:
        """Return how much of the stream has been decoded, 0 to 1."""
        return self._fed / max(1, len(self._log.stamps_us))

    def account(self) -> Account:
        """Return the decoder's own accounts."""
        stats = self._protocol.stats
        board = max(stats.senders, key=lambda sender: sender.frames, default=None)
        mine = [sender for sender in stats.senders if board is not None and sender.system == board.system]
        losses = {
            "frames_lost": sum(sender.lost for sender in mine),
            "frames_lost_of_others": sum(sender.lost for sender in stats.senders if sender not in mine),
            "crc_errors": stats.crc_errors,
            "bytes_junk": stats.bytes_junk,
            "bytes_incomplete": stats.bytes_pending,
            "damaged_records": self._log.damaged,
            "unknown_messages": stats.unknown_messages,
            "filtered_frames": stats.filtered_frames,
        }
        return Account(bytes_in=self.path.stat().st_size, board=stats.board, losses=losses)


def _cut(parts: list[SampleBlock], rows: int) -> Iterator[SampleBlock]:
    """Yield the samples of one power-up again in blocks of `rows`; the last may be shorter, never empty."""
    kind, t_ns = np.concatenate([p.kind for p in parts]), np.concatenate([p.t_ns for p in parts])
    t_rx_ns, data = np.concatenate([p.t_rx_ns for p in parts]), np.concatenate([p.data for p in parts])
    for start in range(0, len(t_ns), rows):
        part = slice(start, start + rows)
        yield SampleBlock(
            kind=kind[part], t_ns=t_ns[part], t_rx_ns=t_rx_ns[part], data=data[part], boot_id=parts[0].boot_id
        )

"""What arrived within the last seconds, by the counters of link and protocol, and what bytes without frames are."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from server.link.base import LinkState, LinkStatus
from server.protocol.base import ProtocolStats

WINDOW_S: Final = 5  # one reading a second
KEPT_BYTES: Final = 4096  # of what arrived while nothing made a frame; the oldest are forgotten


class Finding(NamedTuple):
    """What bytes that make no frame are: a state of the link with its cause and remedy."""

    state: LinkState
    code: str
    cause: str
    remedy: str
    details: dict[str, str]


Detect = Callable[[bytes, str], Finding | None]
"""Say what these bytes of the link of this URL are; None when they are what was expected, or too few to tell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recent:
    """Counts of the last seconds; all zero before the second reading."""

    span_s: float = 0.0
    bytes_in: int = 0
    bytes_junk: int = 0
    frames: int = 0
    crc_errors: int = 0
    lost: int = 0

    @property
    def bytes_per_s(self) -> float | None:
        """Mean rate of bytes; None before it is known."""
        return self.bytes_in / self.span_s if self.span_s > 0.0 else None


class _Reading(NamedTuple):
    t_ns: int
    bytes_in: int
    bytes_junk: int
    frames: int
    crc_errors: int
    lost: int


class Traffic:
    """Reads the counters once a second and keeps what is needed to judge a stream that makes no frames."""

    def __init__(self, url: str, detect: Detect) -> None:
        self._url = url
        self._detect = detect
        self._readings: deque[_Reading] = deque(maxlen=WINDOW_S + 1)
        self._kept = bytearray()
        self._finding: Finding | None = None
        self._has_frames = False

    def keep(self, data: bytes) -> None:
        """Remember bytes for detection, as long as nothing made a frame."""
        if not self._has_frames:
            self._kept += data
            del self._kept[:-KEPT_BYTES]

    def read(self, now_ns: int, status: LinkStatus, stats: ProtocolStats) -> None:
        """Take one reading of the counters and judge again what arrives."""
        lost = sum(sender.lost for sender in stats.senders)
        reading = _Reading(now_ns, status.bytes_in, stats.bytes_junk, stats.frames, stats.crc_errors, lost)
        before = self._readings[-1] if self._readings else reading
        if reading.frames < before.frames or reading.bytes_in < before.bytes_in:
            self._readings.clear()  # the counters started again
        self._readings.append(reading)
        self._judge(reading, before)

    def _judge(self, reading: _Reading, before: _Reading) -> None:
        self._has_frames = reading.frames > before.frames
        if self._has_frames:
            self._finding = None
            self._kept.clear()
        elif reading.bytes_in > before.bytes_in:
            self._finding = self._detect(bytes(self._kept), self._url)

    @property
    def recent(self) -> Recent:
        """Counts between the oldest and the newest reading of the window."""
        if len(self._readings) < 2:
            return Recent()
        first, last = self._readings[0], self._readings[-1]
        span_s = (last.t_ns - first.t_ns) / 1e9
        names = ("bytes_in", "bytes_junk", "frames", "crc_errors", "lost")
        return Recent(span_s=span_s, **{name: getattr(last, name) - getattr(first, name) for name in names})

    def judged(self, status: LinkStatus) -> LinkStatus:
        """Return the link's status; an open link whose bytes make no frame says what they are."""
        if status.state is not LinkState.OPEN or self._finding is None:
            return status
        found = self._finding
        return replace(
            status,
            state=found.state,
            code=found.code,
            cause=found.cause,
            remedy=found.remedy,
            details=status.details | found.details,
        )

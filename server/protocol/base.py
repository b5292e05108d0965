"""What a protocol is: bytes to columnar samples and back, sans-I/O, cut anywhere."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from server.nav.types import SampleBlock


@dataclass(frozen=True, slots=True, kw_only=True)
class SenderStats:
    """Frames and losses of one (system, component), by its own sequence numbers."""

    system: int
    component: int
    frames: int
    lost: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestStats:
    """One message the board was asked for.

    Attributes:
        state: "waiting", "asked", "granted", "refused" or "unanswered".
        granted_hz: NaN unless granted.
    """

    message: str
    state: str
    wanted_hz: float
    granted_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtocolStats:
    """Byte-exact accounts: bytes_in = bytes_frames + bytes_junk + bytes_pending."""

    protocol: str
    bytes_in: int = 0
    bytes_frames: int = 0
    bytes_junk: int = 0
    bytes_pending: int = 0
    frames: int = 0  # whole, and their check sums right
    crc_errors: int = 0
    unknown_messages: int = 0  # besides `frames`: noise makes them too, for an unknown id has no check sum
    filtered_frames: int = 0  # whole and valid, but of another system or component
    senders: tuple[SenderStats, ...] = ()
    messages: tuple[tuple[str, int, float], ...] = ()  # (name, count, rate_hz)
    clock_offset_ns: float = float("nan")  # host minus board
    clock_drift_ppm: float = float("nan")
    boot_id: int = 0
    board: str = ""  # e.g. "ArduPilot quadrotor, system 1"
    repeated_samples: int = 0  # old samples that a message carried again
    disbelieved_stamps: int = 0  # messages dropped because their stamp did not fit the board's clock
    requests: tuple[RequestStats, ...] = ()  # what the board was asked for
    code: str = ""  # stable key of what is wrong, "" when well, e.g. "interval-refused"
    cause: str = ""  # English sentences, empty when well
    remedy: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Decoded:
    """What one chunk gave: sample blocks (one per boot_id, usually one) and texts the board sent."""

    blocks: tuple[SampleBlock, ...] = ()
    texts: tuple[tuple[int, str], ...] = field(default=())  # (severity 0..7, text)


class BoardProtocol(Protocol):
    """Decoder and talker of one board."""

    def feed(self, data: bytes, t_rx_ns: int) -> Decoded:
        """Take the stream cut anywhere; the samples do not depend on the cuts."""
        ...

    def outgoing(self, now_ns: int) -> bytes:
        """Return what should be sent now (heartbeat, stream requests, time sync); empty when nothing is due."""
        ...

    def connected(self, now_ns: int) -> None:
        """Forget half a frame and ask for streams again: the link was (re)opened."""
        ...

    @property
    def stats(self) -> ProtocolStats:
        """Counters, cheap to read."""
        ...

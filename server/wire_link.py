"""Bodies about the link and its protocol: what arrives, what is lost, and why nothing arrives."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from server.wire_base import Num, Out


class LinkOut(Out):
    """State of the link with cause and remedy; see `server.link.base.LinkState` for the states."""

    url: str
    state: Literal[
        "opening",
        "open",
        "silent",
        "not-found",
        "busy",
        "no-permission",
        "wrong-baud",
        "foreign-protocol",
        "lost",
        "ended",
        "failed",
    ]
    code: str = ""
    cause: str = ""
    remedy: str = ""
    details: dict[str, str] = Field(default_factory=dict, description="what the sentences were filled with")
    state_age_s: float = Field(description="for how long it has been in this state")
    rx_age_s: Num = Field(default=None, description="since the last byte; null before the first")
    bytes_in: int = 0
    bytes_out: int = 0
    bytes_in_per_s: Num = None
    reconnects: int = 0


class SenderOut(Out):
    """Frames and sequence losses of one sender on the link."""

    system: int
    component: int
    frames: int
    lost: int


class MessageOut(Out):
    """One kind of message with its count and mean rate."""

    name: str
    count: int
    rate_hz: Num


class RequestOut(Out):
    """One message the board was asked for, and what it said."""

    message: str
    state: str = Field(description='"waiting", "asked", "granted", "refused" or "unanswered"')
    wanted_hz: Num
    granted_hz: Num


class ProtocolOut(Out):
    """Byte-exact accounts: bytes_in = bytes_frames + bytes_junk + bytes_pending."""

    protocol: str
    board: str = Field(description='in words, e.g. "ArduPilot quadrotor, system 1"; empty before a heartbeat')
    bytes_in: int
    bytes_frames: int
    bytes_junk: int
    bytes_pending: int
    frames: int
    crc_errors: int
    unknown_messages: int
    filtered_frames: int
    senders: tuple[SenderOut, ...]
    messages: tuple[MessageOut, ...]
    clock_offset_ns: Num = Field(description="host minus board")
    clock_drift_ppm: Num
    boot_id: int
    repeated_samples: int = Field(default=0, description="old samples that a message carried again")
    disbelieved_stamps: int = Field(default=0, description="messages whose stamp did not fit the board's clock")
    requests: tuple[RequestOut, ...] = ()

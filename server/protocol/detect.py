"""What bytes are that make no MAVLink message: noise of a wrong baud rate, or another protocol, named."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from server.link.base import LinkState
from server.protocol.signatures import Coverage, crsf, msp, nmea, rtcm3, sbf, text, ubx

MIN_BYTES: Final = 600
"""Fewer say nothing: two of the longest frames, a line of boot text, a glitch on opening."""
TEXT_SHARE: Final = 0.95
"""Noise has about 40 % printable bytes; a console or a log more than this."""
STUCK_SHARE: Final = 0.98
"""Of 0x00 or 0xFF alone: a line at one level, not data."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """Why a link gives no message.

    Attributes:
        state: WRONG_BAUD or FOREIGN_PROTOCOL.
        code: stable key: "wrong-baud", "line-stuck" or "foreign-protocol".
        protocol: what it is when foreign ("u-blox UBX"), else "".
        cause, remedy: English sentences.
    """

    state: LinkState
    code: str
    protocol: str
    cause: str
    remedy: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Known:
    name: str
    covered: Coverage
    least: int  # bytes of checked messages that make it certain: more where the check sum is short
    remedy: str


_RECEIVER: Final = (
    "This is a GNSS receiver, not the flight board: connect the board's telemetry or USB port, "
    "or choose this protocol for the link if the receiver is what you mean."
)
# In order of precedence: a receiver that speaks its own protocol mostly mixes in NMEA and RTCM.
_KNOWN: Final = (
    _Known(name="u-blox UBX", covered=ubx, least=8, remedy=_RECEIVER),
    _Known(name="Septentrio SBF", covered=sbf, least=8, remedy=_RECEIVER),
    _Known(
        name="RTCM 3",
        covered=rtcm3,
        least=12,
        remedy="These are GNSS corrections, not the flight board: connect the board's telemetry or USB port.",
    ),
    _Known(
        name="MSP (Betaflight, INAV)",
        covered=msp,
        least=24,
        remedy="Set this port to MAVLink in the board's configurator (Ports, Telemetry Output), at 115200 baud.",
    ),
    _Known(
        name="CRSF (radio control link)",
        covered=crsf,
        least=60,
        remedy="This is the radio receiver's line: connect the port that is set to MAVLink.",
    ),
    _Known(name="NMEA 0183", covered=nmea, least=40, remedy=_RECEIVER),
)


def detect(tail: bytes, baud: int | None = None) -> Detection | None:
    """Say what the newest bytes are, none of which made a MAVLink message; None while they are too few.

    Args:
        tail: the last few kB.
        baud: the rate the port was opened with, for the sentence; None where there is none.
    """
    if len(tail) < MIN_BYTES:
        return None
    for known in _KNOWN:
        if known.covered(tail) >= known.least:
            return _foreign(known.name, known.remedy)
    if text(tail) >= TEXT_SHARE * len(tail):
        return _foreign(
            "plain text",
            f"The board prints text ({_sample(tail)}): a console, a log, or a boot loader. Set this port to MAVLink 2 "
            "(ArduPilot: SERIALn_PROTOCOL = 2), or wait if the board is starting.",
        )
    if max(tail.count(0), tail.count(0xFF)) >= STUCK_SHARE * len(tail):
        return _stuck()
    return _wrong_baud(baud)


def _foreign(name: str, remedy: str) -> Detection:
    return Detection(
        state=LinkState.FOREIGN_PROTOCOL,
        code="foreign-protocol",
        protocol=name,
        cause=f"The bytes are {name}, not MAVLink.",
        remedy=remedy,
    )


def _stuck() -> Detection:
    return Detection(
        state=LinkState.WRONG_BAUD,
        code="line-stuck",
        protocol="",
        cause="Nearly all bytes are 0 or 255: the line stays at one level, or the board is much slower than the link.",
        remedy="Check the baud rate, ground and TX/RX, and that adapter and board use the same voltage.",
    )


def _wrong_baud(baud: int | None) -> Detection:
    rate = f" at {baud} baud" if baud else ""
    return Detection(
        state=LinkState.WRONG_BAUD,
        code="wrong-baud",
        protocol="",
        cause=f"Bytes arrive{rate} but none makes a message, and they look like noise.",
        remedy="Set the link to the board's rate: 57600 on telemetry radios, 115200 or 921600 on wired ports "
        "(ArduPilot: SERIALn_BAUD). A USB port takes any rate: if this is one, it is another device.",
    )


def _sample(tail: bytes) -> str:
    lines = [line for line in tail.decode("ascii", "replace").splitlines() if len(line.strip()) > 3]
    return repr(max(lines, key=len).strip()[:40]) if lines else "no whole line"

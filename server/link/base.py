"""What a link is: bytes in and out of one board, with a state a person can act on."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    from server.simulator import Command, SimulatorState


class LinkState(StrEnum):
    """State of a link; every one but OPEN and ENDED comes with a cause and a remedy."""

    OPENING = "opening"
    OPEN = "open"
    SILENT = "silent"  # open, but no byte for a while
    NOT_FOUND = "not-found"  # no such port or host; unplugged
    BUSY = "busy"  # another program holds the port
    NO_PERMISSION = "no-permission"
    WRONG_BAUD = "wrong-baud"  # bytes come, none of them make a frame, and they look like noise
    FOREIGN_PROTOCOL = "foreign-protocol"  # bytes come and are recognised as something else
    LOST = "lost"  # was open, reconnecting
    ENDED = "ended"  # a file was read to its end
    FAILED = "failed"


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkStatus:
    """What the page and the API show of a link.

    Attributes:
        code: stable key of the cause (the page translates it), "" when well, e.g. "port-busy".
        cause, remedy: English sentences; empty when well.
        details: what the sentences were filled with (device, holder, ...), so that a translation by `code` can be too.
        since_ns: host monotonic time since when it is in this state.
        t_last_rx_ns: host monotonic time of the last byte; -1 before the first.
    """

    url: str
    state: LinkState
    code: str = ""
    cause: str = ""
    remedy: str = ""
    since_ns: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    reconnects: int = 0
    t_last_rx_ns: int = -1
    details: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes as they arrived, with the host's monotonic time; `new_session` marks the first after a (re)connect."""

    data: bytes
    t_rx_ns: int
    new_session: bool = False


class Link(Protocol):
    """One way to a board. Used by one task; `chunks` ends only when the source has ended or `close` was called."""

    @property
    def status(self) -> LinkStatus:
        """The present state, cheap to read."""
        ...

    def chunks(self) -> AsyncIterator[Chunk]:
        """Open, reconnect as long as needed, and yield what arrives."""
        ...

    def write(self, data: bytes) -> None:
        """Send without blocking; what does not fit or has no connection is dropped and not counted as sent."""
        ...

    async def close(self) -> None:
        """Release the port; `chunks` then ends."""
        ...


@runtime_checkable
class Turnable(Protocol):
    """A link whose board can be turned by hand from here: the demo board's only."""

    async def control(self, command: Command | None = None) -> SimulatorState:
        """Turn the board, or what is around it; return its state then. None only asks for the state.

        Raises:
            ValueError: this board cannot do it; the text says why and what to do.
            ConnectionError: the board does not run (now).
        """
        ...

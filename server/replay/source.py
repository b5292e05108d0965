"""What a replay reads from: one interface for every kind of log, and the choice among them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from server.nav.types import SampleBlock
from server.replay.errors import ReplayError

BLOCK_ROWS = 8192
"""Rows a block: large enough that the call costs nothing, small enough to stay in the cache."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Account:
    """What was read, once it was read.

    Attributes:
        bytes_in: size of the input.
        board: what the log says of its board, "" when nothing.
        losses: what was lost or left out, by reason; every reason the reader knows, zero included.
        notes: sentences a person should read.
    """

    bytes_in: int
    board: str = ""
    losses: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


class LogInput(Protocol):
    """One log, read once.

    Attributes:
        path: where it is.
        kind: "tlog" or "folder".
        overrides: fields of EngineSettings the log itself sets.
    """

    path: Path
    kind: str
    overrides: dict[str, Any]

    @property
    def t_origin_ns(self) -> int:
        """Board time that `--gnss-outage` counts from; -1 when there is no sample."""
        ...

    def blocks(self, rows: int) -> Iterator[SampleBlock]:
        """Yield the samples in their order, at most `rows` a block."""
        ...

    def fraction(self) -> float:
        """Return how much of the log has been read, 0 to 1."""
        ...

    def account(self) -> Account:
        """Return what was read and lost so far."""
        ...


def load(log: Path) -> LogInput:
    """Return the reader of a .tlog or of a sensor folder.

    Raises:
        ReplayError: neither, or not readable; the message says what is wrong and the remedy.
    """
    if log.is_dir():
        from server.replay.folder import FolderLog

        return FolderLog(log)
    if not log.exists():
        raise ReplayError(f"{log} does not exist. Give a .tlog file or a sensor folder.")
    if log.suffix.lower() == ".tlog":
        from server.replay.tlog import TlogLog

        return TlogLog(log)
    raise ReplayError(f"{log} is neither a .tlog nor a sensor folder. {_remedy(log)}")


def _remedy(log: Path) -> str:
    if log.suffix.lower() in {".csv", ".toml"}:
        return f"Give the folder that holds it: {log.parent}."
    if log.suffix.lower() in {".bin", ".ulg", ".mcap"}:
        return "This format is not read yet; export its sensors as a sensor folder (see CONTRACT.md)."
    return "Rename a telemetry log to end in .tlog, or write a sensor folder (see CONTRACT.md)."

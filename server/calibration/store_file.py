"""The file of the calibration store: opened sound or put aside, never in the way of a start."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from server.calibration.errors import StoreError

NAME: Final = "calibration.sqlite3"
SCHEMA_VERSION: Final = 1
BUSY_TIMEOUT_S: Final = 5.0
LEAST_BYTES: Final = 512  # the smallest page of an SQLite file
_ASIDE_SUFFIXES: Final = ("", "-journal", "-wal", "-shm")
_SCHEMA: Final = (
    "CREATE TABLE IF NOT EXISTS sets(n INTEGER PRIMARY KEY AUTOINCREMENT, board_id TEXT NOT NULL, id TEXT NOT NULL,"
    " sensor TEXT NOT NULL, samples TEXT NOT NULL, body TEXT NOT NULL, digest TEXT NOT NULL, UNIQUE(board_id, id))",
    "CREATE TABLE IF NOT EXISTS in_force(board_id TEXT NOT NULL, sensor TEXT NOT NULL, set_id TEXT NOT NULL,"
    " PRIMARY KEY(board_id, sensor), FOREIGN KEY(board_id, set_id) REFERENCES sets(board_id, id))",
    "CREATE TABLE IF NOT EXISTS history(n INTEGER PRIMARY KEY AUTOINCREMENT, board_id TEXT NOT NULL,"
    " sensor TEXT NOT NULL, action TEXT NOT NULL, old TEXT NOT NULL, new TEXT NOT NULL, by TEXT NOT NULL,"
    " utc TEXT NOT NULL)",
    "CREATE INDEX IF NOT EXISTS history_of ON history(board_id, sensor, n)",
)
TABLES: Final = {
    "sets": ("n", "board_id", "id", "sensor", "samples", "body", "digest"),
    "in_force": ("board_id", "sensor", "set_id"),
    "history": ("n", "board_id", "sensor", "action", "old", "new", "by", "utc"),
}
_LOCKED: Final = frozenset({sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED})


@dataclass(slots=True)
class Opened:
    """The connection, what had to be said about it, and whether it outlives the process."""

    connection: sqlite3.Connection
    troubles: list[str] = field(default_factory=list)
    is_persistent: bool = True
    salvage_from: Path | None = None


def open_store(folder: Path) -> Opened:
    """Return a usable store: the file's, a new one with the damaged file put aside, or one in memory, and why.

    Raises:
        StoreError: another process holds the file ("store-busy"); its content is unknown, so nothing may replace it.
    """
    path = folder / NAME
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _lock(folder):
            return _opened(path)
    except OSError as error:
        return _in_memory(f"{path} cannot be opened: {error.strerror or error}.")


def _opened(path: Path) -> Opened:
    reason = ""
    size = path.stat().st_size if path.is_file() else LEAST_BYTES
    troubles = [] if size else [f"{path.name} was empty: what it held, if anything, is lost."]
    if 0 < size < LEAST_BYTES:  # SQLite would take it for an empty one, and write over it
        return _put_aside(path, f"it has {size} bytes only")
    try:
        connection = _connect(path)
        if (version := connection.execute("PRAGMA user_version").fetchone()[0]) > SCHEMA_VERSION:
            connection.close()
            return _in_memory(f"{path} was written by a newer navdeck (its format is {version}); it is left alone.")
        reason = _unsoundness(connection)
        if not reason:
            _make_schema(connection)
            return Opened(connection, troubles)
        connection.close()
    except sqlite3.DatabaseError as error:
        if is_locked(error):
            raise busy() from error
        if getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF not in {
            sqlite3.SQLITE_CORRUPT,
            sqlite3.SQLITE_NOTADB,
        }:
            return _in_memory(f"{path} cannot be opened: {error}.")
        reason = str(error)
    return _put_aside(path, reason)


def _connect(path: Path) -> sqlite3.Connection:
    """Open it for all threads (the caller locks), transactions begun by hand."""
    connection = sqlite3.connect(path, timeout=BUSY_TIMEOUT_S, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("PRAGMA journal_mode=DELETE")
        connection.execute("PRAGMA synchronous=EXTRA")
        connection.execute("PRAGMA foreign_keys=ON")
    except sqlite3.DatabaseError:
        connection.close()
        raise
    return connection


def _unsoundness(connection: sqlite3.Connection) -> str:
    answer = [str(row[0]) for row in connection.execute("PRAGMA integrity_check(3)")]
    if answer != ["ok"]:
        return "; ".join(" ".join(line.split()) for line in answer)[:300]
    for table, columns in TABLES.items():
        found = {str(row[1]) for row in connection.execute(f"PRAGMA table_info({table})")}
        if found and not found.issuperset(columns):
            return f"table {table} lacks {', '.join(sorted(set(columns) - found))}"
    return ""


def _make_schema(connection: sqlite3.Connection) -> None:
    if connection.execute("PRAGMA user_version").fetchone()[0] == SCHEMA_VERSION and _has_all(connection):
        return
    connection.execute("BEGIN IMMEDIATE")
    for statement in _SCHEMA:
        connection.execute(statement)
    connection.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
    connection.execute("COMMIT")


def _has_all(connection: sqlite3.Connection) -> bool:
    rows = connection.execute("SELECT name FROM sqlite_master WHERE type='table'")
    return {str(row[0]) for row in rows}.issuperset(TABLES)


def _put_aside(path: Path, reason: str) -> Opened:
    """Move a damaged file and its journal out of the way and begin a new one; nothing of it is deleted."""
    stamp = datetime.now(tz=UTC).strftime("%Y%m%dT%H%M%S%f")
    aside = path.with_name(f"damaged-{stamp}-{path.name}")
    for suffix in _ASIDE_SUFFIXES:
        with contextlib.suppress(FileNotFoundError):
            os.replace(path.with_name(path.name + suffix), aside.with_name(aside.name + suffix))
    connection = _connect(path)
    _make_schema(connection)
    text = f"The calibration store was damaged ({reason}). It was put aside as {aside.name}, nothing of it deleted."
    return Opened(connection, [text], salvage_from=aside)


def _in_memory(reason: str) -> Opened:
    connection = sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA foreign_keys=ON")
    _make_schema(connection)
    text = f"{reason} Calibrations work, but are lost when navdeck ends. Correct this and start again."
    return Opened(connection, [text], is_persistent=False)


def salvaged(aside: Path, table: str) -> Iterator[tuple[object, ...]]:
    """Yield the rows of a damaged file that can still be read, oldest first, as `TABLES` names the columns."""
    uri = f"{aside.absolute().as_uri()}?mode=ro&immutable=1"
    with contextlib.suppress(sqlite3.DatabaseError), contextlib.closing(sqlite3.connect(uri, uri=True)) as connection:
        yield from connection.execute(f"SELECT {', '.join(TABLES[table])} FROM {table}")  # noqa: S608  # constants of `TABLES`


def is_locked(error: sqlite3.Error) -> bool:
    """True when another process or connection holds the file."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in _LOCKED


def busy() -> StoreError:
    """Return the refusal when another process holds the file for longer than the wait."""
    return StoreError(
        "store-busy",
        f"Another process has held the calibration store for {BUSY_TIMEOUT_S:g} s. End the other navdeck, or give "
        "this one another data folder.",
    )


@contextlib.contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Let one process at a time judge the file, so that none puts aside what another has just made anew."""
    if sys.platform == "win32":  # no flock; there an open file cannot be moved anyway
        yield
        return
    import fcntl

    with (folder / ".opening").open("ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield

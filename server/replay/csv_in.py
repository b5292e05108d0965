"""One CSV file of a sensor folder to arrays, with errors that name file, line, value and remedy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from server.nav.types import ROW_WIDTH, Float, Int
from server.replay import csv_cells
from server.replay.errors import ReplayError, nearest
from server.replay.numbers import Uint, powers_of_five
from server.replay.tables import T_NS, Table

_BOM = b"\xef\xbb\xbf"
_FIRST_ODD_ROOM = 1024


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Read:
    """A table as it stands in its file.

    Attributes:
        t_ns: shape (n,), in the file's order.
        data: shape (n, ROW_WIDTH), columns as in SAMPLE_COLUMNS; empty = NaN.
        truncated: 1 when the last line was cut off and left out.
        notes: what a person should know: columns ignored or absent.
    """

    t_ns: Int
    data: Float
    truncated: int
    notes: tuple[str, ...]


@cache
def _five() -> Uint:
    return powers_of_five()


def read_table(path: Path, table: Table) -> Read:
    """Return the file's rows.

    Raises:
        ReplayError: a needed column is missing, or a cell or line cannot be read.
    """
    raw = _bytes(path)
    names, start = _header(path, raw)
    _check_names(path, table, names)
    target = np.array([_target(table, name) for name in names], dtype=np.int64)
    t_ns, data, truncated = _scan(path, raw, start, names, target)
    return Read(t_ns=t_ns, data=data, truncated=truncated, notes=tuple(_notes(path, table, names)))


def _bytes(path: Path) -> bytes:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ReplayError(f"{path} cannot be read: {error.strerror}. Check the path and its permissions.") from error
    raw = raw.removeprefix(_BOM)
    if b"\0" in raw[:4096]:
        raise ReplayError(f"{path} is not plain text (it holds zero bytes). Save it as CSV in UTF-8.")
    return raw


def _header(path: Path, raw: bytes) -> tuple[list[str], int]:
    """Return the column names and where the first row begins."""
    end = raw.find(b"\n")
    end = len(raw) if end < 0 else end
    line = raw[:end].decode("utf-8", errors="replace").strip()
    if not line:
        raise ReplayError(f"{path}: line 1 is empty. The first line must name the columns, t_ns among them.")
    return [name.strip().strip('"').strip() for name in line.split(",")], end + 1


def _check_names(path: Path, table: Table, names: list[str]) -> None:
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        raise ReplayError(f"{path}: line 1 names {', '.join(twice)} more than once. Keep one column of each name.")
    for group in ((T_NS,), *table.needed):
        if not any(name in names for name in group):
            others = [name for name in names if name not in table.columns]
            raise ReplayError(
                f"{path}: line 1 has no column {' or '.join(group)}{nearest(group[0], others)}; it has "
                f"{', '.join(names)}. Columns are found by name, in any order: {', '.join((T_NS, *table.columns))}."
            )


def _target(table: Table, name: str) -> int:
    if name == T_NS:
        return csv_cells.T_NS
    return table.places[table.columns.index(name)] if name in table.columns else csv_cells.IGNORED


def _notes(path: Path, table: Table, names: list[str]) -> list[str]:
    extra = [name for name in names if name != T_NS and name not in table.columns]
    absent = [name for name in table.columns if name not in names]
    alternative = table.columns if table.columns in table.needed else ()
    notes = []
    if extra:
        hints = ", ".join(f"{name}{nearest(name, absent)}" for name in extra)
        notes.append(f"{path.name}: columns not in the contract are ignored: {hints}")
    if unknown := [name for name in absent if name not in alternative]:
        notes.append(f"{path.name}: columns that are absent are unknown throughout: {', '.join(unknown)}")
    return notes


def _scan(path: Path, raw: bytes, start: int, names: list[str], target: NDArray[np.int64]) -> tuple[Int, Float, int]:
    text = np.frombuffer(raw, dtype=np.uint8).copy()  # the kernel's signature wants a writable array
    room = raw.count(b"\n", start) + 1
    t_ns, data = np.zeros(room, dtype=np.int64), np.full((room, ROW_WIDTH), np.nan)
    odd_room = _FIRST_ODD_ROOM
    while True:
        odd = np.empty((odd_room, 4), dtype=np.int64)
        end, rows, odds, line_at, cell = (
            int(v) for v in csv_cells.scan_cells(text, start, target, t_ns, data.view(np.uint64), odd, _five())
        )
        if end != csv_cells.NO_ROOM:
            break
        odd_room *= 16
    truncated = end != csv_cells.END and b"\n" not in raw[line_at:] and raw.count(b",", line_at) + 1 < len(names)
    if end != csv_cells.END and not truncated:
        raise ReplayError(_trouble(path, raw, names, cell if end == csv_cells.BAD_STAMP else -1, line_at))
    for row, column, begin, stop in odd[:odds].tolist():
        data[row, target[column]] = _python_number(path, raw, names[column], begin, stop)
    return t_ns[:rows], data[:rows], int(truncated)


def _python_number(path: Path, raw: bytes, name: str, begin: int, stop: int) -> float:
    """Return the value of a cell that is not a plain decimal; Python's own rule decides, underscores excepted."""
    text = raw[begin:stop].decode("utf-8", errors="replace").strip('"').strip()
    try:
        return float("nan" if not text else text if "_" not in text else "_")
    except ValueError:
        line = _line_number(raw, begin)
        raise ReplayError(
            f"{path}: line {line}, column {name}: {text[:40]!r} is not a number. "
            "Write a decimal number with a point, or leave the cell empty when it is unknown."
        ) from None


def _line_number(raw: bytes, at: int) -> int:
    return raw.count(b"\n", 0, at) + 1


def _trouble(path: Path, raw: bytes, names: list[str], stamp_cell: int, line_at: int) -> str:
    """Return what is wrong with the line: its stamp in the given cell, or (-1) its number of cells."""
    line_end = raw.find(b"\n", line_at)
    line = raw[line_at : len(raw) if line_end < 0 else line_end].decode("utf-8", errors="replace").rstrip("\r")
    where = f"{path}: line {_line_number(raw, line_at)}"
    if stamp_cell >= 0:
        found = line.split(",")[stamp_cell].strip()
        return (
            f"{where}, column t_ns: {found[:40]!r} is not an integer. t_ns is a whole number of nanoseconds of the "
            "board's clock; multiply seconds by 1000000000 and write it without a point or exponent."
        )
    count = len(line.split(","))
    return (
        f"{where} has {count} cells where line 1 names {len(names)} columns ({line[:60]!r}). "
        "Give every line the same cells, leave unknown ones empty, and use commas between them."
    )

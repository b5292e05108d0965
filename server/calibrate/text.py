"""A delimited text file to numbers: any of the usual delimiters, compiled, with errors that name line and value."""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from server.calibrate.columns import plain
from server.calibrate.errors import CalibrateError
from server.nav.types import Float, Int
from server.replay import csv_cells
from server.replay.numbers import Uint, powers_of_five

STDIN: Final = Path("-")
_BOM: Final = b"\xef\xbb\xbf"
_BLANKS: Final = re.compile(rb"[ \t]+")
_EDGES: Final = re.compile(rb"(?m)^[ \t]+|[ \t]+$")
_FIRST_ODD_ROOM: Final = 1024


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Text:
    """A file as it stands.

    Attributes:
        names: of the columns, as `columns.plain`; () when the file has none.
        numbers: shape (n, columns), float64; empty = NaN. A `t_ns` column of integers is in `t_ns` instead.
        t_ns: shape (n,), int64, exact; None without such a column.
    """

    path: Path
    names: tuple[str, ...]
    numbers: Float
    t_ns: Int | None
    notes: tuple[str, ...] = ()


@cache
def _five() -> Uint:
    return powers_of_five()


def read_text(path: Path, told_names: tuple[str, ...] = ()) -> Text:
    """Return the file's numbers.

    Args:
        path: the file; "-" is standard input.
        told_names: names of the columns of a file without a header; () = its first line has them.

    Raises:
        CalibrateError: not readable, or a line or cell that cannot be read.
    """
    raw = _bytes(path)
    names, start, marked = _header(path, raw)
    if told_names and names:
        raise CalibrateError(f"{path}: line 1 names the columns already. Leave --columns away.")
    body, notes = _with_commas(raw, start, marked)
    names = names or tuple(plain(name) for name in told_names)
    width = len(names) or body[: body.find(b"\n")].count(b",") + 1
    numbers, t_ns, cut = _scan(path, body, raw.count(b"\n", 0, start), names, width)
    if cut:
        notes = (*notes, f"{path}: the last line was cut off and is left out.")
    return Text(path=path, names=names, numbers=numbers, t_ns=t_ns, notes=notes)


def _bytes(path: Path) -> bytes:
    try:
        raw = sys.stdin.buffer.read() if path == STDIN else path.read_bytes()
    except OSError as error:
        raise CalibrateError(f"{path} cannot be read: {error.strerror}. Check the path and its permissions.") from error
    raw = raw.removeprefix(_BOM)
    if b"\0" in raw[:4096]:
        raise CalibrateError(f"{path} is not plain text (it holds zero bytes). Give CSV in UTF-8, or a .tlog.")
    return raw.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def _header(path: Path, raw: bytes) -> tuple[tuple[str, ...], int, bytes]:
    """Return the column names (() when there are none), where the first row begins, and the line to judge by.

    Lines that begin with # are skipped; the last of them is the header when it names as many columns as follow.
    """
    at, comment = 0, b""
    while True:
        end = raw.find(b"\n", at)
        line, after = (raw[at:], len(raw)) if end < 0 else (raw[at:end], end + 1)
        if line.strip() and not line.lstrip().startswith(b"#"):
            break
        comment = line.lstrip().lstrip(b"#") or comment
        if after >= len(raw):
            raise CalibrateError(f"{path} is empty. The first line names the columns, samples follow.")
        at = after
    if not _all_numbers(line):
        return tuple(plain(cell) for cell in _cells(line)), after, line
    names = tuple(plain(cell) for cell in _cells(comment)) if comment else ()
    return (names if len(names) == len(_cells(line)) and not _all_numbers(comment) else ()), at, line


def _delimiter(line: bytes) -> str:
    return next((mark for mark in ";,\t" if mark.encode() in line), " ")


def _cells(line: bytes) -> list[str]:
    text, mark = line.decode("utf-8", errors="replace").strip(), _delimiter(line)
    return text.split() if mark == " " else [cell.strip() for cell in text.split(mark)]


def _all_numbers(line: bytes) -> bool:
    cells = _cells(line)
    try:
        [float(cell.replace(",", ".")) for cell in cells if cell]
    except ValueError:
        return False
    return any(cells)


def _with_commas(raw: bytes, start: int, line: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Return the samples with commas between the cells; where ; separates, a comma is a decimal point."""
    body, mark = raw[start:], _delimiter(line)
    first = body[: body.find(b"\n")]
    if mark == "," and b"," not in first and first.strip():  # a header with commas over blank-separated samples
        mark = _delimiter(first)
    if mark == ";":
        points = (f"Cells end with ; so {body.count(b',')} commas are decimal points.",) if b"," in first else ()
        return body.replace(b",", b".").replace(b";", b","), points
    if mark == "\t":
        return body.replace(b"\t", b","), ()
    return (body, ()) if mark == "," else (_BLANKS.sub(b",", _EDGES.sub(b"", body)), ())


def _scan(path: Path, body: bytes, lines: int, names: tuple[str, ...], width: int) -> tuple[Float, Int | None, bool]:
    """Return the numbers, the integer stamps if any, and whether the last line was cut off."""
    target = np.arange(width)
    stamp = names.index("t_ns") if "t_ns" in names else -1
    if stamp >= 0:
        target[stamp] = csv_cells.T_NS
    text = np.frombuffer(body, dtype=np.uint8).copy()
    room = body.count(b"\n") + 1
    t_ns, data = np.zeros(room, dtype=np.int64), np.full((room, width), np.nan)
    odd_room = _FIRST_ODD_ROOM
    while True:
        odd = np.empty((odd_room, 4), dtype=np.int64)
        found = csv_cells.scan_cells(text, 0, target, t_ns, data.view(np.uint64), odd, _five())
        end, rows, odds, line_at, _ = (int(v) for v in found)
        if end == csv_cells.BAD_STAMP and target[stamp] == csv_cells.T_NS:  # 1.0e9: as other programs write integers
            target[stamp] = stamp
        elif end == csv_cells.NO_ROOM:
            odd_room *= 16
        else:
            break
    cut = end == csv_cells.TOO_FEW and b"\n" not in body[line_at:]
    if end != csv_cells.END and not cut:
        raise CalibrateError(_wrong_length(path, body, lines, line_at, width))
    for row, cell, begin, stop in odd[:odds].tolist():
        data[row, cell] = _odd_number(path, body, lines, (begin, stop), names[cell] if names else str(cell + 1))
    exact = stamp >= 0 and target[stamp] == csv_cells.T_NS
    return data[:rows], t_ns[:rows] if exact else None, cut


def _odd_number(path: Path, body: bytes, lines: int, cell: tuple[int, int], name: str) -> float:
    """Return the value of a cell that is not a plain decimal; Python's own rule decides, underscores excepted."""
    text = body[cell[0] : cell[1]].decode("utf-8", errors="replace").strip('"').strip()
    try:
        return float("nan" if not text else text if "_" not in text else "_")
    except ValueError:
        line = lines + body.count(b"\n", 0, cell[0]) + 1
        raise CalibrateError(
            f"{path}: line {line}, column {name}: {text[:40]!r} is not a number. "
            "Write a decimal number with a point, or leave the cell empty when it is unknown."
        ) from None


def _wrong_length(path: Path, body: bytes, lines: int, line_at: int, width: int) -> str:
    end = body.find(b"\n", line_at)
    line = body[line_at : len(body) if end < 0 else end].decode("utf-8", errors="replace")
    number = lines + body.count(b"\n", 0, line_at) + 1
    return (
        f"{path}: line {number} has {line.count(',') + 1} cells instead of {width} "
        f"({line[:60]!r}). Give every line the same cells and leave unknown ones empty."
    )

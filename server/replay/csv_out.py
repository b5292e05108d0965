"""Rows to the contract's CSV: shortest decimals that read back to the same number, unknown = empty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import orjson

from server.nav.types import CSV_LANE_COLUMNS, LANE_COLUMNS, Float, Int, LaneStatus

CSV_COLUMNS: Final = ("t_ns", *LANE_COLUMNS[:CSV_LANE_COLUMNS])
"""The header of every lane file."""

STATUS_COLUMN: Final = LANE_COLUMNS.index("status")
STATUS_WORDS: Final = tuple(status.name.lower() for status in LaneStatus)

_ROWS_A_PIECE: Final = 16384


def header_line() -> bytes:
    """Return the first line of a lane file."""
    return (",".join(CSV_COLUMNS) + "\n").encode()


def csv_lines(t_ns: Int, data: Float) -> bytes:
    """Return one line a row, t_ns first, the status as a word.

    Args:
        t_ns: shape (m,).
        data: shape (m, ≥ CSV_LANE_COLUMNS), as in LaneRows; not finite = empty.
    """
    parts = (slice(k, k + _ROWS_A_PIECE) for k in range(0, len(t_ns), _ROWS_A_PIECE))
    return b"".join(_lane_piece(t_ns[part], data[part]) for part in parts)


def number_table(columns: Sequence[str], t_ns: Int, data: Float) -> bytes:
    """Return a whole file: a header, then one line a row.

    Args:
        columns: names, t_ns first.
        t_ns: shape (m,).
        data: shape (m, len(columns) - 1); not finite = empty.
    """
    parts = (slice(k, k + _ROWS_A_PIECE) for k in range(0, len(t_ns), _ROWS_A_PIECE))
    return (",".join(columns) + "\n").encode() + b"".join(_number_piece(t_ns[part], data[part]) for part in parts)


def _lane_piece(t_ns: Int, data: Float) -> bytes:
    words = _words(data[:, STATUS_COLUMN])
    lines = zip(t_ns.tolist(), _rows(data[:, :STATUS_COLUMN]), words, strict=True)
    return "".join(f"{stamp},{row},{word}\n" for stamp, row, word in lines).encode()


def _number_piece(t_ns: Int, data: Float) -> bytes:
    return "".join(f"{stamp},{row}\n" for stamp, row in zip(t_ns.tolist(), _rows(data), strict=True)).encode()


def _rows(data: Float) -> list[str]:
    """Return the cells of each row with commas between them; at least one row."""
    text = orjson.dumps(np.ascontiguousarray(data), option=orjson.OPT_SERIALIZE_NUMPY)  # the fastest writer there is
    return text[2:-2].replace(b"null", b"").decode().split("],[")


def _words(status: Float) -> Sequence[str]:
    known = np.isfinite(status)
    index = np.where(known, status, 0).astype(np.int64)
    return ["" if not k else STATUS_WORDS[i] for k, i in zip(known.tolist(), index.tolist(), strict=True)]

"""Lane rows to the contract's CSV: shortest decimals that read back to the same number, unknown = empty."""

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
    pieces = range(0, len(t_ns), _ROWS_A_PIECE)
    return b"".join(_piece(t_ns[k : k + _ROWS_A_PIECE], data[k : k + _ROWS_A_PIECE]) for k in pieces)


def _piece(t_ns: Int, data: Float) -> bytes:
    numbers = np.ascontiguousarray(data[:, :STATUS_COLUMN])
    text = orjson.dumps(numbers, option=orjson.OPT_SERIALIZE_NUMPY)  # the fastest shortest-decimal writer there is
    rows = text[2:-2].replace(b"null", b"").decode().split("],[")
    words = _words(data[:, STATUS_COLUMN])
    lines = zip(t_ns.tolist(), rows, words, strict=True)
    return "".join(f"{stamp},{row},{word}\n" for stamp, row, word in lines).encode()


def _words(status: Float) -> Sequence[str]:
    known = np.isfinite(status)
    index = np.where(known, status, 0).astype(np.int64)
    return ["" if not k else STATUS_WORDS[i] for k, i in zip(known.tolist(), index.tolist(), strict=True)]

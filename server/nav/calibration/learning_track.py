"""Rows kept for a picture: bounded; when full, every second one goes and only every second one comes from then on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from server.nav.types import Float

MAX_ROWS: Final = {3: 1500, 7: 36_000}  # points of a 3D view; an hour of 10 Hz


class Track:
    """A bounded table of rows, evenly spread over everything that was added."""

    def __init__(self, width: int) -> None:
        """Start empty; `width`: 3 for points, 7 for (t_ns, offset, sigma)."""
        self._rows = np.empty((MAX_ROWS[width], width))
        self._count = self._seen = 0
        self._stride = 1

    def add(self, row: Sequence[float]) -> None:
        """Keep one row, or pass it over."""
        if self._seen % self._stride == 0:
            if self._count == len(self._rows):
                self._count = len(self._rows) // 2
                self._rows[: self._count] = self._rows[::2].copy()
                self._stride *= 2
            self._rows[self._count] = row
            self._count += 1
        self._seen += 1

    def rows(self) -> Float:
        """Return a copy, shape (k, width), oldest first."""
        return self._rows[: self._count].copy()

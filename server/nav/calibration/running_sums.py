"""Mean and scatter of a stream in constant memory, the same to the last bit wherever the stream is cut."""

from __future__ import annotations

import math

import numpy as np

from server.nav.kernel import kernel
from server.nav.types import Float


@kernel("int64(float64[:, ::1], int64, int64, float64[::1], float64[::1])")
def add_rows(rows: Float, first: int, count: int, mean: Float, square: Float) -> int:
    """Add rows to a running mean and sum of squares about it (Welford), one by one; return how many there are now.

    Args:
        rows: shape (n, > first + c).
        first: the column of the first of the c values.
        count: rows in the mean so far.
        mean, square: shape (c,), changed in place.
    """
    width = mean.shape[0]
    for k in range(rows.shape[0]):
        known = True
        for i in range(width):
            known = known and math.isfinite(rows[k, first + i])
        if not known:
            continue
        count += 1
        for i in range(width):
            step = rows[k, first + i] - mean[i]
            mean[i] += step / count
            square[i] += step * (rows[k, first + i] - mean[i])
    return count


class RunningSums:
    """Count, mean and scatter of a stream of vectors, in constant memory."""

    def __init__(self, width: int) -> None:
        """Start empty, with vectors of this many numbers."""
        self.count = 0
        self.mean = np.zeros(width)
        self._square = np.zeros(width)

    def feed(self, rows: Float, first: int) -> None:
        """Take the columns from `first` on; rows with an unknown one are left out."""
        self.count = add_rows(np.ascontiguousarray(rows), first, self.count, self.mean, self._square)

    @property
    def scatter(self) -> Float:
        """Standard deviation of each column."""
        return np.sqrt(self._square / max(self.count - 1, 1))

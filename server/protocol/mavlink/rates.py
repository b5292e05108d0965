"""Message counts and rates over the last seconds of board time."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.protocol.mavlink.table import MessageTable

PERIOD_NS: Final = 1_000_000_000
WINDOW: Final = 6


class MessageRates:
    """Keeps the counts of the last few seconds beside the running ones."""

    def __init__(self, table: MessageTable) -> None:
        self._table = table
        self.counts = np.zeros(len(table.ids), np.int64)
        self._past: deque[tuple[int, NDArray[np.int64]]] = deque(maxlen=WINDOW)
        self._due_ns = -1

    def update(self, t_ns: int) -> None:
        """Take the newest stamp of the board; cheap unless a second has passed."""
        if t_ns >= self._due_ns:
            self._past.append((t_ns, self.counts.copy()))
            self._due_ns = t_ns + PERIOD_NS

    def count_of(self, message_id: int) -> int:
        """Return how many messages of a known id have come."""
        return int(self.counts[self._table.index_of_id[message_id]])

    def reset(self) -> None:
        """Start measuring again: the board's clock did. The counts go on."""
        self._past.clear()
        self._due_ns = -1

    @property
    def table(self) -> tuple[tuple[str, int, float], ...]:
        """(name, count, Hz) of every message seen; NaN in the first second."""
        rates = np.full(len(self.counts), np.nan)
        if len(self._past) > 1:
            (t0, old), (t1, new) = self._past[0], self._past[-1]
            rates = (new - old) / ((t1 - t0) * 1e-9)
        return tuple((self._table.names[k], int(self.counts[k]), float(rates[k])) for k in np.flatnonzero(self.counts))

"""The last minutes of every row topic, thinned and bounded, for a page that opens late."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from server.nav.types import AID_COLUMNS, StepResult
from server.rows import MAX_ROWS, RowTopic, Table, Thinner, merged

RATE_HZ: Final = 10.0
MAX_PENDING: Final = 512  # results that wait for `flush`; reaching it flushes
AID_GROUPS: Final = 10  # of those there are, as many as one board has: thinned each kind for itself
TURNS: Final = 2  # attitude and position, in rows of their own


class Ring:
    """The newest `capacity` rows; the oldest are overwritten."""

    def __init__(self, capacity: int, columns: int) -> None:
        self._t_ns = np.empty(capacity, dtype=np.int64)
        self._data = np.empty((capacity, columns))
        self._count = 0

    def append(self, table: Table) -> None:
        """Add rows, overwriting the oldest."""
        capacity = self._t_ns.size
        t_ns, data = table.t_ns[-capacity:], table.data[-capacity:]
        at = (self._count + np.arange(t_ns.size)) % capacity
        self._t_ns[at], self._data[at] = t_ns, data
        self._count += t_ns.size

    def since(self, t_ns: int) -> Table:
        """Return a copy of the rows at or after `t_ns`, oldest first."""
        capacity = self._t_ns.size
        order = np.arange(max(0, self._count - capacity), self._count) % capacity
        order = order[self._t_ns[order] >= t_ns]
        return Table(self._t_ns[order], self._data[order])

    def clear(self) -> None:
        """Forget everything."""
        self._count = 0


class History:
    """Rings of all row topics of one power-up, and the native rate of each topic."""

    def __init__(self, topics: Mapping[str, RowTopic], span_s: float) -> None:
        self._topics = topics
        self._span_s = span_s
        self._pending: list[StepResult] = []
        self._newest_ns: dict[str, int] = {}
        self._rate_hz: dict[str, float] = {}
        self._rings: dict[str, Ring] = {}
        self._thinners: dict[str, Thinner] = {}
        self.boot_id = 0

    def add(self, result: StepResult) -> None:
        """Remember a result; the work is done once a second by `flush`, for many results at once."""
        self._pending.append(result)
        if len(self._pending) >= MAX_PENDING:
            self.flush()

    def flush(self) -> None:
        """Move what is pending into the rings; a new power-up forgets the one before."""
        pending, self._pending = self._pending, []
        if pending and pending[-1].boot_id != self.boot_id:
            self.boot_id = pending[-1].boot_id
            self._rings.clear()
            self._thinners.clear()
            self._newest_ns.clear()
        current = [result for result in pending if result.boot_id == self.boot_id]
        if not current:
            return
        whole = merged(current)
        for name, topic in self._topics.items():
            table = topic.extract(whole)
            if table is not None:
                self._measure(name, table)
                self._store(name, topic, table)

    def native_rate_hz(self, name: str) -> float | None:
        """Return the topic's own rate over the last seconds; None until it is known."""
        return self._rate_hz.get(name)

    def rows(self, name: str, seconds: float) -> Table:
        """Return the rows of the last seconds of board time, oldest first."""
        self.flush()
        ring = self._rings.get(name)
        if ring is None:
            return Table(np.empty(0, dtype=np.int64), np.empty((0, len(self._topics[name].columns))))
        return ring.since(max(self._newest_ns.values()) - round(seconds * 1e9))

    def _measure(self, name: str, table: Table) -> None:
        newest = int(table.t_ns.max())
        before = self._newest_ns.get(name)
        if before is not None and newest > before:
            rate = table.t_ns.size * 1e9 / (newest - before)
            known = self._rate_hz.get(name)
            self._rate_hz[name] = rate if known is None else 0.7 * known + 0.3 * rate
        self._newest_ns[name] = newest

    def _store(self, name: str, topic: RowTopic, table: Table) -> None:
        if name not in self._rings:
            groups = AID_GROUPS if topic.columns is AID_COLUMNS else TURNS if topic.group is not None else 1
            rows = min(MAX_ROWS, round(self._span_s * RATE_HZ) * groups)
            self._rings[name] = Ring(rows, len(topic.columns))
            self._thinners[name] = Thinner(RATE_HZ, topic.group)
        kept = self._thinners[name].thin(table)
        if kept is not None:
            self._rings[name].append(kept)

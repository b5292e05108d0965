"""Keeps the samples of one slow sensor since the last hole, and tells how steady they were."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.calibration.statistics import mean_known
from server.nav.types import Float, Int, Kind

BATCH_S: Final = 0.5  # means of half a second: noise is gone, wind and lifts are not
GAP_S: Final = 2.0  # barometers send once a second, or repeat
TEMPERATURE: Final = 2
COLUMNS: Final = 3
CAPACITY: Final = 200_000  # samples kept; the oldest go


class Steady:
    """Keeps the first columns of one kind of samples since the last hole; the newest `CAPACITY` of them."""

    def __init__(self, kind: Kind) -> None:
        """Start empty."""
        self._kind = kind
        self._t_room = np.empty(64, dtype=np.int64)
        self._rows_room = np.empty((64, COLUMNS))
        self._used = 0
        self.restarts = 0
        self.fed = 0

    @property
    def _t(self) -> Int:
        return self._t_room[max(self._used - CAPACITY, 0) : self._used]

    @property
    def _rows(self) -> Float:
        return self._rows_room[max(self._used - CAPACITY, 0) : self._used]

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples; what lies before a hole or a step back is thrown away. Repeats are dropped."""
        if kind != self._kind or not len(t_ns):
            return
        self.fed += len(t_ns)
        data = rows[:, :COLUMNS]
        ok = np.isfinite(data[:, :2]).any(axis=1) & ~np.isinf(data[:, :2]).any(axis=1)
        t, data = t_ns[ok], data[ok]
        if not len(t):
            return
        steps = np.diff(t, prepend=self._t_room[self._used - 1] if self._used else t[0] - 1)
        breaks = np.flatnonzero((steps < 0) | (steps > GAP_S * 1e9))
        if len(breaks):
            self.restarts += len(breaks)
            self._used = 0
            t, data, steps = t[breaks[-1] :], data[breaks[-1] :], steps[breaks[-1] :]
        self._append(t[steps != 0], data[steps != 0])

    def _append(self, t: Int, data: Float) -> None:
        """Keep the samples; the room doubles up to twice the capacity, then the oldest go."""
        if self._used + len(t) > len(self._t_room):
            keep = min(self._used, CAPACITY)
            room = max(2 * keep, keep + len(t), 64)
            old, self._t_room = self._t_room, np.empty(room, dtype=np.int64)
            old_rows, self._rows_room = self._rows_room, np.empty((room, COLUMNS))
            self._t_room[:keep] = old[self._used - keep : self._used]
            self._rows_room[:keep] = old_rows[self._used - keep : self._used]
            self._used = keep
        self._t_room[self._used : self._used + len(t)] = t
        self._rows_room[self._used : self._used + len(t)] = data
        self._used += len(t)

    @property
    def span_s(self) -> float:
        """Seconds covered."""
        return float(self._t[-1] - self._t[0]) * 1e-9 if len(self._t) else 0.0

    def __len__(self) -> int:
        """Return the samples kept."""
        return len(self._t)

    def column(self, i: int) -> tuple[Int, Float]:
        """Return board times, ns, and values, shapes (k,), of a column of `SAMPLE_COLUMNS[kind]` where it is known."""
        known = np.isfinite(self._rows[:, i])
        return self._t[known], self._rows[known, i]

    def temperature(self) -> float:
        """Return the mean temperature, °C; NaN unknown."""
        return mean_known(self._rows[:, TEMPERATURE])


def batch_means(t_ns: Int, values: Float) -> Float:
    """Return the mean of each half second of samples, of ten equal parts when that is fewer."""
    if not len(values):
        return np.empty(0)
    which = (t_ns - t_ns[0]) // int(BATCH_S * 1e9)
    numbers, at = np.unique(which, return_inverse=True)
    return np.asarray(np.bincount(at, weights=values) / np.bincount(at))[: len(numbers)]


def mean_and_sigma(t_ns: Int, values: Float) -> tuple[float, float, float]:
    """Return the mean, its 1σ from the scatter of half-second means (never below white noise's), and that scatter."""
    batches = batch_means(t_ns, values)
    spread = float(batches.std(ddof=1)) if len(batches) > 1 else float(values.std())
    white = float(values.std() / np.sqrt(max(len(values), 1)))
    return float(values.mean()), float(max(white, spread / np.sqrt(max(len(batches), 1)))), spread

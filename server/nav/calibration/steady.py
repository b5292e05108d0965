"""Keeps the samples of one slow sensor since the last hole, and tells how steady they were."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.calibration.types import NAN
from server.nav.types import Float, Int, Kind

BATCH_S: Final = 0.5  # means of half a second: noise is gone, wind and lifts are not
GAP_S: Final = 2.0  # barometers send once a second, or repeat
TEMPERATURE: Final = 2
CAPACITY: Final = 200_000  # samples kept; the oldest go


class Steady:
    """Keeps one column of one kind of samples since the last hole, and tells whether it was steady."""

    def __init__(self, kind: Kind) -> None:
        """Start empty."""
        self._kind = kind
        self._t = np.empty(0, dtype=np.int64)
        self._rows = np.empty((0, 3))
        self.restarts = 0
        self.fed = 0

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples; what lies before a hole or a step back is thrown away. Repeats are dropped."""
        if kind != self._kind or not len(t_ns):
            return
        self.fed += len(t_ns)
        t = np.concatenate([self._t, t_ns])
        data = np.concatenate([self._rows, rows[:, :3]])
        ok = np.isfinite(data[:, :2]).any(axis=1) & ~np.isinf(data[:, :2]).any(axis=1)
        t, data = t[ok], data[ok]
        steps = np.diff(t)
        fresh = np.concatenate([[True], steps != 0])[: len(t)]
        breaks = np.flatnonzero((steps < 0) | (steps > GAP_S * 1e9))
        if len(breaks):
            self.restarts += len(breaks)
            fresh[: breaks[-1] + 1] = False
        self._t, self._rows = t[fresh][-CAPACITY:], data[fresh][-CAPACITY:]

    @property
    def span_s(self) -> float:
        """Seconds covered."""
        return float(self._t[-1] - self._t[0]) * 1e-9 if len(self._t) else 0.0

    def __len__(self) -> int:
        """Return the samples kept."""
        return len(self._t)

    def column(self, i: int) -> tuple[Int, Float]:
        """Return times and values of one column where it is known."""
        known = np.isfinite(self._rows[:, i])
        return self._t[known], self._rows[known, i]

    def temperature(self) -> float:
        """Return the mean temperature, °C; NaN unknown."""
        values = self.column(TEMPERATURE)[1]
        return float(values.mean()) if values.size else NAN


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

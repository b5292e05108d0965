"""How the board's clock runs against the host's, from arrival times alone and, where the board answers, from TIMESYNC.

A message can only arrive late, so the true offset is the lower envelope of arrival minus stamp: the line under all
points that touches them and is highest at their middle. With minima per second of board time it is the edge of the
lower convex hull over the mean time [Moon, Skelly and Towsley 1999, linear programming for clock skew]. A stall lifts
points and changes nothing; a stamp wrong the other way is taken out first by its distance from the median line.

For people only: nothing here enters an estimate.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

BUCKET_NS: Final = 1_000_000_000
WINDOW: Final = 300
"""Seconds of minima kept: long against stalls, short against a crystal's warming up."""
MIN_BUCKETS: Final = 10
OUTLIER_MADS: Final = 8.0
OUTLIER_FLOOR_NS: Final = 2e6
SYNCS: Final = 30
MAX_ROUND_TRIP_NS: Final = 500_000_000


class ClockEstimator:
    """Offset (host minus board, ns) and drift (ppm: positive = the host's clock runs faster) of one power-up."""

    def __init__(self) -> None:
        self._minima: deque[tuple[int, int]] = deque(maxlen=WINDOW)
        self._bucket = -1
        self._low: tuple[int, int] = (0, 0)
        self._t_last = -1
        self._syncs: deque[tuple[int, int, int]] = deque(maxlen=SYNCS)
        self._line: tuple[float, float, float] | None = None  # at t, offset, slope

    def reset(self) -> None:
        """Forget everything: the board started again."""
        self.__init__()  # type: ignore[misc]

    def add(self, t_ns: int, t_rx_ns: int) -> None:
        """Take the newest board stamp of a chunk and the host time of its arrival."""
        self._t_last = t_ns
        offset = t_rx_ns - t_ns
        bucket = t_ns // BUCKET_NS
        if bucket != self._bucket:
            if self._bucket >= 0:
                self._minima.append(self._low)
                self._line = None
            self._bucket = bucket
            self._low = (t_ns, offset)
        elif offset < self._low[1]:
            self._low = (t_ns, offset)

    def add_sync(self, sent_ns: int, t_rx_ns: int, board_ns: int) -> None:
        """Take an answered TIMESYNC; slow ones are dropped."""
        round_trip = t_rx_ns - sent_ns
        if 0 <= round_trip <= MAX_ROUND_TRIP_NS:
            self._syncs.append((round_trip, board_ns, (sent_ns + t_rx_ns) // 2 - board_ns))

    def estimate(self) -> tuple[float, float]:
        """Return the offset at the newest stamp (ns) and the drift (ppm); NaN where not known yet."""
        if self._bucket < 0:
            return float("nan"), float("nan")
        at, offset, slope = self._fit()
        known = not math.isnan(slope)
        rate = slope if known else 0.0
        here = offset + rate * (self._t_last - at)
        if self._syncs:  # the quickest answer says how much of the passive offset is transport
            _, board_ns, sync_offset = min(self._syncs)
            here = sync_offset + rate * (self._t_last - board_ns)
        return float(here), slope * 1e6 if known else float("nan")

    def _fit(self) -> tuple[float, float, float]:
        if self._line is None or len(self._minima) < MIN_BUCKETS:
            points = np.array([*self._minima, self._low], np.int64)
            self._line = fit_lower_line(points[:, 0], points[:, 1])
        return self._line


def fit_lower_line(t_ns: NDArray[np.int64], offset_ns: NDArray[np.int64]) -> tuple[float, float, float]:
    """Return (t, offset at t, slope) of the line under the points; slope NaN with fewer than `MIN_BUCKETS`."""
    if len(t_ns) < MIN_BUCKETS:
        low = int(np.argmin(offset_ns))
        return float(t_ns[low]), float(offset_ns[low]), float("nan")
    t0, d0 = int(t_ns[0]), int(offset_ns[0])  # differences first: 1e18 ns has no room for fractions in a float
    t = (t_ns - t0).astype(np.float64)
    d = (offset_ns - d0).astype(np.float64)
    keep = _not_too_early(t, d)
    t, d = t[keep], d[keep]
    left, right = _hull_edge(t, d)
    slope = (d[right] - d[left]) / (t[right] - t[left]) if right > left else 0.0
    return float(t[left]) + t0, float(d[left]) + d0, float(slope)


def _not_too_early(t: NDArray[np.float64], d: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark the points that do not lie far below the incomplete Theil-Sen line (each point paired with one half on)."""
    half = len(t) // 2
    slopes = (d[half:] - d[: len(d) - half]) / (t[half:] - t[: len(t) - half])
    residual = d - float(np.median(slopes)) * t
    residual -= np.median(residual)
    spread = max(float(np.median(np.abs(residual))) * OUTLIER_MADS, OUTLIER_FLOOR_NS)
    return np.asarray(residual > -spread)


def _hull_edge(t: NDArray[np.float64], d: NDArray[np.float64]) -> tuple[int, int]:
    """Return the two ends of the lower hull's edge over the mean time (t ascending)."""
    hull: list[int] = []
    for k in range(len(t)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            if (d[b] - d[a]) * (t[k] - t[a]) < (d[k] - d[a]) * (t[b] - t[a]):
                break
            hull.pop()
        hull.append(k)
    right = int(np.searchsorted(t[hull], t.mean()))
    right = min(max(right, 1), len(hull) - 1)
    return hull[max(right - 1, 0)], hull[right]

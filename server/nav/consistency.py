"""Whether errors are as large as their variances say, over a sliding window: the chi-square test of a live filter.

What is tested is the normalised component x = error / its standard deviation, which a consistent filter makes a unit
Gaussian: an innovation over the root of its variance (the sum of x² over one measurement is its NIS), or, where a
reference exists, a state error over its published σ. The published rows hold no correlations between components, so
"NEES from the diagonal" is the mean of x² over the three components, not xᵀP⁻¹x: it has the same expectation, 1 per
component, but says nothing of the correlations in P. Monte Carlo (`navdeck montecarlo`) tests the full covariance.

Choices, each of which moves the verdict:

- The mean is per component, so a consistent filter shows 1 whatever it measures.
- A measurement refused at the gate counts, or the gate would cut off the very tail that gives an over-confident filter
  away; but no component counts more than `CLIP`², so one glitch does not condemn a minute. Of Gaussian components one
  in two million is that large. Measurements refused for other reasons (no fix, disturbed, stale) do not count.
- Components whose variance is unknown (NaN) were not used by the filter and do not count.
- Successive innovations are alike when the sensor's error has a memory. Then a window holds fewer independent values
  than samples, and the bound for white ones is too narrow. The autocorrelation ρ(j) of every component is measured in
  the window, about zero, for zero is what the mean of a consistent filter's innovations is; the squares then correlate
  as ρ² (Isserlis), so n squares are worth n / (1 + 2 Σ ρ(j)²) [Bartlett 1946], and the bound is that of this many.
  Components are taken as independent of one another. An error that does not change at all within the window is worth
  one or two values, however often it is sampled: the verdict then needs a large excess, and rightly so.

Rows are put aside as they come and worked through when a person looks, or when many have gathered.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from server.nav.chi_square import mean_bounds
from server.nav.types import AID_COLUMNS, Aid, AidRows, AidStatus, ConsistencyHealth, Float, Int

WINDOW_NS: Final = 60_000_000_000
LEAST: Final = 50
"""A window holds the newest this many samples, however old, so that a slow sensor gets a verdict too."""
MOST: Final = 2048
"""And no more than this many: a fast sensor's window is shorter than a minute."""
ENOUGH: Final = 20
"""Fewer samples get no verdict."""
CLIP: Final = 5.0
LEVEL: Final = 0.95
GATHER: Final = 512
REFRESH_NS: Final = 1_000_000_000
"""Tests younger than this, in board time, are told again instead of computed: looking often costs nothing."""
SIGNIFICANT: Final = 3.84
"""n ρ² of white noise stays below it in 95 % of the cases."""

OVER: Final = "over-confident"
CONSERVATIVE: Final = "conservative"
CONSISTENT: Final = "consistent"
TOO_FEW: Final = "too-few"
WORST_FIRST: Final = (OVER, CONSERVATIVE, CONSISTENT, TOO_FEW)

_INNOVATION: Final = AID_COLUMNS.index("innovation_0")
_VARIANCE: Final = AID_COLUMNS.index("innovation_var_0")


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowTest:
    """One windowed chi-square test.

    Attributes:
        mean: of the squared normalised components; NaN before the first.
        low, high: its two-sided 95 % bound for a consistent filter.
        samples: measurements (NEES: epochs) in the window.
        effective: independent squared components that they are worth.
        verdict: "over-confident" above the bound, "conservative" below, "consistent" inside, "too-few" without one.
    """

    mean: float = math.nan
    low: float = math.nan
    high: float = math.nan
    samples: int = 0
    effective: float = 0.0
    verdict: str = TOO_FEW


def judge(mean: float, effective: float, samples: int, level: float = LEVEL) -> WindowTest:
    """Return the test of a mean of squares that is worth `effective` independent ones."""
    if samples < ENOUGH or not effective > 0.0:
        return WindowTest(mean=mean, samples=samples, effective=effective)
    low, high = mean_bounds(effective, level)
    verdict = OVER if mean > high else (CONSERVATIVE if mean < low else CONSISTENT)
    return WindowTest(mean=mean, low=low, high=high, samples=samples, effective=effective, verdict=verdict)


def repetition(x: Float) -> float:
    """Return how many successive squares of `x`, shape (n,), are worth one independent square; 1 for white noise."""
    n = len(x)
    if n < 2:
        return 1.0
    spectrum = np.fft.rfft(x, 2 * n)
    r = np.fft.irfft(spectrum.real**2 + spectrum.imag**2, 2 * n)[1:n]
    power = float(x @ x)
    if not power > 0.0:
        return float(n)
    rho2 = (r / power) ** 2
    quiet = rho2 * n < SIGNIFICANT
    ends = np.flatnonzero(quiet[:-2] & quiet[1:-1] & quiet[2:])  # three lags in a row: a sine passes zero quickly
    part = rho2[: int(ends[0])] if len(ends) else rho2
    return 1.0 + 2.0 * float(np.maximum(part - 1.0 / n, 0.0).sum())


class Window:
    """The newest normalised components of one group: a minute of them, bounded."""

    def __init__(self) -> None:
        self._t_ns = np.empty(0, dtype=np.int64)
        self._x = np.empty((0, 3))

    def add(self, t_ns: Int, x: Float) -> None:
        """Take components, shape (n, 3), unknown = NaN, in order of time; rows without any are left out."""
        known = np.isfinite(x).any(axis=1)
        if not known.any():
            return
        t_ns = np.concatenate((self._t_ns, t_ns[known]))[-MOST:]
        first = min(int(np.searchsorted(t_ns, t_ns[-1] - WINDOW_NS)), max(0, len(t_ns) - LEAST))
        self._x = np.concatenate((self._x, np.clip(x[known], -CLIP, CLIP)))[-MOST:][first:]
        self._t_ns = t_ns[first:]

    def test(self) -> WindowTest:
        """Return the test over the present window."""
        total = worth = count = 0.0
        for column in self._x.T:
            x = column[np.isfinite(column)]
            total += float(x @ x)
            count += len(x)
            worth += len(x) * repetition(x)
        if not count:
            return WindowTest()
        # The variance of the mean of all squares is 2 Σ n_c τ_c / n² = 2 / ν [Satterthwaite 1946].
        return judge(total / count, count * count / worth, len(self._t_ns))


def normalised(rows: Float) -> Float:
    """Return innovation over its standard deviation, shape (n, 3), of rows of AID_COLUMNS; NaN where one is unknown."""
    innovation, variance = rows[:, _INNOVATION : _INNOVATION + 3], rows[:, _VARIANCE : _VARIANCE + 3]
    usable = variance > 0.0
    return np.asarray(np.where(usable, innovation / np.sqrt(np.where(usable, variance, 1.0)), np.nan))


class NisBook:
    """A window of innovations for every aid."""

    def __init__(self) -> None:
        self._windows = {aid: Window() for aid in Aid}
        self._waiting: list[AidRows] = []
        self._rows = 0
        self._tests: dict[Aid, WindowTest] = {}
        self._newest_ns = self._tested_ns = 0

    def add(self, rows: AidRows) -> None:
        """Take the records of one call, at least one."""
        self._waiting.append(rows)
        self._rows += len(rows.t_ns)
        self._newest_ns = max(self._newest_ns, int(rows.t_ns[-1]))
        if self._rows >= GATHER:
            self._settle()

    def _settle(self) -> None:
        if not self._rows:
            return
        data = np.concatenate([rows.data for rows in self._waiting])
        t_ns = np.concatenate([rows.t_ns for rows in self._waiting])
        self._waiting, self._rows = [], 0
        counts = (data[:, 1] == AidStatus.FUSED) | (data[:, 1] == AidStatus.REFUSED_GATE)
        data, t_ns = data[counts], t_ns[counts]
        x = normalised(data)
        for aid in np.unique(data[:, 0]).astype(int).tolist():
            own = data[:, 0] == aid
            self._windows[Aid(aid)].add(t_ns[own], x[own])

    def tests(self) -> dict[Aid, WindowTest]:
        """Return the test of every aid, over a window that ends at most a second ago."""
        if not self._tests or self._newest_ns - self._tested_ns >= REFRESH_NS:
            self._settle()
            self._tests = {aid: window.test() for aid, window in self._windows.items()}
            self._tested_ns = self._newest_ns
        return self._tests


def lane_verdict(lane: str, groups: Sequence[tuple[str, WindowTest]]) -> ConsistencyHealth:
    """Return the verdict on a lane: the worst of its groups, each tested at a level that makes 95 % of all together.

    Args:
        lane: its name.
        groups: (name of the group as people read it, its test).
    """
    told = [(name, test) for name, test in groups if test.verdict != TOO_FEW]
    if not told:
        return ConsistencyHealth(lane=lane, group="lane", reason="no group has enough samples for a verdict")
    level = LEVEL ** (1.0 / len(told))
    strict = [(name, judge(test.mean, test.effective, test.samples, level)) for name, test in told]
    name, test = min(strict, key=lambda item: (WORST_FIRST.index(item[1].verdict), -abs(math.log(item[1].mean + 1e-9))))
    reason = "" if test.verdict == CONSISTENT else f"{name}: {test.mean:.2f}, bound {test.low:.2f} to {test.high:.2f}"
    return replace(as_health(lane, "lane", test), reason=reason)


def as_health(lane: str, group: str, test: WindowTest) -> ConsistencyHealth:
    """Return a test as the snapshot carries it."""
    return ConsistencyHealth(
        lane=lane,
        group=group,
        mean=test.mean,
        low=test.low,
        high=test.high,
        samples=test.samples,
        effective=test.effective,
        verdict=test.verdict,
    )

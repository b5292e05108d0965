"""Normalised errors of many flights against the chi-square law, epoch by epoch [Bar-Shalom, Estimation, § 5.4].

The mean over N independent runs of a consistent filter's d-dimensional NEES is χ² of N·d degrees of freedom over N.
Runs are independent whatever the correlation in time; an epoch's NIS is that of the last measurement in it, for the
same reason.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.montecarlo.flight import Flight
from server.nav.chi_square import mean_bounds
from server.nav.types import Aid, Float

GROUPS: Final = (
    ("attitude", slice(0, 3)),
    ("velocity", slice(3, 6)),
    ("position", slice(6, 9)),
    ("all nine", slice(0, 9)),
)
REQUIRED: Final = 0.9
"""Share of epochs that must lie inside the bound."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """One normalised quantity over the epochs, mean over the runs and per component, so that 1 is consistent.

    Attributes:
        name: "attitude", …, or the aid's.
        components: of one run's error; 0 where epochs differ (aids).
        runs: shape (n,), how many runs have a value.
        mean, low, high: shape (n,), and the two-sided 95 % bound; NaN where fewer than half the runs have a value.
    """

    name: str
    components: int
    runs: Float
    mean: Float
    low: Float
    high: Float

    @property
    def known(self) -> NDArray[np.bool_]:
        """Epochs that count."""
        return np.isfinite(self.mean)

    def share(self, where: str, part: slice = slice(None)) -> float:
        """Return the share of known epochs "inside", "above" or "below" the bound; NaN without any."""
        mean, low, high, known = self.mean[part], self.low[part], self.high[part], self.known[part]
        hits = {"above": mean > high, "below": mean < low, "inside": (mean >= low) & (mean <= high)}[where]
        return float(hits[known].mean()) if known.any() else math.nan

    def average(self, part: slice = slice(None)) -> float:
        """Return the mean over the known epochs; 1 for a consistent filter."""
        known = self.known[part]
        return float(self.mean[part][known].mean()) if known.any() else math.nan


def nees_curves(flights: Sequence[Flight], *, full: bool) -> list[Curve]:
    """Return the NEES of attitude, velocity, position and all nine, from the full covariance or from σ alone."""
    error = np.stack([flight.error for flight in flights])
    if full:
        P = np.stack([flight.P for flight in flights])
    else:
        P = np.stack([flight.sigma for flight in flights])[..., None] ** 2 * np.eye(9)
    return [_curve(name, nees(error[..., part], P[..., part, part]), part.stop - part.start) for name, part in GROUPS]


def nees(error: Float, P: Float) -> Float:
    """Return eᵀ P⁻¹ e per row, NaN where anything is unknown.

    Args:
        error: shape (…, d).
        P: shape (…, d, d).
    """
    out = np.full(error.shape[:-1], math.nan)
    known = np.isfinite(error).all(axis=-1) & np.isfinite(P).all(axis=(-1, -2))
    e = error[known]
    scale = np.sqrt(np.diagonal(P[known], axis1=-2, axis2=-1))  # radians beside metres: first to unit variances
    x = (e / scale)[..., None]
    correlation = P[known] / (scale[:, :, None] * scale[:, None, :])
    out[known] = (x * np.linalg.solve(correlation, x)).sum(axis=(-1, -2))
    return out


def _curve(name: str, values: Float, d: int) -> Curve:
    return _from_sums(name, d, np.nansum(values, axis=0), np.isfinite(values).sum(axis=0), d, len(values))


def _from_sums(name: str, components: int, total: Float, runs: Float, per_run: Float | int, most: int) -> Curve:
    """Return the curve of sums of squares over `runs` runs with `per_run` components each."""
    dof = np.asarray(runs * per_run, dtype=np.float64)
    counts = (runs >= max(2, most / 2)) & (dof > 0.0)
    mean, low, high = (np.full(len(total), math.nan) for _ in range(3))
    mean[counts] = total[counts] / dof[counts]
    for k in np.flatnonzero(counts):
        low[k], high[k] = mean_bounds(float(dof[k]))
    return Curve(name=name, components=components, runs=runs.astype(np.float64), mean=mean, low=low, high=high)


def nis_curves(flights: Sequence[Flight]) -> list[Curve]:
    """Return the NIS of every aid that was ever used."""
    x = np.stack([flight.nis for flight in flights])
    curves = []
    for aid in Aid:
        own = x[:, aid]
        known = np.isfinite(own)
        if known.any():
            runs, parts = known.any(axis=2).sum(axis=0), known.sum(axis=(0, 2))
            per_run = parts / np.maximum(runs, 1)
            total = np.nansum(own**2, axis=(0, 2))
            curves.append(_from_sums(aid.name.lower(), 0, total, runs, per_run, _most(runs)))
    return curves


def _most(runs: Float) -> int:
    """Return what counts as all runs: an aid is judged where it is in use at all."""
    return int(runs.max())


def rms(flights: Sequence[Flight]) -> tuple[Float, Float]:
    """Return RMS error and RMS published σ over the runs, each (n, 9)."""
    with np.errstate(invalid="ignore"):
        return tuple(
            np.sqrt(_mean(np.stack([getattr(flight, name) for flight in flights]) ** 2)) for name in ("error", "sigma")
        )  # type: ignore[return-value]


def _mean(values: Float) -> Float:
    known = np.isfinite(values)
    return np.asarray(np.where(known, values, 0.0).sum(axis=0) / np.where(known.any(axis=0), known.sum(axis=0), np.nan))

"""Means and their honest sigma when neighbouring samples are alike, and other small laws that every fit uses."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.types import Float

DITHER: Final = 0.5  # of a step: noise of half a step makes the mean of rounded values right
LEAST_BATCHES: Final = 4  # below, the scatter of batch means says nothing


def weighted_mean(values: Float, weights: Float) -> Float:
    """Return the mean over rows, shape (c,), of values shape (k, c)."""
    return np.asarray(weights @ values / weights.sum())


def mean_sigma(means: Float, variances: Float, counts: Float) -> Float:
    """Return 1σ of the mean of a run, shape (c,), from its blocks.

    White noise gives sqrt(var / n). A board's own low-pass and slow drift make neighbours alike, which only the
    scatter of the block means shows: σ² = s²/k · (1 + 2 Σ ρ_j), the ρ summed up to the first that is not positive
    (Geyer's initial positive sequence). The larger of the two is returned.

    Args:
        means, variances: shape (k, c), of each block.
        counts: shape (k,), samples in each.
    """
    n = counts.sum()
    white = np.sqrt((counts @ variances) / n / max(n - 1.0, 1.0))
    k = len(means)
    if k < LEAST_BATCHES:
        spread = np.sqrt(means.var(axis=0, ddof=1) / k) if k > 1 else np.zeros(means.shape[1])
        return np.asarray(np.maximum(white, spread))
    away = means - means.mean(axis=0)
    var = (away**2).sum(axis=0) / (k - 1)
    inflation = np.array([_inflation(away[:, c]) for c in range(means.shape[1])])
    return np.asarray(np.maximum(white, np.sqrt(var / k * inflation)))


def _inflation(away: Float) -> float:
    """Return 1 + 2 Σ ρ_j over the initial positive sequence, at least 1."""
    k = len(away)
    power = float(away @ away)
    total = 1.0
    if power <= 0.0:
        return total
    for lag in range(1, k // 2):
        rho = float(away[lag:] @ away[:-lag]) / power
        if rho < 2.0 / math.sqrt(k):  # not to be told from 0
            break
        total += 2.0 * rho
    return total


def with_resolution(sigma: Float, std: Float, step: float) -> Float:
    """Return 1σ of a mean with what rounding to steps adds where the noise is too small to dither it (step / √12).

    Args:
        sigma: 1σ of the mean; `std` scatter of the samples, same shape; `step`: the sensor's resolution, 0 unknown.
    """
    return np.where(std < DITHER * step, np.hypot(sigma, step / math.sqrt(12.0)), sigma)


def mean_known(values: Float) -> float:
    """Return the mean of the finite ones, in their unit; NaN for none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def rms(values: Float) -> float:
    """Return the root of the mean square; 0 for none."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else 0.0


def directions(vectors: Float) -> Float:
    """Return unit vectors, shape (k, 3); a zero vector stays zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))

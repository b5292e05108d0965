"""How well an ellipsoid is known: its σ, and how its sampling amplifies errors, from the same moments as the fit."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.calibration.ellipsoid_solve import Ellipsoid, adjusted, gradient, misfit, normal_matrix, rms
from server.nav.calibration.sphere_cells import CELLS, DIRECTIONS, fibonacci_directions
from server.nav.types import Float, Int

PATCH_OF_CELL: Final = np.argmax(DIRECTIONS @ fibonacci_directions(24).T, axis=1)
"""Patch of each cell: 24 of them, some 40° across."""
WHITE_MARGIN: Final = 1.1  # the white part is known to a few per cent from some thousand samples


def uncertainty(
    moments: Float, cell: Int, e: Ellipsoid, parameters: int, roughness: float
) -> tuple[Float, tuple[float, float]]:
    """Return 1σ of (centre, matrix entries) and the dilutions (centre, matrix), in the fit's frame.

    Residuals of neighbouring samples are alike, so it is not samples that are independent. Of two views the larger is
    taken:

    - in space: the scores are summed over patches of the sphere and the spread of the sums counts (cluster-robust
      covariance, with the usual C/(C − p)), for patches of two sizes, variances added. On recorded sweeps cut into
      parts the small alone are too bold by three, the large alone by 1.4, the sum is right.
    - in time: least squares, whose residual is part white, as rough as the stream is, each sample for itself; the rest
      is slow (the field of the place, a warming sensor) and a whole patch of the sphere is worth one sample.

    Args:
        moments: shape (m, 35), of the cubes. cell: shape (m,), where each is on the sphere.
        e: the fit. parameters: 9, 6 or 4.
        roughness: `Cubes.roughness` in the fit's unit.
    """
    g, beta, weight = gradient(e, parameters), e.quadric, moments[:, 0]
    sums = np.zeros((CELLS, moments.shape[1]))
    np.add.at(sums, cell, moments)
    per_cell, counts = normal_matrix(adjusted(sums, e.noise**2)), sums[:, 0]
    used = counts > 0.0
    inverse = _inverse(g @ per_cell.sum(axis=0) @ g.T)
    even = _inverse(g @ (per_cell[used] / counts[used, None, None]).sum(axis=0) @ g.T)
    scores = 0.5 * per_cell[used] @ beta @ g.T
    spread = _spread(scores, np.flatnonzero(used)) + _spread(scores, PATCH_OF_CELL[used])
    residual = rms(misfit(moments, e), weight)
    white = (roughness / e.radius) ** 2
    slow = max(residual**2 - WHITE_MARGIN * white, 0.0) * weight.sum() / len(np.unique(PATCH_OF_CELL[used]))
    variance = np.maximum(np.diag(inverse @ spread @ inverse), np.diag(inverse) * (min(white, residual**2) + slow))
    return np.sqrt(variance), (_size(even[:3, :3]), _size(even[3:, 3:]))


def _size(covariance: Float) -> float:
    """Largest standard deviation of any direction."""
    return float(np.sqrt(np.linalg.norm(covariance, 2)))


def _spread(scores: Float, patch: Int) -> Float:
    """Sum over the patches of the outer product of their summed scores, corrected for the parameters fitted."""
    names, place = np.unique(patch, return_inverse=True)
    sums = np.zeros((len(names), scores.shape[1]))
    np.add.at(sums, place, scores)
    total: Float = sums.T @ sums * (len(names) / max(len(names) - scores.shape[1], 1))
    return total


def _inverse(positive: Float) -> Float:
    """Inverse of a positive matrix; enormous where noise has eaten an eigenvalue: that direction is not known."""
    values, vectors = np.linalg.eigh(positive)
    inverse: Float = (vectors / np.maximum(values, 1e-12 * max(values[-1], 1e-300))) @ vectors.T
    return inverse

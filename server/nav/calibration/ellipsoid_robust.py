"""From the stream's cubes to an ellipsoid with its uncertainty; outliers left out, coverage seen from its centre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from server.nav.calibration.ellipsoid_moments import Cubes, Mask
from server.nav.calibration.ellipsoid_sigma import uncertainty
from server.nav.calibration.ellipsoid_solve import Ellipsoid, ellipsoid_from, misfit, rms
from server.nav.calibration.sphere_cells import CELLS, cell_of
from server.nav.types import Float, Int

FAR: Final = 3.0
"""Cubes beyond this many times the 90 % distance are spikes whatever the shape: a closed surface has none there."""
GATE: Final = 6.0  # times the typical residual of a direction (a median: about 4σ)
GATE_FLOOR: Final = 0.05  # of the radius: what is nearer than this does no harm
SOFT: Final = 0.25  # of the radius: residuals of the starting sphere beyond it count little
ROUND: Final = 0.7  # of the radius: farther off it than the longest axis of a soft iron of 1 : 4
ROUNDS: Final = 12
MIN_CUBES: Final = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solution:
    """A fitted ellipsoid in the unit of the data.

    Attributes:
        offset, matrix: |matrix (raw − offset)| = 1.
        offset_sigma: shape (3,), matrix_sigma: shape (3, 3).
        residual: RMS of |matrix (raw − offset)| − 1; noise: of it, what the fit takes for white, per axis.
        radius: geometric mean of the half axes.
        coverage: share of the sphere's cells that hold samples; cells: shape (CELLS,), true where covered.
        samples, rejected: that entered, that did not.
        offset_dilution, matrix_dilution: error of the worst direction of the offset (of the radius) and of the matrix
            (relative) for a residual of 1 that is independent from cell to cell: how model error is amplified.
        cubes: those that entered.
        parameters: 9, 6 or 4 (a sphere).
    """

    offset: Float
    matrix: Float
    offset_sigma: Float
    matrix_sigma: Float
    residual: float
    noise: float
    radius: float
    coverage: float
    cells: Mask
    samples: int
    rejected: int
    offset_dilution: float
    matrix_dilution: float
    cubes: Cubes
    parameters: int


def near(cubes: Cubes) -> Mask:
    """Return a mask, shape (m,): cubes that are not far out of the cloud."""
    means = cubes.means
    distance = np.linalg.norm(means - np.median(means, axis=0), axis=1)
    mask: Mask = distance <= FAR * np.quantile(distance, 0.9)
    return mask


def start(cubes: Cubes) -> Mask:
    """Return a mask, shape (m,), to begin with: `near`, less what is far off a sphere that outliers hardly pull.

    A quadric through fourth powers goes where the spikes are; a sphere by reweighted least squares does not. When it
    would leave out more than a tenth it is not spikes (rest in one pose makes a cluster of its own): then all stay.
    """
    keep = near(cubes)
    x = cubes.means[keep]
    middle, weight = np.median(x, axis=0), np.ones(len(x))
    size = float(np.median(np.linalg.norm(x - middle, axis=1))) or 1.0
    u = (x - middle) / size
    centre, off = np.zeros(3), np.zeros(len(x))
    for _ in range(ROUNDS):
        root = np.sqrt(weight)[:, None]
        rows = np.column_stack([2.0 * u, np.ones(len(u))])
        centre = np.linalg.lstsq(rows * root, root[:, 0] * np.sum(u * u, axis=1), rcond=None)[0][:3]
        distance = np.linalg.norm(u - centre, axis=1)
        off = distance / max(float(np.median(distance)), 1e-300) - 1.0
        weight = 1.0 / (1.0 + (off / SOFT) ** 2) ** 2
    round_ = np.abs(off) <= ROUND
    if round_.mean() >= 0.9:
        keep[keep] = round_
    return keep


def second_moments(cubes: Cubes) -> tuple[Float, Float]:
    """Return the mean, shape (3,), and the covariance, shape (3, 3), of the samples."""
    count, m = cubes.moments[:, 0], cubes.moments
    mean = cubes.means.T @ count / count.sum()
    local = m[:, [4, 5, 6, 5, 7, 8, 6, 8, 9]].reshape(-1, 3, 3)
    h, d = cubes.origins - mean, m[:, 1:4]
    cross = h.T @ d
    total = local.sum(axis=0) + cross + cross.T + (h.T * count) @ h
    return mean, total / count.sum()


def principal_spread(cubes: Cubes) -> Float:
    """Return standard deviations of the samples along their principal axes, shape (3,), ascending."""
    spread: Float = np.sqrt(np.maximum(np.linalg.eigvalsh(second_moments(cubes)[1]), 0.0))
    return spread


def solve(cubes: Cubes, parameters: int) -> Solution | None:
    """Fit what was collected; None when the best quadric of the samples is no ellipsoid."""
    keep = start(cubes)
    mean, covariance = second_moments(cubes.only(keep))
    radius = max(float(np.sqrt(np.trace(covariance))), 1e-300)
    moments = cubes.about(mean, radius)  # centre and size make the numbers of the fit of order 1
    for _ in range(ROUNDS):
        ellipsoid = ellipsoid_from(moments[keep].sum(axis=0), parameters)
        if ellipsoid is None:
            return None
        again = _gate(moments, ellipsoid)
        if np.array_equal(again, keep) or again.sum() < MIN_CUBES:
            break
        keep = again
    final = ellipsoid_from(moments[keep].sum(axis=0), parameters)
    return None if final is None else _describe(cubes, keep, moments[keep], final, (mean, radius), parameters)


def _cells(moments: Float, ellipsoid: Ellipsoid) -> Int:
    """Cell of each cube, shape (m,), by its direction from the fitted centre."""
    return cell_of((moments[:, 1:4] / moments[:, :1] - ellipsoid.centre) @ ellipsoid.matrix)


def _gate(moments: Float, ellipsoid: Ellipsoid) -> Mask:
    """Mask of the cubes near the surface, by the typical residual of directions (not of samples: rest counts once)."""
    off, cell = misfit(moments, ellipsoid), _cells(moments, ellipsoid)
    order = np.lexsort((off, cell))
    _, first, count = np.unique(cell[order], return_index=True, return_counts=True)
    typical = off[order][first + count // 2]  # the median of each cell
    mask: Mask = off <= max(GATE * float(np.median(typical)), GATE_FLOOR)
    return mask


def _describe(
    cubes: Cubes, keep: Mask, moments: Float, e: Ellipsoid, frame: tuple[Float, float], parameters: int
) -> Solution:
    """Return the solution in the unit of the data; `moments` are those kept, in the frame (centre, size)."""
    mean, size = frame
    cell, weight, r = _cells(moments, e), moments[:, 0], e.radius
    sigma, dilution = uncertainty(moments, cell, e, parameters, cubes.roughness / size)
    covered = np.bincount(cell, minlength=CELLS) > 0
    return Solution(
        offset=mean + size * e.centre,
        matrix=e.matrix / size,
        offset_sigma=sigma[:3] * size,
        matrix_sigma=_symmetric(sigma[3:]) / size,
        residual=rms(misfit(moments, e), weight),
        noise=e.noise / r,
        radius=r * size,
        coverage=float(np.mean(covered)),
        cells=covered,
        samples=int(weight.sum()),
        rejected=int(cubes.moments[:, 0].sum() - weight.sum()),
        offset_dilution=dilution[0] / r,
        matrix_dilution=dilution[1] * r,
        cubes=cubes.only(keep),
        parameters=parameters,
    )


def _symmetric(entries: Float) -> Float:
    """Matrix of xx, yy, zz (, xy, xz, yz)."""
    out = np.diag(np.broadcast_to(entries[:3], (3,))).copy()
    for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), entries[3:], strict=False):
        out[i, j] = out[j, i] = value
    return out

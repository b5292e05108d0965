"""Whether an ellipsoid may be believed: refusals and grades, each limit with its reason."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from server.nav.calibration.codes import failure
from server.nav.calibration.ellipsoid_kernel import E_COUNT, E_MAX_A, E_MAX_B, E_MIN_A, E_MIN_B
from server.nav.calibration.ellipsoid_moments import Cubes
from server.nav.calibration.ellipsoid_robust import Solution, near, principal_spread, solve
from server.nav.calibration.types import Failure, Grade

MIN_SAMPLES: Final = 24
THIN: Final = 0.1  # a band of ±8° about a plane
BAND: Final = 0.2  # thinner clouds that admit no ellipsoid are called planar: a band of ±20° or a blunt cone
STILL: Final = 0.1  # of the field (or of the mean reading): what noise and trembling make
RESIDUAL: Final = 0.08  # of the radius: 5° of heading
REJECTED: Final = 0.1  # share of samples off the surface
MISFIT, WELL_SPREAD = 0.03, 0.4  # above the first, with a dilution below the second, it is the residual that spoils σ
SLOW: Final = 0.4  # of the residual's limit: roughness below it cannot be what made the residual
AXIS_RATIO: Final = 4.0
STRENGTH: Final = 0.3
"""The model knows the field to 1 %; soft iron and a cheap sensor's scale take up to a fifth; beyond, it is another."""

# Subsets of recorded sweeps against their whole: half spheres are wrong by 1 to 15 % of the radius and have an offset
# dilution of 1.1 to 3.2; bands of ±20° have matrices wrong by 2 to 20 % and a matrix dilution of 3.6 and more; thirds
# of whole sweeps are right within 1.5 % at dilutions of 0.2 to 0.7.
OFFSET_DILUTION: Final = 1.0
MATRIX_DILUTION: Final = 1.5
OFFSET_ERROR: Final = 0.025  # of the radius: dilution · residual
OFFSET_SIGMA: Final = 0.03  # of the radius: 1.7° of heading at 1σ

GOOD: Final = (0.02, 0.75, 0.012)
FAIR: Final = (0.04, 0.5, 0.025)
"""Grades: residual (of the radius) at most, coverage at least, σ of the offset (of the radius) at most; else poor."""
CLIPPED_SAMPLES: Final = 8
CLIPPED_SPREAD: Final = 0.4  # of the range of that axis: a cap of ±24° pressed flat
CLIPPED_RESIDUAL, CLIPPED_REJECTED = 0.012, 0.01


def provisional(cubes: Cubes) -> Solution | None:
    """Return a sphere while there is no ellipsoid, good enough to see which directions miss; else None."""
    if _before(cubes, float("nan")) is not None:
        return None
    sphere = solve(cubes, 4)
    good = sphere is not None and sphere.residual < 2.0 * RESIDUAL and sphere.offset_dilution < 2.0 * OFFSET_DILUTION
    return sphere if good else None


def grade(solution: Solution) -> Grade:
    """Return the grade by `GOOD` and `FAIR`."""
    for name, (residual, coverage, sigma) in (("good", GOOD), ("fair", FAIR)):
        if solution.residual <= residual and solution.coverage >= coverage and offset_sigma(solution) <= sigma:
            return "good" if name == "good" else "fair"
    return "poor"


def offset_sigma(solution: Solution) -> float:
    """Length of the offset's σ over the radius."""
    return float(np.linalg.norm(solution.offset_sigma) / solution.radius)


def judged(cubes: Cubes, parameters: int, expected: float) -> Solution | Failure:
    """Return the fit, or why there must be none.

    Args:
        cubes: what was collected.
        parameters: 9, 6 or 4.
        expected: strength of the Earth's field in the unit of the data; NaN when unknown.
    """
    refused = _before(cubes, expected)
    if refused is not None:
        return refused
    solution = solve(cubes, parameters)
    uncovered = None if solution is None else _uncovered(solution)
    if uncovered is not None:
        return uncovered
    clipped = clipped_share(cubes)
    if clipped >= CLIPPED_SPREAD and (solution is None or _bent(solution)):
        return failure("saturated", clipped, CLIPPED_SPREAD)
    if solution is None:
        return _shapeless(cubes, parameters)
    return _after(solution, cubes, expected) or solution


def _before(cubes: Cubes, expected: float) -> Failure | None:
    count = float(cubes.moments[:, 0].sum())
    if count == 0.0:
        return failure("no-data", 0.0, MIN_SAMPLES)
    if count < MIN_SAMPLES:
        return failure("too-few-samples", count, MIN_SAMPLES)
    spread = principal_spread(cubes.only(near(cubes)))
    whole = expected if np.isfinite(expected) else float(cubes.lengths.sum() / count)
    nothing = spread[2] <= 1e-9 * whole
    if nothing or (spread[2] < STILL * whole and not _is_shell(cubes)):
        return failure("coverage-poor", spread[2] / max(whole, 1e-300), STILL)
    if spread[0] < THIN * spread[2]:
        return failure("coverage-planar", spread[0] / spread[2], THIN)
    return None


def _is_shell(cubes: Cubes) -> bool:
    """True when a sphere fits: a small one far out (a huge offset) is no noise cloud."""
    sphere = solve(cubes, 4)
    return sphere is not None and sphere.residual < 2.0 * RESIDUAL


def _shapeless(cubes: Cubes, parameters: int) -> Failure:
    """Why the best quadric was no ellipsoid: directions miss, or, when they do not, the samples are not one surface."""
    spread = principal_spread(cubes.only(near(cubes)))
    if spread[0] < BAND * spread[2]:
        return failure("coverage-planar", spread[0] / spread[2], BAND)
    sphere = solve(cubes, 4)
    if sphere is None:
        return failure("residual", float("nan"), RESIDUAL)
    if sphere.residual > 2.0 * RESIDUAL:
        return _rough(sphere.residual, RESIDUAL, cubes, replace(sphere, parameters=parameters))
    if sphere.rejected > REJECTED * sphere.samples:
        return _rough(sphere.rejected / (sphere.samples + sphere.rejected), REJECTED, cubes, sphere)
    return failure("coverage-poor", sphere.coverage, FAIR[1])


def _uncovered(s: Solution) -> Failure | None:
    """Return the failure when too little of the sphere was seen, whatever the residual."""
    spread = principal_spread(s.cubes)
    if s.matrix_dilution > MATRIX_DILUTION and spread[0] < BAND * spread[2]:
        return failure("coverage-planar", spread[0] / spread[2], BAND)
    if s.offset_dilution > OFFSET_DILUTION:
        return failure("coverage-poor", s.offset_dilution, OFFSET_DILUTION)
    if s.matrix_dilution > MATRIX_DILUTION:
        return failure("coverage-poor", s.matrix_dilution, MATRIX_DILUTION)
    return None


def _after(s: Solution, cubes: Cubes, expected: float) -> Failure | None:
    rejected = s.rejected / (s.samples + s.rejected)
    axes = 1.0 / np.linalg.eigvalsh(s.matrix)
    error = s.offset_dilution * s.residual
    if s.residual > RESIDUAL:
        return _rough(s.residual, RESIDUAL, cubes, s)
    if rejected > REJECTED:
        return _rough(rejected, REJECTED, cubes, s)
    if error > OFFSET_ERROR or offset_sigma(s) > OFFSET_SIGMA:
        if s.residual > MISFIT and s.offset_dilution < WELL_SPREAD:
            return _rough(s.residual, MISFIT, cubes, s)
        if error > OFFSET_ERROR:
            return failure("coverage-poor", error, OFFSET_ERROR)
        return failure("coverage-poor", offset_sigma(s), OFFSET_SIGMA)
    if axes[0] / axes[2] > AXIS_RATIO:
        return failure("residual", axes[0] / axes[2], AXIS_RATIO)
    if np.isfinite(expected) and abs(s.radius / expected - 1.0) > STRENGTH:
        return failure("field-strength", s.radius, expected)
    return None


def _bent(s: Solution) -> bool:
    """True when a flat face does harm: an exact ring of latitude has one too, but lies on the ellipsoid."""
    return s.residual > CLIPPED_RESIDUAL or s.rejected > CLIPPED_REJECTED * s.samples


def _rough(measured: float, limit: float, cubes: Cubes, s: Solution) -> Failure:
    """Name what spoils the fit: noise and spikes are rough in time, a field that changes with the place is not.

    A tilted ellipsoid that was asked to be axis-aligned is not the field's fault either.
    """
    slow = s.parameters == 9 and cubes.roughness < SLOW * RESIDUAL * s.radius
    return failure("field-uneven" if slow else "residual", measured, limit)


def clipped_share(cubes: Cubes) -> float:
    """Return how wide a face the samples share that have exactly the extreme value of an axis, over that axis' range.

    A sensor at its limit repeats it while the other axes go on; at rest, or by quantisation alone, they hardly move.
    """
    e, worst = cubes.extremes, 0.0
    for low, high in ((0, 1), (2, 3), (4, 5)):
        whole = e[high, 0] - e[low, 0]
        for side in (e[low], e[high]):
            if side[E_COUNT] >= CLIPPED_SAMPLES and whole > 0.0:
                wide = min(side[E_MAX_A] - side[E_MIN_A], side[E_MAX_B] - side[E_MIN_B])
                worst = max(worst, float(wide / whole))
    return worst

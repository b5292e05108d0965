"""How well poses are spread over the sphere, and which direction is worth taking next."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.calibration.accel_fit import TRIANGLE
from server.nav.calibration.sphere_cells import fibonacci_directions
from server.nav.calibration.statistics import directions
from server.nav.types import Float

SAME_COS: Final = float(np.cos(np.radians(12.0)))  # nearer poses count as one
COVER_COS: Final = float(np.cos(np.radians(50.0)))  # nine well-spread poses cover the sphere with such caps
CANDIDATES: Final = 100


SPHERE: Final = fibonacci_directions(CANDIDATES)


def distinct(unit: Float) -> Float:
    """Return the directions, shape (m, 3), of which none is nearer to an earlier one than 12°."""
    kept: list[Float] = []
    for u in unit:
        if all(float(u @ other) < SAME_COS for other in kept):
            kept.append(u)
    return np.array(kept).reshape(-1, 3)


def uncovered(unit: Float) -> Float:
    """Return the directions of an even sphere that no pose is within 50° of, shape (m, 3)."""
    if not len(unit):
        return SPHERE
    return np.asarray(SPHERE[(SPHERE @ unit.T).max(axis=1) < COVER_COS])


def farthest(unit: Float) -> Float:
    """Return the direction that is farthest from every pose, shape (3,)."""
    if not len(unit):
        return np.array([0.0, 0.0, -1.0])
    return np.asarray(SPHERE[int(np.argmin((SPHERE @ unit.T).max(axis=1)))])


def amplification(away: Float) -> float:
    """Return the largest error of a parameter, of 1, per RMS error of one pose's length; infinite when not determined.

    The law of the 9-parameter norm fit at M = 1: ∂|M(u−b)|/∂b = −û, ∂/∂M_ij = û_i û_j (twice off the diagonal).

    Args:
        away: shape (k, 3), readings about the centre in units of the radius.
    """
    unit = directions(away)
    if len(unit) < 9:
        return float("inf")
    by_m = np.column_stack([unit[:, i] * unit[:, j] * (1.0 if i == j else 2.0) for i, j in TRIANGLE])
    singular = np.linalg.svd(np.column_stack([-unit, by_m]), compute_uv=False)
    return float(1.0 / singular[-1]) if singular[-1] > 1e-9 else float("inf")

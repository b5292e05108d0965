"""A magnetometer's points, fitted ellipsoid and open directions in drawing units, whatever their own unit was."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from server.nav.types import Float
from server.view3d.shapes import Mesh

if TYPE_CHECKING:
    from collections.abc import Sequence

MAX_POINTS: Final = 1500
NOTICEABLE: Final = 0.02
"""Share of the radius by which centre or size must have moved before everything is drawn anew about them."""

RESIDUAL_TOP: Final = 0.05
"""Distance from the fitted surface, as a share of the field, at the far end of the colour scale."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A fitted ellipsoid: |matrix (x − offset)| = radius; offset (3,), matrix (3, 3), in the unit of the points."""

    offset: Float
    matrix: Float
    radius: float

    def at(self, directions: Float) -> Float:
        """Return the points of the surface, shape (n, 3), that calibrate to these unit directions, shape (n, 3)."""
        return self.offset + self.radius * directions @ np.linalg.inv(self.matrix).T

    def calibrated(self, points: Float) -> Float:
        """Return the points, shape (n, 3), after calibration, as shares of the field."""
        return (points - self.offset) @ self.matrix.T / self.radius

    def misfit(self, points: Float) -> Float:
        """Return the distance of each point from the surface, shape (n,), as a share of the field."""
        return np.asarray(np.abs(np.linalg.norm(self.calibrated(points), axis=1) - 1.0), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """What of the measured space is drawn: its centre, shape (3,), and the length that becomes 1."""

    centre: Float
    size: float

    def drawn(self, points: Float) -> Float:
        """Return points, shape (n, 3), in drawing units."""
        return np.asarray((points - self.centre) / self.size, dtype=np.float64)

    def near(self, other: Extent) -> bool:
        """True when nobody would see the difference."""
        moved = float(np.linalg.norm(self.centre - other.centre)) / self.size
        return moved < NOTICEABLE and abs(self.size - other.size) < NOTICEABLE * self.size


def surface_from(
    offset: Sequence[float] | Float, matrix: Sequence[Sequence[float]] | Float, points: Float
) -> Surface | None:
    """Return the surface of a fit; None when there is none, or none that could be drawn.

    Args:
        offset: shape (3,), or empty.
        matrix: shape (3, 3), or empty.
        points: shape (n, 3), raw; their median strength after calibration is the radius (1 without any).
    """
    b, A = np.asarray(offset, dtype=np.float64), np.asarray(matrix, dtype=np.float64)
    if b.shape != (3,) or A.shape != (3, 3) or not np.isfinite(b).all() or not np.isfinite(A).all():
        return None
    if np.linalg.cond(A) > 1e6:
        return None
    radius = float(np.median(np.linalg.norm((points - b) @ A.T, axis=1))) if len(points) else 1.0
    return Surface(b, A, radius) if radius > 0.0 else None


def extent_of(surface: Surface | None, points: Float) -> Extent:
    """Return what to draw: about the ellipsoid; before there is one about zero, wherever the points lie."""
    if surface is not None:
        return Extent(surface.offset, surface.radius / float(np.linalg.svd(surface.matrix, compute_uv=False)[-1]))
    reach = float(np.linalg.norm(points, axis=1).max()) if len(points) else 1.0
    return Extent(np.zeros(3), reach if reach > 0.0 else 1.0)


def thinned(points: Float) -> Float:
    """Return at most `MAX_POINTS` of the finite points, evenly picked; shape (n, 3)."""
    whole = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    whole = whole[np.isfinite(whole).all(axis=1)]
    if len(whole) <= MAX_POINTS:
        return whole
    return whole[np.linspace(0, len(whole) - 1, MAX_POINTS).astype(np.intp)]


def globe_lines(parallels: int = 5, meridians: int = 12, pieces: int = 36) -> tuple[Float, Float]:
    """Return starts and ends, each shape (n, 3), of the lines of latitude and longitude of the unit sphere."""
    angle = np.linspace(0.0, 2.0 * np.pi, pieces + 1)
    polar = np.linspace(0.0, np.pi, pieces // 2 + 1)
    latitudes, longitudes = np.linspace(0.0, np.pi, parallels + 2)[1:-1], np.arange(meridians) * 2.0 * np.pi / meridians
    curves = [_sphere(np.full_like(angle, at), angle) for at in latitudes]
    curves += [_sphere(polar, np.full_like(polar, at)) for at in longitudes]
    return np.vstack([curve[:-1] for curve in curves]), np.vstack([curve[1:] for curve in curves])


def _sphere(polar_rad: Float, angle_rad: Float) -> Float:
    flat = np.sin(polar_rad)
    return np.stack([flat * np.cos(angle_rad), flat * np.sin(angle_rad), np.cos(polar_rad)], axis=1)


def rings_about(places: Float, outwards: Float, radius: float, width: float, sides: int = 14) -> Mesh:
    """Return one flat ring at each place, shape (n, 3), square to a direction, shape (n, 3), as one mesh."""
    out = outwards / np.linalg.norm(outwards, axis=1, keepdims=True)
    helper = np.where(np.abs(out[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(out, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(out, u)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    circle = np.cos(angle)[None, :, None] * u[:, None, :] + np.sin(angle)[None, :, None] * v[:, None, :]
    both = np.stack([(radius - width) * circle, radius * circle], axis=1) + places[:, None, None, :]
    at = np.arange(sides)
    inner, outer, after = at, at + sides, (at + 1) % sides
    ring = np.stack([inner, outer, after + sides, inner, after + sides, after], axis=1).reshape(-1, 3)
    faces = (ring[None] + 2 * sides * np.arange(len(places))[:, None, None]).reshape(-1, 3)
    return Mesh(both.reshape(-1, 3), faces.astype(np.uint32))

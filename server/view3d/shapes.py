"""Triangle meshes from a few primitives; vertices are shared only where a surface is smooth, so edges stay crisp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.nav.types import Float

Faces = NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Vertices, shape (v, 3), m; faces, shape (f, 3), indices."""

    vertices: Float
    faces: Faces


def merge(*meshes: Mesh) -> Mesh:
    """Return one mesh that draws all of them."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Mesh(
        np.vstack([mesh.vertices for mesh in meshes]),
        np.vstack([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]).astype(np.uint32),
    )


def mirrored(mesh: Mesh) -> Mesh:
    """Return the mesh reflected in the x-z plane (left for right), still facing outwards."""
    return Mesh(mesh.vertices * [1.0, -1.0, 1.0], mesh.faces[:, ::-1].copy())


def skin(rings: Float) -> Mesh:
    """Return the smooth surface through closed rings, shape (rings, points, 3), m."""
    count, size, _ = rings.shape
    ring, at = np.meshgrid(np.arange(count - 1), np.arange(size), indexing="ij")
    a, b = ring * size + at, ring * size + (at + 1) % size
    quads = np.stack([a, b, b + size, a, b + size, a + size], axis=-1)
    return Mesh(rings.reshape(-1, 3), quads.reshape(-1, 3).astype(np.uint32))


def cap(ring: Float) -> Mesh:
    """Return the flat fan over a closed ring, shape (points, 3), m."""
    size = len(ring)
    at = np.arange(size)
    faces = np.stack([np.full(size, size), (at + 1) % size, at], axis=1)
    return Mesh(np.vstack([ring, ring.mean(axis=0)]), faces.astype(np.uint32))


def solid(rings: Float) -> Mesh:
    """Return the surface through the rings, closed at both ends with sharp rims."""
    return merge(skin(rings), cap(rings[0]), cap(rings[-1][::-1]))


def tube(start_m: Float, end_m: Float, start_radius_m: float, end_radius_m: float, sides: int = 20) -> Mesh:
    """Return a round bar between two points (m), tapering from one radius to the other."""
    along = (end_m - start_m) / np.linalg.norm(end_m - start_m)
    across = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[:, None]
    circle = np.cos(angle) * across + np.sin(angle) * np.cross(along, across)
    return solid(np.stack([start_m + start_radius_m * circle, end_m + end_radius_m * circle]))


def ellipsoid(centre_m: Float, half_axes_m: Float, rings: int = 14, sides: int = 24) -> Mesh:
    """Return an ellipsoid about a centre, m."""
    polar = np.linspace(0.0, np.pi, rings)[:, None]
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)[None, :]
    ones = np.ones_like(angle)
    unit = np.stack([np.sin(polar) * np.cos(angle), np.sin(polar) * np.sin(angle), np.cos(polar) * ones], axis=-1)
    return skin(unit * half_axes_m + centre_m)


def fuselage(sections: list[tuple[float, float, float, float]], squareness: float, sides: int = 28) -> Mesh:
    """Return a body along x through superellipse sections (x, z, half width, half height), m; 2 is round, 4 boxy."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    y = np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** (2.0 / squareness)
    z = np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** (2.0 / squareness)
    return solid(np.array([np.stack([0 * y + x, w * y, h * z + up], axis=1) for x, up, w, h in sections]))


def wing(sections: list[tuple[float, float, float, float, float]], *, upright: bool = False) -> Mesh:
    """Return a lifting surface through profiles (x of leading edge, y, z, chord, thickness), m; upright: a fin."""
    t = np.linspace(0.0, np.pi, 10)
    x = 0.5 * (1.0 - np.cos(t))
    half = 2.6 * np.sqrt(x) * (1.0 - x) * 0.5
    outline = np.concatenate([np.stack([x, half], axis=1), np.stack([x[::-1], -half[::-1]], axis=1)[1:-1]])
    rings = []
    for lead, y, z, chord, thick in sections:
        along, across = lead - chord * outline[:, 0], thick * outline[:, 1]
        flat = [along, 0 * along + y, z + across]
        rings.append(np.stack([along, y + across, 0 * along + z] if upright else flat, axis=1))
    return solid(np.array(rings))


def disc(centre_m: Float, radius_m: float, thickness_m: float = 0.003, sides: int = 40) -> Mesh:
    """Return a thin disc in the x-y plane, m."""
    up = np.array([0.0, 0.0, 0.5 * thickness_m])
    return tube(centre_m + up, centre_m - up, radius_m, radius_m, sides)


def hoop(radius_m: float, width_m: float, sides: int = 96) -> Mesh:
    """Return a flat ring in the x-y plane, m."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return skin(np.stack([(radius_m - width_m) * circle, radius_m * circle]))

"""The six faces about a vehicle: a filled plate with a tick, a ring with an arrow, an empty ring."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.calibration.types import FACES
from server.nav.types import Float
from server.view3d.shapes import Mesh, disc, hoop, merge, skin, tube

FACE_OUT: Final = 0.92
"""Distance of the plates from the vehicle's middle, drawing units."""

PLATE: Final = 0.24
FACE_UP_B: Final[dict[str, tuple[float, float, float]]] = dict(
    zip(FACES, [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], strict=True)
)
"""Body direction (FRD) that points up in each position: that of the specific force, as `FACES` has them."""

SIDE_NAMES: Final = ("nose up", "tail up", "right up", "left up", "belly up", "top up")


def _onto(mesh: Mesh, out_b: Float) -> Mesh:
    """Return a mesh drawn about +z moved to the face in direction `out_b`, shape (3,)."""
    helper = np.array([0.0, 0.0, -1.0]) if abs(out_b[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = np.cross(helper, out_b)
    frame = np.stack([right, helper, out_b], axis=1)
    return Mesh(mesh.vertices @ frame.T + FACE_OUT * out_b, mesh.faces)


def face_mesh(face: str, state: str) -> Mesh:
    """Return the plate of one of `FACES`; state "done", "next" or "missing"."""
    out_b = np.array(FACE_UP_B[face], dtype=np.float64)
    if state == "done":
        return _onto(merge(disc(np.zeros(3), PLATE, 0.02), _rim(0.03)), out_b)
    return _onto(_rim(0.06 if state == "next" else 0.025), out_b)


def face_mark(face: str, state: str) -> Mesh | None:
    """Return what stands on the plate: a tick, raised on both sides; an arrow outwards; nothing."""
    out_b = np.array(FACE_UP_B[face], dtype=np.float64)
    if state == "done":
        return _onto(_tick(), out_b)
    if state == "next":
        shaft = tube(np.array([0.0, 0.0, -0.05]), np.array([0.0, 0.0, 0.16]), 0.035, 0.035)
        head = tube(np.array([0.0, 0.0, 0.16]), np.array([0.0, 0.0, 0.36]), 0.1, 0.004)
        return _onto(merge(shaft, head), out_b)
    return None


def _rim(width: float) -> Mesh:
    flat = hoop(PLATE, width, 48)
    up = np.array([0.0, 0.0, 0.012])
    top, bottom = Mesh(flat.vertices + up, flat.faces), Mesh(flat.vertices - up, flat.faces)
    edge = flat.vertices[48:]
    return merge(top, bottom, skin(np.stack([edge + up, edge - up])))


def _tick() -> Mesh:
    corner, radius = np.array([-0.035, -0.1, 0.0]), 0.032
    short, long = np.array([-0.125, 0.0, 0.0]), np.array([0.13, 0.12, 0.0])
    return merge(tube(short, corner, radius, radius, 12), tube(corner, long, radius, radius, 12))

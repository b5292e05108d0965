"""Poses in the calibration scene: six faces that fill about the vehicle, and the ghost of the pose to take."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from server.nav.calibration.types import FACES
from server.nav.types import VehicleClass
from server.view3d import palette
from server.view3d.face_shapes import FACE_OUT, FACE_UP_B, SIDE_NAMES, face_mark, face_mesh
from server.view3d.feed import ORIGIN, Quat, Vec3
from server.view3d.held import quat_of_target
from server.view3d.shapes import Mesh
from server.view3d.vehicles import vehicle

if TYPE_CHECKING:
    from server.nav.calibration.types import Progress
    from server.view3d.keeper import Keeper
    from server.view3d.palette import Rgb

GHOST_SIZE: Final = 1.5
GHOST_OPACITY: Final = 0.5
FACE_RGB: Final[dict[str, Rgb]] = {
    "done": palette.FACE_DONE_RGB,
    "next": palette.FACE_NEXT_RGB,
    "missing": palette.FACE_MISSING_RGB,
}


class PoseShow:
    """What a job that wants the vehicle held in certain ways shows."""

    def __init__(self, keep: Keeper, kind: VehicleClass) -> None:
        self._keep = keep
        self.kind = kind
        self.has_next = False
        self._place: Vec3 = ORIGIN
        self._target_b: Vec3 | None = None
        self._ghost: Any = None
        self._ghost_q: Quat | None = None
        self._ghost_kind: VehicleClass | None = None

    def show(self, progress: Progress | None, q_nb: Quat) -> None:
        """Show faces and ghost as a job stands; None takes them away."""
        if progress is None:
            self.clear()
            return
        self._show_faces(progress)
        self._show_ghost(_target_b(progress), q_nb)

    def move(self, place: Vec3) -> None:
        """Have the ghost stand here."""
        self._place = place
        if self._ghost is not None:
            self._ghost.position = place

    def clear(self) -> None:
        """Take everything away."""
        for i in range(len(FACES)):
            self._keep.drop(f"now/face-{i}", f"now/mark-{i}", f"now/side-{i}")
        self._drop_ghost()

    def _show_faces(self, progress: Progress) -> None:
        for i, (face, done) in enumerate(zip(FACES, progress.faces, strict=False)):
            state = "done" if done else "next" if face == progress.face_next else "missing"
            self._keep.mesh(f"now/face-{i}", face_mesh(face, state), FACE_RGB[state])
            mark = face_mark(face, state)
            if mark is None:
                self._keep.drop(f"now/mark-{i}")
            else:
                self._keep.mesh(f"now/mark-{i}", mark, palette.FACE_TICK_RGB if done else FACE_RGB[state])
            self._show_side(i, face, state)

    def _show_side(self, i: int, face: str, state: str) -> None:
        if state == "done":
            self._keep.drop(f"now/side-{i}")
            return
        x, y, z = ((FACE_OUT + (0.5 if state == "next" else 0.0)) * np.array(FACE_UP_B[face])).tolist()
        self._keep.label(f"now/side-{i}", SIDE_NAMES[i], (x, y, z), 0.8 if state == "next" else 0.6)

    def _show_ghost(self, target_b: Vec3 | None, q_nb: Quat) -> None:
        if target_b is None:
            self._drop_ghost()
            return
        before = self._ghost_q if target_b == self._target_b else None
        self._target_b, self._ghost_q = target_b, quat_of_target(q_nb, target_b, before)
        if self._ghost is None or self._ghost_kind != self.kind:
            self._draw_ghost()
        self._ghost.wxyz = self._ghost_q

    def _draw_ghost(self) -> None:
        self._keep.drop("then")
        self._ghost, self._ghost_kind, self.has_next = self._keep.frame("then"), self.kind, True
        self._ghost.position = self._place
        model = vehicle(self.kind)
        for part in model.parts:
            mesh = Mesh(part.mesh.vertices * (GHOST_SIZE / model.span_m), part.mesh.faces)
            rgb = part.rgb if part.name.startswith("front") else palette.GHOST_RGB
            self._keep.mesh(f"then/{part.name}", mesh, rgb, part.opacity or GHOST_OPACITY)

    def _drop_ghost(self) -> None:
        if self.has_next:
            self._keep.drop("then")
        self._ghost = self._ghost_q = self._target_b = None
        self.has_next = False


def _target_b(progress: Progress) -> Vec3 | None:
    """Return what shall point down next, body FRD; None when the job does not say."""
    if len(progress.pose_target_b) == 3:
        x, y, z = progress.pose_target_b
        return (x, y, z) if 0.0 < math.hypot(x, y, z) < math.inf else None
    if progress.face_next not in FACE_UP_B:
        return None
    x, y, z = FACE_UP_B[progress.face_next]
    return -x, -y, -z

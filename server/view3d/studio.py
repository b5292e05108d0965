"""The calibration scene of one viewer: the vehicle as it is held, and what its running job shows of it.

Tree, below the `/ned` that the flight scene has too (a viewer has one of the two):

    /ned/cal         NED turned about down, so that the vehicle headed forwards when the job was first seen
      /now           body axes as they are now: vehicle, faces or the measured field
      /then          the pose to take (a ghost), or the measured field after calibration
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from server.nav.calibration.types import CalKind
from server.nav.rotation import quat_mul
from server.nav.types import Float, VehicleClass
from server.view3d import palette
from server.view3d.feed import IDENTITY, Quat, Vec3
from server.view3d.geometry import NED_WXYZ, Anchor
from server.view3d.held import heading_rad
from server.view3d.keeper import Keeper
from server.view3d.shapes import Mesh, disc, hoop
from server.view3d.studio_field import FieldShow
from server.view3d.studio_layout import FLOOR, LABEL_HEIGHT, camera_place, places
from server.view3d.studio_poses import PoseShow
from server.view3d.vehicles import vehicle

if TYPE_CHECKING:
    import viser

    from server.calibration.scene import CalibrationScene

ROOT: Final = "/ned/cal"
FIELD_KINDS: Final = frozenset({CalKind.MAG_ELLIPSOID})
VEHICLE_SIZE: Final = 1.4
"""Largest extent of the vehicle, drawing units, when it is what matters; small inside a field."""

VEHICLE_SIZE_IN_FIELD: Final = 0.62


class Studio:
    """One viewer's calibration scene. Call from one thread at a time; every change goes to this viewer alone."""

    def __init__(self, client: viser.ClientHandle, kind: VehicleClass, theme: str, *, stay: bool = False) -> None:
        """Draw what does not depend on a job; `stay` leaves the camera where it is until the next job."""
        self._client = client
        self._theme = theme
        self.kind = kind
        self._q_nb: Quat | None = None
        self._turn: Quat = IDENTITY
        self._in_field = False
        self._job_id: str | None = None
        self._stay = stay
        self._count, self._aspect = 1, 0.0
        with client.atomic():
            client.scene.configure_default_lights(enabled=True, cast_shadow=False)
            client.scene.add_frame("/ned", show_axes=False, wxyz=NED_WXYZ)
            client.scene.add_frame(ROOT, show_axes=False)
            self._keep = Keeper(client.scene, ROOT)
            self._now = self._keep.frame("now")
            self._poses = PoseShow(self._keep, kind)
            self._field = FieldShow(self._keep, theme)
            self._draw_vehicle()
            self._arrange(1)

    def set_vehicle(self, kind: VehicleClass) -> None:
        """Draw this class of vehicle instead."""
        self.kind = self._poses.kind = kind
        self._draw_vehicle()

    def set_theme(self, theme: str) -> None:
        """Draw for a dark or a light page; what belongs to the job follows with its next showing."""
        self._theme = self._field.theme = theme
        for i, at in enumerate(places(self._count, self._aspect)):
            self._floor(i, at)

    def look(self) -> None:
        """Place the camera so that everything is seen."""
        position, target = camera_place(self._count, self._aspect)
        with self._client.atomic():
            self._client.camera.position, self._client.camera.look_at = position, target

    def hold(self, q_nb: Quat, mag_b_gauss: Vec3 | None) -> None:
        """Show the present attitude and, in a field, the present sample: the one call per frame."""
        with self._client.atomic():
            if self._q_nb is None:
                self._turn = Anchor(yaw_rad=heading_rad(q_nb)).turn()
            self._q_nb = q_nb
            self._now.wxyz = self._q_drawn
            self._field.point_at(self._q_drawn, mag_b_gauss)

    @property
    def _q_drawn(self) -> Quat:
        """From body to the scene's axes; as `q_nb`, but for the heading."""
        return quat_mul(*self._turn, *(self._q_nb or IDENTITY))

    def forget(self) -> None:
        """Another board is going to be shown."""
        self._q_nb = None
        self.show(None)

    def show(self, job: CalibrationScene | None) -> None:
        """Show a job as it stands; None: there is none."""
        with self._client.atomic():
            if (None if job is None else job.job_id) != self._job_id:
                self._restart(job)
            field = job is not None and job.kind in FIELD_KINDS
            if field != self._in_field:
                self._in_field = field
                self._draw_vehicle()
            self._poses.show(None if field or job is None else job.progress, self._q_drawn)
            self._field.show(job if field else None)
            self._arrange(2 if self._poses.has_next or self._field.has_after else 1)
            self._title(job)
            self._stay = False

    def _restart(self, job: CalibrationScene | None) -> None:
        self._job_id = None if job is None else job.job_id
        self._poses.clear()
        self._field.clear()
        if self._q_nb is not None:
            self._turn = Anchor(yaw_rad=heading_rad(self._q_nb)).turn()

    def _draw_vehicle(self) -> None:
        model = vehicle(self.kind)
        by = (VEHICLE_SIZE_IN_FIELD if self._in_field else VEHICLE_SIZE) / model.span_m
        self._keep.drop("now/vehicle")
        self._keep.frame("now/vehicle")
        for part in model.parts:
            mesh = Mesh(part.mesh.vertices * by, part.mesh.faces)
            self._keep.mesh(f"now/vehicle/{part.name}", mesh, part.rgb, part.opacity)

    def _arrange(self, count: int) -> None:
        aspect = round(float(self._client.camera.aspect), 2)
        if (count, aspect) == (self._count, self._aspect):
            return
        before = camera_place(self._count, self._aspect) if self._aspect else None
        self._count, self._aspect = count, aspect
        spots = places(count, aspect)
        self._now.position = spots[0]
        for i, at in enumerate(spots):
            self._floor(i, at)
        if count < 2:
            self._keep.drop("floor-1", "rim-1")
        self._poses.move(spots[-1])
        self._field.move(*spots)
        after = camera_place(count, aspect)
        if not self._stay and (before is None or math.dist(before[0], after[0]) > 0.05 * math.hypot(*after[0])):
            self.look()

    def _floor(self, i: int, at: Vec3) -> None:
        floor, rim = disc(_below(at), 1.0, 0.02, 64), hoop(1.0, 0.035)
        rim = Mesh(rim.vertices + _below(at) - [0.0, 0.0, 0.02], rim.faces)
        self._keep.mesh(f"floor-{i}", floor, palette.GROUND_RGB[self._theme])
        self._keep.mesh(f"rim-{i}", rim, palette.SECTION_RGB[self._theme])

    def _title(self, job: CalibrationScene | None) -> None:
        spots = places(self._count, self._aspect)
        texts = ["no calibration is running"] if job is None else ["now"]
        if self._poses.has_next:
            texts = ["now", "next"]
        if self._field.shown:
            texts = ["measured", "calibrated"][: self._count]
        for i, (text, at) in enumerate(zip(texts, spots, strict=False)):
            self._keep.label(f"title-{i}", text, (at[0], at[1], at[2] - LABEL_HEIGHT), 1.0)
        if len(texts) < 2:
            self._keep.drop("title-1")


def _below(at: Vec3) -> Float:
    return np.array([at[0], at[1], at[2] + FLOOR])

"""The nodes of one viewer's scene and how they follow the data; nothing here decides when.

Tree (all NED below `/ned`):

    /ned             fixed half turn into viser's world
      /site          origin of the board's local frame, as seen from the anchor: ground, axes, paths, fixes
      /here          the vehicle's place, axes parallel to /site: compass, ellipsoid, drop line, shadow
        /vehicle     body axes: model, cones
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from server.nav.types import Float, VehicleClass
from server.view3d import palette
from server.view3d.feed import ORIGIN, Pose, Quat, Vec3
from server.view3d.geometry import (
    NED_WXYZ,
    Anchor,
    cone_faces,
    cone_spread_rad,
    cone_vertices_m,
    ellipsoid_axes_m,
    world_from_ned,
)
from server.view3d.nodes import CONES, PLAIN, SITE, Cone, add_compass, add_ground, add_site_axes, add_vehicle
from server.view3d.shapes import disc, ellipsoid, tube
from server.view3d.vehicles import vehicle

if TYPE_CHECKING:
    import viser
    from viser import SceneNodeHandle

HERE: Final = "/ned/here"
LARGEST_ELLIPSOID_M: Final = 2000.0
"""A larger 3 σ says "unknown", and would fill the sky."""

NOTICEABLE: Final = 0.03
"""Relative change of an uncertainty below which its shape is left alone."""

ZOOM_SPANS: Final = 14.0
"""Up to this distance the vehicle is to scale; beyond, it keeps its size on the screen."""

GROUND_STEPS_M: Final = (1.0, 10.0, 100.0, 1000.0)


class Scene:
    """One viewer's scene. Call from one thread at a time; every change goes to this viewer alone."""

    def __init__(self, client: viser.ClientHandle, kind: VehicleClass, theme: str) -> None:
        self._client = client
        self._scene = client.scene
        self.theme = theme
        with client.atomic():
            self._scene.configure_default_lights(enabled=True, cast_shadow=False)
            self._scene.add_frame("/ned", show_axes=False, wxyz=NED_WXYZ)
            self._site = self._scene.add_frame(SITE, show_axes=False)
            self._here = self._scene.add_frame(HERE, show_axes=False)
            self._ground = add_ground(self._scene, theme)
            add_site_axes(self._scene)
            self._add_uncertainty()
            self.set_vehicle(kind)

    def set_vehicle(self, kind: VehicleClass) -> None:
        """Draw this class of vehicle instead."""
        if self._scene.get_handle_by_name(f"{HERE}/vehicle") is not None:
            self._scene.remove_by_name(f"{HERE}/vehicle")
        model = vehicle(kind)
        self.kind, self.span_m, self._zoom = kind, model.span_m, 1.0
        self._cones: dict[str, Any] = {}
        self._spreads: dict[str, Float] = {}
        self._body, self._sized = add_vehicle(self._scene, HERE, model)
        self._sized += add_compass(self._scene, HERE, model.span_m, self.theme)

    def _add_uncertainty(self) -> None:
        ball, bar = ellipsoid(np.zeros(3), np.ones(3), 24, 36), tube(np.zeros(3), np.array([0, 0, 1.0]), 0.006, 0.006)
        self._ellipsoid = self._scene.add_mesh_simple(
            f"{HERE}/ellipsoid", ball.vertices, ball.faces, color=palette.ELLIPSOID_RGB, opacity=0.12, **PLAIN
        )
        self._drop = self._scene.add_mesh_simple(
            f"{HERE}/drop", bar.vertices, bar.faces, color=palette.TRIM_RGB, opacity=0.55, **PLAIN
        )
        spot = disc(np.zeros(3), 0.3, 0.01)
        self._shadow = self._scene.add_mesh_simple(
            f"{HERE}/shadow", spot.vertices, spot.faces, color=(0, 0, 0), opacity=0.35, **PLAIN
        )
        self._ellipsoid.visible = self._drop.visible = self._shadow.visible = False

    def place(self, pose: Pose, anchor: Anchor) -> None:
        """Move site and vehicle to where the anchor sees them: the one call per frame."""
        turn = anchor.turn()
        _move(self._site, anchor.locate(ORIGIN), turn)
        _move(self._here, anchor.locate(pose.pos_n_m), turn)
        _turn(self._body, pose.q_nb)
        self._hang(-pose.pos_n_m[2])

    def _hang(self, height_m: float) -> None:
        shown = height_m > 0.25
        if self._drop.visible != shown:
            self._drop.visible = self._shadow.visible = shown
        drawn_m = float(self._drop.scale[2]) if isinstance(self._drop.scale, tuple) else 0.0
        if shown and abs(height_m - drawn_m) > 0.004 * height_m:
            wide = min(max(self._zoom, 0.5), 50.0)
            self._drop.scale = (wide, wide, height_m)
            self._shadow.scale = (wide, wide, 1.0)
            _move(self._shadow, (0.0, 0.0, height_m - 0.01))

    def spread(self, pose: Pose) -> None:
        """Draw how sure the estimate is: ellipsoid and cones, where they changed noticeably."""
        axes = ellipsoid_axes_m(pose.sigma_pos_n_m) if pose.known else None
        shown = axes is not None and max(axes) < LARGEST_ELLIPSOID_M
        if self._ellipsoid.visible != shown:
            self._ellipsoid.visible = shown
        if shown and axes is not None and _differs(axes, self._ellipsoid.scale):
            self._ellipsoid.scale = axes
        for cone in CONES:
            self._open(cone, cone_spread_rad(pose.q_nb, pose.sigma_att_rad, cone.axis_b))

    def _open(self, cone: Cone, spread_rad2: Float | None) -> None:
        if spread_rad2 is None:
            self._close(cone)
            return
        before = self._spreads.get(cone.name)
        if before is not None and np.linalg.norm(spread_rad2 - before) < NOTICEABLE * np.linalg.norm(before):
            return
        self._spreads[cone.name] = spread_rad2
        vertices = cone_vertices_m(cone.axis_b, spread_rad2, cone.length * self.span_m * self._zoom)
        if cone.name in self._cones:
            self._cones[cone.name].vertices = vertices
            return
        name, look = f"{HERE}/vehicle/{cone.name}", {"color": cone.rgb, "opacity": 0.3, "side": "double", **PLAIN}
        self._cones[cone.name] = self._scene.add_mesh_simple(name, vertices, cone_faces(), **look)

    def _close(self, cone: Cone) -> None:
        self._spreads.pop(cone.name, None)
        handle = self._cones.pop(cone.name, None)
        if handle is not None:
            handle.remove()

    def zoom(self, camera_m: Vec3, pose: Pose, anchor: Anchor) -> None:
        """Keep the vehicle findable from afar (drawn larger beyond ZOOM_SPANS) and the ground grid readable."""
        away_m = math.dist(camera_m, world_from_ned(anchor.locate(pose.pos_n_m)))
        zoom = 1.25 ** round(math.log(max(away_m / (ZOOM_SPANS * self.span_m), 1.0), 1.25))
        if zoom != self._zoom:
            self._zoom = zoom
            for sized in self._sized:
                sized.resize(zoom)
            self._spreads.clear()  # so that the cones are drawn again, at the new length
        self._spread_ground(pose.pos_n_m, max(away_m, -pose.pos_n_m[2]))

    def _spread_ground(self, pos_n_m: Vec3, reach_m: float) -> None:
        cell_m = next((step for step in GROUND_STEPS_M if reach_m < 60.0 * step), GROUND_STEPS_M[-1])
        if self._ground.cell_size != cell_m:
            self._ground.cell_size, self._ground.section_size = cell_m, 10.0 * cell_m
            self._ground.fade_distance = 400.0 * cell_m
        section_m = 10.0 * cell_m
        _move(self._ground, (section_m * round(pos_n_m[0] / section_m), section_m * round(pos_n_m[1] / section_m), 0.0))

    def set_theme(self, theme: str) -> None:
        """Draw the ground for a dark or a light page."""
        self.theme = theme
        self._ground.plane_color, self._ground.cell_color = palette.GROUND_RGB[theme], palette.CELL_RGB[theme]
        self._ground.section_color = palette.SECTION_RGB[theme]


def _move(node: SceneNodeHandle, position_m: Vec3, wxyz: Quat | None = None) -> None:
    node.position = position_m
    if wxyz is not None:
        _turn(node, wxyz)


def _turn(node: SceneNodeHandle, wxyz: Quat) -> None:
    node.wxyz = wxyz


def _differs(values: Vec3, drawn: float | tuple[float, ...]) -> bool:
    if not isinstance(drawn, tuple):
        return True
    return any(abs(a - b) > NOTICEABLE * abs(b) for a, b in zip(values, drawn, strict=True))

"""The nodes that are built once per viewer: ground, axes, compass, vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from server.view3d import palette
from server.view3d.feed import Vec3
from server.view3d.palette import Rgb
from server.view3d.shapes import Mesh, hoop, merge, tube
from server.view3d.vehicles import Vehicle

if TYPE_CHECKING:
    from viser import FrameHandle, GridHandle, SceneApi

SITE: Final = "/ned/site"
PLAIN: Final[dict[str, Any]] = {"cast_shadow": False, "receive_shadow": False}
"""Shadow maps cost a second rendering of everything; a disc under the vehicle says as much."""


@dataclass(frozen=True, slots=True)
class Cone:
    """An uncertainty cone about a body axis; length in spans."""

    name: str
    axis_b: Vec3
    rgb: Rgb
    length: float


CONES: Final = (
    Cone("heading-cone", (1.0, 0.0, 0.0), palette.HEADING_CONE_RGB, 2.0),
    Cone("tilt-cone", (0.0, 0.0, -1.0), palette.TILT_CONE_RGB, 1.1),
)


@dataclass(frozen=True, slots=True)
class Sized:
    """A node that is drawn larger from afar; `at_m` moves outwards with the size (labels), None stays."""

    handle: Any
    at_m: Vec3 | None = None

    def resize(self, zoom: float) -> None:
        """Draw `zoom` times the true size."""
        if self.at_m is None:
            self.handle.scale = zoom
        else:
            self.handle.position = (zoom * self.at_m[0], zoom * self.at_m[1], zoom * self.at_m[2])


def add_ground(scene: SceneApi, theme: str) -> GridHandle:
    """Add the ground plane with its grid at the height of the site; it fades into the sky."""
    return scene.add_grid(
        f"{SITE}/ground",
        infinite_grid=True,
        cell_size=1.0,
        section_size=10.0,
        cell_thickness=0.8,
        section_thickness=1.3,
        fade_distance=400.0,
        fade_strength=2.5,
        shadow_opacity=0.0,
        plane_opacity=0.92,
        plane_color=palette.GROUND_RGB[theme],
        cell_color=palette.CELL_RGB[theme],
        section_color=palette.SECTION_RGB[theme],
        wxyz=(0.0, 1.0, 0.0, 0.0),
    )


def add_site_axes(scene: SceneApi) -> None:
    """Add the axes of the local frame at its origin (north red, east green, down blue) and a flat north arrow."""
    scene.add_frame(f"{SITE}/axes", axes_length=1.5, axes_radius=0.02, position=(0.0, 0.0, -0.02))
    up = -0.015
    corners = np.array([[2.6, 0, up], [1.9, 0.28, up], [2.05, 0, up], [1.9, -0.28, up]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    scene.add_mesh_simple(f"{SITE}/north", corners, faces, color=palette.NORTH_RGB, side="double", **PLAIN)


def add_compass(scene: SceneApi, parent: str, span_m: float, theme: str) -> list[Sized]:
    """Add a level ring about the vehicle with N, E, S, W; return what grows with the vehicle."""
    radius_m = 1.15 * span_m
    ring = hoop(radius_m, 0.012 * span_m)
    ticks = [_tick(np.radians(angle), radius_m, span_m) for angle in range(0, 360, 30)]
    arrow = _tick(0.0, 1.1 * radius_m, 4.0 * span_m)
    dial = merge(ring, *ticks)
    rgb = palette.SECTION_RGB[theme]
    made = [
        Sized(scene.add_mesh_simple(f"{parent}/dial", dial.vertices, dial.faces, color=rgb, side="double", **PLAIN)),
        Sized(
            scene.add_mesh_simple(
                f"{parent}/north", arrow.vertices, arrow.faces, color=palette.NORTH_RGB, side="double", **PLAIN
            )
        ),
    ]
    for letter, north, east in (("N", 1, 0), ("E", 0, 1), ("S", -1, 0), ("W", 0, -1)):
        at_m = (1.28 * radius_m * north, 1.28 * radius_m * east, 0.0)
        label = scene.add_label(
            f"{parent}/{letter}", letter, position=at_m, anchor="center-center", font_screen_scale=0.9
        )
        made.append(Sized(label, at_m))
    return made


def _tick(angle_rad: float, radius_m: float, span_m: float) -> Mesh:
    out = np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
    return tube(radius_m * out, (radius_m + 0.04 * span_m) * out, 0.008 * span_m, 0.002 * span_m, 6)


def add_vehicle(scene: SceneApi, parent: str, model: Vehicle) -> tuple[FrameHandle, list[Sized]]:
    """Add the vehicle with its body axes (x red, y green, z blue); return its frame and what grows from afar."""
    name = f"{parent}/vehicle"
    frame = scene.add_frame(
        name, axes_length=0.75 * model.span_m, axes_radius=0.008 * model.span_m, origin_radius=0.01 * model.span_m
    )
    made = [Sized(frame)]
    for part in model.parts:
        mesh = scene.add_mesh_simple(
            f"{name}/{part.name}",
            part.mesh.vertices,
            part.mesh.faces,
            color=part.rgb,
            opacity=part.opacity,
            side="double",
            **PLAIN,
        )
        made.append(Sized(mesh))
    return frame, made

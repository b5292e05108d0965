"""The measured magnetic field in the calibration scene: points, fitted ellipsoid, open directions, hard-iron offset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from server.nav.types import Float
from server.view3d import palette
from server.view3d.feed import ORIGIN, Quat, Vec3
from server.view3d.field_shapes import (
    RESIDUAL_TOP,
    Extent,
    Surface,
    extent_of,
    globe_lines,
    rings_about,
    surface_from,
    thinned,
)
from server.view3d.geometry import quat_from_x
from server.view3d.shapes import Mesh, ellipsoid, merge, tube

if TYPE_CHECKING:
    from server.calibration.scene import CalibrationScene
    from server.view3d.keeper import Keeper

POINT_SIZE: Final = 0.022
SMALLEST_OFFSET: Final = 0.04
"""Hard-iron offset, as a share of what is drawn, below which an arrow would be a blot."""

LARGEST_OFFSET: Final = 1.15
"""The zero of a sensor further off than this is drawn at this distance: the arrow then says where it lies."""

PARTS: Final = ("dots", "globe", "ball", "open", "zero", "offset", "field", "sample", "zero-name")
BALL: Final = ellipsoid(np.zeros(3), np.ones(3), 20, 32)


class FieldShow:
    """What a magnetometer's job shows: before, and once fitted also after calibration."""

    def __init__(self, keep: Keeper, theme: str) -> None:
        self._keep = keep
        self.theme = theme
        self.shown = self.has_after = False
        self._extent: Extent | None = None
        self._surface: Surface | None = None
        self._after: Any = None
        self._after_place: Vec3 = ORIGIN
        self._arrow: Any = None
        self._sample: Any = None

    def show(self, job: CalibrationScene | None) -> None:
        """Show a job as it stands; None takes everything away."""
        if job is None:
            if self.shown:
                self.clear()
            return
        self.shown = True
        points = thinned(job.progress.points)
        result = None if job.fit is None or not job.fit.ok else job.fit.parameters
        offset = job.progress.offset if result is None else np.asarray(result.get("offset", ()))
        matrix = job.progress.matrix if result is None else np.asarray(result.get("matrix", ()))
        self._surface = surface_from(offset, matrix, points)
        extent = extent_of(self._surface, points)
        if self._extent is None or not self._extent.near(extent):
            self._extent = extent
        self._show_before(points, thinned(job.progress.uncovered_b), self._extent)
        self._show_after(points, self._surface if result is not None else None)

    def point_at(self, q_nb: Quat, mag_b_gauss: Vec3 | None) -> None:
        """Turn with the vehicle and show the present sample (gauss, body), None: there is none."""
        if self._after is not None:
            self._after.wxyz = q_nb
        if not self.shown or self._extent is None:
            return
        if mag_b_gauss is None:
            self._keep.drop("now/field", "now/sample")
            self._arrow = self._sample = None
            return
        if self._arrow is None:
            self._draw_present()
        at = self._extent.drawn(np.array([mag_b_gauss]))[0]
        length = float(np.linalg.norm(at))
        if 0.0 < length < 3.0:
            self._sample.position = tuple(at.tolist())
            self._arrow.wxyz = quat_from_x(at)

    def move(self, before: Vec3, *after: Vec3) -> None:
        """Have the calibrated field stand at the last of these places."""
        self._after_place = after[-1] if after else before
        if self._after is not None:
            self._after.position = self._after_place

    def clear(self) -> None:
        """Take everything away."""
        self._keep.drop(*(f"now/{part}" for part in PARTS))
        self._drop_after()
        self.shown, self._extent, self._surface = False, None, None
        self._arrow = self._sample = None

    def _show_before(self, points: Float, open_directions: Float, extent: Extent) -> None:
        misfit = None if self._surface is None else self._surface.misfit(points)
        self._dots("now/dots", extent.drawn(points), misfit)
        surface = self._surface or Surface(extent.centre, np.eye(3), extent.size)
        if self._surface is None:
            self._keep.drop("now/globe", "now/ball")
        else:
            starts, ends = globe_lines()
            rgb = palette.GLOBE_RGB[self.theme]
            self._keep.lines("now/globe", extent.drawn(surface.at(starts)), extent.drawn(surface.at(ends)), rgb, 1.0)
            ball = Mesh(extent.drawn(surface.at(BALL.vertices)), BALL.faces)
            self._keep.mesh("now/ball", ball, palette.ELLIPSOID_RGB, 0.12)
        self._show_open(open_directions, surface, extent)
        self._show_offset(-extent.centre / extent.size)

    def _show_open(self, directions: Float, surface: Surface, extent: Extent) -> None:
        if not len(directions):
            self._keep.drop("now/open")
            return
        places = extent.drawn(surface.at(directions))
        self._keep.mesh("now/open", rings_about(places, places, 0.085, 0.03), palette.OPEN_RGB[self.theme])

    def _show_offset(self, zero: Float) -> None:
        away = float(np.linalg.norm(zero))
        if away < SMALLEST_OFFSET:
            self._keep.drop("now/zero", "now/offset", "now/zero-name")
            return
        zero = zero * min(1.0, LARGEST_OFFSET / away)
        bars = [tube(zero - 0.07 * axis, zero + 0.07 * axis, 0.008, 0.008, 8) for axis in np.eye(3)]
        self._keep.mesh("now/zero", merge(*bars), palette.OFFSET_RGB[self.theme])
        self._keep.mesh("now/offset", arrow(zero, np.zeros(3), 0.014), palette.OFFSET_RGB[self.theme])
        x, y, z = (zero * (1.0 + 0.12 / float(np.linalg.norm(zero)))).tolist()
        self._keep.label("now/zero-name", "zero", (x, y, z), 0.6)

    def _show_after(self, points: Float, surface: Surface | None) -> None:
        if surface is None:
            self._drop_after()
            return
        if self._after is None:
            self._after, self.has_after = self._keep.frame("then"), True
            self._after.position = self._after_place
        starts, ends = globe_lines()
        self._keep.lines("then/globe", starts, ends, palette.GLOBE_RGB[self.theme], 1.0)
        self._keep.mesh("then/ball", BALL, palette.ELLIPSOID_RGB, 0.12)
        self._dots("then/dots", surface.calibrated(points), surface.misfit(points))

    def _drop_after(self) -> None:
        if self.has_after:
            self._keep.drop("then")
        self._after, self.has_after = None, False

    def _dots(self, name: str, points: Float, misfit: Float | None) -> None:
        if not len(points):
            self._keep.drop(name)
            return
        if misfit is None:
            rgb: NDArray[np.uint8] = np.tile(np.array(palette.POINT_RGB[self.theme], dtype=np.uint8), (len(points), 1))
        else:
            rgb = palette.residual_rgb(misfit / RESIDUAL_TOP)
        self._keep.dots(name, points, rgb, POINT_SIZE)

    def _draw_present(self) -> None:
        pointer = arrow(np.zeros(3), np.array([0.97, 0.0, 0.0]), 0.012)
        self._arrow = self._keep.mesh("now/field", pointer, palette.NORTH_RGB)
        ball = ellipsoid(np.zeros(3), np.full(3, 0.05), 10, 16)
        self._sample = self._keep.mesh("now/sample", ball, palette.NORTH_RGB)


def arrow(start: Float, end: Float, radius: float) -> Mesh:
    """Return an arrow between two points, shape (3,) each."""
    along = (end - start) / np.linalg.norm(end - start)
    head = min(6.0 * radius, 0.5 * float(np.linalg.norm(end - start)))
    neck = end - head * along
    return merge(tube(start, neck, radius, radius, 10), tube(neck, end, 2.6 * radius, 0.002, 14))

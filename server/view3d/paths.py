"""One viewer's drawing of the flown paths and the GNSS fixes, in a fixed set of named chunks."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from server.nav.types import Float, VehicleClass
from server.view3d import palette
from server.view3d.feed import Pose
from server.view3d.geometry import quat_from_x
from server.view3d.nodes import SITE
from server.view3d.trail import CHUNK, STEP_M, Track, Trail

if TYPE_CHECKING:
    from viser import SceneApi

Colours = NDArray[np.uint8]
FIX_SIZE_M: Final = 0.07
GAP_S: Final = 0.3
"""Longest time from a path's last point to the vehicle: a sample and a survey."""

NOTICEABLE_RGB: Final = 24


class PathColour(StrEnum):
    """What the colour of the main lane's path says."""

    LANE = "lane"
    SPEED = "speed"
    UNCERTAINTY = "uncertainty"


class Drawn:
    """Which chunks of one trail the viewer has; names `<name>/0` … are reused for ever, never invented."""

    def __init__(self, scene: SceneApi, name: str) -> None:
        self._scene = scene
        self._name = name
        self._count = 0
        self._revision = -1
        self._chunks: dict[int, Any] = {}

    def stale(self, trail: Trail) -> range:
        """Return the chunks that must be sent again, and remember the trail as drawn."""
        first = 0 if trail.revision != self._revision else max(self._count - 1, 0) // CHUNK
        unchanged = trail.revision == self._revision and trail.count == self._count
        self._count, self._revision = trail.count, trail.revision
        chunks = -(-trail.count // CHUNK)
        for beyond in [chunk for chunk in self._chunks if chunk >= chunks]:
            self._chunks.pop(beyond).remove()
        return range(0) if unchanged else range(first, chunks)

    def forget(self) -> None:
        """Have everything sent again at the next occasion."""
        self._revision = -1

    def remove(self) -> None:
        """Take every chunk out of the scene."""
        for handle in self._chunks.values():
            handle.remove()
        self._chunks.clear()
        self.forget()

    def lines(self, chunk: int, points_m: Float, colours: Colours, thickness_px: float) -> None:
        """Draw one chunk as a polyline; points shape (n, 3), NED, m, n ≥ 2; colours shape (n, 3), or (3,) for all."""
        points = np.stack([points_m[:-1], points_m[1:]], axis=1).astype(np.float32)
        if colours.ndim == 2:  # viser takes an sRGB colour for all, but linear ones per vertex
            linear = palette.linear_from_srgb(colours)
            colours = np.stack([linear[:-1], linear[1:]], axis=1)
        if chunk in self._chunks:
            self._chunks[chunk].points = points
            self._chunks[chunk].colors = colours
        else:
            self._chunks[chunk] = self._scene.add_line_segments(
                f"{self._name}/{chunk}", points, colours, thickness=thickness_px, thickness_units="screen"
            )

    def dots(self, chunk: int, points_m: Float, colours: Colours, size_m: float) -> None:
        """Draw one chunk as dots; points shape (n, 3), NED, m; colours shape (n, 3)."""
        self._chunks[chunk] = self._scene.add_point_cloud(
            f"{self._name}/{chunk}",
            points_m.astype(np.float32),
            colours,
            point_size=size_m,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
        )


class Tip:
    """The piece from the vehicle back to its path's last point, which is a sample or two old.

    Only its place and direction change from frame to frame. The browser takes those as they come; another length or
    colour makes it build the node anew, and at the frame rate that would starve the paths of theirs.
    """

    def __init__(self, scene: SceneApi) -> None:
        self._scene = scene
        self._handle: Any = None
        self._end_n_m: Float | None = None
        self._length_m = 0.0
        self._rgb: Colours = np.zeros(3, dtype=np.uint8)

    def end_at(self, newest: Float | None, rgb: Colours) -> None:
        """Take the path's newest point (a row of `Trail.points`), None when there is none, and its colour."""
        self._end_n_m = None if newest is None else newest[:3].copy()
        if newest is None:
            return
        gap_m = max(float(newest[3]) * GAP_S, 2.0 * STEP_M)
        length_m = 1.25 ** math.ceil(math.log(gap_m, 1.25)) if math.isfinite(gap_m) else self._length_m
        if length_m != self._length_m or np.abs(rgb.astype(int) - self._rgb).max() > NOTICEABLE_RGB:
            self._length_m, self._rgb = length_m, rgb
            self.remove()

    def reach(self, pose: Pose) -> None:
        """Start at the vehicle, towards the path's end and as far beyond as its fixed length goes."""
        shown = self._end_n_m is not None and pose.known and self._length_m > 0.0
        if self._handle is not None and self._handle.visible != shown:
            self._handle.visible = shown
        if not shown or self._end_n_m is None:
            return
        if self._handle is None:
            points = np.array([[[0.0, 0.0, 0.0], [self._length_m, 0.0, 0.0]]], dtype=np.float32)
            self._handle = self._scene.add_line_segments(
                f"{SITE}/tip", points, self._rgb, thickness=4.0, thickness_units="screen"
            )
        self._handle.position = pose.pos_n_m
        back_m = self._end_n_m - pose.pos_n_m
        if np.linalg.norm(back_m) > 0.01:
            self._handle.wxyz = quat_from_x(back_m)

    def remove(self) -> None:
        """Take it out of the scene until the next frame."""
        if self._handle is not None:
            self._handle.remove()
        self._handle = None


class Paths:
    """Every lane's path, the fixes with the newest accuracy, and the gap between path and vehicle."""

    def __init__(self, scene: SceneApi, theme: str) -> None:
        self._scene = scene
        self._lanes: dict[str, Drawn] = {}
        self._fixes = Drawn(scene, f"{SITE}/fixes")
        self._tip = Tip(scene)
        self._circle: Any = None
        self._main: str | None = None
        self.theme = theme
        self.colour = PathColour.SPEED
        self.kind = VehicleClass.UNKNOWN

    def update(self, track: Track, main: str | None) -> None:
        """Send what has grown since the last call; take away the paths of lanes that were switched off."""
        for gone in self._lanes.keys() - track.lanes.keys():
            self._lanes.pop(gone).remove()
        if main != self._main:
            for drawn in [drawn for lane, drawn in self._lanes.items() if lane in {main, self._main}]:
                drawn.remove()  # drawn anew below: viser cannot change one colour into one per point
            self._main = main
        for lane, trail in track.lanes.items():
            drawn = self._lanes.setdefault(lane, Drawn(self._scene, f"{SITE}/path-{lane}"))
            self._draw(drawn, trail, lane, is_main=lane == main)
        for chunk in self._fixes.stale(track.fixes):
            points = track.fixes.points[chunk * CHUNK : (chunk + 1) * CHUNK]
            colours = np.where(points[:, 3:4] > 0.5, palette.FIX_FUSED_RGB, palette.FIX_REFUSED_RGB).astype(np.uint8)
            self._fixes.dots(chunk, points[:, :3], colours, FIX_SIZE_M)
        trail_of_main = track.lanes.get(main or "")
        if main is None or trail_of_main is None or not trail_of_main.count:
            self._tip.end_at(None, np.zeros(3, dtype=np.uint8))
        else:
            newest = trail_of_main.points[-1:]
            self._tip.end_at(newest[0], self._colours(newest, main, is_main=True)[0])

    def _draw(self, drawn: Drawn, trail: Trail, lane: str, *, is_main: bool) -> None:
        for chunk in drawn.stale(trail):
            points = trail.points[chunk * CHUNK : (chunk + 1) * CHUNK + 1]
            if len(points) > 1:
                drawn.lines(chunk, points[:, :3], self._colours(points, lane, is_main=is_main), 4.0 if is_main else 2.5)

    def _colours(self, points: Float, lane: str, *, is_main: bool) -> Colours:
        if is_main and self.colour == PathColour.SPEED:
            return palette.scale_rgb(palette.speed_fraction(points[:, 3], self.kind))
        if is_main and self.colour == PathColour.UNCERTAINTY:
            return palette.scale_rgb(palette.sigma_fraction(points[:, 4]))
        rgb = np.array(palette.lane_rgb(lane, self.theme), dtype=np.uint8)
        return np.tile(rgb, (len(points), 1)) if is_main else rgb  # viser cannot change from one form to the other

    def recolour(self, colour: PathColour, theme: str) -> None:
        """Draw everything in other colours."""
        self.colour, self.theme = colour, theme
        for drawn in self._lanes.values():
            drawn.forget()

    def reach(self, pose: Pose) -> None:
        """Close the gap between the path's last point and the vehicle: once a frame."""
        self._tip.reach(pose)

    def accuracy(self, fix_n_m: tuple[float, float, float] | None, h_acc_m: float) -> None:
        """Draw the newest fix's reported horizontal accuracy (m) as a circle about it; None hides it."""
        if fix_n_m is None or not np.isfinite(h_acc_m):
            if self._circle is not None and self._circle.visible:
                self._circle.visible = False
            return
        if self._circle is None:
            angle = np.linspace(0.0, 2.0 * np.pi, 65)
            ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
            self._circle = self._scene.add_line_segments(
                f"{SITE}/accuracy",
                np.stack([ring[:-1], ring[1:]], axis=1),
                palette.ACCURACY_RGB,
                thickness=2.0,
                thickness_units="screen",
            )
        self._circle.visible = True
        self._circle.scale = (h_acc_m, h_acc_m, 1.0)
        self._circle.position = fix_n_m

    def clear(self) -> None:
        """Take every path out of the scene: another board, or another power-up."""
        for drawn in (*self._lanes.values(), self._fixes):
            drawn.remove()
        if self._circle is not None:
            self._circle.remove()
        self._tip.remove()
        self._lanes.clear()
        self._circle = self._main = None

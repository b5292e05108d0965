"""Attitude-only lanes: body axes in the lane's colour at the vehicle's place, so that their difference shows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from server.view3d import palette
from server.view3d.feed import Pose

if TYPE_CHECKING:
    from collections.abc import Mapping

    from viser import SceneApi

PARENT: Final = "/ned/here"
LENGTHS: Final = (1.35, 0.7, 0.7)
"""Forward, right, down, in vehicle spans: the nose reaches out of the vehicle's own axes."""


class Triads:
    """One viewer's axes of the lanes that know nothing but the attitude."""

    def __init__(self, scene: SceneApi, theme: str, span_m: float) -> None:
        self._scene = scene
        self._theme = theme
        self._span_m = span_m
        self._handles: dict[str, Any] = {}

    def turn(self, poses: Mapping[str, Pose]) -> None:
        """Show these lanes' attitudes and no others; one that is not known yet is hidden."""
        for gone in self._handles.keys() - poses.keys():
            self._handles.pop(gone).remove()
        for lane, pose in poses.items():
            handle = self._handles.get(lane) or self._add(lane)
            if handle.visible != pose.turned:
                handle.visible = pose.turned
            if pose.turned:
                handle.wxyz = pose.q_nb

    def _add(self, lane: str) -> Any:  # noqa: ANN401
        ends = np.diag(self._span_m * np.array(LENGTHS))
        points = np.stack([np.zeros((3, 3)), ends], axis=1).astype(np.float32)
        rgb = palette.lane_rgb(lane, self._theme)
        self._handles[lane] = self._scene.add_line_segments(
            f"{PARENT}/axes-{lane}", points, rgb, thickness=2.5, thickness_units="screen"
        )
        return self._handles[lane]

    def redraw(self, theme: str, span_m: float) -> None:
        """Have them drawn anew, in other colours or at another size, at the next turn."""
        self._theme, self._span_m = theme, span_m
        self.clear()

    def clear(self) -> None:
        """Take them out of the scene."""
        for handle in self._handles.values():
            handle.remove()
        self._handles.clear()

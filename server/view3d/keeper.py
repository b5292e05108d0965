"""Nodes of one viewer's scene by fixed names: sent again only when their content changed, names never invented."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from server.nav.types import Float
from server.view3d.nodes import PLAIN
from server.view3d.palette import Rgb
from server.view3d.shapes import Mesh

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from viser import SceneApi


class Keeper:
    """What hangs below one node. Adding a known name replaces it, so the browser never collects."""

    def __init__(self, scene: SceneApi, root: str) -> None:
        self._scene = scene
        self._root = root
        self._kept: dict[str, tuple[Hashable, Any]] = {}

    def frame(self, name: str) -> Any:  # noqa: ANN401
        """Return the frame of this name; made at the first call."""
        return self._keep(name, "frame", lambda path: self._scene.add_frame(path, show_axes=False))

    def mesh(self, name: str, mesh: Mesh, rgb: Rgb, opacity: float | None = None) -> Any:  # noqa: ANN401
        """Show a mesh."""
        key = (hash(mesh.vertices.tobytes()), mesh.faces.shape, rgb, opacity)
        look: dict[str, Any] = {"color": rgb, "opacity": opacity, "side": "double", **PLAIN}
        return self._keep(name, key, lambda path: self._scene.add_mesh_simple(path, mesh.vertices, mesh.faces, **look))

    def lines(self, name: str, starts: Float, ends: Float, rgb: Rgb, thickness_px: float) -> Any:  # noqa: ANN401
        """Show line segments from starts to ends, each shape (n, 3)."""
        points = np.stack([starts, ends], axis=1).astype(np.float32)
        look: dict[str, Any] = {"thickness": thickness_px, "thickness_units": "screen"}
        key = (hash(points.tobytes()), rgb)
        return self._keep(name, key, lambda path: self._scene.add_line_segments(path, points, rgb, **look))

    def dots(self, name: str, points: Float, rgb: NDArray[np.uint8], size: float) -> Any:  # noqa: ANN401
        """Show points, shape (n, 3), with colours, shape (n, 3); half precision is finer than a pixel here."""
        look: dict[str, Any] = {"point_size": size, "point_shape": "circle", "point_shading": "flat"}
        key = (hash(points.tobytes()), hash(rgb.tobytes()))
        return self._keep(
            name, key, lambda path: self._scene.add_point_cloud(path, points.astype(np.float32), rgb, **look)
        )

    def label(self, name: str, text: str, at: tuple[float, float, float], scale: float = 0.9) -> Any:  # noqa: ANN401
        """Show a label that faces the viewer."""
        look: dict[str, Any] = {"position": at, "anchor": "center-center", "font_screen_scale": scale}
        return self._keep(name, (text, at), lambda path: self._scene.add_label(path, text, **look))

    def drop(self, *names: str) -> None:
        """Take nodes away, with what hangs below them; names that are not there are ignored."""
        for name in names:
            for below in [kept for kept in self._kept if kept.startswith(f"{name}/")]:
                del self._kept[below]  # viser takes them away with their parent
            kept = self._kept.pop(name, None)
            if kept is not None:
                kept[1].remove()

    def _keep(self, name: str, key: Hashable, make: Callable[[str], Any]) -> Any:  # noqa: ANN401
        kept = self._kept.get(name)
        if kept is None or kept[0] != key:
            kept = self._kept[name] = (key, make(f"{self._root}/{name}"))
        return kept[1]

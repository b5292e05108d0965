"""Curves of lanes as panels: what they say, how they differ, how wrong they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from server.compare.figures import LaneData
from server.compare.plots import Band, Panel, Series
from server.compare.signals import roll_pitch_yaw, tilt_of
from server.nav.types import LANE_COLUMNS, Float, Int
from server.replay.score import Compared

DEG: Final = 180.0 / np.pi
TIME: Final = "time, s"
HOLE_S: Final = 1.0
_POS: Final = LANE_COLUMNS.index("pos_n_m")
_ALT: Final = LANE_COLUMNS.index("alt_m")
_VEL: Final = LANE_COLUMNS.index("vel_n_m_s")


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A stretch of time to draw.

    Attributes:
        t_origin_ns: where the time axis starts.
        window: board time, ns.
        points: of each curve.
        spans: stretches to shade, seconds on the time axis.
        wide: lanes drawn wide, below the others: the reference.
    """

    t_origin_ns: int
    window: tuple[int, int]
    points: int
    spans: Sequence[tuple[float, float]] = ()
    wide: frozenset[str] = frozenset()

    def curve(self, name: str, t_ns: Int, y: Float, *, angle: bool = False) -> Series:
        """Return one curve within the view: unknown rows left out, holes over a second stay, angles run on."""
        part = slice(*np.searchsorted(t_ns, self.window))
        t_s, y = (t_ns[part] - self.t_origin_ns) * 1e-9, y[part]
        known = np.isfinite(y)
        t_s, y = t_s[known], y[known]
        if angle:
            y = np.unwrap(y, period=360.0)
        at = np.flatnonzero(np.diff(t_s) > HOLE_S) + 1
        return Series(name=name, x=np.insert(t_s, at, t_s[at]), y=np.insert(y, at, np.nan), wide=name in self.wide)

    def panel(self, series: Sequence[Series], label: str, bands: Sequence[Band] = (), y_limit: float = 0.0) -> Panel:
        """Return a panel over time; what is wide lies below the others."""
        return Panel(
            series=sorted(series, key=lambda one: not one.wide),
            x_label=TIME,
            y_label=label,
            bands=bands,
            spans=self.spans,
            y_limit=y_limit,
            points=self.points,
        )


def attitude(lanes: Mapping[str, LaneData], view: View) -> list[Panel]:
    """Return roll, pitch and heading."""
    angles = {name: (lane.t_ns, roll_pitch_yaw(lane.data[:, :4]) * DEG) for name, lane in lanes.items()}
    labels = ("roll, °", "pitch, °", "heading, °")
    return [
        view.panel(_side_by_side([view.curve(name, t, a[:, k], angle=True) for name, (t, a) in angles.items()]), label)
        for k, label in enumerate(labels)
    ]


def _side_by_side(series: list[Series]) -> list[Series]:
    """Return curves of angles in degrees, each moved by whole turns to lie nearest to the first that has points."""
    base = next((one for one in series if len(one.x)), None)
    if base is None:
        return series
    x, y = base.x[~np.isnan(base.y)], base.y[~np.isnan(base.y)]
    turns = [np.nanmedian(np.interp(one.x, x, y) - one.y) / 360.0 if len(one.x) else 0.0 for one in series]
    return [replace(one, y=one.y + 360.0 * round(turn)) for one, turn in zip(series, turns, strict=True)]


def altitude(lanes: Mapping[str, LaneData], view: View) -> list[Panel]:
    """Return height and climb."""
    return [
        _overlay(lanes, view, "height, m", lambda data: data[:, _ALT]),
        _overlay(lanes, view, "climb, m/s", lambda data: -data[:, _VEL + 2]),
    ]


def velocity(lanes: Mapping[str, LaneData], view: View) -> list[Panel]:
    """Return velocity north and east."""
    return [
        _overlay(lanes, view, "velocity north, m/s", lambda data: data[:, _VEL]),
        _overlay(lanes, view, "velocity east, m/s", lambda data: data[:, _VEL + 1]),
    ]


def _overlay(lanes: Mapping[str, LaneData], view: View, label: str, value: Callable[[Float], Float]) -> Panel:
    return view.panel([view.curve(name, lane.t_ns, value(lane.data)) for name, lane in lanes.items()], label)


def track(lanes: Mapping[str, LaneData], view: View) -> Panel:
    """Return the ground track, north up."""
    series = []
    for name, lane in lanes.items():
        part = slice(*np.searchsorted(lane.t_ns, view.window))
        north_east = lane.data[part, _POS : _POS + 2]
        north_east = north_east[np.isfinite(north_east).all(axis=1)]
        wide = name in view.wide
        series.append(Series(name=name, x=north_east[:, 1], y=north_east[:, 0], wide=wide))
    series.sort(key=lambda one: not one.wide)
    return Panel(series=series, x_label="east, m", y_label="north, m", equal=True, points=2 * view.points)


_SIZES: Final[tuple[tuple[str, Callable[[Compared], Float]], ...]] = (
    ("tilt, °", lambda c: tilt_of(c.rotation_n_rad) * DEG),
    ("heading, °", lambda c: c.rotation_n_rad[:, 2] * DEG),
    ("horizontal, m", lambda c: np.hypot(c.position_m[:, 0], c.position_m[:, 1])),
    ("vertical, m", lambda c: c.position_m[:, 2]),
    ("horizontal, m/s", lambda c: np.hypot(c.velocity_n_m_s[:, 0], c.velocity_n_m_s[:, 1])),
    ("vertical, m/s", lambda c: -c.velocity_n_m_s[:, 2]),
)


def sizes(found: Mapping[str, Compared], view: View) -> list[Panel]:
    """Return tilt, heading, horizontal and vertical of differences or errors."""
    return [
        view.panel([view.curve(name, each.t_ns, value(each)) for name, each in found.items()], label)
        for label, value in _SIZES
    ]


def bounded(name: str, error: Compared, view: View) -> list[Panel]:
    """Return the nine components of a lane's error, each with ±3 of its own σ; those without σ are left out.

    An axis reaches as far as the error and the usual σ; a wider σ, as before alignment, runs out of it.
    """
    panels = []
    for label, value, sigma in _components(error):
        curve, band = view.curve(name, error.t_ns, value), _band(view, error.t_ns, 3.0 * sigma)
        if len(curve.x) and np.isfinite(band.high).any():
            limit = 1.2 * max(float(np.nanmax(np.abs(curve.y))), float(np.nanmedian(band.high)))
            panels.append(view.panel([curve], label, [band], limit))
    return panels


def _components(error: Compared) -> Iterator[tuple[str, Float, Float]]:
    for k, axis in enumerate(("about north", "about east", "about down")):
        yield f"{axis}, °", error.rotation_n_rad[:, k] * DEG, error.sigma[:, k] * DEG
    for k, axis in enumerate(("north", "east", "down")):
        yield f"{axis}, m/s", error.velocity_n_m_s[:, k], error.sigma[:, 3 + k]
    for k, axis in enumerate(("north", "east", "up")):
        yield f"{axis}, m", error.position_m[:, k], error.sigma[:, 6 + k]


def _band(view: View, t_ns: Int, bound: Float) -> Band:
    part = slice(*np.searchsorted(t_ns, view.window))
    return Band(
        x=np.asarray((t_ns[part] - view.t_origin_ns) * 1e-9, dtype=np.float64), low=-bound[part], high=bound[part]
    )

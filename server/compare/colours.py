"""Line colours of a report: each a CSS variable with a light and a dark value, the lanes' own as everywhere else."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Final

SERIES: Final = ("#268be6", "#e69f00", "#009e73", "#d55e00", "#9678d2", "#56b4e9", "#b5a92a", "#8c9aa8")
"""For curves that are not lanes, by place [Okabe and Ito 2008]; the same as the page's plots."""

DASHES: Final[tuple[tuple[float, ...], ...]] = ((), (6.0, 2.0), (2.0, 2.0), (8.0, 2.0, 2.0, 2.0))
"""On and off, points: tells apart lanes that share a colour; fixed for a lane, as its colour is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ink:
    """How one name is drawn, in every plot of a report.

    Attributes:
        slug: the name as CSS and HTML attributes take it.
        light, dark: colours in the two themes.
        dash: on and off in points, () = solid.
    """

    slug: str
    light: str
    dark: str
    dash: tuple[float, ...]


def slug_of(name: str) -> str:
    """Return a name as CSS takes it."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "series"


def inks(names: Iterable[str]) -> dict[str, Ink]:
    """Return one ink a name: a lane in its fixed colour and dash, anything else by place."""
    from server.nav.lanes.registry import RECORDED_LANES as LANES

    out: dict[str, Ink] = {}
    for place, name in enumerate(dict.fromkeys(names)):
        lane = name.partition(".")[0]  # a second power-up is "lane.boot1"
        if lane in LANES:
            light, dark = _of_lane(lane)
            alike = [other for other in LANES[: LANES.index(lane)] if _of_lane(other)[0] == light]
            dash = DASHES[len(alike) % len(DASHES)]
        else:
            light = dark = SERIES[place % len(SERIES)]
            dash = DASHES[place // len(SERIES) % len(DASHES)]
        out[name] = Ink(slug=slug_of(name), light=light, dark=dark, dash=dash)
    return out


@cache
def _of_lane(lane: str) -> tuple[str, str]:
    from server.view3d.palette import lane_rgb

    light, dark = ("#{:02x}{:02x}{:02x}".format(*lane_rgb(lane, theme)) for theme in ("light", "dark"))
    return light, dark

"""Panels of curves as SVG that takes its colours from the page it stands in.

Matplotlib draws in stand-in colours, one a curve; they become CSS variables, so that one drawing suits light and dark.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from server.compare.colours import Ink
from server.compare.decimate import kept
from server.nav.types import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS: Final = 1000
"""Points drawn of one curve: about one a pixel."""
WIDTH_PT: Final = 900.0
_TEXT, _GRID, _SHADE, _SPAN = "#010101", "#020202", "#030303", "#030304"
_CSS: Final = {_TEXT: "var(--text-2)", _GRID: "var(--line)", _SHADE: "var(--shade)", _SPAN: "var(--span)"}
_IDS: Final = re.compile(
    r' id="(?:figure|axes|patch|line2d|matplotlib|text|xtick|ytick|FillBetween|PolyCollection)[^"]*"'
)
_LONG: Final = re.compile(r"(?<=[ \d\"MLC-])(-?\d+\.\d)\d+")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """One curve; NaN is a hole. `name` gives its colour and its entry in the legend; `wide` suits what lies below."""

    name: str
    x: Float
    y: Float
    wide: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Band:
    """A shaded stretch between two curves: the bounds an error should keep."""

    x: Float
    low: Float
    high: Float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """One pair of axes.

    Attributes:
        x_label, y_label: with their units.
        spans: stretches of x to shade from top to bottom.
        y_limit: the axis reaches as far up and down, 0 = whatever the curves need.
        equal: a metre is as long in x as in y (ground tracks).
        step: draw bars' tops: a value holds until the next x.
        points: about how many points of each curve to draw.
    """

    series: Sequence[Series]
    x_label: str
    y_label: str
    title: str = ""
    bands: Sequence[Band] = ()
    spans: Sequence[tuple[float, float]] = ()
    y_limit: float = 0.0
    equal: bool = False
    step: bool = False
    points: int = POINTS


def svg(panels: Sequence[Panel], inks: Mapping[str, Ink], *, columns: int = 1, height_pt: float = 200.0) -> str:
    """Return the panels as one inline SVG without any address in it.

    Args:
        panels: in reading order.
        inks: how each series' name is drawn.
        columns: panels side by side.
        height_pt: of one row of panels.
    """
    from matplotlib import rc_context

    stand_ins = {name: f"#04{place // 256:02x}{place % 256:02x}" for place, name in enumerate(inks)}
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "navdeck", "font.family": "sans-serif", "font.size": 9.0}):
        figure = _figure(panels, inks, stand_ins, columns, height_pt)
        out = io.StringIO()
        figure.savefig(
            out, format="svg", transparent=True, metadata=dict.fromkeys(("Creator", "Date", "Format", "Type"))
        )
    return _themed(out.getvalue(), inks, stand_ins)


def _figure(
    panels: Sequence[Panel], inks: Mapping[str, Ink], colours: Mapping[str, str], columns: int, height_pt: float
) -> Figure:
    from matplotlib.figure import Figure

    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(WIDTH_PT / 72.0, rows * height_pt / 72.0), layout="constrained")
    for place, panel in enumerate(panels):
        axes = figure.add_subplot(rows, columns, place + 1)
        _draw(axes, panel, inks, colours)
    return figure


def _draw(axes: Axes, panel: Panel, inks: Mapping[str, Ink], colours: Mapping[str, str]) -> None:
    for begin, end in panel.spans:
        axes.axvspan(begin, end, color=_SPAN, linewidth=0.0)
    for band in panel.bands:
        rows = kept((band.low, band.high), panel.points)
        axes.fill_between(band.x[rows], band.low[rows], band.high[rows], color=_SHADE, linewidth=0.0)
    for one in panel.series:
        rows = kept((one.x, one.y) if panel.equal else (one.y,), panel.points)
        style = "steps-post" if panel.step else "default"
        (line,) = axes.plot(one.x[rows], one.y[rows], color=colours[one.name], drawstyle=style)
        line.set_linewidth(3.0 if one.wide else 1.2)
        line.set_dashes(inks[one.name].dash)
        line.set_gid(f"curve:{inks[one.name].slug}")
    _frame(axes, panel)


def _frame(axes: Axes, panel: Panel) -> None:
    axes.set_xlabel(panel.x_label, color=_TEXT)
    axes.set_ylabel(panel.y_label, color=_TEXT)
    if panel.title:
        axes.set_title(panel.title, color=_TEXT, fontsize=9.0, loc="left")
    axes.grid(visible=True, color=_GRID, linewidth=0.6)
    axes.tick_params(colors=_GRID, labelcolor=_TEXT)
    axes.ticklabel_format(useOffset=False, style="plain")
    for spine in axes.spines.values():
        spine.set_color(_GRID)
    axes.margins(x=0.01)
    if panel.y_limit > 0.0:
        axes.set_ylim(-panel.y_limit, panel.y_limit)
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")


def _themed(text: str, inks: Mapping[str, Ink], colours: Mapping[str, str]) -> str:
    """Return the drawing alone: stand-in colours made variables, ids that would repeat gone, decimals cut."""
    text = text[text.index("<svg") :]
    text = re.sub(r'<svg [^>]*viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1" role="img">', text, count=1)
    text = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>", "", text, count=1, flags=re.DOTALL)
    text = _IDS.sub("", text).replace("xlink:href", "href")
    text = re.sub(r' id="curve:([^"]*)"', r' class="curve" data-of="\1"', text)
    text = re.sub(r"font: ([\d.]+)px [^;\"]*", r"font-size: \1px", text)
    for name, colour in colours.items():
        text = text.replace(colour, f"var(--s-{inks[name].slug})")
    for colour, variable in _CSS.items():
        text = text.replace(colour, variable)
    return _LONG.sub(r"\1", text).replace(" \nL", "L")

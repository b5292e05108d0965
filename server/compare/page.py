"""`report.html` of a comparison."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final

from server.compare import curves
from server.compare.contract import CompareOut
from server.compare.curves import View
from server.compare.figures import OPEN_NS, LaneData
from server.compare.report import Report
from server.compare.run import SETTLED, WHOLE, Comparison
from server.compare.tables import Sheet, detail, main_window, parameters_sheet, sheets, window_text

POINTS_IN_ALL: Final = 220_000
"""Points drawn in a whole report: about 3.5 MB of them."""
FEWEST, MOST = 120, 900
_CURVES_A_LANE: Final = 32


def page(comparison: Comparison) -> str:
    """Return the report as one HTML file."""
    out = comparison.out
    report = Report(f"navdeck compare: {out.log.name}").text(*_words(out))
    shown = [main_window(out), *(name for name in out.windows if name not in {WHOLE, SETTLED})]
    for window in shown:
        report.heading(f"Figures {window_text(out, window)}")
        for sheet in sheets(out, window):
            _add(report, sheet)
    for name, view in _views(comparison):
        _plots(report, comparison, name, view)
    report.heading("Percentiles")
    for window in shown:
        for error in (True, False) if out.reference else (False,):
            _add(report, detail(out, window, error=error))
    report.heading("Parameters")
    _add(report, parameters_sheet(out))
    return report.html()


def _words(out: CompareOut) -> Iterator[str]:
    against = f"errors are against {out.reference}" if out.reference else "there is no reference"
    yield (
        f"{out.log.duration_s:.1f} s of {out.log.board or 'a board'}, {out.settings.nav_rate_hz:g} navigation steps a "
        f"second, every lane on the very same samples. Differences are to {out.chosen}; {against}. Nothing is fitted."
    )
    for start_s, stop_s in out.settings.gnss_outages_s:
        yield f"GNSS was withheld from every lane that computes, {start_s:g} to {stop_s:g} s (shaded)."
    if out.engine_ns_per_step is not None:
        yield (
            f"Cost is measured on this machine, apart from preprocessing ({out.engine_ns_per_step:,.0f} ns a step). "
            "Late: the shift at which a lane's motion most resembles the reference's. Noise: RMS second difference "
            "/ √6 in quiet seconds, which for white noise is its σ."
        )
    yield from out.notes


def _add(report: Report, sheet: Sheet) -> None:
    report.table(sheet.columns, sheet.rows, title=sheet.title)


def _views(comparison: Comparison) -> list[tuple[str, View]]:
    """Return what is drawn: everything, and each stretch that was asked for."""
    out, origin_ns = comparison.out, comparison.t_origin_ns
    names = [WHOLE, *(name for name in out.windows if name not in {WHOLE, SETTLED})]
    points = POINTS_IN_ALL // (len(names) * _CURVES_A_LANE * max(1, len(comparison.lanes)))
    points = max(FEWEST, min(MOST, points))
    wide = frozenset(name for name in comparison.lanes if name.partition(".")[0] == out.reference)
    views = []
    for name in names:
        window = out.windows[name]
        edges = [None if edge_s is None else origin_ns + round(edge_s * 1e9) for edge_s in (window.from_s, window.to_s)]
        span = (-OPEN_NS if edges[0] is None else edges[0], OPEN_NS if edges[1] is None else edges[1])
        spans = out.settings.gnss_outages_s
        views.append((name, View(t_origin_ns=origin_ns, window=span, points=points, spans=spans, wide=wide)))
    return views


def _plots(report: Report, comparison: Comparison, name: str, view: View) -> None:
    out, lanes = comparison.out, comparison.lanes
    where = window_text(out, name)
    report.heading(f"States {where}")
    report.panels(curves.attitude(lanes, view), title="Attitude")
    report.panels(curves.altitude(lanes, view), title="Height and climb")
    report.panels(curves.velocity(lanes, view), title="Horizontal velocity")
    report.panels([curves.track(lanes, view)], title="Ground track", height_pt=480.0)
    differences = {name: lane.difference for name, lane in lanes.items() if lane.difference is not None}
    report.heading(f"Differences to {out.chosen} {where}")
    report.panels(curves.sizes(differences, replace(view, wide=frozenset())), columns=2, height_pt=180.0)
    if out.reference:
        _error_plots(report, lanes, out.reference, view, where)


def _error_plots(report: Report, lanes: Mapping[str, LaneData], reference: str, view: View, where: str) -> None:
    found = {name: lane.error for name, lane in lanes.items() if lane.error is not None and lane.reference is not None}
    report.heading(f"Errors against {reference} {where}")
    report.panels(curves.sizes(found, view), columns=2, height_pt=180.0)
    for name, error in found.items():
        report.panels(
            curves.bounded(name, error, view), title=f"{name}: error, ± 3 σ shaded", columns=3, height_pt=150.0
        )

"""The tables of a comparison, the same on the terminal and in the report."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from server.compare.contract import CompareOut, DelayOut, DifferenceOut, FiguresOut, NoiseOut
from server.compare.run import SETTLED, WHOLE
from server.compare.table import UNKNOWN, Cell, Column
from server.replay.contract import ErrorsOut, SpreadOut

DEG: Final = math.degrees(1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """A table with its title, ready for any medium."""

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Cell]]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Size:
    """One quantity: where it stands in the figures, and how it is shown."""

    key: str
    name: str
    unit: str
    scale: float = 1.0
    digits: int = 2


DIFFERENCES: Final = (
    _Size(key="attitude_rad", name="attitude", unit="°", scale=DEG),
    _Size(key="heading_rad", name="heading", unit="°", scale=DEG),
    _Size(key="tilt_rad", name="tilt", unit="°", scale=DEG),
    _Size(key="horizontal_m", name="horizontal", unit="m"),
    _Size(key="vertical_m", name="vertical", unit="m"),
    _Size(key="horizontal_m_s", name="horizontal", unit="m/s", digits=3),
    _Size(key="vertical_m_s", name="vertical", unit="m/s", digits=3),
)
ERRORS: Final = (
    *DIFFERENCES[:2],
    _Size(key="horizontal_m", name="horizontal", unit="m"),
    _Size(key="vertical_m", name="vertical", unit="m"),
    _Size(key="vertical_less_median_m", name="less median", unit="m"),
    _Size(key="vel_n_m_s", name="north", unit="m/s", digits=3),
    _Size(key="vel_e_m_s", name="east", unit="m/s", digits=3),
    _Size(key="vel_d_m_s", name="down", unit="m/s", digits=3),
)
_TILT_ERROR: Final = _Size(key="tilt_error_rad", name="tilt", unit="°", scale=DEG)


def main_window(out: CompareOut) -> str:
    """Return the window that a reader wants first: without the settling, where the log is long enough for that."""
    settled = [lane.windows[SETTLED].rows for lane in out.lanes.values() if SETTLED in lane.windows]
    return SETTLED if any(settled) else WHOLE


def window_text(out: CompareOut, name: str) -> str:
    """Return a window in words."""
    if name == SETTLED:
        return "from 30 s after the first fix"
    return "over everything" if name == WHOLE else f"from {name.replace(':', ' to ')} s"


def sheets(out: CompareOut, window: str) -> list[Sheet]:
    """Return the tables of one window: errors, differences, and how each lane behaves."""
    rows = [(name, lane.windows[window]) for name, lane in out.lanes.items() if window in lane.windows]
    where = window_text(out, window)
    found = [_differences(out, rows, where), _behaviour(out, rows, where)]
    return [_errors(out, rows, where), *found] if out.reference else found


def _errors(out: CompareOut, rows: Sequence[tuple[str, FiguresOut]], where: str) -> Sheet:
    sizes = [*ERRORS[:2], _TILT_ERROR, *ERRORS[2:]]
    return Sheet(
        title=f"Error against {out.reference}, {where}: RMS (95th percentile)",
        columns=[Column(name="lane"), *(_heading(size) for size in sizes)],
        rows=[
            [name, *(_pair(_error(each, size), size) for size in sizes)]
            for name, each in rows
            if name.partition(".")[0] != out.reference
        ],
    )


def _error(each: FiguresOut, size: _Size) -> SpreadOut | None:
    return each.tilt_error_rad if size is _TILT_ERROR else _spread(each.error, size)


def _differences(out: CompareOut, rows: Sequence[tuple[str, FiguresOut]], where: str) -> Sheet:
    return Sheet(
        title=f"Difference to {out.chosen}, {where}: RMS (95th percentile)",
        columns=[Column(name="lane"), *(_heading(size) for size in DIFFERENCES)],
        rows=[
            [name, *(_pair(_spread(each.difference, size), size) for size in DIFFERENCES)]
            for name, each in rows
            if name.partition(".")[0] != out.chosen
        ],
    )


def _behaviour(out: CompareOut, rows: Sequence[tuple[str, FiguresOut]], where: str) -> Sheet:
    columns = [
        Column(name="lane"),
        Column(name="late, attitude", unit="ms", right=True, meaning="body rates against the reference's"),
        Column(name="vertical", unit="ms", right=True),
        Column(name="horizontal", unit="ms", right=True),
        Column(name="noise, tilt", unit="°", digits=4, meaning="RMS second difference / √6 while quiet"),
        Column(name="heading", unit="°", digits=4),
        Column(name="height", unit="m", digits=4),
        Column(name="climb", unit="m/s", digits=4),
        Column(name="cost", unit="ns/step", digits=0, meaning="of one navigation step on this machine"),
        Column(name="states"),
    ]
    return Sheet(
        title=f"Delay, noise, cost and states, {where}",
        columns=columns,
        rows=[[name, *_behaves(out, name, each)] for name, each in rows],
    )


def _behaves(out: CompareOut, name: str, each: FiguresOut) -> Iterable[Cell]:
    late = each.delay
    noise = each.noise or NoiseOut(
        tilt_rad=None, heading_rad=None, height_m=None, vertical_m_s=None, horizontal_m_s=None
    )
    cost = out.lanes[name].cost
    return (
        *(late_ms(one) for one in ((late.attitude, late.vertical, late.horizontal) if late else (None,) * 3)),
        scaled(noise.tilt_rad, DEG),
        scaled(noise.heading_rad, DEG),
        noise.height_m,
        noise.vertical_m_s,
        cost.ns_per_step if cost else None,
        ", ".join(f"{count:,} {word}" for word, count in each.status_rows.items() if count) or "none",
    )


def detail(out: CompareOut, window: str, *, error: bool) -> Sheet:
    """Return every percentile of every error, or of every difference."""
    sizes: Sequence[_Size] = (*ERRORS[:2], _TILT_ERROR, *ERRORS[2:]) if error else DIFFERENCES
    other = out.reference if error else out.chosen
    rows: list[list[Cell]] = []
    for name, lane in out.lanes.items():
        each = lane.windows.get(window)
        if each is None or name.partition(".")[0] == other:
            continue
        for size in sizes:
            spread = _error(each, size) if error else _spread(each.difference, size)
            if spread is not None:
                values = (spread.rms, spread.p50, spread.p95, spread.p99, spread.max)
                rows.append([name, f"{size.name}, {size.unit}", *(value * size.scale for value in values), spread.rows])
    heads = [Column(name=text, digits=size_digits) for text, size_digits in _SPREAD_COLUMNS]
    what = "Error against" if error else "Difference to"
    return Sheet(
        title=f"{what} {other}, {window_text(out, window)}",
        columns=[Column(name="lane"), Column(name="quantity"), *heads],
        rows=rows,
    )


_SPREAD_COLUMNS: Final = (("RMS", 4), ("50 %", 4), ("95 %", 4), ("99 %", 4), ("largest", 4), ("rows", 0))


def parameters_sheet(out: CompareOut) -> Sheet:
    """Return every lane's parameters as they were set."""
    rows: list[list[Cell]] = [
        [name, parameter, "the vehicle class's own" if value is None else f"{value:g}"]
        for name, lane in out.lanes.items()
        for parameter, value in lane.parameters.items()
    ]
    heads = [Column(name="lane"), Column(name="parameter"), Column(name="value")]
    return Sheet(title="Parameters", columns=heads, rows=rows)


def _heading(size: _Size) -> Column:
    return Column(name=size.name, unit=size.unit, digits=size.digits, right=True)


def _spread(part: DifferenceOut | ErrorsOut | None, size: _Size) -> SpreadOut | None:
    found: SpreadOut | None = getattr(part, size.key) if part is not None else None
    return found


def _pair(spread: SpreadOut | None, size: _Size) -> str:
    if spread is None:
        return UNKNOWN
    return f"{spread.rms * size.scale:,.{size.digits}f} ({spread.p95 * size.scale:,.{size.digits}f})"


def late_ms(delay: DelayOut | None) -> str:
    """Return a delay with its standard error, ms."""
    if delay is None:
        return UNKNOWN
    return f"{delay.delay_s * 1e3:z.1f} ± {delay.standard_error_s * 1e3:.1f}"


def scaled(value: float | None, scale: float) -> float | None:
    """Return the value in another unit; unknown stays unknown."""
    return value * scale if value is not None else None

"""A campaign's figures for people: a table on the terminal, and one HTML file with its curves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from server.compare.plots import Band, Panel, Series
from server.compare.report import Report
from server.compare.table import Cell, Column
from server.nav.types import Float

HEADINGS: Final = (
    Column(name="quantity"),
    Column(name="mean", digits=3, meaning="per component over all epochs; 1 = consistent"),
    Column(name="inside", unit="%", digits=1, meaning="epochs whose mean over the flights is inside its 95 % bound"),
    Column(name="above", unit="%", digits=1, meaning="the filter was over-confident"),
    Column(name="below", unit="%", digits=1, meaning="the filter was too modest"),
    Column(name="mean standing", digits=3),
    Column(name="mean flying", digits=3),
)
FLIGHT_KEYS: Final = (
    "wind_m_s",
    "aligned_s",
    "navigating_s",
    "attitude_rms_rad",
    "velocity_rms_m_s",
    "horizontal_rms_m",
    "horizontal_max_m",
    "vertical_rms_m",
)
UNITS: Final = {"rad": "rad", "m_s": "m/s", "m": "m"}


def rows(found: dict[str, Any]) -> list[tuple[Cell, ...]]:
    """Return the table's rows, one a quantity."""
    return [
        (name, one["average"], *(_percent(one[where]) for where in ("inside", "above", "below")),
         one["standing"]["average"], one["flying"]["average"])
        for name, one in _quantities(found)
    ]  # fmt: skip


def _quantities(found: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for name, one in found["nees"].items():
        yield f"NEES {name}", one
    for name, one in found["nees_diagonal"].items():
        yield f"NEES {name}, σ alone", one
    for name, one in found["nis"].items():
        yield f"NIS {name}" + ("" if one["demanded"] else " (assumed)"), one


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def text(found: dict[str, Any]) -> str:
    """Return the report for a terminal."""
    table = [[column.text(cell) for column, cell in zip(HEADINGS, row, strict=True)] for row in rows(found)]
    heads = [column.name + (f" {column.unit}" if column.unit else "") for column in HEADINGS]
    widths = [max(len(line[i]) for line in [heads, *table]) for i in range(len(heads))]
    lines = [_aligned(line, widths) for line in [heads, *table]]
    return "\n".join([headline(found), "", *lines, "", outcome(found)])


def _aligned(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = zip(cells, widths, strict=True)
    return "  ".join([first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)])


def headline(found: dict[str, Any]) -> str:
    """Return what was flown and told, in one sentence."""
    one = found["campaign"]
    receiver = "a carrier-phase receiver" if one["rtk"] else "an ordinary receiver"
    told = {"defaults": "the product's default parameters", "sheet": "the data sheets of the board's sensors"}
    return (
        f"{one['runs']} flights of {one['seconds']:g} s from seed {one['seed']} with {receiver}, wind up to "
        f"{one['wind_up_to_m_s']:g} m/s; the filter was told {told[one['told']]}."
    )


def outcome(found: dict[str, Any]) -> str:
    """Return the verdict, and what became of the flights."""
    flights, share = found["flights"], 100.0 * found["required_share"]
    lost = sum(flight["failed_epochs"] > 0 or flight["navigating_s"] is None for flight in flights)
    worst = max((flight["horizontal_max_m"] or 0.0 for flight in flights), default=0.0)
    verdict = (
        f"Consistent: every quantity has its mean inside the 95 % bound at {share:.0f} % of the epochs or more."
        if found["passed"]
        else f"Not consistent: inside the bound at under {share:.0f} % of the epochs: {', '.join(found['failing'])}."
    )
    return f"{verdict}\n{lost} of {len(flights)} flights lost; largest horizontal error {worst:.2f} m."


def html(found: dict[str, Any]) -> str:
    """Return the self-contained report."""
    report = Report("Monte Carlo on the demo board").text(headline(found), outcome(found))
    report.heading("Summary").table(HEADINGS, rows(found))
    t_s = np.array(found["epochs_s"])
    for title, key in (("NEES", "nees"), ("NEES from the published σ alone", "nees_diagonal"), ("NIS", "nis")):
        if found[key]:
            panels = [_bounded(name, one, t_s) for name, one in found[key].items()]
            report.heading(title).text("Mean over the flights, per component; shaded: its 95 % bound.")
            report.panels(panels, columns=2)
    report.heading("Errors and σ").panels(
        [_errors(name, one, t_s) for name, one in found["components"].items()], columns=3
    )
    report.heading("Flights").table(*_flights(found))
    return report.html()


def _array(values: list[float | None]) -> Float:
    return np.array([np.nan if value is None else value for value in values])


def _bounded(name: str, one: dict[str, Any], t_s: Float) -> Panel:
    band = Band(x=t_s, low=_array(one["low"]), high=_array(one["high"]))
    series = [Series(name="mean over the flights", x=t_s, y=_array(one["mean"]))]
    return Panel(series=series, x_label="time, s", y_label=name, title=name, bands=[band])


def _errors(name: str, one: dict[str, Any], t_s: Float) -> Panel:
    quantity, unit = next((name.removesuffix(f"_{key}"), UNITS[key]) for key in UNITS if name.endswith(f"_{key}"))
    series = [
        Series(name="RMS error", x=t_s, y=_array(one["rms_error"])),
        Series(name="RMS σ", x=t_s, y=_array(one["rms_sigma"])),
    ]
    return Panel(series=series, x_label="time, s", y_label=f"{quantity}, {unit}", title=quantity)


def _flights(found: dict[str, Any]) -> tuple[list[Column], list[tuple[Cell, ...]]]:
    columns = [
        Column(name="seed", digits=0),
        Column(name="wind", unit="m/s"),
        Column(name="aligned", unit="s", digits=1),
        Column(name="navigating", unit="s", digits=1),
        Column(name="attitude", unit="rad RMS", digits=4),
        Column(name="velocity", unit="m/s RMS", digits=3),
        Column(name="horizontal", unit="m RMS", digits=3),
        Column(name="horizontal", unit="m max", digits=3),
        Column(name="vertical", unit="m RMS", digits=3),
        Column(name="events"),
    ]
    return columns, [
        (
            str(flight["seed"]),
            *(flight[key] for key in FLIGHT_KEYS),
            ", ".join(f"{count} × {code}" for code, count in flight["events"].items()),
        )
        for flight in found["flights"]
    ]

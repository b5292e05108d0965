"""`navdeck compare`: options as text in; a table out, and with --out a folder with compare.json and report.html."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypedDict

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from server.compare.contract import COMPARE_FORMAT, FIVE_MOTIONS_FORMAT, CompareOut
from server.compare.motion_tables import motion_page, motion_sheets
from server.compare.motions import five_motions
from server.compare.options import DEFAULT_CHOSEN, Options, options_from_text
from server.compare.output import check_folder, write_folder
from server.compare.page import page
from server.compare.run import SETTLED, WHOLE, compare_log
from server.compare.table import terminal
from server.compare.tables import Sheet, main_window, sheets
from server.replay.errors import ReplayError
from server.replay.options import lanes_from_text, values_from_texts

COMPARE: Final = "compare.json"
FIVE_MOTIONS: Final = "five_motions.json"
REPORT: Final = "report.html"
NARROWEST: Final = 100
"""Columns of text in a narrow terminal; cells then fold."""
NO_TERMINAL: Final = 180


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """The command line's words as they were given; None and empty = not given."""

    log: Path | None
    five_motions: bool
    lanes: str
    chosen: str
    reference: str | None
    parameters: Sequence[str]
    gnss_outages: Sequence[str]
    windows: Sequence[str]
    nav_rate_hz: float | None
    seed: int | None
    out: Path | None
    overwrite: bool
    as_json: bool


def run(told: Told) -> str:
    """Do what was asked; return what to show.

    Raises:
        ReplayError: with the message to show; nothing was written.
    """
    place: _Place = {"out": told.out, "overwrite": told.overwrite, "as_json": told.as_json}
    if told.five_motions:
        _refuse_log_options(told)
        seed = 1 if told.seed is None else told.seed
        return five_motions_command(lanes=told.lanes, parameters=told.parameters, seed=seed, **place)
    if told.log is None:
        raise ReplayError("there is nothing to compare. Give a LOG (a .tlog or a sensor folder), or --five-motions.")
    if told.seed is not None:
        raise ReplayError("--seed is for --five-motions: a log has its own noise. Leave it out.")
    options = options_from_text(
        lanes=told.lanes,
        chosen=told.chosen,
        reference=told.reference,
        parameters=told.parameters,
        gnss_outages=told.gnss_outages,
        windows=told.windows,
        nav_rate_hz=told.nav_rate_hz,
    )
    return compare_command(told.log, options, **place)


class _Place(TypedDict):
    out: Path | None
    overwrite: bool
    as_json: bool


def _refuse_log_options(told: Told) -> None:
    """Raise for what only means something with a log."""
    given = {
        f"LOG ({told.log})": told.log is not None,
        "--reference": told.reference is not None,
        "--gnss-outage": bool(told.gnss_outages),
        "--window": bool(told.windows),
        "--nav-rate-hz": told.nav_rate_hz is not None,
        "--to": told.chosen != DEFAULT_CHOSEN,
    }
    names = [name for name, there in given.items() if there]
    if names:
        raise ReplayError(
            f"--five-motions has samples, truth and settings of its own and takes no {', '.join(names)}. Leave one out."
        )


def compare_command(
    log: Path, options: Options, *, out: Path | None = None, overwrite: bool = False, as_json: bool = False
) -> str:
    """Compare the lanes over a log; return what to show.

    Args:
        log: a .tlog or a sensor folder.
        options: checked.
        out: folder for compare.json and report.html; None = neither.
        overwrite: write into a folder that holds other files.
        as_json: return compare.json's text instead of the tables.

    Raises:
        ReplayError: with the message to show; nothing was written.
    """
    if out is not None:
        check_folder(out, COMPARE, COMPARE_FORMAT.partition("/")[0], overwrite=overwrite)
    with progress_bar(log.name) as progress:
        found = compare_log(log, options, progress=progress)
    text = found.out.model_dump_json(indent=2)
    if out is not None:
        write_folder(out, {REPORT: page(found).encode(), COMPARE: text.encode() + b"\n"})
    if as_json:
        return text
    return shown(_heading(found.out), _sheets(found.out), [*found.out.notes, *([f"written to {out}"] if out else [])])


def five_motions_command(
    *,
    lanes: str = "all",
    parameters: Sequence[str] = (),
    seed: int = 1,
    out: Path | None = None,
    overwrite: bool = False,
    as_json: bool = False,
) -> str:
    """Compare the lanes over the five motions; return what to show.

    Args:
        lanes: "a,b" or "all".
        parameters: "LANE.PARAMETER=VALUE" each.
        seed: of the motions' noise.
        out: folder for five_motions.json and report.html; None = neither.
        overwrite: write into a folder that holds other files.
        as_json: return five_motions.json's text instead of the tables.

    Raises:
        ReplayError: with the message to show; nothing was written.
    """
    if out is not None:
        check_folder(out, FIVE_MOTIONS, FIVE_MOTIONS_FORMAT.partition("/")[0], overwrite=overwrite)
    names, values = lanes_from_text(lanes), values_from_texts(parameters)
    with progress_bar("five motions") as progress:
        found = five_motions(names, seed=seed, parameters=values, progress=progress)
    text = found.out.model_dump_json(indent=2)
    if out is not None:
        write_folder(out, {REPORT: motion_page(found).encode(), FIVE_MOTIONS: text.encode() + b"\n"})
    if as_json:
        return text
    notes = [*found.out.notes, *([f"written to {out}"] if out else [])]
    return shown(f"Five motions, seed {seed}", motion_sheets(found.out), notes)


def _heading(out: CompareOut) -> str:
    against = f"errors against {out.reference}" if out.reference else "no reference"
    return f"{out.log.name}: {out.log.duration_s:.1f} s, differences to {out.chosen}, {against}"


def _sheets(out: CompareOut) -> list[Sheet]:
    windows = [main_window(out), *(name for name in out.windows if name not in {WHOLE, SETTLED})]
    return [sheet for window in windows for sheet in sheets(out, window)]


def shown(heading: str, tables: list[Sheet], notes: list[str]) -> str:
    """Return tables as text for a terminal of this width."""
    console = Console()
    width = max(NARROWEST, console.width) if console.is_terminal else NO_TERMINAL
    console = Console(width=width, highlight=False, force_terminal=console.is_terminal)
    with console.capture() as caught:
        console.print(heading, markup=False)
        for sheet in tables:
            console.print()
            console.print(terminal(sheet.title, sheet.columns, sheet.rows))
        for note in notes:
            console.print(note, markup=False)
    return "\n".join(line.rstrip() for line in caught.get().splitlines())


@contextmanager
def progress_bar(name: str) -> Iterator[Callable[[float], None] | None]:
    """Give what to tell the progress; nothing is drawn unless standard error is a terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(name, total=1.0)
        yield lambda share: bar.update(task, completed=share)

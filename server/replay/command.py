"""`navdeck replay`: options as text in, a report as text out, a progress bar between them on a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from server.replay.contract import ErrorsOut, LaneOut, OutageOut, SpreadOut, SummaryOut
from server.replay.contract_preprocessing import LearnedOut
from server.replay.options import (
    chain_from_texts,
    lanes_from_text,
    learning_from_text,
    outage_from_text,
    values_from_texts,
)
from server.replay.run import replay

_HARMLESS: Final = ("frames_lost_of_others", "filtered_frames", "unknown_messages")
"""Counted in the summary, but nothing of the board's own data is missing for them."""

_NOT_OURS: Final = ("reference", "onboard")


def replay_command(
    log: Path,
    out: Path,
    *,
    lanes: str = "all",
    gnss_outage: Sequence[str] = (),
    nav_rate_hz: float | None = None,
    lane_values: Sequence[str] = (),
    preprocess: Sequence[str] = (),
    calibrations: Sequence[Path] = (),
    mag_learning: str | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> str:
    """Replay a log and return the report to show, "" when quiet.

    Args:
        log: a .tlog or a sensor folder.
        out: directory for the CSV files and summary.json.
        lanes: "a,b" or "all".
        gnss_outage: "A:B" each, seconds after the earliest t_ns of any file.
        nav_rate_hz: navigation steps a second; None = the default.
        lane_values: "LANE.PARAMETER=VALUE" each.
        preprocess: "SENSOR.PARAMETER=VALUE" each.
        calibrations: files in force from the first sample on, the later one of a sensor winning.
        mag_learning: "run", "apply" or None.
        overwrite: write into a directory that holds other files.
        quiet: no progress bar, no report.

    Raises:
        ReplayError: with the message to show; nothing was written.
    """
    chosen = lanes_from_text(lanes)
    outages = [outage_from_text(text) for text in gnss_outage]
    values, chain = values_from_texts(lane_values), chain_from_texts(preprocess)
    mode = learning_from_text(mag_learning) if mag_learning is not None else None
    with _bar(log.name, quiet=quiet) as progress:
        summary = replay(
            log,
            out,
            lanes=chosen,
            gnss_outages=outages,
            nav_rate_hz=nav_rate_hz,
            lane_parameters=values,
            chain=chain,
            calibrations=calibrations,
            mag_learning=mode,
            overwrite=overwrite,
            progress=progress,
        )
    return "" if quiet else report(summary, out)


@contextmanager
def _bar(name: str, *, quiet: bool) -> Iterator[Callable[[float], None] | None]:
    """Give what to tell the progress; nothing is drawn unless standard error is a terminal."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(name, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def report(summary: SummaryOut, out: Path) -> str:
    """Return what a person wants to know first, in a few lines."""
    timing = summary.timing
    factor = "" if timing.real_time_factor is None else f", {timing.real_time_factor:,.0f} × real time"
    lines = [
        f"{summary.log.name}: {summary.log.duration_s:.1f} s, {sum(summary.samples.values()):,} samples; engine "
        f"{timing.engine_s:.2f} s{factor} (reading {timing.read_s:.2f} s, writing {timing.write_s:.2f} s)",
    ]
    lines += [
        f"  lost: {reason} {count}" for reason, count in summary.losses.items() if count and reason not in _HARMLESS
    ]
    for name, lane in summary.lanes.items():
        lines += _lane_lines(name, lane)
    lines += [
        f"  stages of {each.sensor}: {each.rows:,} rows, its filters delay {1e3 * each.delay_s:.1f} ms"
        for each in summary.stages.values()
    ]
    if summary.mag_learning is not None and summary.mag_learning.state is not None:
        lines.append(_learned_line(summary.mag_learning.state))
    lines += [f"  {note}" for note in summary.notes]
    return "\n".join([*lines, f"written to {out}"])


def _lane_lines(name: str, lane: LaneOut) -> list[str]:
    states = ", ".join(f"{count:,} {word}" for word, count in lane.status_rows.items() if count)
    lines = [f"  {name}: {lane.rows:,} rows ({states or 'none'})"]
    part, where = (lane.settled, "from 30 s after the first fix") if lane.settled else (lane.whole, "over everything")
    source = name.partition(".")[0]
    if part is not None and source != "reference":
        lines.append(f"    RMS {where}: {_errors_text(part)}")
    if source not in _NOT_OURS:  # what is withheld here was not withheld from these
        lines += [_outage_line(stretch) for stretch in lane.outages if stretch.end_horizontal_m is not None]
    return lines


def _learned_line(state: LearnedOut) -> str:
    pairs = zip(state.offset_gauss, state.sigma_gauss, strict=True)
    found = ", ".join(f"{1e3 * offset:.1f} ± {1e3 * sigma:.1f}" for offset, sigma in pairs)
    return f"  magnetic offset learned: {found} mG ({'converged' if state.converged else 'not converged'})"


def _outage_line(stretch: OutageOut) -> str:
    return (
        f"    GNSS withheld {stretch.from_s:g}:{stretch.to_s:g} s: horizontal error at most "
        f"{stretch.peak_horizontal_m:.2f} m, {stretch.end_horizontal_m:.2f} m at the end"
    )


def _errors_text(part: ErrorsOut) -> str:
    """Return the RMS errors that are known, and how honest σ is."""
    texts = [
        _rms("attitude", part.attitude_rad, "°", math.degrees(1.0)),
        _rms("heading", part.heading_rad, "°", math.degrees(1.0)),
        _rms("horizontal", part.horizontal_m, "m"),
        _rms("vertical", part.vertical_m, "m"),
        _rms("vertical less median", part.vertical_less_median_m, "m"),
        _rms("velocity n", part.vel_n_m_s, "m/s"),
        _rms("e", part.vel_e_m_s, "m/s"),
        _rms("d", part.vel_d_m_s, "m/s"),
    ]
    if part.cover_3sigma.horizontal is not None:
        texts.append(f"{part.cover_3sigma.horizontal:.1%} within 3σ")
    if part.sigma_ratio_horizontal is not None:
        texts.append(f"σ/RMS {part.sigma_ratio_horizontal:.2f}")
    return ", ".join(text for text in texts if text)


def _rms(name: str, spread: SpreadOut | None, unit: str, scale: float = 1.0) -> str:
    if spread is None:
        return ""
    space = "" if unit == "°" else " "
    return f"{name} {spread.rms * scale:.3f}{space}{unit}"

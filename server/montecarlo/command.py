"""`navdeck montecarlo`: options in, report out, progress on standard error."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any, Final

import orjson

from server.montecarlo.campaign import EPOCH_S, Campaign
from server.montecarlo.report import html, text
from server.montecarlo.results import results
from server.montecarlo.run import run_campaign, workers

JSON_NAME: Final = "montecarlo.json"
HTML_NAME: Final = "montecarlo.html"
MOST_RUNS: Final = 10_000
MOST_SECONDS: Final = 7200.0
LEAST_SECONDS: Final = 10.0


class CampaignError(Exception):
    """An option that cannot be flown; the message names the remedy."""


def checked(*, runs: int, seconds: float, seed: int, told: str, rtk: bool) -> Campaign:
    """Return the campaign asked for.

    Raises:
        CampaignError: a value outside what is allowed.
    """
    if not 2 <= runs <= MOST_RUNS:
        raise CampaignError(f"--runs is {runs}; a mean over flights needs 2 to {MOST_RUNS}")
    if not LEAST_SECONDS <= seconds <= MOST_SECONDS:
        raise CampaignError(f"--seconds is {seconds:g}; allowed are {LEAST_SECONDS:g} to {MOST_SECONDS:g}")
    if seed < 0:
        raise CampaignError(f"--seed is {seed}; it must not be negative")
    if told not in {"defaults", "sheet"}:
        raise CampaignError(f"--told is {told!r}; write defaults or sheet")
    return Campaign(runs=runs, seconds=seconds, seed=seed, told=told, rtk=rtk)  # type: ignore[arg-type]


def montecarlo(campaign: Campaign, *, out: Path | None, quiet: bool = False) -> dict[str, Any]:
    """Fly a campaign and return its figures; with `out`, write them there as JSON and HTML.

    Args:
        campaign: what to fly.
        out: folder, made when it is not there; files of an earlier campaign in it are replaced.
        quiet: no progress.

    Raises:
        CampaignError: the folder cannot be written.
    """
    if out is not None:
        _make(out)
    begun = time.perf_counter()
    flights = run_campaign(campaign, progress=None if quiet else _Progress(campaign.runs).show)
    found = results(campaign, flights)
    took_s = time.perf_counter() - begun
    flown_s = campaign.runs * len(campaign.epochs_s) * EPOCH_S
    found["timing"] = {"total_s": took_s, "processes": workers(), "real_time_factor": flown_s / took_s}
    if out is not None:
        _write(out, found)
    return found


class _Progress:
    """One line on standard error: rewritten on a terminal, else a line every tenth of the flights."""

    def __init__(self, runs: int) -> None:
        self._runs = runs
        self._every = 1 if sys.stderr.isatty() else max(1, runs // 10)

    def show(self, done: int) -> None:
        """Say how many flights are done."""
        if done % self._every == 0 or done == self._runs:
            end = "\r" if sys.stderr.isatty() and done < self._runs else "\n"
            sys.stderr.write(f"flight {done} of {self._runs}{end}")
            sys.stderr.flush()


def _make(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CampaignError(f"cannot write to {out}: {error.strerror or error}; choose another --out") from error


def _write(out: Path, found: dict[str, Any]) -> None:
    files = {JSON_NAME: as_json(found), HTML_NAME: html(found).encode()}
    try:
        for name, data in files.items():
            (out / name).write_bytes(data)
    except OSError as error:
        raise CampaignError(f"cannot write to {out}: {error.strerror or error}; choose another --out") from error


def as_json(found: dict[str, Any]) -> bytes:
    """Return the figures as they are written."""
    return orjson.dumps(found, option=orjson.OPT_INDENT_2) + b"\n"


def report(found: dict[str, Any], out: Path | None) -> str:
    """Return what a person wants to know first."""
    timing = found["timing"]
    took = (
        f"{timing['total_s']:.1f} s on {timing['processes']} processes, {timing['real_time_factor']:,.0f} × real time"
    )
    where = "" if out is None else f"; written to {out / JSON_NAME} and {HTML_NAME}"
    return f"{text(found)}\n{took}{where}"

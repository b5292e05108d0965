"""Fly a campaign on at most two processes; the result does not depend on how many."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from typing import Final

from server.montecarlo.campaign import Campaign
from server.montecarlo.flight import Flight, fly

MOST_WORKERS: Final = 2
THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def workers() -> int:
    """Return how many processes a campaign uses on this machine."""
    return min(MOST_WORKERS, os.cpu_count() or 1)


def run_campaign(
    campaign: Campaign, *, processes: int | None = None, progress: Callable[[int], None] | None = None
) -> list[Flight]:
    """Return every flight, in the order of their numbers.

    Args:
        campaign: what to fly.
        processes: 1 = in this one; None = `workers()`.
        progress: told the number of flights done after each.
    """
    flights = []
    chosen = min(processes or workers(), campaign.runs)
    for flight in _alone(campaign) if chosen == 1 else _pooled(campaign, chosen):
        flights.append(flight)
        if progress is not None:
            progress(len(flights))
    return flights


def _alone(campaign: Campaign) -> Iterator[Flight]:
    return (fly(campaign, run) for run in range(campaign.runs))


def _pooled(campaign: Campaign, processes: int) -> Iterator[Flight]:
    """Fly on fresh processes, each of one thread: the flights are what runs side by side."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(processes, mp_context=context) as pool:
            yield from pool.map(fly, [campaign] * campaign.runs, range(campaign.runs))
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value

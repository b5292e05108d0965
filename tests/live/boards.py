"""A recorded board on a real pseudo-terminal, a real board task that reads it, and what `replay` makes of its log."""

from __future__ import annotations

import asyncio
import contextlib
import csv
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from server.board import Board
from server.commands import AddBoard
from server.emulate import Emulator
from server.hub import Subscription
from server.link import LinkState, open_link
from server.link.find import Finder
from server.nav.types import CSV_LANE_COLUMNS, EngineSettings, LaneStatus, StepResult
from server.parts import RealFactories
from server.replay.contract import SummaryOut
from server.replay.run import replay

LANES = ("ins_ekf", "onboard", "reference")
ALL = 1_000_000  # results a test keeps
PATIENCE_S = 60.0
WORDS = {status.name.lower(): float(status) for status in LaneStatus}


class LiveBoard:
    """A running board with every result it published."""

    def __init__(self, link: Path, finder: Finder) -> None:
        url = f"serial://{link}?baud=921600"
        parts = RealFactories(EngineSettings(lanes=LANES), talk=True).parts(AddBoard(url=url), lambda _: None)
        self.board = Board("board", url, LANES, replace(parts, link=lambda: open_link(url, finder=finder)))
        self._subscription: Subscription[StepResult] = self.board.hub.results.subscribe(ALL)
        self._results: list[StepResult] = []

    @property
    def results(self) -> list[StepResult]:
        assert self._subscription.lost == 0
        self._results += self._subscription.drain()
        return self._results

    def rows(self, lane: str, since: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """The rows of a lane from the `since`-th result on."""
        found = [rows for result in self.results[since:] for rows in result.lanes if rows.lane == lane]
        return np.concatenate([rows.t_ns for rows in found]), np.concatenate([rows.data for rows in found])

    async def until(self, what: str, holds: Callable[[], bool]) -> None:
        try:
            async with asyncio.timeout(PATIENCE_S):
                while not holds():  # noqa: ASYNC110 - what is waited for has no event
                    await asyncio.sleep(0.005)
        except TimeoutError:
            view = self.board.view()
            raise AssertionError(f"never {what}: {view.state} {view.cause}, link {view.link.state}") from None

    async def until_open(self) -> None:
        await self.until("open", lambda: self.board.view().link.state is LinkState.OPEN)

    async def until_bytes(self, count: int) -> None:
        await self.until(f"{count} bytes", lambda: self.board.view().stats.bytes_in >= count)


@contextlib.asynccontextmanager
async def live_board(link: Path, finder: Finder) -> AsyncIterator[LiveBoard]:
    """Run a board for as long as the block runs."""
    live = LiveBoard(link, finder)
    task = asyncio.create_task(live.board.run())
    try:
        yield live
    finally:
        task.cancel()
        await asyncio.wait({task})


class Plugged:
    """An emulated board that speaks in a thread until it is unplugged."""

    def __init__(self, log: Path, link: Path, speed: float) -> None:
        self.emulator = Emulator(log, speed=speed, link=link)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self.emulator.run, args=(self._stop,))
        self._thread.start()

    def unplug(self) -> None:
        """Go away, in the middle of a frame if need be; what was not read yet is lost."""
        self._stop.set()
        self._thread.join()
        self.emulator.close()


@contextlib.contextmanager
def plugged(log: Path, link: Path, speed: float) -> Iterator[Plugged]:
    board = Plugged(log, link, speed)
    try:
        yield board
    finally:
        board.unplug()


def replayed(log: Path, out: Path, lane: str = "ins_ekf") -> tuple[np.ndarray, np.ndarray, SummaryOut]:
    """What `navdeck replay` writes: stamps, the contract's columns (unknown = NaN), and the summary."""
    summary = replay(log, out)
    with (out / f"{lane}.csv").open(newline="") as file:
        _, *lines = csv.reader(file)
    t_ns = np.array([int(line[0]) for line in lines])
    numbers = [[float(cell) if cell else np.nan for cell in line[1:-1]] + [WORDS[line[-1]]] for line in lines]
    return t_ns, np.array(numbers).reshape(-1, CSV_LANE_COLUMNS), summary

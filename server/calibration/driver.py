"""One task per board while it has jobs: reads the hub, feeds the collectors, fits in threads."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from server.calibration.feeding import runs
from server.calibration.job import Job, JobState
from server.nav.calibration.applied import in_words_of
from server.nav.calibration.codes import failure
from server.nav.calibration.types import Check, Collector, Fit, Sensor

if TYPE_CHECKING:
    from server.board import Board
    from server.calibration.samples import SampleFile
    from server.hub import Subscription
    from server.nav.types import StepResult

log = logging.getLogger("navdeck.calibration")
PERIOD_S: Final = 0.1
QUEUED_RESULTS: Final = 4096  # some ten seconds of a fast board; then the oldest are lost, and counted on the job
JUDGE_EVERY: Final = 5


class Driver:
    """Feeds the active jobs of one board until none is left."""

    def __init__(
        self,
        board: Board,
        jobs: Callable[[], list[Job]],
        sample_file: Callable[[Job], SampleFile | None],
        spawn: Callable[[Job, bool], None],
    ) -> None:
        self._board = board
        self._jobs = jobs
        self._sample_file = sample_file
        self._spawn = spawn
        self._files: dict[str, SampleFile | None] = {}
        self._lost = 0
        self._beats = 0

    async def run(self) -> None:
        """Feed until no job is active."""
        subscription = self._board.hub.results.subscribe(QUEUED_RESULTS)
        try:
            while active := [job for job in self._jobs() if job.is_active]:
                await asyncio.sleep(PERIOD_S)
                self._beat(active, subscription)
                await self._keep()
        finally:
            subscription.close()
            await asyncio.to_thread(self._close)

    def _beat(self, active: list[Job], subscription: Subscription[StepResult]) -> None:
        now_s, self._beats = time.monotonic(), self._beats + 1
        results, mag_scale = subscription.drain(), self._board.mag_scale
        for result in results:
            self._feed(active, result, mag_scale, now_s)
        lost, self._lost = subscription.lost - self._lost, subscription.lost
        for job in active:
            job.lost_results += lost
            job.look(now_s)
            if job.wants_fit:
                self._spawn(job, False)
            if job.state is JobState.VERIFYING and self._beats % JUDGE_EVERY == 0 and job.judge():
                job.end_verification(now_s)

    def _feed(self, active: list[Job], result: StepResult, mag_scale: float, now_s: float) -> None:
        for kind, t_ns, rows in runs(result.block, mag_scale, self._board.converted):
            for job in active:
                if job.state is JobState.FITTING:
                    continue
                job.feed(kind, t_ns, rows, now_s)
                if job.state is JobState.COLLECTING and job.id not in self._files:
                    self._files[job.id] = self._sample_file(job)
                file = self._files.get(job.id)
                if file is not None and job.state is JobState.COLLECTING:
                    file.add(kind, t_ns, rows)

    async def _keep(self) -> None:
        """Write what is pending of the raw samples, in a thread."""
        if self._beats % 10 == 0 and self._files:
            await asyncio.to_thread(lambda: [file.flush() for file in self._files.values() if file is not None])

    def _close(self) -> None:
        for job_id, file in self._files.items():
            stopped = file.close().stopped if file is not None else ""
            if stopped not in {"", "closed"}:
                log.warning("raw samples of %s: %s", job_id, stopped)


def fitted(collector: Collector, job: Job) -> tuple[Fit, Check | None]:
    """Fit, and judge the present calibration on the same data; blocks, so it runs in a thread."""
    try:
        fit = collector.fit()
        present = collector.check(in_words_of(job.kind, job.present)) if fit.ok and has_present(job) else None
    except (ArithmeticError, ValueError, IndexError, KeyError) as error:  # a defect of ours: the job says so
        log.error("calibration %s failed", job.id, exc_info=error)
        return Fit(kind=job.kind, failure=failure("program")), None
    return fit, present


def has_present(job: Job) -> bool:
    """True when the present parameters of this sensor can be judged by what the job collects."""
    return job.sensor is not Sensor.BOARD

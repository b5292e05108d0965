"""One task per board while it has jobs: reads the hub, feeds the collectors, fits in threads."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Final

from server.calibration.errors import DEFECTS
from server.calibration.feeding import runs
from server.calibration.job import COLLECTS, Job, JobState
from server.nav.calibration.applied import in_words_of
from server.nav.calibration.codes import failure
from server.nav.calibration.types import Check, Collector, Fit, Sensor

if TYPE_CHECKING:
    from server.board import Board
    from server.calibration.samples import SampleFile
    from server.hub import Subscription
    from server.nav.types import Float, Int, Kind, StepResult

log = logging.getLogger("navdeck.calibration")
PERIOD_S: Final = 0.1
QUEUED_RESULTS: Final = 4096  # some ten seconds of a fast board; then the oldest are lost, and counted on the job
JUDGE_EVERY: Final = 5
KEEP_EVERY: Final = 10
HELD_RUNS: Final = 20_000  # stretches of samples that wait while a job fits: a minute of a fast board
Run = tuple["Kind", "Int", "Float"]


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
        self._held: dict[str, list[Run]] = {}
        self._lost = 0
        self._beats = 0

    async def run(self) -> None:
        """Feed until no job is active.

        It ends without waiting for anything after it has looked for jobs: one that starts later finds it done.
        """
        subscription = self._board.hub.results.subscribe(QUEUED_RESULTS)
        try:
            while self._active or self._files:
                await asyncio.sleep(PERIOD_S if self._active else 0.0)
                self._beat(subscription)
                await self._keep()
        finally:
            subscription.close()
            if self._files:  # cancelled
                await asyncio.to_thread(_close, self._files)

    @property
    def _active(self) -> list[Job]:
        return [job for job in self._jobs() if job.is_active]

    def _beat(self, subscription: Subscription[StepResult]) -> None:
        now_s, self._beats = time.monotonic(), self._beats + 1
        active, mag_scale = self._active, self._board.mag_scale
        for result in subscription.drain():
            self._feed(active, result, mag_scale, now_s)
        lost, self._lost = subscription.lost - self._lost, subscription.lost
        for job in active:
            job.lost_results += lost
            self._guarded(job, lambda one: self._tend(one, now_s), now_s)

    def _guarded(self, job: Job, work: Callable[[Job], None], now_s: float) -> None:
        """Do something with a job; a defect of its collector is a state of this job and ends nothing else."""
        try:
            work(job)
        except DEFECTS as error:
            log.error("calibration %s failed", job.id, exc_info=error)
            job.fail(now_s)

    def _tend(self, job: Job, now_s: float) -> None:
        job.look(now_s)
        if job.wants_fit:
            self._spawn(job, False)
        if job.state is JobState.VERIFYING and self._beats % JUDGE_EVERY == 0 and job.judge():
            job.end_verification()

    def _feed(self, active: list[Job], result: StepResult, mag_scale: float, now_s: float) -> None:
        for run in runs(result.block, mag_scale, self._board.converted):
            for job in active:
                self._guarded(job, partial(self._hand, run=run, now_s=now_s), now_s)

    def _hand(self, job: Job, run: Run, now_s: float) -> None:
        """Feed a job and its file; what comes while it fits waits, so that a refused attempt leaves no hole."""
        if job.state is JobState.FITTING:
            held = self._held.setdefault(job.id, [])
            if len(held) < HELD_RUNS:
                held.append(run)
            return
        for kind, t_ns, rows in (*self._held.pop(job.id, ()), run):
            job.feed(kind, t_ns, rows, now_s)
            file = self._file(job) if job.state in COLLECTS else None
            if file is not None:
                file.add(kind, t_ns, rows)

    def _file(self, job: Job) -> SampleFile | None:
        if job.id not in self._files:
            self._files[job.id] = self._sample_file(job)
        return self._files[job.id]

    async def _keep(self) -> None:
        """Write what is pending of the raw samples, in a thread; close the files of jobs that collect no more."""
        going_on = {job.id for job in self._jobs() if job.state in COLLECTS or job.state is JobState.FITTING}
        ended = {job_id: self._files.pop(job_id) for job_id in set(self._files) - going_on}
        self._held = {job_id: runs for job_id, runs in self._held.items() if job_id in going_on}
        if ended:
            await asyncio.to_thread(_close, ended)
        if self._beats % KEEP_EVERY == 0 and self._files:
            await asyncio.to_thread(_flush, tuple(self._files.values()))


def _flush(files: Iterable[SampleFile | None]) -> None:
    for file in files:
        if file is not None:
            file.flush()


def _close(files: Mapping[str, SampleFile | None]) -> None:
    for job_id, file in files.items():
        stopped = file.close().stopped if file is not None else ""
        if stopped not in {"", "closed"}:
            log.warning("raw samples of %s: %s", job_id, stopped)


def fitted(collector: Collector, job: Job) -> tuple[Fit, Check | None]:
    """Fit, and judge the present calibration on the same data; blocks, so it runs in a thread."""
    try:
        fit = collector.fit()
        present = collector.check(in_words_of(job.kind, job.present)) if fit.ok and has_present(job) else None
    except DEFECTS as error:  # as in `Driver._guarded`, but in a thread: the job says so
        log.error("calibration %s failed", job.id, exc_info=error)
        return Fit(kind=job.kind, failure=failure("program")), None
    return fit, present


def has_present(job: Job) -> bool:
    """True when the present parameters of this sensor can be judged by what the job collects."""
    return job.sensor is not Sensor.BOARD

"""Calibration of every board: jobs owned by the server, and the sets that they become."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Coroutine
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from server.boards import Boards, no_board
from server.calibration.driver import Driver, fitted
from server.calibration.errors import StoreError
from server.calibration.job import COLLECTS, Job, JobState
from server.calibration.keeper import Keeper, Person
from server.calibration.needs import LONG_TIMEOUT_S, TIMEOUT_S, is_outdated, what_misses
from server.calibration.options import options_from
from server.calibration.refusals import (
    applying,
    bad_option,
    busy,
    clash,
    dry_run,
    no_job,
    outdated,
    wrong_state,
)
from server.calibration.samples import SampleFile
from server.calibration.scene import CalibrationScene
from server.calibration_views import job_out
from server.commands import Refusal
from server.nav.calibration.codes import failure
from server.nav.calibration.types import CalKind
from server.wire_calibration import JobsOut

if TYPE_CHECKING:
    from server.board import Board
    from server.wire_calibration import CalibrationIn

log = logging.getLogger("navdeck.calibration")
JOBS_KEPT: Final = 30  # of one board; the oldest that is not active is forgotten
STREAMED_JOBS: Final = 8


class Calibrations:
    """Jobs and store of all boards; every method runs on the event loop."""

    def __init__(self, boards: Boards, store_folder: Path, version: str) -> None:
        self._boards = boards
        self.keeper = Keeper(store_folder, version)
        self._jobs: dict[str, list[Job]] = {}
        self._drivers: dict[str, asyncio.Task[None]] = {}
        self._group: asyncio.TaskGroup | None = None
        self._tasks: set[asyncio.Task[Any]] = set()
        self._applying = asyncio.Lock()
        self._count = 0
        boards.on_added.append(self._board_added)
        boards.on_removed.append(self._board_removed)

    def start(self, group: asyncio.TaskGroup) -> None:
        """Run drivers and fits in this task group."""
        self._group = group

    def stop(self) -> None:
        """Cancel every driver; the task group waits for them."""
        for task in (*self._drivers.values(), *self._tasks):
            task.cancel()
        self.keeper.close()

    def jobs(self, board_id: str) -> list[Job]:
        """Return the jobs of a board, newest first."""
        return list(reversed(self._jobs.get(board_id, [])))

    def stream_text(self, board_id: str) -> str:
        """Return the jobs of a board as the stream sends them: the body of GET, as JSON."""
        now_s = time.monotonic()
        jobs = tuple(job_out(job, now_s) for job in self.jobs(board_id)[:STREAMED_JOBS])
        return JobsOut(board_id=board_id, jobs=jobs).model_dump_json()

    def job(self, board_id: str, job_id: str) -> Job | Refusal:
        """Return one job."""
        found = next((job for job in self._jobs.get(board_id, []) if job.id == job_id), None)
        return found if found is not None else no_job(board_id, job_id)

    def begin(self, board_id: str, wish: CalibrationIn, by: Person) -> Job | Refusal:
        """Start a job; a second one on the same sensor is refused, naming the one that runs."""
        board = self._boards.get(board_id)
        if board is None:
            return no_board(board_id)
        kind = CalKind(wish.kind)
        if (holder := self._holder(board_id, kind)) is not None:
            return busy(holder)
        try:
            job = self._new_job(board, kind, wish, by)
        except ValueError as error:
            return bad_option(error)
        if (missing := what_misses(job)) is not None:
            return missing
        self._enlist(board, job)
        board.note("calibration-started", "info", f"Calibration {kind.value} started.")
        return job

    def _holder(self, board_id: str, kind: CalKind) -> Job | None:
        return next((job for job in self._jobs.get(board_id, []) if job.is_active and clash(job, kind)), None)

    def _new_job(self, board: Board, kind: CalKind, wish: CalibrationIn, by: Person) -> Job:
        self._count += 1
        now = datetime.now(tz=UTC)
        site = board.snapshot().site
        return Job(
            id=f"{now:%Y%m%dT%H%M%S}-{self._count}-{kind.value.replace('_', '-')}",
            board_id=board.id,
            kind=kind,
            options=options_from(wish.options, site),
            present=board.calibration,
            created_utc=now.isoformat(timespec="seconds"),
            created_by=by.name,
            started_s=time.monotonic(),
            timeout_s=wish.timeout_s or TIMEOUT_S.get(kind, LONG_TIMEOUT_S),
            dry_run=wish.dry_run,
        )

    def _enlist(self, board: Board, job: Job) -> None:
        known = self._jobs.setdefault(board.id, [])
        ended = [one for one in known if not one.is_active]
        for one in ended[: max(0, len(known) + 1 - JOBS_KEPT)]:
            known.remove(one)
        known.append(job)
        self._drive(board)

    def _drive(self, board: Board) -> None:
        running = self._drivers.get(board.id)
        if (running is None or running.done()) and self._group is not None:
            driver = Driver(board, lambda: self._jobs.get(board.id, []), self._sample_file, self._spawn_fit)
            self._drivers[board.id] = self._group.create_task(driver.run(), name=f"calibration of {board.id}")

    def _sample_file(self, job: Job) -> SampleFile | None:
        try:
            file = SampleFile(self.keeper.samples_folder(job.board_id, job.id))
        except OSError as error:
            log.warning("raw samples of %s are not kept: %s", job.id, error)
            return None
        job.samples_file = str(file.folder)
        return file

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        if self._group is None:
            work.close()
            raise RuntimeError("Calibrations.start was not called")
        task = self._group.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _spawn_fit(self, job: Job, asked: bool) -> None:
        collector = job.begin_fit()

        async def work() -> None:
            fit, present = await asyncio.to_thread(fitted, collector, job)
            if job.state is JobState.FITTING:  # else it was cancelled meanwhile
                job.end_fit(fit, present, asked=asked, now_s=time.monotonic())
                self._tell_result(job)

        self._spawn(work())

    def _tell_result(self, job: Job) -> None:
        board = self._boards.get(job.board_id)
        if board is None:
            return
        if job.state is JobState.FITTED and job.fit is not None:
            board.note("calibration-fitted", "info", f"Calibration {job.kind.value} fitted: {job.fit.grade}.")
        elif job.refusal is not None:
            board.note("calibration-refused", "caution", f"Calibration {job.kind.value}: {job.refusal.advice}")

    def confirm(self, job: Job) -> Job | Refusal:
        """Fit what was collected so far."""
        if job.state not in COLLECTS:
            return wrong_state(job, "confirm", "collecting")
        self._spawn_fit(job, True)
        return job

    def cancel(self, job: Job) -> Job | Refusal:
        """End a job at any time before it was applied; a verification alone is given up."""
        if not job.is_active and job.state is not JobState.FITTED:
            return wrong_state(job, "cancel", "active or fitted")
        if job.is_applying:
            return applying(job)
        job.cancel(time.monotonic())
        return job

    def verify(self, job: Job) -> Job | Refusal:
        """Collect fresh data and judge the new parameters on it."""
        board = self._boards.get(job.board_id)
        if job.state not in {JobState.FITTED, JobState.APPLIED} or board is None:
            return wrong_state(job, "verify", "fitted or applied")
        if job.is_applying:
            return applying(job)
        if (holder := self._holder(job.board_id, job.kind)) is not None:
            return busy(holder)
        job.begin_verification(time.monotonic())
        self._drive(board)
        return job

    async def apply(self, job: Job, by: Person) -> Job | Refusal:
        """Store the result and put it in force."""
        async with self._applying:  # two clicks are one application
            board = self._boards.get(job.board_id)
            if board is None:
                return no_board(job.board_id)
            if job.state is not JobState.FITTED or job.fit is None:
                return wrong_state(job, "apply", "fitted")
            if job.dry_run:
                return dry_run(job)
            if is_outdated(job, board.calibration):
                return outdated(job)
            job.is_applying = True
            try:
                stored = await self.keeper.keep_result(board, job, by)
            finally:
                job.is_applying = False
            if isinstance(stored, Refusal):
                return stored
            job.applied(stored.id)
            return job

    def scene(self, board_id: str) -> CalibrationScene | None:
        """Return what the 3D view draws of this board's newest job; None when there was none."""
        job = next((one for one in self.jobs(board_id) if one.state is not JobState.CANCELLED), None)
        if job is None:
            return None
        return CalibrationScene(job_id=job.id, kind=job.kind, state=job.state.value, progress=job.progress, fit=job.fit)

    async def _board_added(self, board: Board) -> None:
        try:
            calibration, troubles = await self.keeper.read(board.id)
            if not calibration.is_identity:
                board.set_calibration(calibration)
            for trouble in troubles:
                board.note("calibration-store-trouble", "warning", trouble)
        except (OSError, StoreError, ValueError) as error:  # ValueError: numbers that the engine does not take
            board.note("calibration-unreadable", "warning", f"The stored calibration cannot be read: {error}")

    def _board_removed(self, board_id: str) -> None:
        driver = self._drivers.pop(board_id, None)
        if driver is not None:  # it reads this board's hub: another board of the same id gets one of its own
            driver.cancel()
        for job in self._jobs.get(board_id, []):
            if job.is_active:
                job.refuse(failure("board-removed"), time.monotonic())

"""From a result to a set in the store and in force on the board; the only writer of what is in force."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from server.calibration.errors import StoreError
from server.calibration.records import CalibrationSet, set_from_fit
from server.calibration.refusals import impossible, not_settled, store_failed
from server.calibration.store import CalibrationStore
from server.calibration.store_samples import SampleFolders
from server.commands import Refusal
from server.nav.calibration.applied import OFFSET_ONLY, Calibration
from server.nav.calibration.types import CalKind, Fit
from server.nav.preprocess.chain_calibration import check_calibration

if TYPE_CHECKING:
    from server.board import Board
    from server.calibration.job import Job

T = TypeVar("T")
MAX_ALL_SAMPLES_BYTES: Final = 2_000_000_000  # of jobs that became no set; past that the oldest go


@dataclass(frozen=True, slots=True, kw_only=True)
class Person:
    """Who asks: the role that the door gave."""

    name: str


class Keeper:
    """Owns the store; the disk is touched in threads only."""

    def __init__(self, folder: Path, version: str) -> None:
        self._folder = folder
        self._version = version
        self._store: CalibrationStore | None = None
        self._opening = threading.Lock()
        self._changing = asyncio.Lock()
        self._learned = asyncio.Lock()
        self._samples = SampleFolders(folder / "samples")

    @property
    def store(self) -> CalibrationStore:
        """The store, opened when it is first needed.

        Raises:
            StoreError: another process holds it.
        """
        with self._opening:
            if self._store is None:
                self._store = CalibrationStore(self._folder)
                self._store.trim_samples(MAX_ALL_SAMPLES_BYTES)
            return self._store

    def samples_folder(self, board_id: str, job_id: str) -> Path:
        """Return where the raw samples of a job belong; does not open the store, so it may be asked anywhere."""
        return self._samples.folder_of(board_id, job_id)

    def close(self) -> None:
        """Let go of the file; the next call opens it again."""
        with self._opening:
            if self._store is not None:
                self._store.close()
                self._store = None

    async def read(self, board_id: str) -> tuple[Calibration, tuple[str, ...]]:
        """Return what is in force on a board, and what the store had to put aside.

        Raises:
            StoreError, OSError: it cannot be read.
        """
        return await asyncio.to_thread(lambda: (self.store.calibration(board_id), tuple(self.store.troubles)))

    async def keep_result(self, board: Board, job: Job, by: Person) -> CalibrationSet | Refusal:
        """Store the result of a job and put it in force.

        What the job did not find stays as it is now, but for a magnetic offset: it was found under the job's matrix.
        """
        if job.fit is None:
            return not_settled()
        present = job.present if job.kind in OFFSET_ONLY else board.calibration
        made = self._made(job.fit, board, by, present=present, source=job.id, samples_file=job.samples_file)
        return await self._keep(board, replace(made, verified=job.check))

    async def keep_learned(self, board: Board, by: Person) -> CalibrationSet | Refusal:
        """Make what the magnetometer learned in flight a set, and put it in force; learning begins anew."""
        async with self._learned:  # two clicks are one set: after the first, nothing is learned any more
            return await self._keep_learned(board, by)

    async def _keep_learned(self, board: Board, by: Person) -> CalibrationSet | Refusal:
        state = board.mag_learning()
        if state is None or not state.converged:
            return not_settled()
        fit = Fit(
            kind=CalKind.MAG_IN_FLIGHT,
            parameters={"offset": state.offset_gauss},
            sigma={"offset": state.sigma_gauss},
            details={"residual_gauss": state.residual_gauss},
        )
        made = self._made(fit, board, by, present=board.calibration, source="learned in flight")
        return await self._keep(board, made)  # the engine starts learning anew when the magnetic calibration changes

    async def change(
        self, board: Board, work: Callable[[CalibrationStore], T], wanted: CalibrationSet | None = None
    ) -> T | Refusal:
        """Change what is in force: on disk, in a thread, then on the board; one change at a time.

        Args:
            board: whose.
            work: changes the store.
            wanted: what it will put in force, which is refused beforehand when the engine would not take it.
        """
        refusal = None if wanted is None else impossible_set(board.calibration, wanted)
        if refusal is not None:
            return refusal
        async with self._changing:
            try:
                done = await asyncio.to_thread(lambda: work(self.store))
                board.set_calibration(await asyncio.to_thread(self.store.calibration, board.id))
            except (OSError, StoreError) as error:
                return store_failed(error)
            except ValueError as error:
                return impossible(error)
        return done

    def _made(
        self, fit: Fit, board: Board, by: Person, *, present: Calibration, source: str, samples_file: str = ""
    ) -> CalibrationSet:
        return set_from_fit(
            fit,
            board_id=board.id,
            present=present,
            created_by=by.name,
            software_version=self._version,
            source=source,
            samples_file=samples_file,
        )

    async def _keep(self, board: Board, made: CalibrationSet) -> CalibrationSet | Refusal:
        def keep(store: CalibrationStore) -> CalibrationSet:
            stored = store.add(made)
            store.apply(board.id, stored.id, made.created_by)
            return stored

        return await self.change(board, keep, made)


def impossible_set(present: Calibration, wanted: CalibrationSet) -> Refusal | None:
    """Refuse parameters that would make numbers no numbers: a matrix that cannot be inverted, a number that is none."""
    try:
        check_calibration(present.having(wanted.sensor, wanted.parameters))
    except ValueError as error:
        return impossible(error)
    return None

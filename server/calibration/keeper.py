"""From a result to a set in the store and in force on the board; the only writer of what is in force."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from server.calibration.errors import StoreError
from server.calibration.records import CalibrationSet, set_from_fit
from server.calibration.refusals import not_settled, store_failed
from server.calibration.store import CalibrationStore
from server.commands import Refusal
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import CalKind, Fit

if TYPE_CHECKING:
    from server.board import Board
    from server.calibration.job import Job

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

    @property
    def store(self) -> CalibrationStore:
        """The store, opened when it is first needed.

        Raises:
            StoreError: another process holds it.
        """
        if self._store is None:
            self._store = CalibrationStore(self._folder)
            self._store.trim_samples(MAX_ALL_SAMPLES_BYTES)
        return self._store

    def close(self) -> None:
        """Let go of the file; the next call opens it again."""
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
        """Store the result of a job and put it in force."""
        if job.fit is None:
            return not_settled()
        made = self._made(job.fit, board, by, present=job.present, source=job.id, samples_file=job.samples_file)
        return await self._keep(board, replace(made, verified=job.check))

    async def keep_learned(self, board: Board, by: Person) -> CalibrationSet | Refusal:
        """Make what the magnetometer learned in flight a set, and put it in force; learning begins anew."""
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

    async def reload(self, board: Board) -> None:
        """Put in force what the store says is in force."""
        board.set_calibration(await asyncio.to_thread(self.store.calibration, board.id))

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
        def keep() -> CalibrationSet:
            stored = self.store.add(made)
            self.store.apply(board.id, stored.id, made.created_by)
            return stored

        try:
            stored = await asyncio.to_thread(keep)
            await self.reload(board)
        except (OSError, StoreError) as error:
            return store_failed(error)
        return stored

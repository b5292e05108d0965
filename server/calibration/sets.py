"""What a person may do with the stored calibration sets of a board; the answer or the refusal."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from server.calibration.errors import StoreError
from server.calibration.keeper import Keeper, impossible_set
from server.calibration.refusals import store_failed
from server.commands import Refusal
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import Sensor

if TYPE_CHECKING:
    from server.board import Board
    from server.calibration.diff import Change
    from server.calibration.keeper import Person
    from server.calibration.records import CalibrationSet

T = TypeVar("T")


class StoredSets:
    """The store of every board behind typed refusals; what changes what is in force reaches the board at once."""

    def __init__(self, keeper: Keeper) -> None:
        self._keeper = keeper

    async def sets(self, board_id: str) -> list[CalibrationSet] | Refusal:
        """Return every set of a board, newest first."""
        return await _tried(lambda: list(self._keeper.store.sets(board_id)))

    async def get(self, board_id: str, set_id: str) -> CalibrationSet | Refusal:
        """Return one set."""
        return await _tried(lambda: self._keeper.store.get(board_id, set_id))

    async def in_force(self, board_id: str) -> dict[Sensor, CalibrationSet] | Refusal:
        """Return the set in force of each sensor that has one."""
        return await _tried(lambda: dict(self._keeper.store.in_force(board_id)))

    async def roll_back_targets(self, board_id: str) -> frozenset[Sensor] | Refusal:
        """Return the sensors whose application can be rolled back."""
        return await _tried(
            lambda: frozenset(sensor for sensor in Sensor if self._keeper.store.can_roll_back(board_id, sensor))
        )

    async def apply(self, board: Board, set_id: str, by: Person) -> Refusal | None:
        """Put a stored set in force."""
        wanted = await self.get(board.id, set_id)
        if isinstance(wanted, Refusal):
            return wanted
        return _refused(await self._keeper.change(board, lambda store: store.apply(board.id, set_id, by.name), wanted))

    async def take_off(self, board: Board, sensor: Sensor, by: Person) -> Refusal | None:
        """Have a sensor work without a calibration of ours."""
        return _refused(await self._keeper.change(board, lambda store: store.take_off(board.id, sensor, by.name)))

    async def roll_back(self, board: Board, sensor: Sensor, by: Person) -> Refusal | None:
        """Put in force what was in force before."""
        return _refused(await self._keeper.change(board, lambda store: store.roll_back(board.id, sensor, by.name)))

    async def delete(self, board_id: str, set_id: str) -> Refusal | None:
        """Forget a set that is not in force."""
        return _refused(await _tried(lambda: self._keeper.store.delete(board_id, set_id)))

    async def add(self, found: Sequence[CalibrationSet]) -> list[CalibrationSet] | Refusal:
        """Store sets without applying them; none of them when one could never be in force."""
        refusals = [refusal for one in found if (refusal := impossible_set(Calibration(), one)) is not None]
        if refusals:
            return refusals[0]
        return await _tried(lambda: [self._keeper.store.add(one) for one in found])

    async def diff(self, board_id: str, old_id: str, new_id: str) -> list[Change] | Refusal:
        """Compare two sets of one sensor number by number."""
        return await _tried(lambda: list(self._keeper.store.diff(board_id, old_id, new_id)))

    @property
    def troubles(self) -> tuple[str, ...]:
        """What the store had to put aside when it was opened."""
        return tuple(self._keeper.store.troubles)


def _refused(reply: object) -> Refusal | None:
    return reply if isinstance(reply, Refusal) else None


async def _tried(work: Callable[[], T]) -> T | Refusal:
    """Do it in a thread; what the store refuses or the disk does not let becomes a refusal."""
    try:
        return await asyncio.to_thread(work)
    except (OSError, StoreError) as error:
        return store_failed(error)

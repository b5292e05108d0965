"""Turning the demo board: what is refused, why, and what to do instead."""

from __future__ import annotations

from dataclasses import asdict
from typing import Protocol

from server.commands import Refusal, RefusalKind
from server.link.base import Turnable
from server.simulator import Command
from server.wire_simulator import SimulatorOut


class HasSimulator(Protocol):
    """What is needed of a board."""

    @property
    def id(self) -> str:
        """Its name."""
        ...

    @property
    def simulator(self) -> Turnable | None:
        """Its link when that is a demo board, else None."""
        ...


async def control_simulator(board: HasSimulator, command: Command | None = None) -> SimulatorOut | Refusal:
    """Have the demo board do this; return what it does then. Without a command nothing but that."""
    link = board.simulator
    if link is None:
        return _no_simulator(board.id)
    try:
        state = await link.control(command)
    except ConnectionError:
        detail = f"The demo board {board.id} does not run now."
        remedy = f"Try again in a second, or reconnect it: POST /api/v1/boards/{board.id}/reconnect."
        return Refusal(kind=RefusalKind.CONFLICT, code="simulator-not-running", detail=detail, remedy=remedy)
    except ValueError as error:
        text, _, remedy = str(error).partition("; ")
        detail = f"This cannot be done: {text}."
        return Refusal(kind=RefusalKind.CONFLICT, code="simulator-cannot", detail=detail, remedy=f"{remedy}.")
    return SimulatorOut(board_id=board.id, **asdict(state))


def _no_simulator(board_id: str) -> Refusal:
    return Refusal(
        kind=RefusalKind.MISSING,
        code="not-a-simulator",
        detail=f"Board {board_id} is not a demo board: only those can be turned from here.",
        remedy='Open one: POST /api/v1/boards {"url": "sim:?errors=raw"}.',
        name="board_id",
        value=board_id[:80],
    )

"""The demo board in the hand: what it does, and having it turned. Other boards have no such address."""

from __future__ import annotations

from fastapi import APIRouter

from server.api.boards import CONFLICT, NOT_FOUND
from server.api.context import BoardDep
from server.api.errors import granted
from server.simulator_commands import control_simulator
from server.wire_simulator import SimulatorIn, SimulatorOut

router = APIRouter(prefix="/api/v1/boards/{board_id}/simulator", tags=["simulator"])


@router.get("", responses=NOT_FOUND | CONFLICT)
async def get_simulator(board: BoardDep) -> SimulatorOut:
    """Return what the demo board does now."""
    return granted(await control_simulator(board))


@router.post("", status_code=202, responses=NOT_FOUND | CONFLICT)
async def post_simulator(board: BoardDep, body: SimulatorIn) -> SimulatorOut:
    """Turn the demo board, or what is around it; it begins within 0.2 s, and the answer says what it does then.

    A motion ends the one before and takes the board out of its flight; `fly` takes it back.
    """
    return granted(await control_simulator(board, body.command()))

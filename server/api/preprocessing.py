"""The preprocessing chain of each sensor, and the magnetometer that learns in flight."""

from __future__ import annotations

from fastapi import APIRouter

from server.api.calibrations import CONFLICT, NOT_FOUND, CalibrationsDep, person
from server.api.context import BoardDep, RoleDep
from server.api.errors import granted
from server.calibration_views import set_out
from server.chain_commands import set_chain, set_mag_learning
from server.preprocessing_views import mag_learning_out, preprocessing_out
from server.wire_calibration_sets import SetOut
from server.wire_preprocessing import ChainIn, MagLearningIn, MagLearningOut, PreprocessingOut

router = APIRouter(prefix="/api/v1/boards/{board_id}", tags=["preprocessing"])


@router.get("/preprocessing", responses=NOT_FOUND)
async def get_preprocessing(board: BoardDep) -> PreprocessingOut:
    """Return the chain of every sensor: its steps with limits, meaning and value, and what its filters delay."""
    return preprocessing_out(board)


@router.patch("/preprocessing/{sensor}", responses=NOT_FOUND | CONFLICT)
async def patch_preprocessing(board: BoardDep, sensor: str, body: ChainIn) -> PreprocessingOut:
    """Change the preprocessing of one sensor from its next sample on; the estimators are told the new delay."""
    granted(set_chain(board, sensor, body.root))
    return preprocessing_out(board)


@router.get("/mag-learning", responses=NOT_FOUND)
async def get_mag_learning(board: BoardDep) -> MagLearningOut:
    """Return what the magnetometer learned in flight, beside the main lane's own magnetic bias."""
    return mag_learning_out(board)


@router.put("/mag-learning", responses=NOT_FOUND | CONFLICT)
async def put_mag_learning(board: BoardDep, body: MagLearningIn) -> MagLearningOut:
    """Switch learning, and the use of what was learned, on or off; two switches, what is left out stays."""
    granted(set_mag_learning(board, body.run, body.apply))
    return mag_learning_out(board)


@router.post("/mag-learning/keep", status_code=201, responses=NOT_FOUND | CONFLICT)
async def keep_mag_learning(board: BoardDep, service: CalibrationsDep, role: RoleDep) -> SetOut:
    """Put what was learned in force as a calibration set of its own; learning begins anew from there."""
    kept = granted(await service.keeper.keep_learned(board, person(role)))
    return set_out(kept, {kept.sensor: kept})

"""The calibration store of a board: sets, what is in force, roll back, import and export."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Response

from server.api.calibrations import CONFLICT, NOT_FOUND, person
from server.api.context import BoardDep, ContextDep, RoleDep
from server.api.errors import ApiError, granted
from server.board import Board
from server.calibration.errors import ExchangeError
from server.calibration.exchange import export_calibration, import_calibration, read_parameters
from server.calibration.exchange.export import Format
from server.calibration.sets import StoredSets
from server.calibration_views import change_out, set_out, sets_out
from server.nav.calibration.types import Sensor
from server.wire_calibration_sets import DiffOut, ExportIn, ImportedOut, ImportIn, SensorIn, SetOut, SetsOut, WarningOut

Responses = dict[int | str, dict[str, Any]]
router = APIRouter(prefix="/api/v1/boards/{board_id}/calibration-sets", tags=["calibration"])
TEXT: Responses = {200: {"content": {"text/plain": {"schema": {"type": "string"}}}}}
FormatQuery = Annotated[Format, Query(alias="format")]


def _sets(context: ContextDep) -> StoredSets:
    return StoredSets(context.calibrations.keeper)


SetsDep = Annotated[StoredSets, Depends(_sets)]


async def _all(board: Board, stored: StoredSets) -> SetsOut:
    found = granted(await stored.sets(board.id))
    in_force = granted(await stored.in_force(board.id))
    targets = granted(await stored.roll_back_targets(board.id))
    return sets_out(board.id, board.calibration, found, in_force, targets, stored.troubles)


@router.get("", responses=NOT_FOUND)
async def list_sets(board: BoardDep, stored: SetsDep) -> SetsOut:
    """Return every stored set of a board, newest first, and which are in force."""
    return await _all(board, stored)


@router.post("", status_code=201, responses=NOT_FOUND | CONFLICT)
async def import_sets(
    board: BoardDep, body: ImportIn, stored: SetsDep, role: RoleDep, context: ContextDep
) -> ImportedOut:
    """Store calibrations from elsewhere, one set for each sensor; nothing of them is in force before it is applied.

    navdeck's own JSON and parameter files of ArduPilot and PX4 are told apart by what they hold.
    """
    try:
        given = import_calibration(
            body.text,
            name=body.name,
            board_id=board.id,
            created_by=person(role).name,
            software_version=context.version,
            board=read_parameters(body.board_text) if body.board_text else None,
        )
    except ExchangeError as error:
        raise ApiError(422, "unreadable-calibration", str(error), "Choose another file.") from error
    kept = granted(await stored.add(given.sets))
    return ImportedOut(
        format=given.form,
        added=tuple(one.id for one in kept),
        warnings=tuple(WarningOut(code=one.code, text=one.text) for one in given.warnings),
        store=await _all(board, stored),
    )


@router.get("/export", responses=NOT_FOUND | CONFLICT | TEXT, response_class=Response)
async def export_sets(board: BoardDep, stored: SetsDep, context: ContextDep, file: FormatQuery = "native") -> Response:
    """Return what is in force as a file: navdeck's JSON, ArduPilot's or PX4's parameters, or a C header."""
    return await _file(board, stored, context.version, file, "")


@router.post("/export", responses=NOT_FOUND | CONFLICT | TEXT, response_class=Response)
async def export_composed(board: BoardDep, body: ExportIn, stored: SetsDep, context: ContextDep) -> Response:
    """Return the same composed with what the board applies already, which its own parameter file tells."""
    return await _file(board, stored, context.version, body.format, body.board_text)


async def _file(board: Board, stored: StoredSets, version: str, form: Format, board_text: str) -> Response:
    in_force = granted(await stored.in_force(board.id))
    try:
        made = export_calibration(
            form,
            in_force,
            board_id=board.id,
            software_version=version,
            now_utc=datetime.now(tz=UTC).isoformat(timespec="seconds"),
            board=read_parameters(board_text) if board_text else None,
        )
    except ExchangeError as error:
        raise ApiError(422, "unreadable-calibration", str(error), "Correct the board's parameter file.") from error
    headers = {"cache-control": "no-store", "content-disposition": f'attachment; filename="{made.name}"'}
    return Response(made.text, media_type=made.media_type, headers=headers)


@router.post("/roll-back", status_code=202, responses=NOT_FOUND | CONFLICT)
async def roll_back(board: BoardDep, body: SensorIn, stored: SetsDep, role: RoleDep) -> SetsOut:
    """Put in force what was in force on this sensor before; again for the one before that."""
    granted(await stored.roll_back(board, Sensor(body.sensor), person(role)))
    return await _all(board, stored)


@router.post("/take-off", status_code=202, responses=NOT_FOUND | CONFLICT)
async def take_off(board: BoardDep, body: SensorIn, stored: SetsDep, role: RoleDep) -> SetsOut:
    """Have this sensor work without a calibration of ours; its sets stay."""
    granted(await stored.take_off(board, Sensor(body.sensor), person(role)))
    return await _all(board, stored)


@router.get("/{set_id}", responses=NOT_FOUND)
async def get_set(board: BoardDep, set_id: str, stored: SetsDep) -> SetOut:
    """Return one set."""
    found = granted(await stored.get(board.id, set_id))
    in_force = granted(await stored.in_force(board.id))
    return set_out(found, in_force)


@router.get("/{set_id}/diff/{other_id}", responses=NOT_FOUND | CONFLICT)
async def diff_sets(board: BoardDep, set_id: str, other_id: str, stored: SetsDep) -> DiffOut:
    """Compare two sets of one sensor, from the first to the second."""
    changes = granted(await stored.diff(board.id, set_id, other_id))
    return DiffOut(old_id=set_id, new_id=other_id, changes=tuple(change_out(one) for one in changes))


@router.post("/{set_id}/apply", status_code=202, responses=NOT_FOUND | CONFLICT)
async def apply_set(board: BoardDep, set_id: str, stored: SetsDep, role: RoleDep) -> SetsOut:
    """Put a stored set in force."""
    granted(await stored.apply(board, set_id, person(role)))
    return await _all(board, stored)


@router.delete("/{set_id}", status_code=204, responses=NOT_FOUND | CONFLICT)
async def delete_set(board: BoardDep, set_id: str, stored: SetsDep) -> None:
    """Forget a set that is not in force."""
    granted(await stored.delete(board.id, set_id))

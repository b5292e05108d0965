"""Boards: list, connect, remove; state, health and history of each."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from server.api.context import BoardDep, ContextDep, not_known
from server.api.errors import error_from_refusal, granted
from server.commands import AddBoard, ChooseLanes, ReconnectBoard, RemoveBoard, SetLaneParameters
from server.lane_commands import no_lane, not_running
from server.rows import lane_of, message, packed
from server.view_parts import choices_out
from server.views import board_out, health_out, nav_out
from server.wire import BoardIn, BoardOut, BoardsOut, HealthOut, NavOut
from server.wire_base import Problem
from server.wire_lanes import LanesIn, LanesOut, ParametersIn

Responses = dict[int | str, dict[str, Any]]
router = APIRouter(prefix="/api/v1/boards", tags=["boards"])
NOT_FOUND: Responses = {404: {"model": Problem}}
CONFLICT: Responses = {409: {"model": Problem}}
ROWS: Responses = {200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}}


@router.get("")
async def list_boards(context: ContextDep) -> BoardsOut:
    """Return every board in short."""
    return BoardsOut(boards=tuple(board_out(board.view()) for board in context.boards))


@router.post("", status_code=201, responses=CONFLICT)
async def add_board(body: BoardIn, context: ContextDep, request: Request, response: Response) -> BoardOut:
    """Open a link and run a board on it; a link that finds nothing yet is a state of the board, not an error.

    Files may only be named below the data folder, so that this is no way to read others.
    """
    command = AddBoard(url=body.url, system=body.system, component=body.component)
    reply = granted(await context.boards.add(command))
    board = context.boards.get(reply.board_id)
    if board is None:
        raise not_known("board", reply.board_id, [])
    response.headers["location"] = request.url_for("get_board", board_id=board.id).path
    return board_out(board.view())


@router.get("/{board_id}", responses=NOT_FOUND)
async def get_board(board: BoardDep) -> BoardOut:
    """Return one board in short."""
    return board_out(board.view())


@router.delete("/{board_id}", status_code=204, responses=NOT_FOUND)
async def remove_board(board_id: str, context: ContextDep) -> None:
    """Close the link of a board and forget the board."""
    granted(await context.boards.remove(RemoveBoard(board_id=board_id)))


@router.post("/{board_id}/reconnect", status_code=202, responses=NOT_FOUND)
async def reconnect_board(board_id: str, board: BoardDep, context: ContextDep) -> BoardOut:
    """Close the link and open it anew; a board that had failed starts afresh."""
    granted(await context.boards.reconnect(ReconnectBoard(board_id=board_id)))
    return board_out(board.view())


@router.get("/{board_id}/nav", responses=NOT_FOUND | CONFLICT)
async def get_nav(board: BoardDep, lane: Annotated[str | None, Query(max_length=80)] = None) -> NavOut:
    """Return attitude, velocity, position, their uncertainty and the aids of one lane; without `lane` the main one."""
    view = board.view()
    if lane is not None and lane not in view.lanes:
        info = next((one for one in view.lane_infos if one.name == lane), None)
        known = [one.name for one in view.lane_infos]
        raise error_from_refusal(no_lane(lane, known) if info is None else not_running(board.id, info))
    return nav_out(view, lane or view.lanes[0])


@router.get("/{board_id}/lanes", responses=NOT_FOUND)
async def get_lanes(board: BoardDep) -> LanesOut:
    """Return every estimator there is: whether it runs, and its parameters with limits, meaning and value."""
    return choices_out(board.view())


@router.put("/{board_id}/lanes", responses=NOT_FOUND | CONFLICT)
async def put_lanes(board: BoardDep, body: LanesIn, context: ContextDep) -> LanesOut:
    """Run these estimators from the next step on and no others; those that run go on undisturbed.

    The choice outlives a reconnection and a reboot of the board. One that failed starts again.
    """
    granted(await context.boards.choose_lanes(ChooseLanes(board_id=board.id, lanes=body.lanes)))
    return choices_out(board.view())


@router.patch("/{board_id}/lanes/{lane}/parameters", responses=NOT_FOUND | CONFLICT)
async def patch_parameters(board: BoardDep, lane: str, body: ParametersIn, context: ContextDep) -> LanesOut:
    """Change numbers of one estimator, running or not, from its next step on; its state stays."""
    command = SetLaneParameters(board_id=board.id, lane=lane, values=body.root)
    granted(await context.boards.set_lane_parameters(command))
    return choices_out(board.view())


@router.get("/{board_id}/health", responses=NOT_FOUND)
async def get_health(board: BoardDep) -> HealthOut:
    """Return link, protocol, sensors, aids, lanes, events, and the verdict with causes and remedies."""
    return health_out(board.view())


@router.get("/{board_id}/history", responses=NOT_FOUND | CONFLICT | ROWS, response_class=Response)
async def get_history(
    board: BoardDep,
    topic: Annotated[str, Query(max_length=80, description="lanes/ins_ekf, filtered, aids, raw/imu, …")],
    seconds: Annotated[float, Query(ge=0.1, le=3600.0)] = 600.0,
) -> Response:
    """Return the last rows of a binary topic, thinned to 10 Hz, laid out as one message of the stream with id 0."""
    name = topic.removeprefix(f"boards/{board.id}/")
    if name not in board.topics:
        raise not_known("topic", topic, sorted(board.topics))
    table = board.history.rows(name, seconds)
    rows, columns = table.data.shape
    if not rows and not board.is_fed(name):
        raise error_from_refusal(not_running(board.id, next(one for one in board.lanes() if one.name == lane_of(name))))
    body = message(0, board.history.boot_id, rows, columns, packed(table))
    return Response(body, media_type="application/octet-stream", headers={"cache-control": "no-store"})

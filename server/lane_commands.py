"""Choosing estimators and setting their numbers: what is refused, why, and what to do instead."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from server.board import Board
from server.commands import ChooseLanes, Done, Refusal, RefusalKind, SetLaneParameters

if TYPE_CHECKING:
    from server.nav.lanes.base import Parameter
    from server.nav.lanes.registry import LaneInfo  # importing it loads every kernel


def choose_lanes(board: Board, command: ChooseLanes) -> Done | Refusal:
    """Have the board run these lanes and no others."""
    known = [info.name for info in board.lanes()]
    refusal = next((no_lane(name, known) for name in command.lanes if name not in known), None) or not_now(board)
    if refusal is not None:
        return refusal
    try:
        board.choose_lanes(command.lanes)
    except ValueError as error:
        remedy = "Name at least one, each once; the first is the main one."
        return _invalid("bad-lanes", str(error), remedy, "lanes", ", ".join(command.lanes))
    return Done(board_id=board.id)


def set_lane_parameters(board: Board, command: SetLaneParameters) -> Done | Refusal:
    """Have one lane of the board work with other numbers; all of them or none."""
    infos = {info.name: info for info in board.lanes()}
    if command.lane not in infos:
        return no_lane(command.lane, list(infos))
    refusal = refused_value(command.lane, infos[command.lane].parameters, command.values) or not_now(board)
    if refusal is not None:
        return refusal
    defaults = {one.name: one.default for one in infos[command.lane].parameters}
    values = {name: defaults[name] if value is None else value for name, value in command.values.items()}
    try:
        board.set_lane_parameters(command.lane, values)
    except ValueError as error:
        remedy = f"GET /api/v1/boards/{board.id}/lanes lists every parameter with its limits."
        return _invalid("bad-parameter", str(error), remedy, command.lane, ", ".join(map(str, values)))
    return Done(board_id=board.id)


def no_lane(name: str, known: list[str]) -> Refusal:
    """Say that there is no such lane."""
    return Refusal(
        kind=RefusalKind.MISSING,
        code="no-such-lane",
        detail=f"There is no lane {name[:80]!r}.",
        remedy=f"One of: {', '.join(known)}.",
        name="lane",
        value=name[:80],
    )


def not_running(board_id: str, info: LaneInfo) -> Refusal:
    """Say that a lane exists but gives nothing now, and why."""
    detail = f"The estimator {info.name} is not running; it was not chosen."
    if info.failure:
        detail = f"The estimator {info.name} was put aside: {info.failure}."
    remedy = f"Choose it: PUT /api/v1/boards/{board_id}/lanes."
    return Refusal(kind=RefusalKind.CONFLICT, code="lane-not-running", detail=detail, remedy=remedy)


def not_now(board: Board) -> Refusal | None:
    """Refuse while the board's program does not run; None when it does."""
    if board.state == "running":
        return None
    detail = f"Board {board.id} has {board.state}, so none of its estimators work."
    remedy = f"Reconnect it first: POST /api/v1/boards/{board.id}/reconnect."
    return Refusal(kind=RefusalKind.CONFLICT, code="board-not-running", detail=detail, remedy=remedy)


def refused_value(owner: str, parameters: Sequence[Parameter], values: Mapping[str, float | None]) -> Refusal | None:
    """Refuse a name that the owner (a lane, a sensor) does not have, or a value outside its limits."""
    known = {one.name: one for one in parameters}
    for name, value in values.items():
        if name not in known:
            detail = f"{owner} has no parameter {name[:80]!r}."
            remedy = f"One of: {', '.join(known)}." if known else "Leave it as it is: it repeats what others computed."
            return _invalid("no-such-parameter", detail, remedy, name[:80], str(value))
        if value is not None and not known[name].minimum <= value <= known[name].maximum:
            return _out_of_range(owner, known[name], value)
    return None


def _out_of_range(lane: str, one: Parameter, value: float) -> Refusal:
    unit = f" {one.unit}" if one.unit else ""
    limits = f"{one.minimum:g} to {one.maximum:g}{unit}"
    default = "the vehicle class's own" if math.isnan(one.default) else f"{one.default:g}{unit}"
    detail = f"{lane}.{one.name} = {value:g}{unit} is outside its limits, {limits}."
    remedy = f"Give a value from {limits}, or null for the default: {default}."
    return _invalid("parameter-out-of-range", detail, remedy, one.name, f"{value:g}")


def _invalid(code: str, detail: str, remedy: str, name: str, value: str) -> Refusal:
    return Refusal(kind=RefusalKind.INVALID, code=code, detail=detail, remedy=remedy, name=name, value=value)

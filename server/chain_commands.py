"""Setting the preprocessing of a sensor and the learning magnetometer: what is refused, why, and what to do instead."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from server.board import Board
from server.commands import Refusal, RefusalKind
from server.lane_commands import not_now, refused_value

if TYPE_CHECKING:
    from server.nav.preprocess.chain_parameters import ChainInfo


def set_chain(board: Board, sensor: str, told: Mapping[str, float | None]) -> Refusal | None:
    """Have one sensor preprocessed with other numbers, None = the default; all of them or none."""
    infos = {info.name: info for info in board.chain()}
    if sensor not in infos:
        return _no_sensor(sensor, list(infos))
    info = infos[sensor]
    refusal = refused_value(sensor, info.parameters, told) or not_now(board)
    if refusal is not None:
        return refusal
    defaults = {one.name: one.default for one in info.parameters}
    try:
        board.set_chain(sensor, {name: defaults[name] if value is None else value for name, value in told.items()})
    except ValueError as error:
        return _bad(board, info, str(error))
    return None


def set_mag_learning(board: Board, run: bool | None, apply: bool | None) -> Refusal | None:
    """Switch learning and its use; what is None stays. Learning that does not run is not applied."""
    was_run, was_apply = board.mag_learning_switches
    run = was_run if run is None else run
    apply = was_apply if apply is None else apply
    if apply and not run:
        return Refusal(
            kind=RefusalKind.CONFLICT,
            code="learning-off",
            detail="What is not learned cannot be applied.",
            remedy="Switch run on as well.",
            name="apply",
            value="true",
        )
    refusal = not_now(board)
    if refusal is None:
        board.set_mag_learning(run, apply)
    return refusal


def _no_sensor(sensor: str, known: list[str]) -> Refusal:
    return Refusal(
        kind=RefusalKind.MISSING,
        code="no-such-sensor",
        detail=f"There is no preprocessing of {sensor[:80]!r}.",
        remedy=f"One of: {', '.join(known)}.",
        name="sensor",
        value=sensor[:80],
    )


def _bad(board: Board, info: ChainInfo, text: str) -> Refusal:
    return Refusal(
        kind=RefusalKind.INVALID,
        code="bad-parameter",
        detail=text,
        remedy=f"GET /api/v1/boards/{board.id}/preprocessing lists every parameter with its limits.",
        name=info.name,
    )

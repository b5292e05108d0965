"""What the routers are given: the parts of the service, put together by `server.app`."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Annotated

from fastapi import Depends
from prometheus_client import CollectorRegistry
from starlette.requests import HTTPConnection

from server.api.errors import ApiError, error_from_refusal
from server.board import Board
from server.boards import Boards, no_board
from server.calibration.service import Calibrations
from server.keyring import Keyring
from server.wire_base import Role
from server.wire_service import DoctorOut, PortOut, SettingsOut


@dataclass(slots=True, kw_only=True)
class Context:
    """The service as the API sees it.

    Attributes:
        list_ports, doctor: block for some milliseconds, so they are called in a thread.
        ready: kernels are loaded and the boards were started.
    """

    version: str
    boards: Boards
    calibrations: Calibrations
    keyring: Keyring
    registry: CollectorRegistry
    settings: SettingsOut
    list_ports: Callable[[], Sequence[PortOut]]
    doctor: Callable[[], DoctorOut]
    view3d: bool
    ready: bool = False
    started_s: float = field(default_factory=time.monotonic)


def _context(connection: HTTPConnection) -> Context:
    context: Context = connection.app.state.context
    return context


def _role(connection: HTTPConnection) -> Role | None:
    role: Role | None = connection.scope.get("state", {}).get("role")
    return role


ContextDep = Annotated[Context, Depends(_context)]
RoleDep = Annotated[Role | None, Depends(_role)]


def _board(board_id: str, context: ContextDep) -> Board:
    board = context.boards.get(board_id)
    if board is None:
        raise error_from_refusal(no_board(board_id))
    return board


BoardDep = Annotated[Board, Depends(_board)]


def not_known(kind: str, name: str, known: Sequence[str]) -> ApiError:
    """Return the 404 for a name that is none of those known."""
    return ApiError(404, f"no-such-{kind}", f"There is no {kind} {name[:80]!r}.", f"One of: {', '.join(known)}.")

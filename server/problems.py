"""The one error body (RFC 9457) and how it leaves the process, over HTTP and as the refusal of a WebSocket."""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus
from typing import Final

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from server.wire_base import Problem, ProblemError

MEDIA_TYPE: Final = "application/problem+json"


def problem(status: int, code: str, detail: str, remedy: str = "", errors: tuple[ProblemError, ...] = ()) -> Problem:
    """Return the body; the title is the status's own phrase."""
    return Problem(
        type=f"urn:navdeck:problem:{code}",
        title=HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        code=code,
        remedy=remedy,
        errors=errors,
    )


def problem_response(body: Problem, headers: Mapping[str, str] | None = None) -> Response:
    """Return the body as a response."""
    return Response(body.model_dump_json(), body.status, dict(headers or {}), MEDIA_TYPE)


async def refuse(
    body: Problem, scope: Scope, receive: Receive, send: Send, headers: Mapping[str, str] | None = None
) -> None:
    """Answer a request, or the handshake of a WebSocket, with the problem."""
    if scope["type"] == "websocket":
        await receive()  # the handshake
        if "websocket.http.response" not in scope.get("extensions", {}):
            await send({"type": "websocket.close", "code": 1008, "reason": body.code})
            return
    await problem_response(body, headers)(scope, receive, send)

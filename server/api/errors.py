"""Every error of the API leaves as one body: `Problem` (RFC 9457)."""

from __future__ import annotations

import logging
from typing import Final, TypeVar

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from server.commands import Refusal, RefusalKind
from server.problems import problem, problem_response, refuse
from server.wire_base import Problem, ProblemError

T = TypeVar("T")
log = logging.getLogger("navdeck.api")
STATUS: Final = {RefusalKind.INVALID: 422, RefusalKind.MISSING: 404, RefusalKind.CONFLICT: 409}
CODES: Final = {404: "not-found", 405: "method-not-allowed"}
REMEDIES: Final = {404: "/docs lists every address.", 405: "See the Allow header for what may be asked here."}
SHOWN: Final = 200  # characters of an offending value that are sent back


class ApiError(Exception):
    """A request that cannot be met."""

    def __init__(self, status: int, code: str, detail: str, remedy: str = "") -> None:
        super().__init__(detail)
        self.problem = problem(status, code, detail, remedy)


def error_from_refusal(refusal: Refusal) -> ApiError:
    """Return the error that says what a command's refusal says."""
    error = ApiError(STATUS[refusal.kind], refusal.code, refusal.detail, refusal.remedy)
    if refusal.name:
        offending = ProblemError(name=refusal.name, value=refusal.value[:SHOWN], detail=refusal.detail)
        error.problem = error.problem.model_copy(update={"errors": (offending,)})
    return error


def granted(reply: T | Refusal) -> T:
    """Return what a command answered.

    Raises:
        ApiError: it was refused.
    """
    if isinstance(reply, Refusal):
        raise error_from_refusal(reply)
    return reply


def problem_from_validation(error: RequestValidationError) -> Problem:
    """Return a 422 that names every offending value, its limit, and what to do."""
    errors = tuple(
        ProblemError(
            name=".".join(str(part) for part in one["loc"] if part not in {"body", "query", "path"}) or "body",
            value=repr(one.get("input"))[:SHOWN],
            detail=str(one["msg"]),
        )
        for one in error.errors()
    )
    detail = "; ".join(f"{one.name} = {one.value}: {one.detail}" for one in errors)
    return problem(422, "invalid-value", detail, "Correct these values; /docs has their limits.", errors)


def install_errors(app: FastAPI) -> None:
    """Have every exception of the app answered with a Problem, and so every address that does not exist."""

    @app.exception_handler(ApiError)
    async def api_error(_request: Request, error: ApiError) -> Response:
        return problem_response(error.problem)

    @app.exception_handler(RequestValidationError)
    async def validation_error(_request: Request, error: RequestValidationError) -> Response:
        return problem_response(problem_from_validation(error))

    @app.exception_handler(HTTPException)
    async def http_error(request: Request, error: HTTPException) -> Response:
        status = error.status_code
        body = problem(
            status, CODES.get(status, "http-error"), f"{request.url.path}: {error.detail}", REMEDIES.get(status, "")
        )
        return problem_response(body, error.headers)

    @app.exception_handler(Exception)
    async def any_error(request: Request, error: Exception) -> Response:
        log.error("%s %s failed", request.method, request.url.path, exc_info=error)
        remedy = "Try again; if it fails again, please report this with the log."
        return problem_response(problem(500, "internal-error", "The service failed on this request.", remedy))


async def no_such_socket(scope: Scope, receive: Receive, send: Send) -> None:
    """Refuse a WebSocket at an address that has none."""
    detail = f"There is no WebSocket at {scope['path']}."
    await refuse(problem(404, "not-found", detail, "It is at /api/v1/stream."), scope, receive, send)

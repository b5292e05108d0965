"""The ASGI application of the API and the page, without the door in front of it."""

from __future__ import annotations

from typing import Any, Final

from fastapi import APIRouter, FastAPI
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.api import boards, calibration_sets, calibrations, docs, preprocessing, service, simulator
from server.api.context import Context
from server.api.errors import install_errors
from server.api.openapi import openapi_of
from server.api.pages import page_or_404
from server.wire_base import Problem

RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    code: {"model": Problem} for code in (401, 403, 413, 422, 429, 500)
}


class HeadAsGet:
    """ASGI middleware: HEAD is answered as GET would be, without the body (RFC 9110, section 9.3.2)."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass everything else on as it is."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return

        async def without_body(message: Message) -> None:
            await send({**message, "body": b""} if message["type"] == "http.response.body" else message)

        await self._app({**scope, "method": "GET"}, receive, without_body)


def make_app(context: Context, *more: APIRouter) -> FastAPI:
    """Return the application; `more` are routers of the other consumers (live, view3d)."""
    app = FastAPI(
        title="navdeck",
        version=context.version,
        description="Live navigation from a flight board.",
        docs_url=None,
        redoc_url=None,
        responses=RESPONSES,
        redirect_slashes=False,
    )
    app.state.context = context
    app.add_middleware(HeadAsGet)
    install_errors(app)
    calibrating = (calibrations.router, calibration_sets.router, preprocessing.router, simulator.router)
    for router in (service.router, service.ops_router, boards.router, *calibrating, docs.router, *more):
        app.include_router(router)
    app.router.default = page_or_404
    app.openapi = lambda: openapi_of(app)  # type: ignore[method-assign]  # FastAPI's own way to extend the schema
    return app

"""The ASGI application of the API and the page, without the door in front of it."""

from __future__ import annotations

from typing import Any, Final

from fastapi import APIRouter, FastAPI

from server.api import boards, docs, service
from server.api.context import Context
from server.api.errors import install_errors
from server.api.openapi import openapi_of
from server.api.pages import page_or_404
from server.wire_base import Problem

RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    code: {"model": Problem} for code in (401, 403, 413, 422, 429, 500)
}


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
    install_errors(app)
    for router in (service.router, service.ops_router, boards.router, docs.router, *more):
        app.include_router(router)
    app.router.default = page_or_404
    app.openapi = lambda: openapi_of(app)  # type: ignore[method-assign]  # FastAPI's own way to extend the schema
    return app

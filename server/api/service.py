"""The service itself: who is asking, sessions, ports, settings, doctor; liveness, readiness and metrics."""

from __future__ import annotations

import asyncio
import time

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from server.api.context import ContextDep, RoleDep
from server.api.errors import ApiError
from server.door import cookie_name, cookie_value
from server.keyring import SESSION_S
from server.problems import problem, problem_response
from server.wire_base import Problem
from server.wire_service import DoctorOut, InfoOut, PortsOut, SessionIn, SessionOut, SettingsOut

router = APIRouter(prefix="/api/v1", tags=["service"])
ops_router = APIRouter(tags=["operation"])


@router.get("/info")
async def get_info(context: ContextDep, role: RoleDep) -> InfoOut:
    """Return what this service is and what the asker may do."""
    return InfoOut(
        version=context.version,
        role=role or "viewer",
        auth_required=not context.keyring.is_open,
        view3d=context.view3d,
        uptime_s=time.monotonic() - context.started_s,
        ready=context.ready,
    )


@router.post("/session", responses={429: {"model": Problem}})
async def open_session(body: SessionIn, context: ContextDep, request: Request, response: Response) -> SessionOut:
    """Exchange a token for a cookie that no script can read; the token itself is not kept by the browser."""
    address = request.client.host if request.client is not None else ""
    if context.keyring.is_open:
        return SessionOut(role="operator", expires_s=SESSION_S)
    if context.keyring.wait_s(address) > 0.0:
        raise ApiError(429, "too-many-guesses", "Too many wrong tokens came from this address.", "Wait a minute.")
    role = context.keyring.role_of_token(body.token, address)
    if role is None:
        raise ApiError(401, "wrong-token", "This token is not known here.", "Ask who started the service for it.")
    response.set_cookie(
        cookie_name(request.headers.get("host", "")),
        context.keyring.open_session(role),
        max_age=int(SESSION_S),
        httponly=True,
        samesite="strict",
        secure=request.url.scheme == "https",
    )
    return SessionOut(role=role, expires_s=SESSION_S)


@router.delete("/session", status_code=204)
async def close_session(context: ContextDep, request: Request, response: Response) -> None:
    """Forget the cookie, here and in the browser."""
    context.keyring.close_session(cookie_value(request.headers))
    response.delete_cookie(cookie_name(request.headers.get("host", "")), httponly=True, samesite="strict")


@router.get("/ports")
async def list_ports(context: ContextDep) -> PortsOut:
    """Return the serial ports of this machine and why each one cannot be used."""
    return PortsOut(ports=tuple(await asyncio.to_thread(context.list_ports)))


@router.get("/settings")
async def get_settings(context: ContextDep) -> SettingsOut:
    """Return every setting with its unit, default and where its value came from; secrets are hidden."""
    return context.settings


@router.get("/doctor")
async def get_doctor(context: ContextDep) -> DoctorOut:
    """Return what is wrong with this set-up and what to do about it."""
    return await asyncio.to_thread(context.doctor)


@ops_router.get("/healthz")
async def get_liveness() -> dict[str, str]:
    """Answer as long as the process lives."""
    return {"status": "alive"}


@ops_router.get("/readyz", responses={503: {"model": Problem}}, response_model=dict[str, str])
async def get_readiness(context: ContextDep) -> Response | dict[str, str]:
    """Answer 200 once kernels are loaded and the boards were started; a board without data is no reason against."""
    if context.ready:
        return {"status": "ready"}
    return problem_response(problem(503, "not-ready", "The kernels are still being loaded.", "Ask again in a second."))


@ops_router.get("/metrics", response_class=Response)
async def get_metrics(context: ContextDep) -> Response:
    """Return the metrics in Prometheus' text format."""
    return Response(generate_latest(context.registry), media_type=CONTENT_TYPE_LATEST)

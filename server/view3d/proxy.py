"""/view/ on our own port: viser's client as a page, and its socket passed through with a guard at the door."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

import msgspec
from fastapi import APIRouter, Request, Response, WebSocket
from starlette.responses import RedirectResponse
from starlette.websockets import WebSocketDisconnect
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from server.problems import problem, refuse
from server.view3d.guard import CameraReport, admit
from server.view3d.page import CSP, SOCKET_PATH, ViewPage, build_page
from server.view3d.view import HOP_BUFFER_BYTES, MAX_VIEWERS, View3D
from server.view3d.viewer import Viewer, Wishes

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

SEND_TIMEOUT_S: Final = 5.0
"""A browser that takes nothing for this long is gone; until then viser waits and merges, so memory stays flat."""

ROLES: Final = frozenset({"viewer", "operator"})
POLICY_VIOLATION, TRY_AGAIN = 1008, 1013


def router(view: View3D) -> APIRouter:
    """Return the routes `/view` and `/view/`; the page is built at the first request."""
    routes = APIRouter(include_in_schema=False)
    pages: list[ViewPage] = []

    @routes.get(SOCKET_PATH)
    async def to_page(request: Request) -> Response:
        query = f"?{request.url.query}" if request.url.query else ""
        return RedirectResponse(f"{SOCKET_PATH}/{query}", status_code=307)

    @routes.get(f"{SOCKET_PATH}/")
    async def page(request: Request) -> Response:
        if not pages:
            pages.append(await asyncio.to_thread(build_page, view.client_html))
        return _respond(pages[0], request.headers)

    @routes.websocket(SOCKET_PATH)
    @routes.websocket(f"{SOCKET_PATH}/")
    async def socket(ws: WebSocket) -> None:
        await _serve(view, ws)

    return routes


def _respond(page: ViewPage, headers: Mapping[str, str]) -> Response:
    common = {
        "ETag": page.etag,
        "Cache-Control": "no-cache",
        "Vary": "Accept-Encoding",
        "Content-Security-Policy": CSP,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
    }
    if headers.get("if-none-match") == page.etag:
        return Response(status_code=304, headers=common)
    if "gzip" in headers.get("accept-encoding", ""):
        return Response(page.gzipped, media_type="text/html", headers={**common, "Content-Encoding": "gzip"})
    return Response(page.html, media_type="text/html", headers=common)


def same_origin(headers: Mapping[str, str]) -> bool:
    """True when the request comes from our own page, or from something that is not a browser (no Origin)."""
    origin = headers.get("origin")
    return origin is None or urlsplit(origin).netloc == headers.get("host")


def _allowed(ws: WebSocket) -> bool:
    role = (ws.scope.get("state") or {}).get("role")
    return same_origin(ws.headers) and (role is None or role in ROLES)


def viser_protocol() -> str:
    """Return the subprotocol that viser's client of this version asks for."""
    import viser

    return f"viser-v{viser.__version__}"


def _wishes(ws: WebSocket) -> Wishes:
    """Return what the query asks for; what does not make sense falls back to the defaults."""
    fields = {key: ws.query_params[key] for key in Wishes.__struct_fields__ if key in ws.query_params}
    try:
        return msgspec.convert(fields, Wishes)
    except msgspec.ValidationError:
        return Wishes(board=ws.query_params.get("board", ""))


async def _serve(view: View3D, ws: WebSocket) -> None:
    protocol, upstream_url = viser_protocol(), view.upstream_url
    if not _allowed(ws):
        await ws.close(POLICY_VIOLATION)
    elif protocol not in ws.scope.get("subprotocols", []):
        detail = f"This WebSocket speaks {protocol} only, and the client did not offer that subprotocol."
        body = problem(400, "subprotocol-needed", detail, "Load the 3D view again, at /view/ of this service.")
        await refuse(body, ws.scope, ws.receive, ws.send)
    elif upstream_url is None or view.viewers >= MAX_VIEWERS:
        await ws.close(TRY_AGAIN)
    else:
        await _pass_through(view, ws, upstream_url, protocol)


async def _pass_through(view: View3D, ws: WebSocket, upstream_url: str, protocol: str) -> None:
    async with connect(
        upstream_url,
        subprotocols=[Subprotocol(protocol)],
        compression=None,
        ping_interval=None,
        max_size=None,
        max_queue=4,  # then viser is not read, and merges what it has not sent
        close_timeout=1.0,  # a stuck viewer's queue stands before viser's farewell
        proxy=None,
        sock=_upstream_socket(upstream_url),
    ) as upstream:
        await ws.accept(subprotocol=protocol)
        with view.session(_wishes(ws), upstream.local_address[1]) as viewer:
            await _pump(view, viewer, ws, upstream)
    await _close(ws)


async def _pump(view: View3D, viewer: Viewer, ws: WebSocket, upstream: ClientConnection) -> None:
    """Pass messages both ways until either side ends."""
    ways = [asyncio.create_task(_down(upstream, ws)), asyncio.create_task(_up(view, viewer, ws, upstream))]
    try:
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)


def _upstream_socket(url: str) -> socket.socket:
    """Return a socket connected to viser that takes little in advance: set before connecting, or it has no effect."""
    raw = socket.socket()
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, HOP_BUFFER_BYTES)
    raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    raw.connect((urlsplit(url).hostname, urlsplit(url).port))  # loopback: at once, or refused
    raw.setblocking(False)
    return raw


async def _down(upstream: ClientConnection, ws: WebSocket) -> None:
    """Pass viser's messages on in step: nothing is queued here, so nothing can pile up or be lost."""
    try:
        async for message in upstream:
            async with asyncio.timeout(SEND_TIMEOUT_S):
                await ws.send_bytes(message if isinstance(message, bytes) else message.encode())
    except (ConnectionClosed, WebSocketDisconnect, TimeoutError, RuntimeError):
        return


async def _up(view: View3D, viewer: Viewer, ws: WebSocket, upstream: ClientConnection) -> None:
    """Pass cameras on to viser, do what commands ask, drop the rest."""
    try:
        while (event := await ws.receive())["type"] == "websocket.receive":
            data = event.get("bytes") or b""
            message = admit(data)
            if isinstance(message, CameraReport):
                await upstream.send(data)
            elif message is not None:
                view.command(viewer, message)
    except (ConnectionClosed, WebSocketDisconnect):
        return


async def _close(ws: WebSocket) -> None:
    try:
        async with asyncio.timeout(1.0):
            await ws.close()
    except (RuntimeError, TimeoutError, WebSocketDisconnect):
        return  # it was gone already

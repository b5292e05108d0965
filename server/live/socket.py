"""The WebSocket /api/v1/stream: one reader and one sender for each client."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Final

from fastapi import APIRouter, WebSocket
from pydantic import TypeAdapter, ValidationError
from starlette.websockets import WebSocketDisconnect

from server.live.live import Live
from server.live.outbox import FloodedError, Outbox
from server.problems import problem, refuse
from server.wire_base import Problem
from server.wire_stream import PingIn, PongOut, StreamErrorOut, StreamIn, SubscribeIn

router = APIRouter()
SUBPROTOCOL: Final = "navdeck.v1"
SEND_TIMEOUT_S: Final = 5.0
MAX_REQUEST_CHARS: Final = 4096
TOO_FAST: Final = 1008  # policy violation
_stream_in: TypeAdapter[StreamIn] = TypeAdapter(StreamIn)


@router.websocket("/api/v1/stream")
async def stream(websocket: WebSocket) -> None:
    """Serve one client until either side ends; a client that does not read for five seconds is disconnected."""
    live: Live = websocket.app.state.live
    outbox = Outbox()
    if not live.join(outbox):
        body = problem(503, "too-many-clients", "Too many pages are connected.", "Close one and load this again.")
        await refuse(body, websocket.scope, websocket.receive, websocket.send)
        return
    try:
        await websocket.accept(SUBPROTOCOL if SUBPROTOCOL in websocket.scope["subprotocols"] else None)
        sending = asyncio.create_task(_send(websocket, outbox))
        receiving = asyncio.create_task(_receive(websocket, outbox, live))
        done, pending = await asyncio.wait({sending, receiving}, return_when=asyncio.FIRST_COMPLETED)
        live.dropped_total += sending in done and isinstance(sending.exception(), TimeoutError)
        for task in pending:
            task.cancel()
        await asyncio.gather(sending, receiving, return_exceptions=True)
        await _say_why(websocket, [task.exception() for task in done])
    finally:
        live.leave(outbox)


async def _say_why(websocket: WebSocket, errors: list[BaseException | None]) -> None:
    """Close with a reason, as far as the client still listens; what is unknown here is raised."""
    for error in errors:
        if isinstance(error, FloodedError):
            with contextlib.suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
                async with asyncio.timeout(1.0):
                    await websocket.close(TOO_FAST, "asked faster than read")
        elif error is not None and not isinstance(error, TimeoutError | WebSocketDisconnect):
            raise error


async def _send(websocket: WebSocket, outbox: Outbox) -> None:
    loop = asyncio.get_running_loop()
    while True:
        message = await outbox.pop()
        async with asyncio.timeout_at(loop.time() + SEND_TIMEOUT_S):
            if isinstance(message, bytes):
                await websocket.send_bytes(message)
            else:
                await websocket.send_text(message)


async def _receive(websocket: WebSocket, outbox: Outbox, live: Live) -> None:
    while True:
        message = await websocket.receive()
        if message["type"] == "websocket.disconnect":
            return
        _handle(message.get("text"), outbox, live)


def _handle(text: str | None, outbox: Outbox, live: Live) -> None:
    """Carry out one request; what cannot be understood is answered, not punished."""
    if text is None or len(text) > MAX_REQUEST_CHARS:
        detail = f"A request is a text of at most {MAX_REQUEST_CHARS} characters."
        outbox.reply(_error(problem(413, "bad-request", detail, "Send subscribe, unsubscribe or ping as JSON.")))
        return
    try:
        wish = _stream_in.validate_json(text)
    except ValidationError as error:
        outbox.reply(_error(_problem_of(error)))
        return
    if isinstance(wish, SubscribeIn):
        answer = live.subscribe(outbox, wish)
        if isinstance(answer, StreamErrorOut):
            outbox.reply(answer.model_dump_json())
    elif isinstance(wish, PingIn):
        outbox.reply(PongOut(t=wish.t).model_dump_json())
    else:
        live.unsubscribe(outbox, wish.id)


def _error(body: Problem) -> str:
    return StreamErrorOut(id=0, problem=body).model_dump_json()


def _problem_of(error: ValidationError) -> Problem:
    parts = (f"{'.'.join(map(str, one['loc'])) or 'message'}: {one['msg']}" for one in error.errors())
    return problem(422, "invalid-value", "; ".join(parts)[:500], 'As in {"op":"subscribe","id":1,"topic":"boards"}.')

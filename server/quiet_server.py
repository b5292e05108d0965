"""uvicorn as this service runs it: one socket of ours, no compression, its own words kept to what a person needs."""

from __future__ import annotations

import contextlib
import logging
import socket
from collections.abc import Callable, Iterator
from typing import Any, Final

import uvicorn

STOP_S: Final = 3  # how long open requests may take to end


class QuietServer(uvicorn.Server):
    """uvicorn that says when it listens."""

    def __init__(self, app: Any, on_started: Callable[[], None]) -> None:  # noqa: ANN401  # uvicorn's own
        config = uvicorn.Config(
            app,
            lifespan="off",
            log_config=None,
            access_log=False,
            server_header=False,
            proxy_headers=False,
            ws="websockets-sansio",
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=STOP_S,
        )
        super().__init__(config)
        self._on_started = on_started
        logging.getLogger("uvicorn.error").addFilter(_not_a_refusal)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Take signals as wishes to stop, and do not raise them again: a stop that was asked for has status 0."""
        with super().capture_signals():
            yield
            self._captured_signals.clear()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Listen, and say so."""
        await super().startup(sockets)
        self._on_started()


def _not_a_refusal(record: logging.LogRecord) -> bool:
    """Drop what uvicorn 0.54 says of every WebSocket that was refused with an HTTP answer, as if that were a fault."""
    return "without completing handshake" not in record.msg

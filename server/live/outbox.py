"""What waits to be sent to one client: a slow client loses its own oldest data, nobody else's."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Final

MAX_DATA: Final = 2048  # messages, some seconds of everything; the oldest is dropped and counted
MAX_REPLIES: Final = 64  # answers that a client does not read; when full it is disconnected

Message = str | bytes


class FloodedError(Exception):
    """The client asks faster than it reads the answers."""


class Outbox:
    """Replies first and never dropped, then data, oldest first."""

    def __init__(self) -> None:
        self._replies: deque[Message] = deque()
        self._data: deque[Message] = deque(maxlen=MAX_DATA)
        self._ready = asyncio.Event()
        self.lost = 0

    def reply(self, message: Message) -> None:
        """Queue an answer; `FloodedError` when too many wait."""
        if len(self._replies) >= MAX_REPLIES:
            raise FloodedError
        self._replies.append(message)
        self._ready.set()

    def offer(self, message: Message) -> None:
        """Queue data, dropping the oldest when full."""
        self.lost += len(self._data) == MAX_DATA
        self._data.append(message)
        self._ready.set()

    async def pop(self) -> Message:
        """Return the next message, as soon as there is one: a reply if any waits, else the oldest data."""
        while True:
            if self._replies:
                return self._replies.popleft()
            if self._data:
                return self._data.popleft()
            self._ready.clear()
            await self._ready.wait()

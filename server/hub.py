"""Bounded fan-out: a publisher never waits, a slow reader loses its own oldest items and can see how many."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

from server.link.base import Chunk
from server.nav.types import Event, StepResult

T = TypeVar("T")


class Subscription(Generic[T]):
    """One reader's queue; holds the newest `maxlen` items and counts those it lost."""

    def __init__(self, topic: Topic[T], maxlen: int) -> None:
        self._topic = topic
        self._items: deque[T] = deque(maxlen=maxlen)
        self._ready = asyncio.Event()
        self.lost = 0

    def offer(self, item: T) -> None:
        """Append, dropping the oldest item when full."""
        self.lost += len(self._items) == self._items.maxlen
        self._items.append(item)
        self._ready.set()

    def drain(self) -> list[T]:
        """Return and forget everything queued, oldest first, without waiting."""
        items = list(self._items)
        self._items.clear()
        self._ready.clear()
        return items

    async def wait(self) -> list[T]:
        """Return everything queued, oldest first, as soon as there is something."""
        await self._ready.wait()
        return self.drain()

    async def __aiter__(self) -> AsyncIterator[T]:
        while True:
            for item in await self.wait():
                yield item

    def close(self) -> None:
        """Stop receiving."""
        self._topic.leave(self)


class Topic(Generic[T]):
    """One stream of items; publish from the event loop's thread only."""

    def __init__(self) -> None:
        self._readers: set[Subscription[T]] = set()

    @property
    def readers(self) -> int:
        """How many are subscribed: who publishes may skip work nobody sees."""
        return len(self._readers)

    def publish(self, item: T) -> None:
        """Hand the item to every reader; never blocks."""
        for reader in self._readers:
            reader.offer(item)

    def subscribe(self, maxlen: int) -> Subscription[T]:
        """Return a new reader's queue; when full it drops its own oldest items."""
        reader = Subscription(self, maxlen)
        self._readers.add(reader)
        return reader

    def leave(self, reader: Subscription[T]) -> None:
        """Forget a reader; a second call does nothing."""
        self._readers.discard(reader)


@dataclass(frozen=True, slots=True, kw_only=True)
class EventRecord:
    """An event of the engine, the board, the link or the server, with the order and host time of its arrival."""

    seq: int
    t_host_ns: int
    source: Literal["engine", "board", "link", "server"]
    event: Event


class Hub:
    """The topics of one board."""

    def __init__(self) -> None:
        self.chunks: Topic[Chunk] = Topic()  # before decoding, so that a recording holds the damage too
        self.results: Topic[StepResult] = Topic()
        self.events: Topic[EventRecord] = Topic()

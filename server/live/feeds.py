"""Feeds: one for each topic and rate that anybody wants, so that rows are packed once however many look."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final

from server.board import Board
from server.live.outbox import Outbox
from server.nav.types import StepResult
from server.rows import MAX_ROWS, RowTopic, Table, Thinner, merged, message, packed
from server.views import event_out

QUEUED_RESULTS: Final = 256  # results a pump may fall behind; then it loses the oldest
AS_NATIVE: Final = 0.95  # a rate of this share of the topic's own means every row

Reader = tuple[Outbox, int]
"""A client's outbox and the id under which it subscribed."""


class RowFeed:
    """Rows of one topic at one rate, to every reader."""

    def __init__(
        self, name: str, topic: RowTopic, rate_hz: float, native_rate_hz: Callable[[str], float | None]
    ) -> None:
        self.readers: set[Reader] = set()
        self.name = name
        self.rate_hz = rate_hz
        self._topic = topic
        self._native_rate_hz = native_rate_hz
        self._thinner = Thinner(rate_hz, topic.group)
        self._boot_id = -1

    def push(self, result: StepResult) -> None:
        """Send what this result holds of the topic."""
        boot_id = result.boot_id
        if boot_id != self._boot_id:
            self._boot_id, self._thinner = boot_id, Thinner(self.rate_hz, self._topic.group)
        table = self._topic.extract(result)
        if table is not None and not self._wants_all():
            table = self._thinner.thin(table)
        if table is not None:
            self._send(table, boot_id)

    def _wants_all(self) -> bool:
        native_hz = self._native_rate_hz(self.name)
        return native_hz is None or self.rate_hz >= AS_NATIVE * native_hz

    def _send(self, table: Table, boot_id: int) -> None:
        for start in range(0, table.t_ns.size, MAX_ROWS):
            part = Table(table.t_ns[start : start + MAX_ROWS], table.data[start : start + MAX_ROWS])
            body = packed(part)
            for outbox, stream_id in self.readers:
                outbox.offer(message(stream_id, boot_id, part.data.shape[0], part.data.shape[1], body))


class JsonFeed:
    """A body rendered once a period, to every reader."""

    def __init__(self, render: Callable[[], str], rate_hz: float) -> None:
        self.readers: set[Reader] = set()
        self._render = render
        self._period_s = 1.0 / rate_hz

    async def run(self) -> None:
        """Send until cancelled; the first at once."""
        while True:
            self.send(self._render())
            await asyncio.sleep(self._period_s)

    def send(self, body: str) -> None:
        """Send a body that is JSON already."""
        for outbox, stream_id in self.readers:
            outbox.offer(data_message(stream_id, body))

    def greet(self, reader: Reader) -> None:
        """Send the newest to a reader that comes while the feed runs, so that it need not wait for the period."""
        reader[0].offer(data_message(reader[1], self._render()))


class EventFeed:
    """Events of one board as they happen, to every reader."""

    def __init__(self, board: Board) -> None:
        self.readers: set[Reader] = set()
        self._subscription = board.hub.events.subscribe(maxlen=256)

    async def run(self) -> None:
        """Send until cancelled."""
        try:
            async for record in self._subscription:
                body = event_out(record, record.t_host_ns).model_dump_json()
                for outbox, stream_id in self.readers:
                    outbox.offer(data_message(stream_id, body))
        finally:
            self._subscription.close()


class Pump:
    """The row feeds of one board, fed by one task."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self.feeds: dict[tuple[str, float], RowFeed] = {}

    def feed(self, name: str, rate_hz: float) -> RowFeed:
        """Return the feed of this topic at this rate; made when it is the first time."""
        key = (name, rate_hz)
        if key not in self.feeds:
            self.feeds[key] = RowFeed(name, self.board.topics[name], rate_hz, self.board.history.native_rate_hz)
        return self.feeds[key]

    async def run(self) -> None:
        """Send until cancelled."""
        subscription = self.board.hub.results.subscribe(QUEUED_RESULTS)
        try:
            while True:
                for results in _by_boot(await subscription.wait()):
                    whole = merged(results)
                    for feed in tuple(self.feeds.values()):
                        feed.push(whole)
        finally:
            subscription.close()


def _by_boot(results: list[StepResult]) -> list[list[StepResult]]:
    """Split where a new power-up begins; usually nowhere."""
    parts: list[list[StepResult]] = []
    for result in results:
        if not parts or parts[-1][0].boot_id != result.boot_id:
            parts.append([])
        parts[-1].append(result)
    return parts


def data_message(stream_id: int, body: str) -> str:
    """Return a message of a JSON topic around a body that was rendered once for all."""
    return f'{{"op":"data","id":{stream_id},"data":{body}}}'

"""Subscriptions of all clients: which feeds run, who reads them, and the tick that proves the socket alive."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine
from typing import Any, Final, NamedTuple

from server.board import Board
from server.boards import Boards
from server.lane_commands import not_running
from server.live.feeds import EventFeed, JsonFeed, Pump, Reader, RowFeed
from server.live.outbox import Outbox
from server.problems import problem
from server.rows import lane_of
from server.views import board_out, health_out
from server.wire import BoardsOut
from server.wire_base import Problem
from server.wire_stream import StreamErrorOut, SubscribedOut, SubscribeIn, TickOut

TICK_S: Final = 0.8  # a client takes silence of more than a second for a broken socket
JSON_MAX_HZ: Final = 2.0
CALIBRATION_MAX_HZ: Final = 5.0  # a person turns a board and looks at what it does
ROWS_DEFAULT_HZ: Final = 10.0
MAX_CLIENTS: Final = 64

JSON_TOPICS: Final = {"health": JSON_MAX_HZ, "calibration": CALIBRATION_MAX_HZ}

AnyFeed = RowFeed | JsonFeed | EventFeed


class Subscribed(NamedTuple):
    """A client's subscription."""

    feed: AnyFeed
    board_id: str  # "" for the list of boards
    silent: bool = False  # the client was told that this lane does not run


class Live:
    """All clients of the stream; nothing runs for a topic nobody wants."""

    def __init__(self, boards: Boards, calibration_of: Callable[[str], str] = lambda _board_id: "null") -> None:
        self._boards = boards
        self._calibration_of = calibration_of
        self._group: asyncio.TaskGroup | None = None
        self._clients: dict[Outbox, dict[int, Subscribed]] = {}
        self._json: dict[tuple[str, float], JsonFeed] = {}
        self._events: dict[str, EventFeed] = {}
        self._pumps: dict[str, Pump] = {}
        self._tasks: dict[object, asyncio.Task[None]] = {}
        self._started_ns = time.monotonic_ns()
        self.lost_total = 0  # messages lost by clients that are gone
        self.dropped_total = 0  # clients disconnected because they did not read
        boards.on_removed.append(self._forget_board)
        boards.on_lanes.append(self._tell_lanes)

    def start(self, group: asyncio.TaskGroup) -> None:
        """Run the feeds in this task group."""
        self._group = group
        self._start(self, self._tick_forever())

    def stop(self) -> None:
        """Cancel every feed; the task group waits for them."""
        for task in self._tasks.values():
            task.cancel()

    @property
    def clients(self) -> int:
        """How many are connected."""
        return len(self._clients)

    @property
    def lost(self) -> int:
        """Messages lost by slow clients, since the start."""
        return self.lost_total + sum(outbox.lost for outbox in self._clients)

    def join(self, outbox: Outbox) -> bool:
        """Take a client in; False when there are too many."""
        if len(self._clients) >= MAX_CLIENTS:
            return False
        self._clients[outbox] = {}
        return True

    def leave(self, outbox: Outbox) -> None:
        """Forget a client and stop the feeds only it had."""
        for stream_id in tuple(self._clients.get(outbox, ())):
            self.unsubscribe(outbox, stream_id)
        if self._clients.pop(outbox, None) is not None:
            self.lost_total += outbox.lost

    def subscribe(self, outbox: Outbox, wish: SubscribeIn) -> SubscribedOut | StreamErrorOut:
        """Begin a subscription; one with the same id ends. The answer is queued before the first data."""
        self.unsubscribe(outbox, wish.id)
        head, _, rest = wish.topic.partition("/")
        if wish.topic == "boards":
            return self._join_json(outbox, wish, "")
        board_id, _, name = rest.partition("/")
        board = self._boards.get(board_id)
        if head != "boards" or board is None:
            return StreamErrorOut(id=wish.id, problem=self._no_topic(wish.topic))
        if name in JSON_TOPICS:
            return self._join_json(outbox, wish, board.id, name)
        if name == "events":
            return self._join_events(outbox, wish, board)
        if name in board.topics:
            return self._join_rows(outbox, wish, board, name)
        return StreamErrorOut(id=wish.id, problem=self._no_topic(wish.topic))

    def unsubscribe(self, outbox: Outbox, stream_id: int) -> None:
        """End a subscription; an unknown one is ignored."""
        subscribed = self._clients.get(outbox, {}).pop(stream_id, None)
        if subscribed is not None:
            subscribed.feed.readers.discard((outbox, stream_id))
            self._sweep(subscribed)

    def _join_json(self, outbox: Outbox, wish: SubscribeIn, board_id: str, name: str = "") -> SubscribedOut:
        rate_hz = min(wish.rate_hz or JSON_MAX_HZ, JSON_TOPICS.get(name, JSON_MAX_HZ))
        answer = SubscribedOut(id=wish.id, topic=wish.topic, columns=None, rate_hz=rate_hz)
        outbox.reply(answer.model_dump_json())
        key, reader = (wish.topic, rate_hz), (outbox, wish.id)
        feed = self._json.get(key)
        if feed is None:
            feed = self._json[key] = JsonFeed(self._render(board_id, name), rate_hz)
            self._enter(feed, reader, board_id)
            self._start(feed, feed.run())
        else:
            self._enter(feed, reader, board_id)
            feed.greet(reader)
        return answer

    def _join_events(self, outbox: Outbox, wish: SubscribeIn, board: Board) -> SubscribedOut:
        answer = SubscribedOut(id=wish.id, topic=wish.topic, columns=None, rate_hz=wish.rate_hz or 0.0)
        outbox.reply(answer.model_dump_json())
        if board.id not in self._events:
            self._events[board.id] = EventFeed(board)
            self._start(self._events[board.id], self._events[board.id].run())
        self._enter(self._events[board.id], (outbox, wish.id), board.id)
        return answer

    def _join_rows(self, outbox: Outbox, wish: SubscribeIn, board: Board, name: str) -> SubscribedOut | StreamErrorOut:
        """A lane that does not run is an error now, and gives rows as soon as it is chosen."""
        rate_hz = wish.rate_hz or ROWS_DEFAULT_HZ
        answer = _row_answer(board, name, wish.id, rate_hz)
        if isinstance(answer, SubscribedOut):
            outbox.reply(answer.model_dump_json())
        if board.id not in self._pumps:
            self._pumps[board.id] = Pump(board)
            self._start(self._pumps[board.id], self._pumps[board.id].run())
        silent = isinstance(answer, StreamErrorOut)
        self._enter(self._pumps[board.id].feed(name, rate_hz), (outbox, wish.id), board.id, silent=silent)
        return answer

    def _enter(self, feed: AnyFeed, reader: Reader, board_id: str, *, silent: bool = False) -> None:
        feed.readers.add(reader)
        self._clients[reader[0]][reader[1]] = Subscribed(feed, board_id, silent)

    def _tell_lanes(self, board: Board) -> None:
        """Tell the readers of a lane that it was switched on or off; their subscriptions stay."""
        for outbox, subscriptions in self._clients.items():
            for stream_id, (feed, board_id, silent) in tuple(subscriptions.items()):
                if board_id == board.id and isinstance(feed, RowFeed):
                    answer = _row_answer(board, feed.name, stream_id, feed.rate_hz)
                    if isinstance(answer, StreamErrorOut) is not silent:
                        subscriptions[stream_id] = Subscribed(feed, board_id, not silent)
                        outbox.offer(answer.model_dump_json())

    def _sweep(self, subscribed: Subscribed) -> None:
        """Stop a feed that nobody reads any more, and the pump of a board without feeds."""
        feed, board_id, _ = subscribed
        if feed.readers:
            return
        if isinstance(feed, RowFeed):
            pump = self._pumps[board_id]
            pump.feeds = {key: known for key, known in pump.feeds.items() if known is not feed}
            if not pump.feeds:
                self._end(self._pumps.pop(board_id))
        elif isinstance(feed, JsonFeed):
            self._json = {key: known for key, known in self._json.items() if known is not feed}
            self._end(feed)
        else:
            self._end(self._events.pop(board_id))

    def _forget_board(self, board_id: str) -> None:
        """End every subscription to a board that was removed, and say so."""
        detail, remedy = f"Board {board_id} was removed.", "GET /api/v1/boards lists those that remain."
        for outbox, subscriptions in self._clients.items():
            for stream_id in [key for key, subscribed in subscriptions.items() if subscribed.board_id == board_id]:
                self.unsubscribe(outbox, stream_id)
                told = StreamErrorOut(id=stream_id, problem=problem(404, "board-removed", detail, remedy))
                outbox.offer(told.model_dump_json())

    def _all_boards(self) -> str:
        return BoardsOut(boards=tuple(board_out(board.view()) for board in self._boards)).model_dump_json()

    def _render(self, board_id: str, name: str) -> Callable[[], str]:
        if not board_id:
            return self._all_boards
        return self._health_of(board_id) if name == "health" else lambda: self._calibration_of(board_id)

    def _health_of(self, board_id: str) -> Callable[[], str]:
        def render() -> str:
            board = self._boards.get(board_id)
            return health_out(board.view()).model_dump_json() if board is not None else "null"

        return render

    def _no_topic(self, topic: str) -> Problem:
        names = (*JSON_TOPICS, "events")
        known = ["boards", *(f"boards/{b.id}/{name}" for b in self._boards for name in (*b.topics, *names))]
        return problem(404, "no-such-topic", f"There is no topic {topic[:80]!r}.", f"One of: {', '.join(known)}.")

    async def _tick_forever(self) -> None:
        while True:
            t_ns = time.monotonic_ns() - self._started_ns
            for outbox in self._clients:
                outbox.offer(TickOut(t_ns=t_ns, lost=outbox.lost).model_dump_json())
            await asyncio.sleep(TICK_S)

    def _start(self, owner: object, work: Coroutine[Any, Any, None]) -> None:
        if self._group is None:
            work.close()
            raise RuntimeError("Live.start was not called")
        self._tasks[owner] = self._group.create_task(work)

    def _end(self, owner: object) -> None:
        self._tasks.pop(owner).cancel()


def _row_answer(board: Board, name: str, stream_id: int, rate_hz: float) -> SubscribedOut | StreamErrorOut:
    """Return that rows will come, or that this lane does not run."""
    lane = lane_of(name)
    idle = next((info for info in board.lanes() if info.name == lane and not info.running), None)
    if idle is not None:
        why = not_running(board.id, idle)
        return StreamErrorOut(id=stream_id, problem=problem(409, why.code, why.detail, why.remedy))
    topic = f"boards/{board.id}/{name}"
    return SubscribedOut(id=stream_id, topic=topic, columns=board.topics[name].columns, rate_hz=rate_hz)

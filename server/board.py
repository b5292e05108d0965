"""One flight board: link → protocol → engine → hub. Whatever touches its engine runs in the one event loop."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final, Literal

from server.board_choices import Choices
from server.board_parts import BoardParts, Engine
from server.board_view import BoardStateName, BoardView
from server.history import History
from server.hub import EventRecord, Hub
from server.link.base import Chunk, LinkState, Turnable
from server.nav.calibration.applied import Calibration
from server.nav.types import Event, Float, Kind, SampleBlock, Snapshot
from server.rows import lane_of, row_topics
from server.traffic import Traffic

if TYPE_CHECKING:
    from server.nav.calibration.mag_learning import MagLearnState
    from server.nav.lanes.registry import LaneInfo  # importing it loads every kernel
    from server.nav.preprocess.chain_parameters import ChainInfo

__all__ = ["Board", "BoardParts", "Engine"]
log = logging.getLogger("navdeck.board")
TICK_S: Final = 0.1
TICKS_PER_READING: Final = 10
MAX_EVENTS: Final = 200  # the oldest is forgotten
MAX_LATENCIES: Final = 1000  # the oldest is forgotten
BREATH_NS: Final = 5_000_000  # how long chunks that are already there may keep the other tasks waiting
WAITED_NS: Final = 500_000  # a chunk that came later than this after the one before: the others ran in between
TEXT_SEVERITY: Final = ("warning", "warning", "warning", "warning", "caution", "info", "info", "info")
LINK_SEVERITY: Final = {LinkState.OPENING: "info", LinkState.OPEN: "info", LinkState.ENDED: "info"}


class Board:
    """Owns one link, protocol and engine, and drives them until it is cancelled.

    What a person chose and set is kept in `Choices`, for the engine that follows one that failed.
    """

    def __init__(
        self, board_id: str, url: str, lanes: tuple[str, ...], parts: BoardParts, history_s: float = 600.0
    ) -> None:
        self.id = board_id
        self.url = url
        self.hub = Hub()
        self._choices = Choices(lanes)
        self._parts = parts
        self._link = parts.link()
        self._protocol = parts.protocol()
        self._engine = self._new_engine()
        self.topics = row_topics([info.name for info in self._engine.lanes()])
        self.history = History(self.topics, history_s)
        self._traffic = Traffic(url, parts.detect)
        self._state: BoardStateName = "running"
        self._cause = self._remedy = ""
        self._again = asyncio.Event()
        self._t_ns = self._t_rx_ns = -1
        self._events: deque[EventRecord] = deque(maxlen=MAX_EVENTS)
        self._event_count = 0
        self._latencies_s: deque[float] = deque(maxlen=MAX_LATENCIES)
        self._link_told: tuple[LinkState, str] = (LinkState.OPENING, "opening")
        self._breathed_ns = self._busy_ns = 0

    async def run(self) -> None:
        """Drive the board; a failure is a state of this board and ends nothing else. Ends only by cancellation."""
        try:
            while True:
                await self._run_once()
                await self._again.wait()
                self._renew()
        finally:
            await self._link.close()

    async def reconnect(self) -> None:
        """Have the link closed and opened anew; a board that had failed starts afresh."""
        self._again.set()
        await self._link.close()

    @property
    def state(self) -> BoardStateName:
        """Whether its task drives it."""
        return self._state

    @property
    def main_lane(self) -> str:
        """The estimator that is shown where one is: the first of those chosen."""
        return self._choices.lanes[0]

    def snapshot(self) -> Snapshot:
        """Return the newest state of everything."""
        return self._engine.snapshot()

    def lanes(self) -> tuple[LaneInfo, ...]:
        """Return every lane there is, with its parameters as they are set."""
        return self._engine.lanes()

    def choose_lanes(self, names: tuple[str, ...]) -> None:
        """Run these lanes from the next step on, through reconnection, reboot and failure; the first is the main one.

        Raises:
            ValueError: a lane that does not exist, one named twice, or none; nothing is changed then.
        """
        self._choices.choose_lanes(self._engine, names)
        self._tell("server", "lanes-chosen", "info", f"Estimators chosen: {', '.join(names)}.")

    def set_lane_parameters(self, lane: str, values: Mapping[str, float]) -> None:
        """Change parameters of one lane from the next step on, through reconnection, reboot and failure.

        Raises:
            ValueError: unknown lane or parameter, or a value outside its limits; nothing is changed then.
        """
        self._choices.set_lane_parameters(self._engine, lane, values)
        told = ", ".join(f"{name} = {value:g}" for name, value in values.items())
        self._tell("server", "lane-parameters-set", "info", f"Estimator {lane}: {told}.")

    @property
    def calibration(self) -> Calibration:
        """What is in force."""
        return self._choices.calibration

    @property
    def mag_learning_switches(self) -> tuple[bool, bool]:
        """Whether the magnetic offset is learned in flight, and whether that is applied."""
        return self._choices.mag_learning

    @property
    def mag_scale(self) -> float:
        """Factor that brings the magnetometer's values to gauss; 0 before it was found."""
        sensors = self.snapshot().sensors
        return next((one.scale for one in sensors if one.name == "mag" and one.t_last_ns >= 0), 0.0)

    @property
    def simulator(self) -> Turnable | None:
        """Its link when that is a demo board's, which can be turned from here."""
        return self._link if isinstance(self._link, Turnable) else None

    def set_calibration(self, calibration: Calibration) -> None:
        """Put this calibration in force from the next sample on, through reconnection, reboot and failure."""
        self._choices.set_calibration(self._engine, calibration)

    def converted(self, kind: Kind, rows: Float) -> Float:
        """Return raw rows in SI and body axes, where counts or a mounting are set: what calibrations are made of."""
        return self._engine.converted(kind, rows)

    def chain(self) -> tuple[ChainInfo, ...]:
        """Return the preprocessing of every sensor as it is set."""
        return self._engine.chain()

    def set_chain(self, sensor: str, values: Mapping[str, float]) -> None:
        """Change the preprocessing of one sensor from the next sample on, through reconnection, reboot and failure.

        Raises:
            ValueError: unknown sensor or parameter, or a value outside its limits; nothing is changed then.
        """
        self._choices.set_chain(self._engine, sensor, values)

    def mag_learning(self) -> MagLearnState | None:
        """Return what was learned of the magnetic offset; None when it does not run."""
        return self._engine.mag_learning()

    def set_mag_learning(self, run: bool, apply: bool) -> None:
        """Switch learning in flight and its use on or off, through reconnection, reboot and failure."""
        self._choices.set_mag_learning(self._engine, run, apply)
        words = {(False, False): "off", (True, False): "on, only watched", (True, True): "on and applied"}
        self._tell("server", "mag-learning", "info", f"Learning the magnetic offset: {words.get((run, apply), 'off')}.")

    def note(self, code: str, severity: str, text: str) -> None:
        """Write something that the service did into the board's event log."""
        self._tell("server", code, severity, text)

    def view(self) -> BoardView:
        """Return the board as it is now."""
        return BoardView(
            id=self.id,
            url=self.url,
            lanes=self._choices.lanes,
            lane_infos=self._engine.lanes(),
            topics=tuple((name, topic.columns) for name, topic in self.topics.items() if self.is_fed(name)),
            state=self._state,
            cause=self._cause,
            remedy=self._remedy,
            now_ns=time.monotonic_ns(),
            t_ns=self._t_ns,
            t_rx_ns=self._t_rx_ns,
            link=self._traffic.judged(self._link.status),
            stats=self._protocol.stats,
            recent=self._traffic.recent,
            snapshot=self.snapshot(),
            events=tuple(self._events),
            latencies_s=tuple(self._latencies_s),
        )

    def is_fed(self, topic: str) -> bool:
        """False for the topic of a lane that was not chosen."""
        return lane_of(topic) is None or lane_of(topic) in self._choices.lanes

    def _new_engine(self) -> Engine:
        """Return an engine that was told what a person chose and set so far."""
        engine = self._parts.engine()
        self._choices.tell(engine)
        return engine

    async def _run_once(self) -> None:
        failed = self._state == "failed"
        self._state, self._cause, self._remedy = "running", "", ""
        try:
            if failed:
                self._protocol, self._engine = self._parts.protocol(), self._new_engine()
            async with asyncio.TaskGroup() as tasks:
                ticking = tasks.create_task(self._tick_forever())
                await self._read()
                ticking.cancel()
            self._state = "ended"
        except Exception as error:  # the one place: nothing else may fall with this board
            await self._fail(error)

    async def _fail(self, error: Exception) -> None:
        while isinstance(error, ExceptionGroup):
            error = error.exceptions[0]
        log.error("board %s failed", self.id, exc_info=error)
        self._state = "failed"
        self._cause = f"Its program failed: {type(error).__name__}: {error}"
        self._remedy = "Reconnect the board; if it fails again, please report this with the log."
        self._tell("server", "board-failed", "warning", f"{self._cause}. {self._remedy}")
        await self._link.close()

    def _renew(self) -> None:
        self._again.clear()
        self._link = self._parts.link()
        self._traffic = Traffic(self.url, self._parts.detect)

    async def _read(self) -> None:
        async for chunk in self._link.chunks():
            now_ns = time.monotonic_ns()
            if now_ns - self._busy_ns > WAITED_NS:
                self._breathed_ns = now_ns
            self.hub.chunks.publish(chunk)  # before decoding, so that a recording holds the damage too
            if chunk.new_session:
                self._protocol.connected(chunk.t_rx_ns)
            self._feed(chunk)
            await self._breathe()
        self._look(time.monotonic_ns())

    async def _breathe(self) -> None:
        """Let the other tasks run when chunks that were there already have kept them waiting."""
        self._busy_ns = time.monotonic_ns()
        if self._busy_ns - self._breathed_ns > BREATH_NS:
            await asyncio.sleep(0)
            self._breathed_ns = self._busy_ns = time.monotonic_ns()

    def _feed(self, chunk: Chunk) -> None:
        self._traffic.keep(chunk.data)
        decoded = self._protocol.feed(chunk.data, chunk.t_rx_ns)
        for block in decoded.blocks:
            self._step(block)
        for severity, text in decoded.texts:
            self._tell("board", "board-text", TEXT_SEVERITY[min(severity, 7)], text)
        if decoded.blocks:
            latency_s = (time.monotonic_ns() - chunk.t_rx_ns) / 1e9
            self._latencies_s.append(latency_s)
            self._parts.observe_latency(latency_s)

    def _step(self, block: SampleBlock) -> None:
        result = self._engine.step(block)
        if block.t_ns.size:
            self._t_ns = int(block.t_ns.max())
            self._t_rx_ns = int(block.t_rx_ns[-1])
        self.history.add(result)
        self.hub.results.publish(result)
        for event in result.events:
            self._record("engine", event)

    async def _tick_forever(self) -> None:
        count = 0
        while True:
            now_ns = time.monotonic_ns()
            outgoing = self._protocol.outgoing(now_ns)
            if outgoing:
                self._link.write(outgoing)
            if count % TICKS_PER_READING == 0:
                self._look(now_ns)
            count += 1
            await asyncio.sleep(TICK_S)

    def _look(self, now_ns: int) -> None:
        """Once a second: read the counters, tell of a changed link, and file away what is pending."""
        self._traffic.read(now_ns, self._link.status, self._protocol.stats)
        self.history.flush()
        status = self._traffic.judged(self._link.status)
        if (status.state, status.code) != self._link_told:
            self._link_told = (status.state, status.code)
            severity = LINK_SEVERITY.get(status.state, "caution")
            text = " ".join(filter(None, (f"Link {status.url} is {status.state}.", status.cause, status.remedy)))
            self._tell("link", f"link-{status.state}", severity, text)

    def _tell(self, source: Literal["board", "link", "server"], code: str, severity: str, text: str) -> None:
        self._record(source, Event(t_ns=self._t_ns, code=code, severity=severity, text=text))

    def _record(self, source: Literal["engine", "board", "link", "server"], event: Event) -> None:
        self._event_count += 1
        record = EventRecord(seq=self._event_count, t_host_ns=time.monotonic_ns(), source=source, event=event)
        self._events.append(record)
        self.hub.events.publish(record)
        log.log(logging.INFO if event.severity == "info" else logging.WARNING, "%s: %s", self.id, event.text)

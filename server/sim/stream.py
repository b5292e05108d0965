"""The demo board without its port: a clock goes in, bytes come out; and it answers what it is asked."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from server.sim import wire
from server.sim.errors import RawErrors
from server.sim.messages import FLIGHT_TEXTS, STREAMS, Scene
from server.sim.onboard import Onboard
from server.sim.path import PERIOD_S
from server.sim.sensors import BLOCK, Sensors
from server.sim.settings import SimSettings
from server.simulator import Command, SimulatorState

TICK_NS: Final = 1_000_000
ONLY_HEARTBEAT: Final[dict[int, float]] = {wire.HEARTBEAT.id: 1.0}
"""What a board sends before anyone asks for more: message id → rate in Hz."""
FULL: Final[dict[int, float]] = {message_id: stream.default_hz for message_id, stream in STREAMS.items()}
"""Everything, at the rates a ground station asks for."""
SEVERITY_INFO: Final = 6


class SimStream:
    """Bytes of a demo board as a function of board time; knows no port and no clock.

    Equal settings, rates and requests at equal board times give equal bytes.
    """

    def __init__(self, settings: SimSettings | None = None, rates_hz: Mapping[int, float] = FULL) -> None:
        """Power the board up, sending `rates_hz` (message id → Hz) from the start."""
        self._settings = settings or SimSettings()
        self._sensors = Sensors(self._settings)
        self._onboard = Onboard(self._settings)
        self._framer, self._listener = wire.Framer(), wire.Listener()
        self._interval_ms = {key: self._granted_ms(1e6 / hz) for key, hz in rates_hz.items()}
        self._talking = len(self._interval_ms) > 1
        self._tick = 0
        self._scene = self._next_scene()
        self._due: deque[tuple[int, wire.Message, bytes]] = deque()
        self._answers: list[bytes] = []
        self._write_rest()

    @property
    def next_due_ns(self) -> int:
        """Board time at which there is something to do again."""
        return (self._due[0][0] if self._due else self._scene.block.first_tick + BLOCK) * TICK_NS

    def receive(self, data: bytes, t_ns: int) -> None:
        """Take bytes from the ground at board time `t_ns`; answers leave with the next `advance`."""
        for request in self._listener.feed(data):
            if isinstance(request, wire.TimeRequest):
                self._answer(wire.TIMESYNC, t_ns, request.ts1)
            elif isinstance(request, wire.OtherCommand):
                self._acknowledge(request.command, wire.UNSUPPORTED, request.asker)
            else:
                result = self._set_interval(request)
                self._acknowledge(wire.SET_MESSAGE_INTERVAL, result, request.asker)

    def control(self, command: Command) -> None:
        """Turn the board, or what is around it; it takes effect within `BLOCK` ticks.

        Raises:
            ValueError: this board cannot do it; the text says why and what to do.
        """
        self._sensors.stage.take(command)

    def state(self, t_ns: int) -> SimulatorState:
        """Return what the board does at board time `t_ns`."""
        return self._sensors.stage.state(t_ns * 1e-9)

    @property
    def truth_errors(self) -> RawErrors:
        """What this board's sensors err by; what a calibration should find."""
        return self._sensors.truth_errors

    def advance(self, t_ns: int) -> list[bytes]:
        """Return every frame due up to and including board time `t_ns`, in order."""
        frames, self._answers = self._answers, []
        return frames + [frame for _, frame in self._frames_until(t_ns // TICK_NS)]

    def run(self, duration_s: float) -> Iterator[tuple[int, bytes]]:
        """Yield (board time in ns, the bytes of that millisecond) for the next `duration_s`, as fast as it goes."""
        end = self._tick + round(duration_s * 1000.0)
        at, held = self._tick, b"".join(self.advance(0))
        for tick, frame in self._frames_until(end):
            if tick != at and held:
                yield at * TICK_NS, held
                held = b""
            at, held = tick, held + frame
        if held:
            yield at * TICK_NS, held

    def _frames_until(self, tick: int) -> Iterator[tuple[int, bytes]]:
        while True:
            while self._due and self._due[0][0] <= tick:
                at, message, payload = self._due.popleft()
                self._tick = at
                yield at, self._framer.frame(message, payload)
            self._tick = min(max(tick, self._tick), self._scene.block.first_tick + BLOCK)
            if self._tick >= tick:
                return
            self._scene = self._next_scene()
            self._write_rest()

    def _next_scene(self) -> Scene:
        block = self._sensors.step()
        self._onboard.step(self._sensors.gnss_error_n_m)
        return Scene(block=block, onboard=self._onboard)

    def _write_rest(self) -> None:
        """Write what the present block still has to send after the present tick, at the present rates."""
        end = self._scene.block.first_tick + BLOCK
        due: list[tuple[int, int, wire.Message, bytes]] = []
        for order, (message_id, stream) in enumerate(STREAMS.items()):
            interval = self._interval_ms.get(message_id, 0)
            if interval:
                first = self._tick + 1 + (stream.phase_ms - self._tick - 1) % interval
                ticks = np.arange(first, end + 1, interval)
                due += [
                    (t, order, stream.message, p)
                    for t, p in zip(ticks.tolist(), stream.write(self._scene, ticks), strict=True)
                ]
        due += self._texts(self._tick + 1, end)
        due.sort(key=lambda item: item[:2])
        self._due = deque((tick, message, payload) for tick, _, message, payload in due)

    def _texts(self, first: int, last: int) -> list[tuple[int, int, wire.Message, bytes]]:
        begun = self._scene.block.flight_from_ms
        if not self._talking or begun is None:
            return []
        at = ((tick, FLIGHT_TEXTS.get((tick - begun) % (PERIOD_S * 1000))) for tick in range(first, last + 1))
        order = len(STREAMS)
        return [(tick, order, wire.STATUSTEXT, _text_payload(text)) for tick, text in at if text is not None]

    def _set_interval(self, request: wire.IntervalRequest) -> int:
        if request.message_id not in STREAMS:
            self._answer(wire.STATUSTEXT, *_text_values(f"No ap_message for mavlink id ({request.message_id})"))
            return wire.DENIED
        if 0.0 < request.interval_us < self._settings.shortest_interval_ms * 1000.0:
            return wire.DENIED
        self._interval_ms[request.message_id] = self._granted_ms(request.interval_us)
        self._talking = True
        self._write_rest()
        return wire.ACCEPTED

    def _granted_ms(self, interval_us: float) -> int:
        """Return the interval in whole ms, rounded down as boards do; 0 = never."""
        return max(self._settings.shortest_interval_ms, int(min(interval_us, 6e7) // 1000)) if interval_us > 0.0 else 0

    def _acknowledge(self, command: int, result: int, asker: tuple[int, int]) -> None:
        self._answer(wire.COMMAND_ACK, command, result, 0, 0, *asker)

    def _answer(self, message: wire.Message, *values: object) -> None:
        self._answers.append(self._framer.frame(message, message.payload(*values)))


def _text_values(text: str) -> tuple[object, ...]:
    return SEVERITY_INFO, text.encode("ascii")[:50], 0, 0


def _text_payload(text: str) -> bytes:
    return wire.STATUSTEXT.payload(*_text_values(text))

"""Flights of the demo board through memory: its bytes, the protocol, the engine that learns; no real time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from server.magnetic import wmm_field
from server.nav.calibration.mag_learning import MagLearnState
from server.nav.engine import NavEngine
from server.nav.types import EngineSettings
from server.protocol.mavlink.protocol import MavlinkProtocol
from server.sim import SimSettings, SimStream, wire
from server.sim.stream import FULL
from server.simulator import Command

Floats = np.ndarray[Any, np.dtype[np.float64]]
TICK_S = 0.2
NEEDED = {wire.HEARTBEAT.id: 1.0, wire.HIGHRES_IMU.id: 100.0}
"""What learning needs of the board's messages."""
Orders = Iterable[tuple[float, Command]]
"""(board time in s, what the board is told then), in order."""


class LearningFlight:
    """A board that flies, and what was learned.

    Attributes:
        t_s: shape (n,), board time of each state. states: what the learner said then.
        truth_gauss: shape (3,), the sensor's own offset, without magnets.
    """

    def __init__(self, duration_s: float, board: SimSettings, orders: Orders = (), lanes: tuple[str, ...] = ()) -> None:
        """Fly; with lanes the board sends everything."""
        stream = SimStream(board, rates_hz=FULL if lanes else NEEDED)
        self.engine = NavEngine(EngineSettings(lanes=lanes or ("onboard",)), wmm_field)
        self.engine.set_mag_learning(run=True, apply=False)
        protocol, waiting = MavlinkProtocol(talk=False), list(orders)
        self.states: list[MagLearnState] = []
        times = []
        for k in range(1, round(duration_s / TICK_S) + 1):
            while waiting and waiting[0][0] <= k * TICK_S:
                stream.control(waiting.pop(0)[1])
            at_ns = round(k * TICK_S * 1e9)
            for block in protocol.feed(b"".join(stream.advance(at_ns)), at_ns).blocks:
                self.engine.step(block)
            state = self.engine.mag_learning()
            if state is not None and state.t_ns >= 0:
                self.states.append(state)
                times.append(k * TICK_S)
        self.t_s = np.array(times)
        self.truth_gauss = stream.truth_errors.mag_offset

    def at(self, t_s: float) -> MagLearnState:
        """Return what was known at a board time."""
        return self.states[int(np.searchsorted(self.t_s, t_s))]

    def share(self, begin_s: float, end_s: float, holds: Callable[[MagLearnState], bool]) -> float:
        """Return the share of the states in an interval of which something is true."""
        own = [holds(state) for t, state in zip(self.t_s, self.states, strict=True) if begin_s < t <= end_s]
        return sum(own) / len(own)

    def offsets(self, begin_s: float, end_s: float) -> Floats:
        """Return the offsets in an interval, shape (n, 3)."""
        return np.array(
            [state.offset_gauss for t, state in zip(self.t_s, self.states, strict=True) if begin_s < t <= end_s]
        )

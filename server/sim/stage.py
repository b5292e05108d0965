"""Who moves the demo board, block after block: its endless flight, or a hand that was told to."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from server.nav.types import Float
from server.sim import quaternion as quat
from server.sim.hand import DIFFERENCE_S, Hand, Start
from server.sim.hand_orders import hand_for
from server.sim.settings import SimSettings
from server.sim.truth import TICK_S, FlightTruth, TruthState
from server.simulator import (
    Command,
    DropLink,
    Fly,
    Magnet,
    Motion,
    Pose,
    RoomMagnet,
    Shake,
    SimulatorState,
    Spin,
    Turntable,
    WindOnPitot,
)

ACTIONS: Final = {Pose: "pose", Spin: "spin", Turntable: "turntable", Shake: "shake", Fly: "fly"}


class Stage:
    """Where the board is and what is around it; a command takes effect at the next block."""

    def __init__(self, settings: SimSettings, field_n_gauss: Float) -> None:
        self._flight = FlightTruth(settings)
        self._field_n = field_n_gauss
        self._raw = settings.errors == "raw"
        self._hand: Hand | None = None
        self._flight_from_ms = 0
        self._action = self._pose = ""
        self._tick = 0
        self.magnet_b_gauss: tuple[float, ...] = ()
        self.room_n_gauss: tuple[float, ...] = ()
        self.is_wind_on_pitot = False

    @property
    def flight_from_ms(self) -> int | None:
        """Board time at which the present flight began; None in the hand."""
        return None if self._hand is not None else self._flight_from_ms

    def step(self, first_tick: int, ticks: int) -> TruthState:
        """Return the truth from `first_tick` on, `ticks` + 1 rows."""
        self._tick = first_tick + ticks
        if self._hand is not None and self._action == "fly" and first_tick * TICK_S >= self._hand.done_s:
            self._hand, self._flight_from_ms = None, first_tick
        return self._at(np.arange(first_tick, first_tick + ticks + 1, dtype=np.float64) * TICK_S)

    def take(self, command: Command) -> None:
        """Carry a command out from the next block on.

        Raises:
            ValueError: this board cannot do it; the text says why and what to do.
        """
        if isinstance(command, Magnet):
            self.magnet_b_gauss = command.field_b_gauss if command.is_on else ()
        elif isinstance(command, RoomMagnet):
            self.room_n_gauss = command.field_n_gauss if command.is_on else ()
        elif isinstance(command, WindOnPitot):
            if command.is_on and not self._raw:
                raise ValueError("this demo board has no pressure tube; open one that has: sim:?errors=raw")
            self.is_wind_on_pitot = command.is_on
        elif not isinstance(command, (DropLink, Fly)) or (isinstance(command, Fly) and self._hand is not None):
            self._move(command)

    def state(self, t_s: float) -> SimulatorState:
        """Return what goes on at board time `t_s`, within the newest block."""
        now = self._at(np.array([t_s]))
        left_s = 0.0 if self._hand is None else max(self._hand.done_s - t_s, 0.0)
        q_nb = now.q_nb[0] if now.q_nb[0, 0] >= 0.0 else -now.q_nb[0]
        return SimulatorState(
            mode="flying" if self._hand is None else "in-hand",
            action=self._action,
            name=self._pose,
            is_moving=left_s > 0.0 or (self._hand is not None and self._hand.is_held),
            remaining_s=left_s,
            q_nb=tuple(q_nb.tolist()),
            down_b=tuple(now.R_nb[0, 2].tolist()),
            magnet_b_gauss=self.magnet_b_gauss,
            room_n_gauss=self.room_n_gauss,
            is_wind_on_pitot=self.is_wind_on_pitot,
            has_airspeed=self._raw,
            is_uncalibrated=self._raw,
        )

    def _move(self, command: Motion) -> None:
        """Have a hand begin with this where the newest block ends."""
        start_s = self._tick * TICK_S
        start = self._hand.start_at(start_s) if self._hand is not None else self._taken_from_flight(start_s)
        ready_q_nb = self._flight.at(np.zeros(1)).q_nb[0]
        self._hand = hand_for(command, start, self._tick, self._field_n, ready_q_nb, self._hand is not None)
        self._action = ACTIONS[type(command)]
        if isinstance(command, Pose):
            self._pose = command.name
        elif not isinstance(command, Shake):
            self._pose = ""

    def _taken_from_flight(self, t_s: float) -> Start:
        h = DIFFERENCE_S
        state = self._at(np.array([t_s - h, t_s, t_s + h]))
        turn = quat.product(quat.inverse(state.q_nb[0]), state.q_nb[2])
        return Start(
            pos_n_m=state.pos_n_m[1],
            vel_n_m_s=state.vel_n_m_s[1],
            accel_n_m_s2=(state.vel_n_m_s[2] - state.vel_n_m_s[0]) / (2.0 * h),
            q_nb=state.q_nb[1],
            rate_b_rad_s=quat.log(turn) / (2.0 * h),
        )

    def _at(self, t_s: Float) -> TruthState:
        if self._hand is not None:
            return self._hand.at(t_s)
        if not self._flight_from_ms:
            return self._flight.at(t_s)
        return replace(self._flight.at(t_s - self._flight_from_ms * TICK_S), t_s=t_s)

"""What a run of the engine made of a stream: rows, aids and events of the main lane, and its errors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.nav.ekf.states import packed
from server.nav.engine import NavEngine
from server.nav.lanes.ins_ekf import InsEkf
from server.nav.types import Aid, EngineSettings, Event, SampleBlock

from .ekf_flights import GRID_S, Floats, Motion
from .synthetic import LAT_DEG, LON_DEG, METRES_PER_DEG_LAT, METRES_PER_DEG_LON, field_model


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flown:
    """What the main lane made of a stream."""

    t_s: Floats
    rows: Floats
    aids: Floats
    aid_t_s: Floats
    events: tuple[Event, ...]
    engine: NavEngine
    blocks: tuple[SampleBlock, ...]

    @property
    def lane(self) -> InsEkf:
        """The main lane itself, for the states that it does not publish."""
        lane = self.engine._bank._running["ins_ekf"]
        assert isinstance(lane, InsEkf)
        return lane

    def states(self, first: int, n: int) -> Floats:
        """Return nominal states of the present."""
        return np.asarray(self.lane._x[first : first + n], np.float64)

    def sigmas(self, first: int, n: int) -> Floats:
        """Return standard deviations of error states of the present."""
        return np.sqrt([self.lane._P[packed(i, i)] for i in range(first, first + n)])

    def has(self, state: int) -> bool:
        """Return whether the block of an error state is in use."""
        return bool(self.lane._P[packed(state, state)] > 0.0)

    def codes(self) -> list[str]:
        """Return the events' codes."""
        return [event.code for event in self.events]

    def statuses(self, aid: Aid, start_s: float = -np.inf, end_s: float = np.inf) -> Floats:
        """Return what became of the measurements of one kind, by time of validity."""
        valid_s = self.aids[:, 15] * 1e-9
        return self.aids[(self.aids[:, 0] == aid) & (valid_s >= start_s) & (valid_s < end_s), 1]

    def between(self, start_s: float, end_s: float) -> NDArray[np.bool_]:
        """Return which rows lie in [start, end)."""
        return np.asarray((self.t_s >= start_s) & (self.t_s < end_s))


def fly(blocks: SampleBlock | Iterable[SampleBlock], model: Any = field_model, **settings: Any) -> Flown:
    """Run the main lane over blocks."""
    given = (blocks,) if isinstance(blocks, SampleBlock) else tuple(blocks)
    engine = NavEngine(EngineSettings(**({"lanes": ("ins_ekf",)} | settings)), model)
    results = [engine.step(block) for block in given]
    rows = [lane for result in results for lane in result.lanes if lane.lane == "ins_ekf"]
    return Flown(
        t_s=np.concatenate([r.t_ns for r in rows]) * 1e-9,
        rows=np.concatenate([r.data for r in rows]),
        aids=np.concatenate([r.aids.data for r in results]),
        aid_t_s=np.concatenate([r.aids.t_ns for r in results]) * 1e-9,
        events=tuple(event for r in results for event in r.events),
        engine=engine,
        blocks=given,
    )


def heading_error(flown: Flown, motion: Motion) -> Floats:
    """Return the heading error of every row, rad."""
    return np.asarray(attitude_error(flown, motion)[:, 2], np.float64)


def attitude_error(flown: Flown, motion: Motion) -> Floats:
    """Return the NED rotation vector from the true to the estimated attitude of every row, rad; NaN while aligning."""
    error = np.full((len(flown.t_s), 3), np.nan)
    known = np.isfinite(flown.rows[:, 0])
    k = np.rint((flown.t_s[known] - motion.t_s[0]) / GRID_S).astype(int)
    estimate = Rotation.from_quat(flown.rows[known, :4], scalar_first=True)
    error[known] = (estimate * motion.R_nb[k].inv()).as_rotvec()
    return error


def position_error(flown: Flown, motion: Motion) -> Floats:
    """Return north and east errors of every row, m, by latitude and longitude."""
    true = motion.at(flown.t_s, motion.pos_n)[:, :2]
    north = (flown.rows[:, 7] - LAT_DEG) * METRES_PER_DEG_LAT
    east = (flown.rows[:, 8] - LON_DEG) * METRES_PER_DEG_LON
    return np.stack([north, east], 1) - true


def body_velocity(flown: Flown) -> Floats:
    """Return forward, right, down velocity of every row, by the estimate's own attitude."""
    velocity = np.full((len(flown.t_s), 3), np.nan)
    known = np.isfinite(flown.rows[:, 0])
    R_nb = Rotation.from_quat(flown.rows[known, :4], scalar_first=True)
    velocity[known] = R_nb.apply(flown.rows[known, 4:7], inverse=True)
    return velocity

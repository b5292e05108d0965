"""The filter of `ins_ekf` run forward with its way recorded, and the pass back, in windows of bounded memory.

What is kept of the way would be a gigabyte an hour. So the forward run leaves the filter's memory at the start of each
window and keeps the way of the last one only; on the way back each earlier window is run again from there. The result
is that of one pass over everything.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from server.nav.codes import FAILED
from server.nav.ekf import layout as at
from server.nav.ekf.run import GAP_RESTART_S
from server.nav.ekf.smooth import layout as rec
from server.nav.ekf.smooth.back import smooth
from server.nav.ekf.smooth.record import record_slots
from server.nav.ekf.states import PACKED, POS, X_SIZE, N
from server.nav.ekf.update import LOGGED
from server.nav.lanes.base import LaneContext
from server.nav.lanes.ins_ekf import InsEkf
from server.nav.types import AID_COLUMNS, LANE_COLUMNS, Float, Int

WINDOW_STEPS: Final = 8_192
"""Steps whose way is kept at once, 10 kB each: 2.7 minutes at 50 Hz."""
CHUNK_STEPS: Final = 64
STATUS: Final = LANE_COLUMNS.index("status")


class Tape:
    """The filter's way through one window."""

    def __init__(self, slots: int) -> None:
        """Make room for so many slots."""
        self.count = np.zeros(2, dtype=np.int64)
        self.u, self.x = np.empty((slots, at.U_SIZE)), np.empty((slots, X_SIZE))
        self.P, self.f = np.empty((slots, PACKED)), np.empty((slots, rec.F_SIZE))
        self.s, self.log = np.empty((slots, rec.Z_SIZE)), np.empty((4 * slots, rec.L_SIZE))

    def arrays(self, room: int) -> tuple[Any, ...]:
        """Return the arrays as `record_slots` takes them, with room for the log of so many more slots."""
        wanted = int(self.count[1]) + room * rec.LOG_ROOM
        if wanted > len(self.log):
            grown = np.empty((wanted + len(self.log) // 2, rec.L_SIZE))
            grown[: self.count[1]] = self.log[: self.count[1]]
            self.log = grown
        return self.u, self.x, self.P, self.f, self.s, self.log, self.count


class Carried:
    """What the pass back takes from one window to the one before it: the adjoint and its covariance."""

    def __init__(self, states: int) -> None:
        """Start at the end of the recording, after which nothing is known; `states` are active."""
        self.states = states
        self.lam, self.Lam, self.b = np.zeros(N), np.zeros((N, N)), np.zeros(rec.B_SIZE)


class Recorder(InsEkf):
    """The filter of `ins_ekf` with a longer history, whose slots are recorded as they end."""

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        super().__init__(context)
        self._depth = len(self._r_u)  # as the live lane has it
        self.chunk = max(CHUNK_STEPS, self._depth)
        for name, value in list(vars(self).items()):
            if name.startswith("_r_"):
                setattr(self, name, np.zeros((self._depth + self.chunk, *value.shape[1:]), dtype=value.dtype))
        self.t = np.zeros(rec.T_SIZE)
        self._own_x, self._own_P, self._before = np.zeros(X_SIZE), np.zeros(PACKED), np.zeros(N)
        self._own_work = np.zeros(at.W_SIZE + rec.LOG_ROOM * LOGGED)

    @property
    def learns(self) -> bool:
        """Return whether delays are estimated on line."""
        return bool(self._work[at.W_DELAYS])

    def take_delays(self, found: Recorder) -> None:
        """Start with the delays that another run over the same recording has ended with."""
        mine, theirs = self._work, found._work
        used, left = slice(at.W_USED, at.W_USED + at.DELAYS), slice(at.W_DELTA, at.W_DELTA + at.DELAYS)
        error = slice(at.W_M, at.W_M + at.DELAYS**2)
        mine[used], mine[error] = theirs[used] + theirs[left], theirs[error]

    @property
    def room(self) -> int:
        """Slots that may still be recorded after the last step of a window."""
        return len(self._r_u)

    def record(self, tape: Tape, *, everything: bool) -> None:
        """Record the slots that have become final, or all of them."""
        head, alive = int(self._ctl[at.C_HEAD]), int(self._ctl[at.C_VALID])
        end = head if everything else head - self._depth
        more = end - int(self.t[rec.T_NEXT])
        if more <= 0:
            return
        self._own_work[at.W_DIM] = self._work[at.W_DIM]
        record_slots(
            end, head - alive, self.t, self._own_x, self._own_P, self._before, self._h, self._par,
            self._aux.copy(), self._ctl.copy(), self._own_work, self._r_u, self._r_x, self._r_P, self._r_m, self._r_n,
            np.empty((1, len(AID_COLUMNS))), np.empty(1), np.empty((8, at.E_SIZE)), *tape.arrays(more),
        )  # fmt: skip
        self._ctl[at.C_VALID] = min(alive, 1 if everything else self._depth)

    def back(self, tape: Tape, step_of: Int, carried: Carried, rows: Float) -> None:
        """Go back over a window."""
        slots = int(tape.count[0])
        smooth(
            slots, carried.states, tape.u, tape.x, tape.P, tape.f, tape.s, tape.log, step_of, carried.lam, carried.Lam,
            carried.b, np.zeros(X_SIZE), np.zeros(PACKED), np.zeros(N), np.zeros((N, N)), np.zeros((POS + 3, N)),
            self._par, self._aux.copy(), self._ctl.copy(), self._work.copy(), rows,
        )  # fmt: skip

    @property
    def states(self) -> int:
        """Return how many error states are active."""
        return int(self._work[at.W_DIM])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Chunk:
    """Steps [begin, end) run in one call; `fresh`: a hole in the data before them ended everything."""

    begin: int
    end: int
    fresh: bool


def _chunks(steps: Float, size: int) -> list[_Chunk]:
    """Cut the steps where a hole in the data ends everything, and into pieces the history can take."""
    fresh = np.flatnonzero(steps[:, at.U_GAP_S] > GAP_RESTART_S).tolist()
    starts = sorted({0, *fresh})
    out = []
    for a, b in zip(starts, [*starts[1:], len(steps)], strict=True):
        out += [_Chunk(begin=k, end=min(k + size, b), fresh=k == a) for k in range(a, b, size)]
    return out


def _windows(chunks: Sequence[_Chunk], most: int) -> list[list[_Chunk]]:
    """Put chunks together into windows of at most so many steps."""
    out: list[list[_Chunk]] = []
    for chunk in chunks:
        if not out or chunk.end - out[-1][0].begin > most:
            out.append([])
        out[-1].append(chunk)
    return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Way:
    """The inputs of one power-up, and the rows they become.

    Attributes:
        steps: shape (n, U_SIZE). meas: shape (k, M_SIZE), M_STEP counting all steps.
        t_ns: shape (n,), board time. rows: shape (n, len(LANE_COLUMNS)).
    """

    steps: Float
    meas: Float
    t_ns: Int
    rows: Float

    def run(self, recorder: Recorder, window: Sequence[_Chunk], tape: Tape, *, again: bool = False) -> None:
        """Run the filter through a window; its way goes to the tape, its rows to `rows` unless they were there."""
        tape.count[:] = 0
        for chunk in window:
            if chunk.fresh:
                recorder.record(tape, everything=True)
            first, last = np.searchsorted(self.meas[:, at.M_STEP], (chunk.begin, chunk.end))
            meas = self.meas[first:last].copy()
            meas[:, at.M_STEP] -= chunk.begin
            part = slice(chunk.begin, chunk.end)
            result = recorder.step(self.steps[part], meas, self.t_ns[part])
            if not again:
                self.rows[part] = result.rows.data
            recorder.record(tape, everything=chunk.end == len(self.steps))

    def back(self, recorder: Recorder, tape: Tape, carried: Carried) -> None:
        """Replace the rows of a tape's slots by smoothed ones."""
        slots = int(tape.count[0])
        step_of = np.searchsorted(self.steps[:, at.U_T], tape.u[:slots, at.U_T]).astype(np.int64)
        failed = step_of[self.rows[step_of, STATUS] == FAILED]
        kept = self.rows[failed].copy()
        recorder.back(tape, step_of, carried, self.rows)
        self.rows[failed] = kept


def smooth_all(
    start: Callable[[], Recorder], steps: Float, meas: Float, t_ns: Int, window_steps: int = WINDOW_STEPS
) -> tuple[Float, Float]:
    """Return smoothed rows of LANE_COLUMNS, one a step, and where the recording ended (`smooth.layout`, T_…).

    Args:
        start: gives the filter before its first step.
        steps: shape (n, U_SIZE), n ≥ 1.
        meas: shape (k, M_SIZE), M_STEP ascending in [0, n).
        t_ns: shape (n,), board time.
        window_steps: whose way is kept at once.
    """
    recorder = start()
    way = Way(steps=steps, meas=meas, t_ns=t_ns, rows=np.empty((len(steps), len(LANE_COLUMNS))))
    windows = _windows(_chunks(steps, recorder.chunk), max(window_steps, 8 * recorder.chunk))
    tape = Tape(max(w[-1].end - w[0].begin for w in windows) + recorder.room)
    if recorder.learns:  # what it learns of the delays counts from the first step
        for window in windows:
            way.run(recorder, window, tape)
        learned, recorder = recorder, start()
        recorder.take_delays(learned)
    saved = []
    for window in windows:
        saved.append(copy.deepcopy(vars(recorder)))
        way.run(recorder, window, tape)
    carried, t = Carried(recorder.states), recorder.t.copy()
    way.back(recorder, tape, carried)
    for window, memory in zip(windows[-2::-1], saved[-2::-1], strict=True):
        vars(recorder).update(memory)
        way.run(recorder, window, tape, again=True)
        way.back(recorder, tape, carried)
    return way.rows, t

"""`mag_learning.csv`: the magnetic offset learned in flight, as it stood at every tenth of a second of board time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from server.nav.types import Float, Int, Kind, SampleBlock
from server.replay.contract_preprocessing import LearnedOut, LearningFileOut, MagLearningOut
from server.replay.options import Mode
from server.replay.output import Output

if TYPE_CHECKING:
    from server.nav.calibration.mag_learning import MagLearnState  # loads kernels

PERIOD_NS: Final = 100_000_000
"""Often enough to see a magnet being put on, few enough for a flight of hours."""
LEARNING_COLUMNS: Final = (
    "t_ns",
    *(f"{part}_{axis}{unit}" for part, unit in (("offset", "_gauss"), ("sigma", "_gauss")) for axis in "xyz"),
    *(f"excitation_{axis}" for axis in "xyz"),
    "converged",
    "frozen",
)


class Learner(Protocol):
    """The part of the engine that learns."""

    @property
    def mag_learned_gauss(self) -> Float:
        """The learned offset that is taken off now, shape (3,), body."""
        ...

    def mag_learning(self) -> MagLearnState | None:
        """Return what has been learned; None before the first navigation step."""
        ...


class LearningLog:
    """What was learned in one power-up: 12 numbers every `PERIOD_NS` of board time, however the log is cut."""

    def __init__(self, learner: Learner, boot_id: int, place: int) -> None:
        """Start before the first sample of the log's first (place 0), second (1), … power-up."""
        self._learner, self._boot_id = learner, boot_id
        self.file = "mag_learning.csv" if place == 0 else f"mag_learning.boot{place}.csv"
        self._cell: int | None = None
        self._t_last_ns = -1
        self._lines: list[str] = []
        self._final: LearnedOut | None = None

    def pieces(self, block: SampleBlock) -> Iterator[SampleBlock]:
        """Yield a block in parts that end where a period begins; step each before asking for the next."""
        begin = 0
        for cut in self._cuts(block.kind == Kind.IMU, block.t_ns):
            if cut > begin:
                yield _part(block, begin, cut)
            self._note(self._learner.mag_learning())
            begin = cut
        yield _part(block, begin, len(block.kind))

    def close(self) -> None:
        """Take what stands at the end of the power-up."""
        state = self._learner.mag_learning()
        self._note(state)
        if state is not None and state.t_ns >= 0:
            self._final = _learned(state, self._learner.mag_learned_gauss)

    def table(self) -> bytes:
        """Return the whole file."""
        return "\n".join([",".join(LEARNING_COLUMNS), *self._lines, ""]).encode()

    def out(self) -> LearningFileOut:
        """Return the account of this power-up."""
        return LearningFileOut(file=self.file, boot_id=self._boot_id, rows=len(self._lines), state=self._final)

    def _cuts(self, is_imu: np.ndarray[tuple[int], np.dtype[np.bool_]], t_ns: Int) -> list[int]:
        """Return the IMU samples that begin a period; the first of all begins none, for nothing was learned yet."""
        imu = np.flatnonzero(is_imu)
        if not len(imu):
            return []
        cells = t_ns[imu] // PERIOD_NS
        before = int(cells[0]) if self._cell is None else self._cell
        self._cell = int(cells[-1])
        return [int(cut) for cut in imu[np.diff(cells, prepend=before) != 0]]

    def _note(self, state: MagLearnState | None) -> None:
        """Add a row, unless no navigation step has been made since the last."""
        if state is None or state.t_ns < 0 or state.t_ns == self._t_last_ns:
            return
        self._t_last_ns = state.t_ns
        numbers = np.concatenate((state.offset_gauss, state.sigma_gauss, state.excitation)).tolist()
        cells = [str(state.t_ns), *map(repr, numbers), str(int(state.converged)), str(int(state.frozen))]
        self._lines.append(",".join(cells))


def write_learning(output: Output, logs: Sequence[LearningLog]) -> None:
    """Write a file for each power-up."""
    for log in logs:
        output.write(log.file, log.table())


def mag_learning_out(mode: Mode, logs: Sequence[LearningLog]) -> MagLearningOut:
    """Return the summary's block."""
    power_ups = [log.out() for log in logs]
    state = power_ups[-1].state if power_ups else None
    return MagLearningOut(run=True, apply=mode == "apply", state=state, power_ups=power_ups)


def _part(block: SampleBlock, begin: int, end: int) -> SampleBlock:
    rows = slice(begin, end)
    return SampleBlock(
        kind=block.kind[rows],
        t_ns=block.t_ns[rows],
        t_rx_ns=block.t_rx_ns[rows],
        data=block.data[rows],
        boot_id=block.boot_id,
    )


def _learned(state: MagLearnState, applied_gauss: Float) -> LearnedOut:
    return LearnedOut(
        t_ns=state.t_ns,
        offset_gauss=state.offset_gauss.tolist(),
        sigma_gauss=state.sigma_gauss.tolist(),
        excitation=state.excitation.tolist(),
        converged=state.converged,
        frozen=state.frozen,
        reason=state.reason,
        changes=state.changes,
        t_changed_ns=state.t_changed_ns if state.t_changed_ns >= 0 else None,
        residual_gauss=state.residual_gauss if math.isfinite(state.residual_gauss) else None,
        applied_gauss=applied_gauss.tolist(),
    )

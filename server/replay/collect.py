"""Everything one replay keeps of what went into the engine and what came out, one part per power-up of the board."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from server.nav.types import (
    AID_COLUMNS,
    LANE_COLUMNS,
    ROW_WIDTH,
    SAMPLE_COLUMNS,
    Aid,
    AidStatus,
    Event,
    Float,
    Int,
    Kind,
    LaneRows,
    SampleBlock,
    Snapshot,
    StageRows,
    StepResult,
)
from server.replay.learning import LearningLog

_FIX_TYPE: Final = SAMPLE_COLUMNS[Kind.GNSS].index("fix_type")
_FIX_3D: Final = 3.0
_AID, _STATUS = AID_COLUMNS.index("aid"), AID_COLUMNS.index("status")


@dataclass(slots=True, kw_only=True, eq=False)
class Boot:
    """One power-up: samples counted, reference kept, rows of every lane.

    Attributes:
        t_first_ns, t_last_ns: of its samples (dates and profiles aside); -1 before the first.
        t_fix_ns: stamp of the first GNSS row that is a 3-D fix; -1 without one.
        decimal_year: the board's own date, the first it told; NaN without one.
        samples: rows by `Kind`.
        aids: shape (aids, statuses), measurements by what became of them.
        snapshot: the engine's own account at the end.
        learning: what was learned of the magnetic offset; None when that did not run.
    """

    boot_id: int
    t_first_ns: int = -1
    t_last_ns: int = -1
    t_fix_ns: int = -1
    decimal_year: float = math.nan
    samples: Int = field(default_factory=lambda: np.zeros(len(Kind) + 1, dtype=np.int64))
    aids: Int = field(default_factory=lambda: np.zeros((len(Aid), len(AidStatus)), dtype=np.int64))
    events: list[Event] = field(default_factory=list)
    snapshot: Snapshot | None = None
    learning: LearningLog | None = None
    _reference: list[tuple[Int, Float]] = field(default_factory=list)
    _lanes: dict[str, list[LaneRows]] = field(default_factory=dict)
    _stages: dict[str, list[StageRows]] = field(default_factory=dict)

    def add_block(self, block: SampleBlock) -> None:
        """Count what goes in; keep the reference."""
        self.samples += np.bincount(block.kind, minlength=len(self.samples))
        stamps = block.t_ns[(block.kind != Kind.DATE) & (block.kind != Kind.PROFILE)]
        if len(stamps):
            first, last = int(stamps.min()), int(stamps.max())
            self.t_first_ns, self.t_last_ns = (
                (first, last)
                if self.t_first_ns == self.t_last_ns == -1
                else (min(first, self.t_first_ns), max(last, self.t_last_ns))
            )
        truth = block.kind == Kind.REFERENCE
        if truth.any():
            self._reference.append((block.t_ns[truth], block.data[truth]))
        dates = block.data[block.kind == Kind.DATE, 0]
        if len(dates) and math.isnan(self.decimal_year):
            self.decimal_year = float(dates[0])
        if self.t_fix_ns < 0:
            self.t_fix_ns = _first_fix(block)

    def add_result(self, result: StepResult) -> None:
        """Keep what came out."""
        for rows in result.lanes:
            self._lanes.setdefault(rows.lane, []).append(rows)
        for stages in result.stages:
            self._stages.setdefault(stages.sensor, []).append(stages)
        if len(result.aids.t_ns):
            pair = result.aids.data[:, [_AID, _STATUS]].astype(np.int64)
            np.add.at(self.aids, (pair[:, 0], pair[:, 1]), 1)
        self.events.extend(result.events)

    def close(self, result: StepResult, snapshot: Callable[[], Snapshot]) -> None:
        """Keep what came out at the end of the power-up, and the engine's account after it."""
        self.add_result(result)
        self.snapshot = snapshot()

    def lane(self, name: str) -> tuple[Int, Float]:
        """Return every row of a lane: stamps, and data as in LANE_COLUMNS."""
        parts = self._lanes.get(name, [])
        if not parts:
            return np.empty(0, dtype=np.int64), np.empty((0, len(LANE_COLUMNS)))
        return np.concatenate([p.t_ns for p in parts]), np.concatenate([p.data for p in parts])

    def has_stages(self, sensor: str) -> bool:
        """Return whether any sample of this sensor went through the chain."""
        return sensor in self._stages

    def stages(self, sensor: str) -> tuple[Int, Float]:
        """Return every row of a sensor that `has_stages`: stamps, and data as in STAGE_COLUMNS."""
        parts = self._stages[sensor]
        return np.concatenate([p.t_ns for p in parts]), np.concatenate([p.data for p in parts])

    def failure(self, name: str) -> str:
        """Return why a lane was put aside; "" when it was not."""
        lanes = self.snapshot.lanes if self.snapshot is not None else ()
        return next((lane.failure for lane in lanes if lane.lane == name), "")

    def reference(self) -> tuple[Int, Float]:
        """Return the reference by ascending stamp, the first row of each."""
        if not self._reference:
            return np.empty(0, dtype=np.int64), np.empty((0, ROW_WIDTH))
        t_ns = np.concatenate([stamps for stamps, _ in self._reference])
        data = np.concatenate([rows for _, rows in self._reference])
        unique_ns, first = np.unique(t_ns, return_index=True)
        return unique_ns, data[first]


def _first_fix(block: SampleBlock) -> int:
    """Return the stamp of the block's first 3-D fix, or -1; a place and height without a fix type is taken for one."""
    gnss = block.kind == Kind.GNSS
    fix = block.data[:, _FIX_TYPE]
    placed = np.isfinite(block.data[:, :3]).all(axis=1)
    good = gnss & placed & (np.isnan(fix) | (fix >= _FIX_3D))
    return int(block.t_ns[int(np.argmax(good))]) if good.any() else -1

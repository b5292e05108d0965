"""Static poses: what a board reads while it is held still, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from server.nav.calibration.blocks import B_MAX, B_MIN, B_T0, B_T1, BlockTable
from server.nav.calibration.pose import Pose, joined, mean_of, pose_of, rounded, stir_of, with_common_noise
from server.nav.calibration.stillness import Scale, StillLimits, count_step, scale_of_counts, still_runs
from server.nav.calibration.types import Options
from server.nav.types import Float, Int, Kind

BLOCK_S: Final = 0.2  # long enough that the slow turning of a hand shows, short enough for a pose of a second
BLOCK_SAMPLES: Final = 4
SAME_POSE: Final = 0.02  # of g: neighbours that near (1.1°) are one pose with a bump in it
SATURATED_SHARE: Final = 0.3
LARGEST_STEP: Final = 0.02  # of g: ±2 g in 8 bits
SATURATED_SAMPLES: Final = 12
CLIPPED_STD: Final = 0.65  # half a normal distribution at a stop keeps 0.58 of its scatter
OPEN_BLOCKS: Final = 3
POSE_S: Final = 5 * BLOCK_S  # shortest pose


def _new_table() -> BlockTable:
    return BlockTable(needs=1, least_n=BLOCK_SAMPLES, least_s=BLOCK_S)


class PoseCollector:
    """Collects static poses from IMU samples; the same for live, for files and for any cut of the stream."""

    def __init__(self, options: Options, limits: StillLimits | None = None) -> None:
        """Start without samples.

        Args:
            options: `unit` and `gravity_m_s2` matter here.
            limits: what still means; None = for poses on a table or in a steady hand.
        """
        self._options = options
        self._limits = limits or StillLimits()
        self._table = _new_table()
        self._known: tuple[int, list[Pose], Scale] = (-1, [], Scale(accel=1.0, gyro=1.0))
        self._given: list[Pose] | None = None
        self._stir = 0.0

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples; other kinds than the IMU are ignored."""
        if kind == Kind.IMU:
            self._table.feed(t_ns, rows)

    def finish(self) -> None:
        """Count the samples after the last complete block too: no more come."""
        self._table.flush()

    def take_ranges(self, t_ns: Int, rows: Float, ranges: Sequence[tuple[int, int]]) -> None:
        """Take these ranges [first, end) of samples as the poses, each one, instead of looking for them."""
        tables = []
        for a, b in ranges:
            table = _new_table()
            table.feed(t_ns[a:b], rows[a:b])
            table.flush()
            if len(table.rows):
                tables.append(table.rows)
        self._stir = max((stir_of(blocks) for blocks in tables), default=0.0)
        self._table.feed(t_ns, rows)
        self._table.flush()
        self._given = with_common_noise([pose_of(blocks) for blocks in tables])
        step = self._step(self.scale)
        self._given = [rounded(pose, step) for pose in self._given]

    def _current(self) -> tuple[int, list[Pose], Scale]:
        blocks = self._table.rows
        if self._known[0] != len(blocks):
            scale = Scale(accel=self._options.gravity_m_s2, gyro=1.0)
            if self._options.unit == "raw":
                scale = scale_of_counts(blocks) if len(blocks) else Scale(accel=0.0, gyro=0.0, is_found=True)
            runs = still_runs(blocks, self._limits, scale)
            step = self._step(scale)
            poses = [rounded(pose_of(inner), step) for inner in joined(blocks, runs, SAME_POSE * scale.accel)]
            self._known = (len(blocks), poses, scale)
        return self._known

    def _step(self, scale: Scale) -> float:
        """Return the sensor's resolution in the unit of the data, 0 unknown."""
        counted = count_step(self._table.rows, 3) if self._options.unit == "raw" else 0.0
        return self._table.resolution(3, LARGEST_STEP * scale.accel) or counted

    @property
    def poses(self) -> list[Pose]:
        """The poses so far, oldest first; the one that is being held included once it is long enough."""
        return self._current()[1] if self._given is None else self._given

    @property
    def scale(self) -> Scale:
        """1 g and 1 rad/s in the unit of the data."""
        if self._given and self._options.unit == "raw":
            means = np.array([pose.accel for pose in self._given])
            return Scale(accel=float(np.max(np.ptp(means, axis=0))) / 2.0, gyro=0.0, is_found=True)
        return self._current()[2]

    @property
    def stirred(self) -> tuple[float, float]:
        """The scatter within the liveliest of the given ranges, and what a pose may have; (0, inf) without ranges."""
        return (self._stir, self._limits.accel_std_cap * self.scale.accel) if self._given else (0.0, np.inf)

    @property
    def samples(self) -> int:
        """Samples taken."""
        return self._table.samples

    @property
    def span_s(self) -> float:
        """Seconds from the first block to the last."""
        blocks = self._table.rows
        return float(blocks[-1, B_T1] - blocks[0, B_T0]) * 1e-9 if len(blocks) else 0.0

    @property
    def still_share(self) -> float:
        """Share of the time that the poses cover."""
        held = sum(pose.t1_ns - pose.t0_ns for pose in self.poses) * 1e-9
        return held / self.span_s if self.span_s > 0.0 else 1.0

    @property
    def held_s(self) -> float:
        """Median of the time that a pose was held, both ends left out; 0 without one."""
        held = [pose.t1_ns - pose.t0_ns for pose in self.poses]
        return float(np.median(held)) * 1e-9 if held else 0.0

    def lengths_anyhow(self) -> Float:
        """Return the lengths of what is still whatever its unit, in the unit of the data, shape (k,)."""
        blocks = self._table.rows
        if not len(blocks):
            return np.empty(0)
        runs = still_runs(blocks, self._limits, scale_of_counts(blocks))
        means = np.array([mean_of(blocks[a:b]) for a, b in runs]).reshape(-1, 3)
        return np.asarray(np.linalg.norm(means, axis=1))

    @property
    def newest(self) -> Float:
        """The last blocks, shape (≤ 3, B_SIZE), for showing what is held now."""
        return self._table.rows[-OPEN_BLOCKS:]

    @property
    def still_s(self) -> float:
        """How long the board has been held still until now."""
        blocks = self._table.rows
        if not len(blocks):
            return 0.0
        runs = still_runs(blocks, replace(self._limits, least_blocks=1), self.scale)
        if not runs or runs[-1][1] != len(blocks):
            return 0.0
        return float(blocks[-1, B_T1] - blocks[runs[-1][0], B_T0]) * 1e-9

    def saturated(self) -> float:
        """Return the largest share of a pose's samples that sit exactly at the end of the range; 0 when none does.

        A sensor at its stop repeats one value which it never exceeds, in motion neither, and shows less noise there
        than in its other poses. Coarse steps alone repeat values too, so noise must exceed half a step elsewhere.
        """
        poses, blocks = self.poses, self._table.rows
        if len(poses) < 2:
            return 0.0
        worst = 0.0
        std = np.array([pose.std for pose in poses])
        usual = np.median(std, axis=0)
        top, bottom = blocks[:, B_MAX + 3 : B_MAX + 6].max(axis=0), blocks[:, B_MIN + 3 : B_MIN + 6].min(axis=0)
        noisy = usual > 0.5 * self._table.quantum[3:]
        for pose in poses:
            if pose.samples < SATURATED_SAMPLES:
                continue  # of two samples one is the largest, and half of them is there
            clipped = noisy & (pose.std < CLIPPED_STD * usual)
            share = np.maximum(
                np.where(pose.high == top, pose.at_high, 0.0), np.where(pose.low == bottom, pose.at_low, 0.0)
            )
            worst = max(worst, float(np.max(np.where(clipped, share / pose.samples, 0.0))))
        return worst if worst >= SATURATED_SHARE else 0.0

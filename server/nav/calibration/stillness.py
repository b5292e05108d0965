"""Finds the runs of blocks in which the board was still.

One implementation for live and for files, for every rate from 10 Hz to 1 kHz, with or without a gyro, in SI or in
counts. What is still follows from the table of blocks alone: limits in SI are fractions of g and rates; in counts they
are fractions of the radius that the blocks themselves span, and multiples of the noise floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from server.nav.calibration.blocks import B_GAP, B_MAX, B_MEAN, B_MIN, B_N, B_VAR
from server.nav.kernel import kernel
from server.nav.types import Float, Int

FLOOR_QUANTILE: Final = 0.1  # the quietest tenth of the blocks shows the sensor's own noise
FLOOR_FACTOR: Final = 3.0  # four samples on three axes scatter by a factor of 2 about their mean; motion by more than 3
LEAST_STEPS: Final = 50.0  # a count that flips now and then is not motion: the limits are 0.01 of a scale and more
SHIFT_SIGMAS: Final = 5.0  # a mean that left the run by more is not noise, once in a million blocks


@dataclass(frozen=True, slots=True, kw_only=True)
class StillLimits:
    """When a block belongs to a still run.

    Attributes:
        accel_std, accel_std_cap: scatter within a block as a share of g (in counts: of the radius): always still below
            the first, never above the second; between, still up to `FLOOR_FACTOR` times the stream's own noise floor.
        accel_shift: the block's mean against the run's mean, same unit (0.02 of g is a tilt of 1.1°).
        gyro_std, gyro_std_cap, gyro_shift: the same in rad/s; in counts, shares of the liveliest rate seen.
        least_blocks: a run of fewer is none.
    """

    accel_std: float = 0.03
    accel_std_cap: float = 0.15
    accel_shift: float = 0.02
    gyro_std: float = 0.15
    gyro_std_cap: float = 0.6
    gyro_shift: float = 0.1
    least_blocks: int = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """What 1 g and 1 rad/s are in the unit of the data; `is_found`: the data themselves say so, as far as they can."""

    accel: float
    gyro: float
    is_found: bool = False


def block_std(table: Float, at: int) -> Float:
    """Return the RMS over three axes (from channel `at`) of the scatter within each block, shape (k,)."""
    return np.asarray(np.sqrt(table[:, B_VAR + at : B_VAR + at + 3].mean(axis=1)))


def noise_floor(table: Float, at: int) -> float:
    """Return the scatter of the quietest tenth of the blocks; 0 when the sensor is absent."""
    std = block_std(table, at)
    known = std[np.isfinite(std)]
    return float(np.quantile(known, FLOOR_QUANTILE)) if known.size else 0.0


def scale_of_counts(table: Float) -> Scale:
    """Return the scale that raw blocks themselves show: half the widest span of quiet means, and the liveliest rate.

    Before the board was turned over the span is too small, so the limits are tighter than they need to be, not looser.
    The liveliest rate stands for 2 rad/s, which is how fast a hand turns a board.
    """
    accel = gyro = 0.0
    std = block_std(table, 3)
    if np.isfinite(std).any():
        quiet = table[std <= max(float(np.nanmedian(std)), FLOOR_FACTOR * noise_floor(table, 3))]
        low, high = np.quantile(quiet[:, B_MEAN + 3 : B_MEAN + 6], [0.01, 0.99], axis=0)
        accel = float(np.max(high - low)) / 2
    rate = table[:, B_MEAN : B_MEAN + 3]
    rate = rate[np.isfinite(rate).all(axis=1)]
    if len(rate):
        gyro = float(np.quantile(np.linalg.norm(rate - np.median(rate, axis=0), axis=1), 0.98)) / 2
    return Scale(
        accel=max(accel, LEAST_STEPS * count_step(table, 3)),
        gyro=max(gyro, LEAST_STEPS * count_step(table, 0)),
        is_found=True,
    )


def count_step(table: Float, at: int) -> float:
    """Return 1 when the sensor from channel `at` on gave whole numbers, 0 otherwise or when it is absent."""
    ends = table[:, [*range(B_MIN + at, B_MIN + at + 3), *range(B_MAX + at, B_MAX + at + 3)]]
    ends = ends[np.isfinite(ends)]
    return 1.0 if len(ends) and not (ends % 1.0).any() else 0.0


@kernel("boolean(float64[::1], float64[::1])")
def _is_quiet(row: Float, std_limit: Float) -> bool:
    for s in range(2):
        var = row[B_VAR + 3 * s] + row[B_VAR + 3 * s + 1] + row[B_VAR + 3 * s + 2]
        if var > 3.0 * std_limit[s] ** 2:
            return False
    return True


@kernel("boolean(float64[::1], float64[::1], float64[::1])")
def _is_near(row: Float, shift_limit: Float, sums: Float) -> bool:
    for s in range(2):
        away, n = 0.0, sums[6 + s]
        for i in range(3 * s, 3 * s + 3):
            away += (row[B_MEAN + i] - sums[i] / n) ** 2 if n > 0.0 else 0.0
        if away > shift_limit[s] ** 2:
            return False
    return True


@kernel("void(float64[:, ::1], float64[::1], float64[::1], int64, float64[::1], int64[::1])")
def _label(table: Float, std_limit: Float, shift_limit: Float, least: int, sums: Float, out: Int) -> None:
    """Set out[k] to the number of the still run that block k belongs to, −1 for none.

    Args:
        table: blocks.
        std_limit, shift_limit: shape (2,): gyro, accelerometer; a sensor that is absent (NaN) says nothing.
        least: a run of fewer blocks is none.
        sums: shape (8,), scratch: sums of the run's means, and the samples in them.
        out: shape (k,).
    """
    start, runs, n = 0, 0, table.shape[0]
    for k in range(n + 1):
        quiet = k < n and _is_quiet(table[k], std_limit)
        joins = quiet and k > start and table[k, B_GAP] == 0.0 and _is_near(table[k], shift_limit, sums)
        if not joins:
            if k - start >= least:
                runs += 1
            else:
                for j in range(start, k):
                    out[j] = -1
            start = k if quiet else k + 1
            for i in range(8):
                sums[i] = 0.0
        if k < n:
            out[k] = runs if quiet else -1
        if quiet:
            for i in range(6):
                mean = table[k, B_MEAN + i]
                if not math.isnan(mean):
                    sums[i] += mean * table[k, B_N]
                    sums[6 + i // 3] += table[k, B_N] if i % 3 == 0 else 0.0


def still_runs(table: Float, limits: StillLimits, scale: Scale) -> list[tuple[int, int]]:
    """Return [start, end) in blocks of every still run, oldest first."""
    if not len(table):
        return []
    units = (scale.gyro, scale.accel)
    floors = (noise_floor(table, 0), noise_floor(table, 3))
    shares = (
        (limits.gyro_std, limits.gyro_std_cap, limits.gyro_shift),
        (limits.accel_std, limits.accel_std_cap, limits.accel_shift),
    )
    std, shift = np.empty(2), np.empty(2)
    n = float(np.median(table[:, B_N]))
    for s in range(2):
        least, cap, drift = (share * units[s] for share in shares[s])
        std[s] = min(max(least, FLOOR_FACTOR * floors[s]), math.inf if scale.is_found else cap)
        shift[s] = max(drift, SHIFT_SIGMAS * min(floors[s], std[s]) * np.sqrt(3.0 / n))
    labels = np.empty(len(table), dtype=np.int64)
    _label(table, std, shift, limits.least_blocks, np.zeros(8), labels)
    edges = np.flatnonzero(np.diff(labels, prepend=-2, append=-2))
    return [(int(a), int(b)) for a, b in pairwise(edges) if labels[a] >= 0]

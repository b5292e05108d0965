"""Finds rests and turns in a gyro's stream, and what each turn's integral says of the scale [S1 eq. 3.10, 3.11]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.blocks import (
    B_ANGLE,
    B_AT_MAX,
    B_AT_MIN,
    B_GAP,
    B_MAX,
    B_MEAN,
    B_MIN,
    B_N,
    B_SPAN,
    B_T1,
    B_VAR,
    BlockTable,
)
from server.nav.calibration.statistics import mean_sigma, weighted_mean
from server.nav.calibration.stillness import Scale, StillLimits, scale_of_counts, still_runs
from server.nav.calibration.types import GRAVITY_M_S2
from server.nav.types import Float

BLOCK_SAMPLES: Final = 4
BLOCK_S: Final = 0.1
REST_LIMITS: Final = StillLimits(
    accel_std=0.1, accel_std_cap=0.5, accel_shift=9.0, gyro_std=0.05, gyro_std_cap=0.3, gyro_shift=0.02, least_blocks=5
)
"""Runs of a steady rate, half a second at least; the accelerometer, if any, only tells shaking."""
SAME_REST: Final = 0.03  # rad/s (in counts: of a lively rate): rests whose bias differs more are slow turns
TRIM: Final = 4  # a quarter at either end is left out of the mean
SATURATED_SHARE: Final = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rest:
    """A run of blocks at rest: [start, end) in blocks, its mean rate and the 1σ of that, shapes (3,)."""

    start: int
    end: int
    bias: Float
    sigma: Float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Movement:
    """What lies between two rests.

    Attributes:
        angle: shape (3,), ∫ (raw − bias) dt, the bias running from one rest's to the other's.
        sigma: shape (3,), 1σ of it from the bias and the noise.
        span_s: seconds.
        bias, bias_sigma: shape (3,).
        saturated: shape (3,), share of samples at the end of the range.
        t1_ns: when it ended.
        both: a rest on either side.
    """

    angle: Float
    sigma: Float
    span_s: float
    bias: Float
    bias_sigma: Float
    saturated: Float
    t1_ns: int
    both: bool

    @property
    def axis(self) -> int:
        """The axis that turned most."""
        return int(np.argmax(np.abs(self.angle)))

    @property
    def purity(self) -> float:
        """Share of the rotation vector that lies on that axis."""
        length = float(np.linalg.norm(self.angle))
        return float(np.max(np.abs(self.angle))) / length if length > 0.0 else 0.0


def new_table() -> BlockTable:
    """Return an empty table of blocks as the functions here take them."""
    return BlockTable(needs=0, least_n=BLOCK_SAMPLES, least_s=BLOCK_S)


def rest_of(table: Float, start: int, end: int) -> Rest:
    """Return the rest that these blocks are; its bias is from the middle: the slow start of a turn looks like rest."""
    trim = (end - start) // TRIM
    blocks = table[start + trim : end - trim]
    rates, n = blocks[:, B_MEAN : B_MEAN + 3], blocks[:, B_N]
    sigma = mean_sigma(rates, blocks[:, B_VAR : B_VAR + 3], n)
    return Rest(start=start, end=end, bias=weighted_mean(rates, n), sigma=sigma)


def find_rests(table: Float, unit: str) -> list[Rest]:
    """Return the rests, oldest first.

    A turntable's steady turn is as quiet as a rest. In SI the rest is the steady rate nearest to zero, and everything
    near it, none when that is more than any bias; in counts, whose zero is unknown, the first steady rate: a turn
    starts from rest.
    """
    scale = Scale(accel=GRAVITY_M_S2, gyro=1.0) if unit == "si" or not len(table) else scale_of_counts(table)
    steady = [rest_of(table, a, b) for a, b in still_runs(table, REST_LIMITS, scale)]
    if unit == "si":
        steady = [run for run in steady if float(np.abs(run.bias).max()) <= grades.GYRO_BIAS_MAX_RAD_S]
    if not steady:
        return []
    rest = steady[0] if unit == "raw" else min(steady, key=lambda run: float(np.linalg.norm(run.bias)))
    near = max(SAME_REST * scale.gyro, 6.0 * float(np.max(rest.sigma)))
    return [run for run in steady if float(np.linalg.norm(run.bias - rest.bias)) <= near]


def saturated(table: Float, blocks: Float, quiet_std: Float, quantum: Float) -> Float:
    """Return the share of the blocks' samples that stand at the stream's extreme value, 0 unless they repeat it."""
    out = np.zeros(3)
    for i in range(3):
        known = table[np.isfinite(table[:, B_MEAN + i])]
        top, bottom = known[:, B_MAX + i].max(), known[:, B_MIN + i].min()
        stuck = blocks[:, B_VAR + i] == 0.0
        stuck &= (blocks[:, B_MAX + i] == top) | (blocks[:, B_MIN + i] == bottom)
        at = np.where(blocks[:, B_MAX + i] == top, blocks[:, B_AT_MAX + i], 0.0)
        at = at + np.where(blocks[:, B_MIN + i] == bottom, blocks[:, B_AT_MIN + i], 0.0)
        share = float(at.sum() / max(blocks[:, B_N].sum(), 1.0))
        if stuck.any() and quiet_std[i] > 0.5 * quantum[i] and share >= SATURATED_SHARE:
            out[i] = share
    return out


def bias_beside(rests: Sequence[Rest]) -> tuple[Float, Float]:
    """Return the bias between one or two rests and its 1σ, shapes (3,)."""
    bias = np.mean([rest.bias for rest in rests], axis=0)
    sigma = np.sqrt(np.mean([rest.sigma**2 for rest in rests], axis=0) / len(rests))
    drift = np.abs(rests[-1].bias - rests[0].bias) / 4.0  # of a line between them, no more is sure
    return np.asarray(bias), np.asarray(np.hypot(sigma, drift))


def movement_of(table: Float, start: int, end: int, rests: Sequence[Rest], quantum: Float) -> Movement:
    """Return the movement of blocks [start, end) with the bias of one or two rests beside it."""
    blocks = table[start:end]
    span_s = float(blocks[:, B_SPAN].sum())
    bias, bias_sigma = bias_beside(rests)
    quiet = table[rests[0].start : rests[0].end]
    quiet_var = weighted_mean(quiet[:, B_VAR : B_VAR + 3], quiet[:, B_N])
    dt = span_s / max(float(blocks[:, B_N].sum()), 1.0)
    return Movement(
        angle=blocks[:, B_ANGLE : B_ANGLE + 3].sum(axis=0) - bias * span_s,
        sigma=np.sqrt((bias_sigma * span_s) ** 2 + quiet_var * span_s * dt),
        span_s=span_s,
        bias=bias,
        bias_sigma=bias_sigma,
        saturated=saturated(table, blocks, np.sqrt(quiet_var), quantum),
        t1_ns=int(blocks[-1, B_T1]),
        both=len(rests) == 2,
    )


def find_movements(table: Float, rests: Sequence[Rest], quantum: Float) -> list[Movement]:
    """Return what lies between the rests, and before the first and after the last, oldest first; none over a gap."""
    out: list[Movement] = []
    edges: list[tuple[int, int, list[Rest]]] = []
    if rests and rests[0].start > 0:
        edges.append((0, rests[0].start + 1, [rests[0]]))
    edges += [(a.end - 1, b.start + 1, [a, b]) for a, b in pairwise(rests)]
    if rests and rests[-1].end < len(table):
        edges.append((rests[-1].end - 1, len(table), [rests[-1]]))
    for start, end, beside in edges:
        if not np.any(table[start + 1 : end, B_GAP] > 0.0):
            out.append(movement_of(table, start, end, beside, quantum))
    return out

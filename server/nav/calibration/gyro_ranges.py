"""Turns whose samples somebody named: each is integrated over exactly its samples, the bias is from rest.

Which of the ranges are rests shows by itself. The rests of the stream stand in where none is named; a stream that has
none either is integrated without a bias in SI, as S1 (3.10) does, with the sigma of a bias that nobody measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.blocks import B_FIRST, B_N, GAP_S, BlockTable
from server.nav.calibration.gyro_turns import (
    REST_LIMITS,
    Movement,
    Rest,
    bias_beside,
    find_rests,
    new_table,
    rest_of,
    saturated,
)
from server.nav.calibration.stillness import scale_of_counts, still_runs
from server.nav.types import Float, Int

REST_ANGLE_RAD: Final = 0.5 * np.pi  # in SI: what turned by less than a quarter was at rest
REST_SHARE: Final = 0.1  # of the fastest mean rate, in counts
REST_STIR: Final = 0.1  # of the fastest mean rate: RMS about the mean of a range that may be a rest
QUIET_SHARE: Final = 0.3  # of the liveliest range
UNKNOWN_BIAS_RAD_S: Final = 0.02  # 1σ: MEMS data sheets promise ±1 °/s at best
GAP_STEPS: Final = 3.0  # of the usual step; a slow log has no holes everywhere


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """The samples of one range.

    Attributes:
        first, end: as given, in samples of the stream.
        integral: shape (3,), ∫ raw dt over the time its samples stand for, half a step beyond the first and the last.
        span_s: that time; `step_s`: between two samples.
        stir: shape (3,), RMS about the mean.
        rest: its mean rate and 1σ, as far as it is a rest.
    """

    first: int
    end: int
    t1_ns: int
    integral: Float
    span_s: float
    step_s: float
    stir: Float
    rest: Rest

    @property
    def mean(self) -> Float:
        """Mean rate, shape (3,)."""
        return self.integral / self.span_s


def _stretch(t_ns: Int, rows: Float, first: int, end: int) -> Stretch | None:
    """Return the range's integral; None without two samples, or with a hole in it."""
    rate = rows[first:end, :3]
    known = np.isfinite(rate).all(axis=1)
    t, rate = t_ns[first:end][known], rate[known]
    fresh = np.diff(t, prepend=t[0] - 1 if len(t) else 0) != 0
    t, rate = t[fresh], rate[fresh]
    if len(t) < 2:
        return None
    steps = np.diff(t) * 1e-9
    step_s = float(np.median(steps))
    if steps.min() < 0.0 or steps.max() > max(GAP_S, GAP_STEPS * step_s):
        return None
    padded = np.concatenate([steps[:1], steps, steps[-1:]])
    weights = 0.5 * (padded[:-1] + padded[1:])
    integral, span_s = weights @ rate, float(weights.sum())
    table = new_table()
    table.feed(t, np.column_stack([rate, np.full((len(t), rows.shape[1] - 3), np.nan)]))
    table.flush()
    return Stretch(
        first=first,
        end=end,
        t1_ns=int(t[-1]),
        integral=integral,
        span_s=span_s,
        step_s=step_s,
        stir=np.sqrt(np.mean((rate - integral / span_s) ** 2, axis=0)),
        rest=rest_of(table.rows, 0, len(table.rows)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Known:
    """A rest, where it lies in the stream, and its noise, shape (3,)."""

    first: int
    end: int
    rest: Rest
    std: Float


def _rests_outside(t_ns: Int, rows: Float, ranges: Sequence[tuple[int, int]], unit: str) -> list[Known]:
    """Return the rests of the stream outside the ranges, oldest first."""
    outside = np.ones(len(t_ns), dtype=bool)
    for first, end in ranges:
        outside[first:end] = False
    found: list[Known] = []
    edges = np.flatnonzero(np.diff(outside.astype(np.int8), prepend=0, append=0))
    tables = [(int(a), _table(t_ns[a:b], rows[a:b])) for a, b in edges.reshape(-1, 2)]
    blocks = [table.rows for _, table in tables if len(table.rows)]
    if not blocks:
        return found
    everything = np.concatenate(blocks)
    for start, table in tables:
        for rest in _rests_of(table.rows, everything, unit):
            at = table.rows[rest.start : rest.end]
            first, end = start + int(at[0, B_FIRST]), start + int(at[-1, B_FIRST] + at[-1, B_N])
            found.append(Known(first=first, end=end, rest=rest, std=rows[first:end, :3].std(axis=0)))
    return _commonest(found, REST_SHARE * scale_of_counts(everything).gyro) if unit == "raw" else found


def _commonest(found: Sequence[Known], near: float) -> list[Known]:
    """Return the steady rates near the one that was held longest in all: in counts, whose zero is unknown, the rest."""
    if not found:
        return []
    bias = np.array([known.rest.bias for known in found])
    samples = np.array([known.end - known.first for known in found])
    limit = max(near, 6.0 * float(np.median([known.rest.sigma.max() for known in found])))
    alike = np.linalg.norm(bias[:, None] - bias[None, :], axis=2) <= limit
    most = int(np.argmax(alike @ samples))
    return [known for known, keep in zip(found, alike[most], strict=True) if keep]


def _rests_of(blocks: Float, everything: Float, unit: str) -> list[Rest]:
    if unit == "si" or not len(blocks):
        return find_rests(blocks, unit)
    return [rest_of(blocks, a, b) for a, b in still_runs(blocks, REST_LIMITS, scale_of_counts(everything))]


def _table(t_ns: Int, rows: Float) -> BlockTable:
    table = new_table()
    table.feed(t_ns, rows)
    return table


def _quietest(parts: Sequence[Stretch], unit: str) -> Float | None:
    """Return the mean rate of the range that is at rest when the stream outside shows none; None when that is open.

    In SI it is the slowest, if no faster than any bias. In counts it is one much nearer to zero than another, or much
    steadier; two steady turns in either sense must not be taken for a turn and its rest.
    """
    means = np.array([float(np.linalg.norm(part.mean)) for part in parts])
    stir = np.array([float(np.linalg.norm(part.stir)) for part in parts])
    slowest, steadiest = parts[int(np.argmin(means))].mean, parts[int(np.argmin(stir))].mean
    if unit == "si":
        return slowest if means.min() <= grades.GYRO_BIAS_MAX_RAD_S else None
    if means.min() < QUIET_SHARE * means.max():
        return slowest
    return steadiest if stir.min() < QUIET_SHARE * stir.max() else None


def _is_rest(parts: Sequence[Stretch], bias: Float | None, unit: str) -> list[bool]:
    """Return which ranges are rests: steady, and as slow as a bias; none when no bias is known."""
    bias = _quietest(parts, unit) if bias is None and parts else bias
    if bias is None:
        return [False] * len(parts)
    stir = np.array([float(np.linalg.norm(part.stir)) for part in parts])
    rate = np.array([float(np.linalg.norm(part.mean - bias)) for part in parts])
    lively = max(float(np.max(rate, initial=0.0)), float(np.max(stir, initial=0.0)))
    slow = rate <= REST_SHARE * lively
    if unit == "si":
        slow = rate * np.array([part.span_s for part in parts]) < REST_ANGLE_RAD
    return [bool(s and x <= max(REST_STIR * lively, 1e-300)) for s, x in zip(slow, stir, strict=True)]


def given_movements(
    t_ns: Int, rows: Float, ranges: Sequence[tuple[int, int]], unit: str
) -> tuple[list[Movement], bool]:
    """Return the turns of explicit sample ranges, each over exactly its samples, and whether a bias is known.

    Args:
        t_ns: shape (n,).
        rows: shape (n, ≥ 7), gyro first.
        ranges: [first, end) in samples: turns, and rests if any.
        unit: "si" or "raw".
    """
    parts = [part for part in (_stretch(t_ns, rows, a, b) for a, b in ranges) if part is not None]
    outside = _rests_outside(t_ns, rows, ranges, unit)
    bias = np.mean([known.rest.bias for known in outside], axis=0) if outside else None
    is_rest = _is_rest(parts, bias, unit)
    turns = [part for part, rest in zip(parts, is_rest, strict=True) if not rest]
    named = [
        Known(first=part.first, end=part.end, rest=part.rest, std=part.stir)
        for part, rest in zip(parts, is_rest, strict=True)
        if rest
    ]
    rests = sorted(named or outside, key=lambda known: known.first)
    if not rests and unit == "si":
        nobody = Rest(start=0, end=0, bias=np.zeros(3), sigma=np.full(3, UNKNOWN_BIAS_RAD_S))
        rests = [Known(first=0, end=0, rest=nobody, std=np.zeros(3))]
    if not rests or not turns:
        return [], bool(rests)
    whole = _table(t_ns, rows)
    whole.flush()
    return [_movement(part, rests, whole, t_ns, rows) for part in turns], True


def _movement(part: Stretch, rests: Sequence[Known], whole: BlockTable, t_ns: Int, rows: Float) -> Movement:
    """Return a range's movement with the bias of the nearest rest before and after it."""
    before = [known for known in rests if known.end <= part.first]
    after = [known for known in rests if known.first >= part.end]
    beside = (before[-1:] + after[:1]) or list(rests[:1])
    bias, bias_sigma = bias_beside([known.rest for known in beside])
    table = _table(t_ns[part.first : part.end], rows[part.first : part.end])
    table.flush()
    return Movement(
        angle=part.integral - bias * part.span_s,
        sigma=np.sqrt((bias_sigma * part.span_s) ** 2 + beside[0].std ** 2 * part.span_s * part.step_s),
        span_s=part.span_s,
        bias=bias,
        bias_sigma=bias_sigma,
        saturated=saturated(whole.rows, table.rows, beside[0].std, table.quantum[:3]),
        t1_ns=part.t1_ns,
        both=True,
    )

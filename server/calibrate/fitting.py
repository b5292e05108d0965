"""Samples in order through a collector: all of them, or stretches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np

from server.calibrate.columns import MAIN_KIND
from server.calibrate.errors import CalibrateError
from server.calibrate.order import Piece
from server.calibrate.told import Ranges
from server.nav.calibration.registry import collector_for
from server.nav.calibration.types import CalKind, Collector, Fit, Options
from server.nav.types import Float, Int, Kind

FitRanges = Callable[[Int, Float, Sequence[tuple[int, int]]], Fit]


def collector_of(kind: CalKind, options: Options) -> Collector:
    """Return a collector that has seen nothing.

    Raises:
        CalibrateError: an option that this kind needs is missing or impossible.
    """
    try:
        return collector_for(kind, options)
    except ValueError as error:
        raise CalibrateError(str(error)) from error


def feed(collector: Collector, pieces: Sequence[Piece]) -> None:
    """Give the collector all samples."""
    for piece in pieces:
        collector.feed(piece.kind, piece.t_ns, piece.rows)


def fit_all(kind: CalKind, options: Options, pieces: Sequence[Piece]) -> Fit:
    """Return the fit of all samples.

    As live does, without the few samples after the last complete block; where that is refused, with them: a file's end
    is one, a stream's is not.

    Raises:
        CalibrateError: an option is missing.
    """
    collector = collector_of(kind, options)
    feed(collector, pieces)
    fit = collector.fit()
    finish = cast(Callable[[], None] | None, getattr(collector, "finish", None))
    if fit.ok or finish is None:
        return fit
    finish()
    whole = collector.fit()
    return whole if whole.ok else fit


def fit_ranges(kind: CalKind, options: Options, pieces: Sequence[Piece], ranges: Ranges) -> Fit:
    """Return the fit of the stretches alone; indices count the samples of the kind's own sensor, through all files.

    Raises:
        CalibrateError: a stretch ends after the last sample, or an option is missing.
    """
    collector, mine = collector_of(kind, options), MAIN_KIND[kind]
    t_ns = np.concatenate([piece.t_ns for piece in pieces if piece.kind is mine] or [np.empty(0, np.int64)])
    rows = np.concatenate([piece.rows for piece in pieces if piece.kind is mine] or [np.empty((0, 1))])
    past = next((pair for pair in ranges if pair[1] > len(t_ns)), None)
    if past is not None:
        raise CalibrateError(
            f"--ranges {past[0]}:{past[1]} ends after the last of {len(t_ns)} samples. Give b ≤ {len(t_ns)}."
        )
    fit_these = cast(FitRanges | None, getattr(collector, "fit_ranges", None))
    if fit_these is not None:
        return fit_these(t_ns, rows, list(ranges))
    feed(collector, _cut(pieces, mine, t_ns, ranges))
    return collector.fit()


def _cut(pieces: Sequence[Piece], mine: Kind, t_ns: Int, ranges: Ranges) -> list[Piece]:
    """Return the samples of the stretches alone; of other sensors those stamped within them."""
    wanted = np.zeros(len(t_ns), dtype=bool)
    for start, stop in ranges:
        wanted[start:stop] = True
    found, before = [], 0
    for piece in pieces:
        if piece.kind is mine:
            keep = wanted[before : before + len(piece.t_ns)]
            before += len(piece.t_ns)
        else:
            keep = np.zeros(len(piece.t_ns), dtype=bool)
            for start, stop in ranges:
                keep |= (piece.t_ns >= t_ns[start]) & (piece.t_ns <= t_ns[stop - 1])
        if keep.any():
            found.append(Piece(kind=piece.kind, t_ns=piece.t_ns[keep], rows=piece.rows[keep]))
    return found

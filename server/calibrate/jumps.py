"""Poses in a table without time or in a slow log: a handful of rows each, one after the other, little between them."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from server.nav.types import Float

JUMP: Final = 0.2  # of the radius, 11°: nearer neighbours are one pose
STEADY: Final = 0.05  # of the radius: RMS within a pose
BETWEEN: Final = 0.34  # of the usual rows a pose: fewer were taken on the way from one to the next
MOST_ROWS: Final = 50  # a pose, on average: with more of them the pose shows by itself
FEWEST_POSES, MOST_POSES = 4, 400


def ranges_by_jumps(accel: Float) -> tuple[tuple[int, int], ...]:
    """Return [first, end) of the rows between two jumps; () when that is not what the rows are.

    Args:
        accel: shape (n, 3), in any unit; unknown = NaN.
    """
    known = np.flatnonzero(np.isfinite(accel).all(axis=1))
    if len(known) < FEWEST_POSES:
        return ()
    values = accel[known]
    radius = float(np.ptp(values, axis=0).max()) / 2.0
    jumps = np.linalg.norm(np.diff(values, axis=0), axis=1) > JUMP * radius
    edges = [0, *(np.flatnonzero(jumps) + 1).tolist(), len(values)]
    parts = [values[a:b] for a, b in pairwise(edges)]
    if not FEWEST_POSES <= len(parts) <= MOST_POSES or len(values) > MOST_ROWS * len(parts):
        return ()
    if max(float(part.std(axis=0).max()) for part in parts) > STEADY * radius:
        return ()
    lengths = np.diff(edges)
    usual = float(np.median(np.repeat(lengths, lengths)))  # of the part that a sample is in
    kept = [pair for pair, length in zip(pairwise(edges), lengths, strict=True) if length >= BETWEEN * usual]
    return tuple((int(known[a]), int(known[b - 1]) + 1) for a, b in kept)

"""Which way to hold the board next: from a direction of the field that misses to the side that must point down."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.calibration.ellipsoid_robust import Solution
from server.nav.calibration.sphere_cells import DIRECTIONS
from server.nav.types import Float

NEARNESS: Final = 0.25  # how many radians of a hole's size one radian of a longer way is worth


class Attitudes:
    """Remembers down and the field in the board's axes, newest each, and so the angle between them: 90° − dip.

    A field direction u says only half of the attitude: the board may be turned about it. Among the ways to have it,
    the one is named whose down is nearest to the present down, at the angle that gravity and the field have here.
    """

    def __init__(self, field_n_gauss: tuple[float, ...] = ()) -> None:
        self._down = np.zeros(3)
        self._raw = np.zeros(3)
        self._pairs: list[tuple[Float, Float]] = []
        self._cosine = field_n_gauss[2] / float(np.linalg.norm(field_n_gauss)) if field_n_gauss else float("nan")

    def feed_accel(self, accel: Float) -> None:
        """Take specific force, shape (n, 3): its reverse points down while the hand is slow."""
        good = accel[np.isfinite(accel).all(axis=1)]
        if len(good):
            mean = good.mean(axis=0)
            self._down = -mean / max(float(np.linalg.norm(mean)), 1e-12)

    def feed_mag(self, raw: Float) -> None:
        """Take raw field, shape (n, 3); remember a bounded number of pairs of field and down."""
        good = raw[np.isfinite(raw).all(axis=1)]
        if len(good) == 0:
            return
        self._raw = good[-1].copy()
        if self._down.any():
            self._pairs = [*self._pairs[-99:], (self._raw, self._down)]

    def cosine(self, solution: Solution) -> float:
        """Cosine of the angle from the field to down: by the model when told, else measured, else 1 (straight down)."""
        if np.isfinite(self._cosine):
            return self._cosine
        if not self._pairs:
            return 1.0
        raw, down = (np.array(column) for column in zip(*self._pairs, strict=True))
        field = (raw - solution.offset) @ solution.matrix
        field /= np.maximum(np.linalg.norm(field, axis=1, keepdims=True), 1e-12)
        return float(np.clip(np.median(np.sum(field * down, axis=1)), -1.0, 1.0))

    def down_for(self, direction: Float, solution: Solution) -> Float:
        """Return the unit direction that shall point down so that the field lies along `direction`."""
        cosine = self.cosine(solution)
        side = self._down - (self._down @ direction) * direction
        length = float(np.linalg.norm(side))
        if length < 1e-6:
            return direction if cosine >= 0.0 else -direction
        down: Float = cosine * direction + np.sqrt(1.0 - cosine * cosine) * side / length
        return down

    def field_now(self, solution: Solution) -> Float:
        """Unit direction of the field now, by the solution."""
        field = solution.matrix @ (self._raw - solution.offset)
        return field / max(float(np.linalg.norm(field)), 1e-12)


def most_useful(solution: Solution, missing: Float, attitudes: Attitudes) -> tuple[float, ...]:
    """Return the direction to point down that fills the widest hole, the nearer of two alike; () when none misses."""
    if len(missing) == 0:
        return ()
    covered = DIRECTIONS[solution.cells]
    hole = np.arccos(np.clip(np.max(missing @ covered.T, axis=1), -1.0, 1.0))
    way = np.arccos(np.clip(missing @ attitudes.field_now(solution), -1.0, 1.0))
    best = missing[int(np.argmax(hole - NEARNESS * way))]
    return tuple(float(v) for v in attitudes.down_for(best, solution))

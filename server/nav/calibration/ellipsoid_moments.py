"""Moments of a stream of samples in constant memory, and their exact translation, scaling and noise correction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import comb
from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.calibration.ellipsoid_kernel import (
    CUBES,
    E_SIZE,
    E_VALUE,
    HUGE,
    MOMENTS,
    SUMS,
    TABLE,
    accumulate,
    find_slot,
)
from server.nav.types import Float, Int

Mask = NDArray[np.bool_]

GROWTH: Final = 2.0**0.5
FIRST_WIDTH: Final = 2.0**-26
"""First width of the cubes, of the first sample's length: below any sensor's resolution; it grows as it must."""
FINEST: Final = 0.02  # of the cloud's spread: the first width to try when the cubes are used up
FILL: Final = 0.75  # share of the cubes in use after growing

WHITE_ROUGHNESS: Final = (6.0 * 8.0 / np.pi) ** 0.5
"""Mean length of the second difference of white noise of unit variance per axis: √6 times the mean of Maxwell's law."""


def _exponents() -> list[tuple[int, int, int]]:
    return [(d - j - k, j, k) for d in range(5) for j in range(d + 1) for k in range(d + 1) if j + k <= d]


EXPONENTS: Final = sorted(_exponents(), key=lambda e: (sum(e), -e[0], -e[1]))
"""Exponents of x, y, z of the 35 moments, in the order of `ellipsoid_kernel.add_moments`."""
_INDEX: Final = {e: i for i, e in enumerate(EXPONENTS)}


@cache
def _shift_terms() -> tuple[tuple[int, int, int, tuple[int, int, int]], ...]:
    """Terms (target, source, factor, power of the shift) of the binomial theorem in three variables."""
    terms = []
    for to, e in enumerate(EXPONENTS):
        for i in range(e[0] + 1):
            for j in range(e[1] + 1):
                for k in range(e[2] + 1):
                    factor = comb(e[0], i) * comb(e[1], j) * comb(e[2], k)
                    terms.append((to, _INDEX[i, j, k], factor, (e[0] - i, e[1] - j, e[2] - k)))
    return tuple(terms)


def shifted(moments: Float, shift: Float) -> Float:
    """Return the moments of samples + shift, exactly: shape (n, 35) each, `shift` shape (n, 3)."""
    powers = np.stack([shift**p for p in range(5)])  # (5, n, 3)
    products = np.stack([powers[i, :, 0] * powers[j, :, 1] * powers[k, :, 2] for i, j, k in EXPONENTS])  # (35, n)
    given, out = np.ascontiguousarray(moments.T), np.zeros((MOMENTS, len(moments)))
    for to, source, factor, power in _shift_terms():
        out[to] += factor * products[_INDEX[power]] * given[source]
    return np.ascontiguousarray(out.T)


def scaled(moments: Float, factor: float) -> Float:
    """Return the moments of samples · factor, shape (n, 35)."""
    order: Float = np.array([sum(e) for e in EXPONENTS], dtype=np.float64)
    return moments * factor**order


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cubes:
    """A picture of the stream: what each small cube of the sensor's space held.

    Attributes:
        origins: shape (m, 3), one measured sample of each cube.
        moments: shape (m, 35), about the origins.
        lengths: shape (m,), Σ|raw|.
        extremes: shape (6, E_SIZE), as in `ellipsoid_kernel`.
        width: of a cube.
        roughness: standard deviation per axis of white noise that would make the stream's second differences; what is
            slow (the turning, a field that changes with the place) adds little.
    """

    origins: Float
    moments: Float
    lengths: Float
    extremes: Float
    width: float
    roughness: float

    @property
    def means(self) -> Float:
        """Mean sample of each cube, shape (m, 3)."""
        return self.origins + self.moments[:, 1:4] / self.moments[:, :1]

    def about(self, centre: Float, radius: float) -> Float:
        """Return the moments of (raw − centre) / radius of each cube, shape (m, 35)."""
        return shifted(scaled(self.moments, 1.0 / radius), (self.origins - centre) / radius)

    def only(self, keep: Mask) -> Cubes:
        """Return those cubes alone; `keep` is a boolean mask of shape (m,)."""
        return Cubes(
            origins=self.origins[keep],
            moments=self.moments[keep],
            lengths=self.lengths[keep],
            extremes=self.extremes,
            width=self.width,
            roughness=self.roughness,
        )


def _groups(keys: Int) -> tuple[Int, Int]:
    """Return the first row of each group of equal rows, and the group of each row; by hashes of 64 bits."""
    with np.errstate(over="ignore"):
        mixed = keys @ np.array([0x5851F42D4C957F2D, 0x14057B7EF767814F, 0x2545F4914F6CDD1D], dtype=np.int64)
    _, first, group = np.unique(mixed, return_index=True, return_inverse=True)
    return first.astype(np.int64), group.astype(np.int64)


class MomentStream:
    """Takes samples and forgets them; holds the moments of at most `CUBES` cubes however long it lasts."""

    def __init__(self) -> None:
        self._table: Int = np.full(TABLE, -1, dtype=np.int64)
        self._keys: Int = np.zeros((CUBES, 3), dtype=np.int64)
        self._origins = np.zeros((CUBES, 3))
        self._sums = np.zeros((CUBES, SUMS))
        self._extremes = np.zeros((6, E_SIZE))
        self._extremes[::2, E_VALUE], self._extremes[1::2, E_VALUE] = np.inf, -np.inf
        self._counts: Int = np.zeros(3, dtype=np.int64)
        self._rough = np.full(8, np.nan)
        self._rough[6:] = 0.0
        self._zero, self._width = np.zeros(3), 0.0

    @property
    def samples(self) -> int:
        """Samples taken."""
        return int(self._counts[1])

    @property
    def left_out(self) -> int:
        """Samples that were not finite or beyond any range."""
        return int(self._counts[2])

    def feed(self, xyz: Float) -> None:
        """Take samples, shape (n, 3); how they are cut into calls changes nothing."""
        given = np.ascontiguousarray(xyz, dtype=np.float64)
        at = self._place(given) if self._width == 0.0 else 0
        while at < len(given):
            at = accumulate(
                given,
                at,
                self._zero,
                self._width,
                self._table,
                self._keys,
                self._origins,
                self._sums,
                self._extremes,
                self._counts,
                self._rough,
            )
            if at < len(given):
                self._grow()

    def cubes(self) -> Cubes:
        """Return a copy of what is held."""
        used = int(self._counts[0])
        return Cubes(
            origins=self._origins[:used].copy(),
            moments=self._sums[:used, :MOMENTS].copy(),
            lengths=self._sums[:used, MOMENTS].copy(),
            extremes=self._extremes.copy(),
            width=self._width,
            roughness=float(self._rough[6] / max(self._rough[7], 1.0)) / WHITE_ROUGHNESS,
        )

    def _place(self, given: Float) -> int:
        """Lay the grid by the first good sample that says how long a reading is (a sensor that wakes up says zero)."""
        good = np.flatnonzero((np.abs(given) < HUGE / 3.0).all(axis=1) & given.any(axis=1))
        first = int(good[0]) if len(good) else len(given)
        self._counts[2] += first
        if first == len(given):
            return first
        self._zero = given[first].copy()
        self._width = max(float(np.abs(self._zero).max()), 1e-9) * FIRST_WIDTH
        return first

    def _grow(self) -> None:
        """Make the cubes wider until a good part is free; at once by as much as the spread of the cloud asks."""
        used = int(self._counts[0])
        origins = self._origins[:used]
        spread = float(np.median(np.linalg.norm(origins - np.median(origins, axis=0), axis=1)))
        steps = max(1, round(np.log2(max(spread * FINEST / self._width, 1.0)) * 2.0))
        while len(_groups(self._indices(used, steps))[0]) > FILL * CUBES:
            steps += 1
        self._width *= GROWTH**steps
        self._merge()

    def _indices(self, used: int, steps: int) -> Int:
        """Places of the first samples on a grid that is wider by so many steps, shape (used, 3)."""
        keys: Int = np.floor((self._origins[:used] - self._zero) / (self._width * GROWTH**steps)).astype(np.int64)
        return keys

    def _merge(self) -> None:
        used = int(self._counts[0])
        keys = self._indices(used, 0)
        first, group = _groups(keys)
        moved = shifted(self._sums[:used, :MOMENTS], self._origins[:used] - self._origins[first][group])
        sums = np.zeros((len(first), SUMS))
        np.add.at(sums, group, np.column_stack([moved, self._sums[:used, MOMENTS]]))
        count = len(first)
        self._origins[:count], self._keys[:count] = self._origins[first], keys[first]
        self._sums[:] = 0.0
        self._sums[:count], self._counts[0] = sums, count
        self._table[:] = -1
        for i in range(count):
            k = self._keys[i]
            self._table[find_slot(int(k[0]), int(k[1]), int(k[2]), self._table, self._keys)] = i

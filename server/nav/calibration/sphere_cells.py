"""Equal-area cells over all directions: what was measured, and which directions still miss."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.types import Float, Int

CELLS: Final = 100
"""Number of cells: about 20° across, what a hand-turned board can be asked to hit."""


def fibonacci_directions(count: int) -> Float:
    """Return shape (count, 3), unit directions on a golden spiral: nearly equal areas, no pole is special."""
    at = np.arange(count) + 0.5
    z = 1.0 - 2.0 * at / count
    turn = np.pi * (1.0 + 5.0**0.5) * at
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


DIRECTIONS: Final = fibonacci_directions(CELLS)
"""Centres of the cells, shape (CELLS, 3)."""


def cell_of(directions: Float) -> Int:
    """Return the cell of each direction, shape (n,); the directions, shape (n, 3), need not be of unit length."""
    cell: Int = np.argmax(directions @ DIRECTIONS.T, axis=1).astype(np.int64)
    return cell

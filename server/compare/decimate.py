"""Curves thinned for drawing without losing a peak: of every stretch its lowest and its highest point stay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from server.nav.types import Float, Int


def kept(columns: Sequence[Float], points: int) -> Int:
    """Return the ascending places of the rows to draw, about `points` of them.

    The rows are cut into equal stretches; of each stay, for every column, its lowest and its highest known value, and
    its first row with an unknown one, so that a hole stays a hole. The first and the last row stay.

    Args:
        columns: each of shape (n,); several share one choice of rows (a track's north and east).
        points: about how many rows to keep; fewer rows than that are all kept.
    """
    n = len(columns[0])
    if n <= points:
        return np.arange(n)
    stretches = max(1, points // (2 * len(columns)))
    edges = np.linspace(0, n, stretches + 1).astype(np.int64)
    width = int(np.diff(edges).max())
    places = np.minimum(edges[:-1, None] + np.arange(width), edges[1:, None] - 1)
    found = [np.array([0, n - 1])]
    for column in columns:
        values = column[places]
        unknown = np.isnan(values)
        low, high = np.where(unknown, np.inf, values).argmin(axis=1), np.where(unknown, -np.inf, values).argmax(axis=1)
        rows = np.arange(stretches)
        found += [places[rows, low], places[rows, high]]
        holes = unknown.any(axis=1)
        found.append(places[rows, unknown.argmax(axis=1)][holes])
    return np.unique(np.concatenate(found))

"""Attitude, position and velocity between two neighbouring stamps, never across a gap."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.types import Float, Int

MAX_GAP_NS: Final = 50_000_000
"""Neighbours further apart than this are not interpolated: at 5 m/s² a straight line is then within 1.6 mm."""

_GROUPS: Final = ((0, 4), (4, 6), (6, 7), (7, 9), (9, 10), (10, 13), (13, 15), (15, 16), (16, 18), (18, 19))
"""Attitude, place, height, velocity level and down, then the standard deviations of each: known together or unknown."""

_PLACE: Final = (4, 6)


def sampled(at_ns: Int, t_ns: Int, data: Float) -> Float:
    """Return `data` at other stamps, shape (len(at_ns), columns); NaN where no two known neighbours are near enough.

    A stamp that is met exactly takes that row, whatever its neighbours.

    Args:
        at_ns: the stamps wanted.
        t_ns: shape (n,), ascending.
        data: shape (n, 10 or 19): quaternion, latitude, longitude, height, velocity NED, standard deviations. The
            columns of a group are known together or taken as unknown; a lane may know attitude or height alone.
    """
    out = np.full((len(at_ns), data.shape[1]), np.nan)
    for first, last in _GROUPS:
        if last <= data.shape[1]:
            known = np.isfinite(data[:, first:last]).all(axis=1)
            if known.any():
                values = data[known, first:last].copy()
                if first == 0:
                    values = _continuous(values)
                elif (first, last) == _PLACE:
                    values[:, 1] = np.unwrap(values[:, 1], period=360.0)
                out[:, first:last] = _between(at_ns, t_ns[known], values)
    norm = np.linalg.norm(out[:, :4], axis=1, keepdims=True)
    out[:, :4] /= np.where(norm > 0.0, norm, 1.0)
    return out


def _continuous(q_nb: Float) -> Float:
    """Return the quaternions with signs chosen so that neighbours lie in one hemisphere."""
    turns = (q_nb[1:] * q_nb[:-1]).sum(axis=1) < 0.0
    sign = np.concatenate(([1.0], np.where(np.cumsum(turns) % 2 == 1, -1.0, 1.0)))
    return np.asarray(q_nb * sign[:, None])


def _between(at_ns: Int, t_ns: Int, values: Float) -> Float:
    after = np.searchsorted(t_ns, at_ns, side="left")
    right, left = np.minimum(after, len(t_ns) - 1), np.maximum(after - 1, 0)
    exact = t_ns[right] == at_ns
    gap_ns = t_ns[right] - t_ns[left]
    usable = exact | ((after > 0) & (after < len(t_ns)) & (gap_ns <= MAX_GAP_NS))
    share = np.where(exact, 1.0, (at_ns - t_ns[left]) / np.maximum(gap_ns, 1))[:, None]
    found = values[left] + share * (values[right] - values[left])
    found = np.where(exact[:, None], values[right], found)
    return np.where(usable[:, None], found, np.nan)

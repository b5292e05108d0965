"""Figures of one lane over one window: difference to the chosen lane, error, delay, noise, states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from server.compare.contract import DifferenceOut, FiguresOut
from server.compare.delay import delays
from server.compare.flight import Flight
from server.compare.noise import noise
from server.compare.signals import Rows, tilt_of
from server.nav.types import LANE_COLUMNS, Float, Int
from server.replay.csv_out import STATUS_WORDS
from server.replay.score import Compared, compare, errors, spread

STATUS: Final = LANE_COLUMNS.index("status")
OPEN_NS: Final = 1 << 62
Window = tuple[int, int]
"""Start and end in board time, ns; the start belongs to it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaneData:
    """One lane of one power-up, ready for any window.

    Attributes:
        t_ns, data: its rows as the engine gave them, columns LANE_COLUMNS.
        rows: the same as reference rows.
        difference: lane minus the chosen lane; None for the chosen one and where either has no rows.
        error: lane minus the reference; None without one.
        quiet: stamps, and 1 where the board was quiet.
    """

    t_ns: Int
    data: Float
    rows: Rows
    reference: Rows | None
    difference: Compared | None
    error: Compared | None
    quiet: tuple[Int, Float]


def lanes_of(flight: Flight, names: tuple[str, ...], chosen: str, reference: str | None) -> Mapping[str, LaneData]:
    """Return every lane of one power-up, compared."""
    rows = {name: flight.rows(name) for name in {*names, chosen, *([reference] if reference else [])}}
    truth = rows[reference] if reference and len(rows[reference].t_ns) else None
    quiet = flight.quiet()
    out = {}
    for name in names:
        t_ns, data = flight.boot.lane(name)
        out[name] = LaneData(
            t_ns=t_ns,
            data=data,
            rows=rows[name],
            reference=truth if name != reference else None,
            difference=_minus(t_ns, data, rows[chosen]) if name != chosen else None,
            error=_minus(t_ns, data, truth),
            quiet=quiet,
        )
    return out


def _minus(t_ns: Int, data: Float, other: Rows | None) -> Compared | None:
    if other is None or not len(t_ns) or not len(other.t_ns):
        return None
    return compare(t_ns, data, other.t_ns, other.data)


def figures(lane: LaneData, window: Window) -> FiguresOut:
    """Return a lane's figures over a window."""
    part = slice(*np.searchsorted(lane.t_ns, window))
    status = lane.data[part, STATUS]
    error = lane.error.within(*window) if lane.error is not None else None
    rows = lane.rows.within(*window)
    return FiguresOut(
        rows=len(status),
        status_rows={word: int((status == place).sum()) for place, word in enumerate(STATUS_WORDS)},
        difference=difference(lane.difference.within(*window)) if lane.difference is not None else None,
        error=errors(error) if error is not None else None,
        tilt_error_rad=spread(tilt_of(error.rotation_n_rad)) if error is not None else None,
        delay=delays(rows, lane.reference.within(*window)) if lane.reference is not None else None,
        noise=noise(rows, *lane.quiet),
    )


def difference(found: Compared) -> DifferenceOut | None:
    """Return the sizes of a difference, None when nothing could be compared."""
    rotation, position, velocity = found.rotation_n_rad, found.position_m, found.velocity_n_m_s
    usable = np.isfinite(np.hstack([rotation, position, velocity])).any(axis=1)
    if not usable.any():
        return None
    return DifferenceOut(
        rows=int(usable.sum()),
        attitude_rad=spread(np.linalg.norm(rotation, axis=1)),
        heading_rad=spread(rotation[:, 2]),
        tilt_rad=spread(tilt_of(rotation)),
        horizontal_m=spread(np.hypot(position[:, 0], position[:, 1])),
        vertical_m=spread(position[:, 2]),
        horizontal_m_s=spread(np.hypot(velocity[:, 0], velocity[:, 1])),
        vertical_m_s=spread(velocity[:, 2]),
    )

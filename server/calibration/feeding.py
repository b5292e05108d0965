"""From the engine's results to the collectors: raw samples in order of arrival, the magnetometer in gauss."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from server.nav.types import Float, Int, Kind, SampleBlock

FED: Final = (Kind.IMU, Kind.MAG, Kind.BARO, Kind.AIRSPEED)
_IS_FED: Final = np.isin(np.arange(256), [int(kind) for kind in FED])


def runs(
    block: SampleBlock, mag_scale: float, converted: Callable[[Kind, Float], Float] = lambda _kind, rows: rows
) -> Iterator[tuple[Kind, Int, Float]]:
    """Yield stretches of samples of one kind, in order of arrival: (kind, t_ns (n,), rows (n, ROW_WIDTH)).

    Args:
        block: as the protocol gave it.
        mag_scale: factor to gauss; 0 = not known yet, and magnetometer samples are left out.
        converted: from the sensor's own counts and mounting to SI and body axes, where such are set.
    """
    at = np.flatnonzero(_IS_FED[block.kind])
    if not at.size:
        return
    kinds = block.kind[at]
    cuts = np.flatnonzero(np.diff(kinds)) + 1
    for part in np.split(at, cuts):
        kind = Kind(int(block.kind[part[0]]))
        rows = converted(kind, np.ascontiguousarray(block.data[part]))
        if kind is Kind.MAG:
            if mag_scale == 0.0:
                continue
            rows = rows.copy()
            rows[:, :3] *= mag_scale
        yield kind, np.ascontiguousarray(block.t_ns[part]), rows

"""Lanes that publish what someone else computed: the board itself (`onboard`) and a better source (`reference`)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from server.nav.kernel import kernel

from server.nav.codes import ATTITUDE, NAVIGATING
from server.nav.earth import ned_from_lla
from server.nav.types import LANE_COLUMNS, Float, Kind, LaneRows, SampleBlock, Site

SOURCE: Final = {"onboard": Kind.ONBOARD, "reference": Kind.REFERENCE}
"""Lane name → kind of sample it repeats."""


@kernel("void(float64[:, ::1], float64[::1], float64[:, ::1])")
def repeat_rows(source: Float, origin: Float, out: Float) -> None:
    """Write LANE_COLUMNS from sample rows; unknown stays NaN.

    Args:
        source: shape (n, ROW_WIDTH), columns of `Kind.ONBOARD` or `Kind.REFERENCE`.
        origin: shape (3,), site's latitude rad, longitude rad, height m; NaN leaves pos_*_m unknown.
        out: shape (n, len(LANE_COLUMNS)), written.
    """
    for n in range(source.shape[0]):
        row = out[n]
        for i in range(row.shape[0]):
            row[i] = math.nan
        sign = -1.0 if source[n, 0] < 0.0 else 1.0
        for i in range(4):
            row[i] = sign * source[n, i]
        for i in range(3):
            row[7 + i], row[4 + i] = source[n, 4 + i], source[n, 7 + i]
        lat, lon = math.radians(row[7]), math.radians(row[8])
        row[26], row[27], row[28] = ned_from_lla(lat, lon, row[9], origin[0], origin[1], origin[2])
        row[25] = NAVIGATING if math.isfinite(row[7]) else ATTITUDE


def repeat(lane: str, block: SampleBlock, site: Site | None) -> LaneRows | None:
    """Return one row per sample of the lane's kind in the block, None when there is none; unknown stays NaN.

    Args:
        lane: "onboard" or "reference".
        block: samples as they arrived.
        site: origin for pos_*_m; without one they stay NaN.
    """
    chosen = np.flatnonzero(block.kind == SOURCE[lane])
    if not len(chosen):
        return None
    data = np.empty((len(chosen), len(LANE_COLUMNS)))
    unknown = (math.nan, math.nan, math.nan)
    place = unknown if site is None else (math.radians(site.lat_deg), math.radians(site.lon_deg), site.alt_m)
    repeat_rows(block.data[chosen], np.array(place), data)
    return LaneRows(lane=lane, t_ns=block.t_ns[chosen], data=data)


def merged(newest: Float, before: Float) -> Float:
    """Return the newest row completed by what an earlier one knew: attitude and position come in turns."""
    row = np.where(np.isnan(newest), before, newest)
    row[25] = max(newest[25], before[25])
    return row

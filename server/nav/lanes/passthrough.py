"""Lanes that publish what someone else computed: the board itself (`onboard`) and a better source (`reference`)."""

from __future__ import annotations

import math

import numpy as np

from server.nav.earth import ned_from_lla
from server.nav.types import LANE_COLUMNS, Kind, LaneRows, LaneStatus, SampleBlock, Site

SOURCE = {"onboard": Kind.ONBOARD, "reference": Kind.REFERENCE}
"""Lane name → kind of sample it repeats."""


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
    source = block.data[chosen]
    data = np.full((len(chosen), len(LANE_COLUMNS)), np.nan)
    data[:, 0:4], data[:, 7:10], data[:, 4:7] = source[:, 0:4], source[:, 4:7], source[:, 7:10]
    data[data[:, 0] < 0.0, 0:4] *= -1.0
    has_position = np.isfinite(source[:, 4])
    data[:, 25] = np.where(has_position, LaneStatus.NAVIGATING, LaneStatus.ATTITUDE)
    if site is not None:
        origin = (math.radians(site.lat_deg), math.radians(site.lon_deg), site.alt_m)
        for row in data[has_position]:
            row[26:29] = ned_from_lla(math.radians(row[7]), math.radians(row[8]), row[9], *origin)
    return LaneRows(lane=lane, t_ns=block.t_ns[chosen], data=data)

"""Pieces of one engine call and how they are joined."""

from __future__ import annotations

import numpy as np

from server.nav.lanes.base import LaneResult
from server.nav.types import (
    AID_COLUMNS,
    ROW_WIDTH,
    STAGE_COLUMNS,
    STEP_COLUMNS,
    AidRows,
    Event,
    LaneRows,
    SampleBlock,
    StageRows,
)


class Part:
    """What one uninterrupted run of samples gave."""

    def __init__(self) -> None:
        self.t_ns = np.empty(0, dtype=np.int64)
        self.filtered = np.empty((0, len(STEP_COLUMNS)))
        self.results: list[LaneResult] = []
        self.events: list[Event] = []
        self.stages: tuple[StageRows, ...] = ()


def join(rows: list[LaneRows]) -> LaneRows | None:
    """Return the rows of one lane as one table."""
    if len(rows) <= 1:
        return rows[0] if rows else None
    return LaneRows(
        lane=rows[0].lane,
        t_ns=np.concatenate([r.t_ns for r in rows]),
        data=np.concatenate([r.data for r in rows]),
    )


def join_aids(rows: list[AidRows]) -> AidRows:
    """Return the records of one call as one table."""
    if len(rows) == 1:
        return rows[0]
    if not rows:
        return AidRows(t_ns=np.empty(0, dtype=np.int64), data=np.empty((0, len(AID_COLUMNS))))
    return AidRows(t_ns=np.concatenate([r.t_ns for r in rows]), data=np.concatenate([r.data for r in rows]))


def join_stages(parts: list[tuple[StageRows, ...]]) -> tuple[StageRows, ...]:
    """Return the stages of one call, each sensor's as one table."""
    if not any(parts):
        return ()
    found: dict[str, list[StageRows]] = {sensor: [] for sensor in STAGE_COLUMNS}
    for part in parts:
        for rows in part:
            found[rows.sensor].append(rows)
    return tuple(
        rows[0]
        if len(rows) == 1
        else StageRows(
            sensor=sensor, t_ns=np.concatenate([r.t_ns for r in rows]), data=np.concatenate([r.data for r in rows])
        )
        for sensor, rows in found.items()
        if rows
    )


def empty_block(boot_id: int) -> SampleBlock:
    """Return a block of no samples."""
    none = np.empty(0, dtype=np.int64)
    return SampleBlock(
        kind=np.empty(0, dtype=np.uint8), t_ns=none, t_rx_ns=none, data=np.empty((0, ROW_WIDTH)), boot_id=boot_id
    )

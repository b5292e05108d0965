"""The binary rows of the wire: which topics a board has, their columns, and their one layout.

Little-endian header uint8 version, uint8 id, uint16 n_rows, uint16 n_cols, uint16 boot_id (modulo 65536), then n_rows
times (float64 t_ns, n_cols float64). Unknown is NaN.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np

from server.nav.types import (
    AID_COLUMNS,
    LANE_COLUMNS,
    SAMPLE_COLUMNS,
    STEP_COLUMNS,
    AidRows,
    FilteredRows,
    Float,
    Int,
    Kind,
    LaneRows,
    SampleBlock,
    StepResult,
)

VERSION: Final = 1
HEADER: Final = struct.Struct("<BBHHH")
MAX_ROWS: Final = 65_535
LANE_TOPIC: Final = "lanes/"
RAW_KINDS: Final = (Kind.IMU, Kind.MAG, Kind.BARO, Kind.GNSS, Kind.AIRSPEED, Kind.REFERENCE, Kind.ONBOARD)


class Table(NamedTuple):
    """Rows of one topic: t_ns of shape (n,), data of shape (n, columns)."""

    t_ns: Int
    data: Float


Extract = Callable[[StepResult], Table | None]


class RowTopic(NamedTuple):
    """Columns of a topic, and how its rows come out of a result of the engine."""

    columns: tuple[str, ...]
    extract: Extract


def row_topics(lanes: Sequence[str]) -> dict[str, RowTopic]:
    """Return the binary topics of a board that has these lanes, running or not, by name below `boards/{id}/`."""
    topics = {f"{LANE_TOPIC}{lane}": RowTopic(LANE_COLUMNS, _lane(lane)) for lane in lanes}
    topics["filtered"] = RowTopic(STEP_COLUMNS, lambda result: _filled(result.filtered.t_ns, result.filtered.data))
    topics["aids"] = RowTopic(AID_COLUMNS, lambda result: _filled(result.aids.t_ns, result.aids.data))
    topics |= {f"raw/{kind.name.lower()}": RowTopic(SAMPLE_COLUMNS[kind], _raw(kind)) for kind in RAW_KINDS}
    return topics


def lane_of(topic: str) -> str | None:
    """Return the lane whose rows a topic holds; None when it is no lane's."""
    return topic.removeprefix(LANE_TOPIC) if topic.startswith(LANE_TOPIC) else None


def _filled(t_ns: Int, data: Float) -> Table | None:
    return Table(t_ns, data) if t_ns.size else None


def _lane(name: str) -> Extract:
    def extract(result: StepResult) -> Table | None:
        return next((_filled(rows.t_ns, rows.data) for rows in result.lanes if rows.lane == name), None)

    return extract


def _raw(kind: Kind) -> Extract:
    width = len(SAMPLE_COLUMNS[kind])

    def extract(result: StepResult) -> Table | None:
        at = np.flatnonzero(result.block.kind == kind)
        return Table(result.block.t_ns[at], result.block.data[at, :width]) if at.size else None

    return extract


def joined(tables: Iterable[Table | None]) -> Table | None:
    """Return all rows one after the other; None when there are none."""
    found = [table for table in tables if table is not None]
    if len(found) < 2:
        return found[0] if found else None
    return Table(np.concatenate([table.t_ns for table in found]), np.concatenate([table.data for table in found]))


def merged(results: Sequence[StepResult]) -> StepResult:
    """Return several results of one power-up as one, so that what reads many of them works on long arrays."""
    if len(results) == 1:
        return results[0]
    blocks = [result.block for result in results]
    lanes: dict[str, list[LaneRows]] = {}
    for result in results:
        for rows in result.lanes:
            lanes.setdefault(rows.lane, []).append(rows)
    filtered, aids = [result.filtered for result in results], [result.aids for result in results]
    return StepResult(
        boot_id=results[0].boot_id,
        block=SampleBlock(
            kind=np.concatenate([block.kind for block in blocks]),
            t_ns=_stamps(blocks),
            t_rx_ns=np.concatenate([block.t_rx_ns for block in blocks]),
            data=_values(blocks),
            boot_id=results[0].boot_id,
        ),
        lanes=tuple(LaneRows(lane=name, t_ns=_stamps(rows), data=_values(rows)) for name, rows in lanes.items()),
        aids=AidRows(t_ns=_stamps(aids), data=_values(aids)),
        filtered=FilteredRows(t_ns=_stamps(filtered), data=_values(filtered)),
        events=tuple(event for result in results for event in result.events),
    )


class _Rows(Protocol):
    @property
    def t_ns(self) -> Int: ...
    @property
    def data(self) -> Float: ...


def _stamps(parts: Sequence[_Rows]) -> Int:
    return np.concatenate([part.t_ns for part in parts])


def _values(parts: Sequence[_Rows]) -> Float:
    return np.concatenate([part.data for part in parts])


def packed(table: Table) -> bytes:
    """Return the rows without a header: it differs from client to client, they do not."""
    body = np.empty((table.t_ns.size, table.data.shape[1] + 1), dtype="<f8")
    body[:, 0] = table.t_ns
    body[:, 1:] = table.data
    return body.tobytes()


def message(stream_id: int, boot_id: int, n_rows: int, n_cols: int, body: bytes) -> bytes:
    """Return a whole binary message: header and rows."""
    return HEADER.pack(VERSION, stream_id, n_rows, n_cols, boot_id & 0xFFFF) + body


class Thinner:
    """Keep the newest row of each period of board time; rows of different groups do not replace each other."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._slot: dict[float, int] = {}

    def thin(self, table: Table, group_column: int | None = None) -> Table | None:
        """Return the rows to keep; a period counts as served by the newest row there was when it was asked for."""
        if group_column is None:
            return self._one(table, 0.0)
        groups = table.data[:, group_column]
        parts = (Table(table.t_ns[groups == g], table.data[groups == g]) for g in np.unique(groups))
        return joined(self._one(part, float(part.data[0, group_column])) for part in parts)

    def _one(self, table: Table, group: float) -> Table | None:
        slot = table.t_ns // self._period_ns
        served = self._slot.get(group, -1)
        newest = int(slot[-1])
        if newest <= served:
            return None
        self._slot[group] = newest
        if slot.size == 1:
            return table
        last = np.append(np.flatnonzero(slot[1:] != slot[:-1]), slot.size - 1)
        last = last[slot[last] > served]
        return Table(table.t_ns[last], table.data[last])

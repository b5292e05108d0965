"""The binary rows of the wire: which topics a board has, their columns, and their one layout.

Little-endian header uint8 version, uint8 id, uint16 n_rows, uint16 n_cols, uint16 boot_id (modulo 65536), then n_rows
times (float64 t_ns, n_cols float64). Unknown is NaN.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from server.nav.parts import join_stages
from server.nav.types import (
    AID_COLUMNS,
    LANE_COLUMNS,
    SAMPLE_COLUMNS,
    STAGE_COLUMNS,
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
IN_TURNS: Final = frozenset({"lanes/onboard", "lanes/reference", "raw/onboard", "raw/reference"})
"""Attitude and position come in messages, and so in rows, of their own: one never stands for the other."""
RAW_KINDS: Final = (Kind.IMU, Kind.MAG, Kind.BARO, Kind.GNSS, Kind.AIRSPEED, Kind.REFERENCE, Kind.ONBOARD)


class Table(NamedTuple):
    """Rows of one topic: t_ns of shape (n,), data of shape (n, columns)."""

    t_ns: Int
    data: Float


Extract = Callable[[StepResult], Table | None]
Grouping = Callable[[Float], Float]
"""Data of shape (n, columns) → a number per row, shape (n,); rows of different groups say different things."""


class RowTopic(NamedTuple):
    """Columns of a topic, how its rows come out of a result of the engine, and which may stand for one another."""

    columns: tuple[str, ...]
    extract: Extract
    group: Grouping | None = None


def row_topics(lanes: Sequence[str]) -> dict[str, RowTopic]:
    """Return the binary topics of a board that has these lanes, running or not, by name below `boards/{id}/`."""
    topics = {f"{LANE_TOPIC}{lane}": RowTopic(LANE_COLUMNS, _lane(lane)) for lane in lanes}
    topics["filtered"] = RowTopic(STEP_COLUMNS, lambda result: _filled(result.filtered.t_ns, result.filtered.data))
    topics["aids"] = RowTopic(AID_COLUMNS, lambda result: _filled(result.aids.t_ns, result.aids.data), _first_column)
    topics |= {f"stages/{sensor}": RowTopic(columns, _stages(sensor)) for sensor, columns in STAGE_COLUMNS.items()}
    topics |= {f"raw/{kind.name.lower()}": RowTopic(SAMPLE_COLUMNS[kind], _raw(kind)) for kind in RAW_KINDS}
    return {name: topic._replace(group=known_columns) if name in IN_TURNS else topic for name, topic in topics.items()}


def known_columns(data: Float) -> Float:
    """Return a number per row that says which of its columns are known."""
    return np.asarray(np.isfinite(data) @ 2.0 ** np.arange(data.shape[1]), dtype=np.float64)


def _first_column(data: Float) -> Float:
    return data[:, 0]


def lane_of(topic: str) -> str | None:
    """Return the lane whose rows a topic holds; None when it is no lane's."""
    return topic.removeprefix(LANE_TOPIC) if topic.startswith(LANE_TOPIC) else None


def _filled(t_ns: Int, data: Float) -> Table | None:
    return Table(t_ns, data) if t_ns.size else None


def _lane(name: str) -> Extract:
    def extract(result: StepResult) -> Table | None:
        return next((_filled(rows.t_ns, rows.data) for rows in result.lanes if rows.lane == name), None)

    return extract


def _stages(sensor: str) -> Extract:
    def extract(result: StepResult) -> Table | None:
        return next((_filled(rows.t_ns, rows.data) for rows in result.stages if rows.sensor == sensor), None)

    return extract


def _raw(kind: Kind) -> Extract:
    width = len(SAMPLE_COLUMNS[kind])

    def extract(result: StepResult) -> Table | None:
        at = np.flatnonzero(result.block.kind == kind)
        return Table(result.block.t_ns[at], result.block.data[at, :width]) if at.size else None

    return extract


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
        stages=join_stages([result.stages for result in results]),
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
    """Keep the first row of each period of board time: the same rows however they are cut.

    Rows of different groups do not replace each other.
    """

    def __init__(self, rate_hz: float, group: Grouping | None = None) -> None:
        self._period_ns = round(1e9 / rate_hz)
        self._group = group
        self._served: dict[float, int] = {}

    def thin(self, table: Table) -> Table | None:
        """Return the rows to keep in the order in which they came; None when there are none."""
        groups = self._group(table.data) if self._group is not None else np.zeros(table.t_ns.size)
        slot = table.t_ns // self._period_ns
        if table.t_ns.size == 1:
            return table if self._serve(float(groups[0]), slot)[0] else None
        kept = np.zeros(table.t_ns.size, dtype=np.bool_)
        for group in np.unique(groups):
            at = np.flatnonzero(groups == group)
            kept[at] = self._serve(float(group), slot[at])
        return Table(table.t_ns[kept], table.data[kept]) if kept.any() else None

    def _serve(self, group: float, slot: Int) -> NDArray[np.bool_]:
        """Return which rows are the first of a period later than all before, shape of `slot`."""
        newest = np.maximum.accumulate(np.append(self._served.get(group, -1), slot))
        self._served[group] = int(newest[-1])
        first: NDArray[np.bool_] = newest[1:] > newest[:-1]
        return first

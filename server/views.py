"""From a board's view to the bodies of the wire."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from server.board_view import BoardView
from server.hub import EventRecord
from server.nav.rotation import euler_from_quat
from server.nav.types import LANE_COLUMNS, STEP_COLUMNS, LaneState, LaneStatus
from server.verdict import STALE_S, judge, lane_status, worst
from server.view_parts import (
    aids_out,
    consistency_out,
    delays_out,
    engine_out,
    lanes_out,
    link_out,
    protocol_out,
    sensors_out,
    site_out,
)
from server.wire import BoardOut, EventOut, FlagsOut, HealthOut, NavOut, TopicOut

JSON_TOPICS: Final = ("health", "events", "calibration")
HEALTH_EVENTS: Final = 50
HEADING_KNOWN_RAD: Final = math.radians(20.0)


def board_out(view: BoardView) -> BoardOut:
    """Return a board in short."""
    verdict = judge(view)
    topics = [TopicOut(topic=f"boards/{view.id}/{name}", columns=columns) for name, columns in view.topics]
    topics += [TopicOut(topic=f"boards/{view.id}/{name}", columns=None) for name in JSON_TOPICS]
    return BoardOut(
        id=view.id,
        name=view.stats.board or view.url,
        url=view.url,
        state=view.state,
        cause=view.cause,
        remedy=view.remedy,
        severity=worst(verdict),
        headline=verdict[0] if verdict else None,
        link=link_out(view),
        boot_id=view.stats.boot_id,
        t_ns=view.t_ns,
        age_s=view.age_s,
        main_lane=view.lanes[0],
        lanes=lanes_out(view),
        topics=tuple(topics),
    )


def health_out(view: BoardView) -> HealthOut:
    """Return everything needed to tell whether a board can be trusted."""
    verdict, snapshot = judge(view), view.snapshot
    filtered: dict[str, float | None] = {}
    if snapshot is not None:
        filtered |= zip(STEP_COLUMNS, snapshot.filtered, strict=False)
    return HealthOut(
        board_id=view.id,
        boot_id=view.stats.boot_id,
        t_ns=view.t_ns,
        age_s=view.age_s,
        severity=worst(verdict),
        verdict=verdict,
        link=link_out(view),
        protocol=protocol_out(view),
        engine=engine_out(view),
        sensors=sensors_out(view),
        aids=aids_out(view),
        lanes=lanes_out(view),
        consistency=consistency_out(view),
        delays=delays_out(view),
        site=site_out(snapshot.site) if snapshot is not None else None,
        filtered=filtered,
        events=tuple(event_out(record, view.now_ns) for record in view.events[-HEALTH_EVENTS:]),
    )


def nav_out(view: BoardView, lane_name: str) -> NavOut:
    """Return the state of one lane of `view.lanes`; before the first step everything in it is null."""
    lane = _lane_named(view, lane_name)
    fields: dict[str, Any] = dict(zip(LANE_COLUMNS, lane.row.tolist(), strict=True))
    q_nb = tuple(fields.pop(name) for name in ("q_w", "q_x", "q_y", "q_z"))
    status = lane_status(lane)
    fields |= _euler(lane)
    fields |= {
        "status": status.name.lower(),
        "board_id": view.id,
        "lane": lane.lane,
        "provides": lane.provides,
        "boot_id": view.stats.boot_id,
        "t_ns": lane.t_ns,
        "age_s": view.age_of_s(lane.t_ns),
        "flags": _flags(view, lane, status),
        "q_nb": q_nb if np.isfinite(q_nb).all() else None,
        "aids": aids_out(view),
        "sensors": sensors_out(view),
        "delays": delays_out(view),
        "site": site_out(view.snapshot.site if view.snapshot is not None else None),
    }
    return NavOut.model_validate(fields)


def _lane_named(view: BoardView, name: str) -> LaneState:
    lanes = view.snapshot.lanes if view.snapshot is not None else ()
    found = next((lane for lane in lanes if lane.lane == name and lane.row.size), None)
    provides = next((info.provides for info in view.lane_infos if info.name == name), "full")
    return found or LaneState(lane=name, provides=provides, t_ns=-1, row=np.full(len(LANE_COLUMNS), np.nan))


def _euler(lane: LaneState) -> dict[str, float | None]:
    names, q_nb = ("roll_rad", "pitch_rad", "yaw_rad"), np.ascontiguousarray(lane.row[:4])
    angles = euler_from_quat(q_nb) if np.isfinite(q_nb).all() else (None, None, None)
    return dict(zip(names, angles, strict=True))


def _flags(view: BoardView, lane: LaneState, status: LaneStatus) -> FlagsOut:
    row = dict(zip(LANE_COLUMNS, lane.row.tolist(), strict=True))
    alive = status not in {LaneStatus.ALIGNING, LaneStatus.FAILED}
    attitude = alive and math.isfinite(row["q_w"])
    unknown_sigma = math.isnan(row["sigma_att_z_rad"])  # a lane that passes a reference through has none
    return FlagsOut(
        attitude_valid=attitude,
        heading_valid=attitude and (unknown_sigma or row["sigma_att_z_rad"] < HEADING_KNOWN_RAD),
        velocity_valid=alive and math.isfinite(row["vel_n_m_s"]),
        position_valid=alive and math.isfinite(row["lat_deg"]),
        dead_reckoning=status is LaneStatus.DEAD_RECKONING,
        stale=(age_s := view.age_of_s(lane.t_ns)) is None or age_s >= STALE_S,
    )


def event_out(record: EventRecord, now_ns: int) -> EventOut:
    """Return an event with its age."""
    event = record.event
    fields: dict[str, object] = {
        "seq": record.seq,
        "t_ns": event.t_ns,
        "age_s": max(0.0, (now_ns - record.t_host_ns) / 1e9),
        "source": record.source,
        "code": event.code,
        "severity": event.severity,
        "text": event.text,
        "values": dict(event.values),
    }
    return EventOut.model_validate(fields)

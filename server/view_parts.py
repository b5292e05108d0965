"""From a board's view to the parts of the wire's bodies: link, protocol, sensors, aids, lanes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import TYPE_CHECKING, Final

from server.board_view import BoardView
from server.link.base import LinkStatus
from server.nav.types import (
    LANE_COLUMNS,
    SAMPLE_COLUMNS,
    AidHealth,
    AidStatus,
    Kind,
    LaneState,
    SensorHealth,
    Site,
    Snapshot,
)
from server.verdict import lane_status
from server.wire import AidOut, CountOut, EngineOut, LaneOut, SensorOut, SiteOut
from server.wire_consistency import ConsistencyOut
from server.wire_delays import DelayedName, DelayOut
from server.wire_lanes import LaneChoiceOut, LanesOut, ParameterOut
from server.wire_link import LinkOut, MessageOut, ProtocolOut, RequestOut, SenderOut

if TYPE_CHECKING:
    from server.nav.lanes.registry import LaneInfo  # importing it loads every kernel


def link_out(view: BoardView) -> LinkOut:
    """Return the link with cause, remedy and ages."""
    link: LinkStatus = view.link
    return LinkOut(
        url=link.url,
        state=link.state.value,
        code=link.code,
        cause=link.cause,
        remedy=link.remedy,
        details=link.details,
        state_age_s=max(0.0, (view.now_ns - link.since_ns) / 1e9) if link.since_ns else 0.0,
        rx_age_s=None if link.t_last_rx_ns < 0 else max(0.0, (view.now_ns - link.t_last_rx_ns) / 1e9),
        bytes_in=link.bytes_in,
        bytes_out=link.bytes_out,
        bytes_in_per_s=view.recent.bytes_per_s,
        reconnects=link.reconnects,
    )


def protocol_out(view: BoardView) -> ProtocolOut:
    """Return the byte-exact accounts of the protocol."""
    stats = view.stats
    plain = ("protocol", "board", "bytes_in", "bytes_frames", "bytes_junk", "bytes_pending", "frames", "crc_errors")
    more = ("unknown_messages", "filtered_frames", "clock_offset_ns", "clock_drift_ppm", "boot_id")
    newer = ("repeated_samples", "disbelieved_stamps")
    return ProtocolOut(
        senders=tuple(
            SenderOut(system=s.system, component=s.component, frames=s.frames, lost=s.lost) for s in stats.senders
        ),
        requests=tuple(
            RequestOut(message=r.message, state=r.state, wanted_hz=r.wanted_hz, granted_hz=r.granted_hz)
            for r in stats.requests
        ),
        messages=tuple(MessageOut(name=name, count=count, rate_hz=rate) for name, count, rate in stats.messages),
        **{name: getattr(stats, name) for name in (*plain, *more, *newer)},
    )


def engine_out(view: BoardView) -> EngineOut:
    """Return what the engine did and how long its answers took."""
    sorted_s = sorted(view.latencies_s)
    at = (lambda part: sorted_s[min(len(sorted_s) - 1, int(part * len(sorted_s)))]) if sorted_s else lambda _part: None
    steps = view.snapshot.steps if view.snapshot is not None else 0
    return EngineOut(steps=steps, latency_p50_s=at(0.5), latency_p99_s=at(0.99))


def _counts(pairs: Iterable[tuple[str | AidStatus, int]]) -> tuple[CountOut, ...]:
    names = ((kebab(reason.name) if isinstance(reason, AidStatus) else reason, count) for reason, count in pairs)
    return tuple(CountOut(reason=reason, count=count) for reason, count in names if count)


def kebab(name: str) -> str:
    """Return an enumeration's name as it stands on the wire: REFUSED_GATE → refused-gate."""
    return name.lower().replace("_", "-")


def sensors_out(view: BoardView) -> tuple[SensorOut, ...]:
    """Return every sensor; none before the engine exists."""
    return tuple(_sensor(view, sensor) for sensor in view.snapshot.sensors) if view.snapshot is not None else ()


def _sensor(view: BoardView, sensor: SensorHealth) -> SensorOut:
    known = Kind.__members__.get(sensor.name.upper())
    return SensorOut(
        name=sensor.name,
        age_s=view.age_of_s(sensor.t_last_ns),
        rate_hz=sensor.rate_hz,
        samples=sensor.samples,
        repeated=sensor.repeated,
        refused=_counts(sensor.refused),
        clipped=sensor.clipped,
        scale=sensor.scale,
        note=sensor.note,
        columns=SAMPLE_COLUMNS[known] if known is not None else (),
    )


def aids_out(view: BoardView) -> tuple[AidOut, ...]:
    """Return every aid; none before the engine exists."""
    return tuple(_aid(view, aid) for aid in view.snapshot.aids) if view.snapshot is not None else ()


def _aid(view: BoardView, aid: AidHealth) -> AidOut:
    last = aid.last
    used = [i for i in range(3) if last and math.isfinite(last[8 + i])]
    fields: dict[str, object] = {
        "aid": aid.aid.name.lower(),
        "fused": aid.fused,
        "refused": _counts(aid.refused),
        "fused_age_s": view.age_of_s(aid.t_fused_ns),
        "last_status": kebab(AidStatus(int(last[1])).name) if last else "",
        "test_ratio": last[14] if last else None,
        "innovation": tuple(last[8 + i] for i in used),
        "innovation_sigma": tuple(math.sqrt(last[11 + i]) if last[11 + i] >= 0.0 else None for i in used),
        "nis_mean": aid.nis_mean,
        "nis_low": aid.nis_low,
        "nis_high": aid.nis_high,
        "nis_samples": aid.nis_samples,
        "verdict": aid.verdict,
    }
    return AidOut.model_validate(fields)


def consistency_out(view: BoardView) -> tuple[ConsistencyOut, ...]:
    """Return the main lane's consistency; none before the engine exists."""
    groups = view.snapshot.consistency if view.snapshot is not None else ()
    return tuple(ConsistencyOut.model_validate(asdict(group)) for group in groups)


TOLD_OF: Final[dict[DelayedName, str]] = {
    "imu": "imu",
    "gnss_position": "gnss",
    "gnss_velocity": "gnss",
    "mag": "mag",
    "baro": "baro",
}
"""Measurement → the delay that may be told of it: a receiver's position and velocity are told together."""


def delays_out(view: BoardView) -> tuple[DelayOut, ...]:
    """Return the delay of every measurement with where it is from; none before the first sample."""
    snapshot = view.snapshot
    return tuple(_delay(snapshot, name) for name in TOLD_OF) if snapshot is not None and snapshot.t_ns >= 0 else ()


def _delay(snapshot: Snapshot, name: DelayedName) -> DelayOut:
    added = next((one.delay_s for one in snapshot.filter_delays if one.name == TOLD_OF[name]), None)
    return _known_delay(snapshot, name).model_copy(update={"filter_s": added})


def _known_delay(snapshot: Snapshot, name: DelayedName) -> DelayOut:
    told = next((one for one in snapshot.told_delays if one.name == TOLD_OF[name]), None)
    if told is not None:
        return DelayOut.model_validate({"measurement": name, "delay_s": told.delay_s, "source": told.source})
    found = next((one for one in snapshot.delays if one.name == name), None)
    if found is not None:
        return DelayOut(measurement=name, delay_s=found.delay_s, sigma_s=found.sigma_s, source="estimated")
    return DelayOut(measurement=name, source="unknown")


def lanes_out(view: BoardView) -> tuple[LaneOut, ...]:
    """Return every estimator in short."""
    return tuple(_lane(view, lane) for lane in view.snapshot.lanes) if view.snapshot is not None else ()


def _lane(view: BoardView, lane: LaneState) -> LaneOut:
    row = dict(zip(LANE_COLUMNS, lane.row.tolist(), strict=False))
    nan = math.nan
    fields: dict[str, object] = {
        "lane": lane.lane,
        "provides": lane.provides,
        "status": lane_status(lane).name.lower(),
        "failure": lane.failure,
        "t_ns": lane.t_ns,
        "age_s": view.age_of_s(lane.t_ns),
        "sigma_heading_rad": row.get("sigma_att_z_rad", nan),
        "sigma_tilt_rad": math.hypot(row.get("sigma_att_x_rad", nan), row.get("sigma_att_y_rad", nan)),
        "sigma_h_m": math.hypot(row.get("sigma_pos_n_m", nan), row.get("sigma_pos_e_m", nan)),
        "sigma_v_m": row.get("sigma_pos_d_m", nan),
        "dead_reckoning_s": row.get("dead_reckoning_s", nan),
    }
    return LaneOut.model_validate(fields)


def choices_out(view: BoardView) -> LanesOut:
    """Return every estimator there is, with its parameters as they are set."""
    lanes = tuple(_choice(view, info) for info in view.lane_infos)
    return LanesOut(board_id=view.id, main_lane=view.lanes[0], chosen=view.lanes, lanes=lanes)


def _choice(view: BoardView, info: LaneInfo) -> LaneChoiceOut:
    states = {lane.lane: lane for lane in view.snapshot.lanes} if view.snapshot is not None else {}
    fields: dict[str, object] = {
        "name": info.name,
        "provides": info.provides,
        "chosen": info.name in view.lanes,
        "running": info.running,
        "failure": info.failure,
        "status": lane_status(states[info.name]).name.lower() if info.name in states else None,
        "parameters": tuple(
            ParameterOut(
                name=one.name,
                unit=one.unit,
                default=one.default,
                minimum=one.minimum,
                maximum=one.maximum,
                meaning=one.meaning,
                value=info.values[one.name],
            )
            for one in info.parameters
        ),
    }
    return LaneChoiceOut.model_validate(fields)


def site_out(site: Site | None) -> SiteOut | None:
    """Return the origin of the local frame; None when it is unknown."""
    if site is None:
        return None
    return SiteOut(**{name: getattr(site, name) for name in Site.__dataclass_fields__})

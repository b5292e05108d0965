"""`summary.json` from what a replay kept."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from typing import Final

import numpy as np

from server.chain_values import changed_chain
from server.lane_values import changed_values
from server.magnetic import WMM_FIRST_YEAR, WMM_LAST_YEAR
from server.nav.types import Aid, AidStatus, EngineSettings, Event, Kind, SensorHealth, Site
from server.replay.collect import Boot
from server.replay.contract import (
    AidOut,
    EventOut,
    LaneOut,
    LogOut,
    ReplaySettingsOut,
    SensorOut,
    SettingsOut,
    SiteOut,
)
from server.replay.contract_preprocessing import CalibrationOut
from server.replay.csv_out import STATUS_COLUMN, STATUS_WORDS
from server.replay.options import Stretch
from server.replay.score import compare, errors, outage
from server.replay.source import LogInput

YEAR_TOLERANCE: Final = 1e-6
SETTLING_NS: Final = 30_000_000_000
"""The settled window begins this long after the first 3-D fix: the filter has then aligned and found its biases."""


def known(value: float) -> float | None:
    """Return a finite number as it is, anything else as None (JSON has no NaN)."""
    return float(value) if math.isfinite(value) else None


def stem(lane: str, place: int) -> str:
    """Return the file stem of a lane in the log's first (0), second (1), … power-up."""
    return lane if place == 0 else f"{lane}.boot{place}"


def navdeck_version() -> str:
    """Return the installed package's version."""
    return version("navdeck")


def score_lane(boot: Boot, place: int, lane: str, stretches: Sequence[Stretch], t_origin_ns: int) -> LaneOut:
    """Return one lane's account: rows by status, and its errors where the log has a reference."""
    from server.nav.lanes.registry import provides_of  # loads every kernel, as the engine did

    t_ns, data = boot.lane(lane)
    status = data[:, STATUS_COLUMN]
    words = {word: int((status == k).sum()) for k, word in enumerate(STATUS_WORDS)}
    found = compare(t_ns, data, *boot.reference()) if len(t_ns) and boot.samples[Kind.REFERENCE] else None
    whole = errors(found) if found else None
    settled = errors(found.within(boot.t_fix_ns + SETTLING_NS, 1 << 62)) if found and boot.t_fix_ns >= 0 else None
    return LaneOut(
        file=f"{stem(lane, place)}.csv",
        provides=provides_of(lane),
        failure=boot.failure(lane),
        boot_id=boot.boot_id,
        rows=len(t_ns),
        status_rows=words,
        compared_at=found.stamps if found and whole else None,
        whole=whole,
        settled=settled,
        outages=[outage(found, t_origin_ns, stretch) for stretch in stretches] if found else [],
    )


def log_out(log: LogInput, boots: Sequence[Boot]) -> LogOut:
    """Return what was replayed."""
    account = log.account()
    lived = [boot for boot in boots if boot.samples.any()]
    return LogOut(
        name=log.path.name or log.path.resolve().name,
        kind="tlog" if log.kind == "tlog" else "folder",
        bytes_in=account.bytes_in,
        board=account.board,
        boots=len(boots),
        t_first_ns=lived[0].t_first_ns if lived else None,
        t_last_ns=lived[-1].t_last_ns if lived else None,
        duration_s=sum(boot.t_last_ns - boot.t_first_ns for boot in lived) * 1e-9,
    )


def settings_out(settings: EngineSettings) -> SettingsOut:
    """Return what the engine was told."""
    return SettingsOut(
        nav_rate_hz=settings.nav_rate_hz,
        lanes=list(settings.lanes),
        lane_parameters=changed_values(settings.lane_parameters),
        vehicle=settings.vehicle.name.lower(),
        gnss_delay_s=known(settings.gnss_delay_s),
        lever_arm_b_m=list(settings.lever_arm_b_m),
        aids={name: bool(getattr(settings, f"use_{name}")) for name in ("gnss", "baro", "mag", "airspeed")},
        gnss_outages_s=[(float(a), float(b)) for a, b in settings.gnss_withheld_s],
        t_origin_ns=settings.t_origin_ns if settings.t_origin_ns >= 0 else None,
    )


def replay_settings_out(settings: EngineSettings, calibration: Sequence[CalibrationOut]) -> ReplaySettingsOut:
    """Return what the engine was told, preprocessing included."""
    plain = settings_out(settings)
    return ReplaySettingsOut(
        **{name: getattr(plain, name) for name in type(plain).model_fields},
        preprocess=changed_chain(settings.chain),
        calibration=list(calibration),
    )


def date_notes(settings: EngineSettings, boots: Iterable[Boot]) -> list[str]:
    """Return a note for each date that the magnetic model does not cover: it was held at the nearest end."""
    notes = []
    for boot in boots:
        told = settings.decimal_year if math.isfinite(settings.decimal_year) else boot.decimal_year
        site = boot.snapshot.site if boot.snapshot is not None else None
        if site is None or site.date_source not in {"settings", "board"}:
            continue
        if abs(told - site.decimal_year) > YEAR_TOLERANCE:
            notes.append(
                f"the date {told:.2f} is outside the magnetic model's life, {WMM_FIRST_YEAR:.1f} to "
                f"{WMM_LAST_YEAR:.1f}: the field of {site.decimal_year:.2f} is used. Check the date, or update navdeck."
            )
    return list(dict.fromkeys(notes))


def site_out(boots: Sequence[Boot]) -> SiteOut | None:
    """Return the site of the last power-up that found one."""
    sites = [boot.snapshot.site for boot in boots if boot.snapshot is not None and boot.snapshot.site is not None]
    return _site(sites[-1]) if sites else None


def _site(site: Site) -> SiteOut:
    return SiteOut(
        lat_deg=known(site.lat_deg),
        lon_deg=known(site.lon_deg),
        alt_m=known(site.alt_m),
        gravity_m_s2=known(site.gravity_m_s2),
        declination_rad=known(site.declination_rad),
        field_n_gauss=[float(part) for part in site.field_n_gauss] or None,
        decimal_year=known(site.decimal_year),
        date_source=site.date_source,
    )


def samples_out(boots: Iterable[Boot]) -> dict[str, int]:
    """Return rows given to the engine by kind, zeros included."""
    total = sum((boot.samples for boot in boots), np.zeros(len(Kind) + 1, dtype=np.int64))
    return {kind.name.lower(): int(total[kind]) for kind in Kind}


def sensors_out(boots: Iterable[Boot]) -> list[SensorOut]:
    """Return the engine's own account of each sensor in each power-up."""
    return [_sensor(b.boot_id, sensor) for b in boots if b.snapshot is not None for sensor in b.snapshot.sensors]


def _sensor(boot_id: int, sensor: SensorHealth) -> SensorOut:
    return SensorOut(
        boot_id=boot_id,
        name=sensor.name,
        fresh=sensor.samples,
        repeated=sensor.repeated,
        refused=dict(sensor.refused),
        rate_hz=known(sensor.rate_hz),
        scale=sensor.scale,
        note=sensor.note,
    )


def aids_out(boots: Sequence[Boot]) -> dict[str, AidOut]:
    """Return fused and refused measurements of each aid; refusals by reason, only those that happened."""
    total = sum((boot.aids for boot in boots), np.zeros((len(Aid), len(AidStatus)), dtype=np.int64))
    return {aid.name.lower(): _aid(total[aid].tolist()) for aid in Aid}


def _aid(counts: list[int]) -> AidOut:
    refused = {
        status.name.lower().removeprefix("refused_"): counts[status]
        for status in AidStatus
        if status is not AidStatus.FUSED and counts[status]
    }
    return AidOut(fused=counts[AidStatus.FUSED], refused=refused)


def events_out(boots: Iterable[Boot]) -> list[EventOut]:
    """Return every event in order."""
    return [_event(boot.boot_id, event) for boot in boots for event in boot.events]


def _event(boot_id: int, event: Event) -> EventOut:
    return EventOut(
        boot_id=boot_id,
        t_ns=event.t_ns,
        code=event.code,
        severity=event.severity,
        text=event.text,
        values={name: known(value) for name, value in event.values},
    )

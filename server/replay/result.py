"""What a replay kept, into its files and its summary."""

from __future__ import annotations

import time
from collections.abc import Sequence

from server.nav.types import EngineSettings, Kind
from server.replay import summary as build
from server.replay.calibration import Given
from server.replay.clock import Clock
from server.replay.collect import Boot
from server.replay.contract import LaneOut, SummaryOut
from server.replay.csv_out import csv_lines, header_line
from server.replay.learning import LearningLog, mag_learning_out, write_learning
from server.replay.options import Mode, idle_values
from server.replay.output import Output
from server.replay.source import LogInput
from server.replay.stages import idle_chain, stages_out, write_stages


def score(boots: Sequence[Boot], settings: EngineSettings, clock: Clock) -> dict[str, LaneOut]:
    """Return each lane's account, by file stem."""
    start = time.perf_counter()
    scored = {
        build.stem(lane, place): build.score_lane(boot, place, lane, settings.gnss_withheld_s, settings.t_origin_ns)
        for place, boot in enumerate(boots or [Boot(boot_id=0)])
        for lane in settings.lanes
    }
    clock.score_s = time.perf_counter() - start
    return scored


def write(output: Output, boots: Sequence[Boot], lanes: Sequence[str], clock: Clock) -> None:
    """Write every file but the summary."""
    start = time.perf_counter()
    for place, boot in enumerate(boots or [Boot(boot_id=0)]):
        for lane in lanes:
            output.write(f"{build.stem(lane, place)}.csv", header_line(), csv_lines(*boot.lane(lane)))
    write_stages(output, boots)
    write_learning(output, _learning(boots))
    clock.write_s = time.perf_counter() - start


def summary(
    source: LogInput,
    settings: EngineSettings,
    given: Given,
    mag_learning: Mode | None,
    boots: Sequence[Boot],
    lanes: dict[str, LaneOut],
) -> SummaryOut:
    """Return the summary, its timing still to be filled in."""
    account = source.account()
    empty = [f"{name}: no row; {_why_empty(name, boots)}" for name, lane in lanes.items() if not lane.rows]
    return SummaryOut(
        navdeck_version=build.navdeck_version(),
        log=build.log_out(source, boots),
        settings=build.replay_settings_out(settings, given.parts),
        site=build.site_out(boots),
        samples=build.samples_out(boots),
        losses=dict(account.losses),
        sensors=build.sensors_out(boots),
        aids=build.aids_out(boots),
        events=build.events_out(boots),
        timing=Clock().timing(0.0, 0, 0.0),
        lanes=lanes,
        stages=stages_out(boots),
        mag_learning=mag_learning_out(mag_learning, _learning(boots)) if mag_learning is not None else None,
        notes=[
            *account.notes,
            *idle_values(settings.lane_parameters, settings.lanes),
            *idle_chain(settings.chain, boots),
            *build.date_notes(settings, boots),
            *empty,
        ],
    )


def _learning(boots: Sequence[Boot]) -> list[LearningLog]:
    return [boot.learning for boot in boots if boot.learning is not None]


def _why_empty(stem: str, boots: Sequence[Boot]) -> str:
    """Return what the lane would have needed."""
    lane = stem.split(".", maxsplit=1)[0]
    needs = {"reference": Kind.REFERENCE, "onboard": Kind.ONBOARD, "dmp": Kind.DMP}.get(lane, Kind.IMU)
    if any(boot.samples[needs] for boot in boots):
        return "its samples never sufficed for a step."
    return f"the log has no {needs.name.lower()} samples."

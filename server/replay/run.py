"""A log through the very engine that runs live, as fast as it goes, into lane files and a summary."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from server.magnetic import wmm_field
from server.nav.types import EngineSettings, FieldModel, Kind, SampleBlock, Snapshot, StepResult
from server.replay import summary as build
from server.replay.collect import Boot
from server.replay.contract import LaneOut, SummaryOut, TimingOut
from server.replay.csv_out import csv_lines, header_line
from server.replay.errors import ReplayError
from server.replay.options import checked_lanes, checked_outage, checked_values, idle_values, known_lanes, merged
from server.replay.output import SUMMARY, Output
from server.replay.source import BLOCK_ROWS, LogInput, load


class Engine(Protocol):
    """The part of NavEngine a replay uses."""

    def step(self, block: SampleBlock) -> StepResult:
        """Take a block of samples; return every row it produced."""
        ...

    def finish(self) -> StepResult:
        """End a power-up; return the rows of the lanes that need all of it."""
        ...

    def snapshot(self) -> Snapshot:
        """Return the newest state of everything."""
        ...


EngineFactory = Callable[[EngineSettings, FieldModel], Engine]


@dataclass(slots=True)
class _Clock:
    """Where the time goes."""

    read_s: float = 0.0
    engine_s: float = 0.0
    finish_s: float = 0.0
    score_s: float = 0.0
    write_s: float = 0.0

    def timing(self, total_s: float, samples: int, duration_s: float) -> TimingOut:
        """Return the account; rates are None when the engine had nothing to do."""
        busy = self.engine_s > 0.0 and samples > 0
        return TimingOut(
            read_s=self.read_s,
            engine_s=self.engine_s,
            finish_s=self.finish_s,
            score_s=self.score_s,
            write_s=self.write_s,
            total_s=total_s,
            samples_per_s=samples / self.engine_s if busy else None,
            real_time_factor=duration_s / self.engine_s if busy else None,
        )


def nav_engine(settings: EngineSettings, field_model: FieldModel) -> Engine:
    """Return the engine that also runs live; the import compiles or loads its kernels."""
    from server.nav.engine import NavEngine

    try:
        return NavEngine(settings, field_model)
    except ValueError as error:
        raise ReplayError(f"the engine refuses its settings: {error}.") from error


def replay(
    log: Path,
    out: Path,
    *,
    lanes: Sequence[str] | None = None,
    gnss_outages: Iterable[Sequence[float]] = (),
    nav_rate_hz: float | None = None,
    lane_parameters: Mapping[str, Mapping[str, float]] | None = None,
    overrides: dict[str, Any] | None = None,
    overwrite: bool = False,
    block_rows: int = BLOCK_ROWS,
    progress: Callable[[float], None] | None = None,
    engine_factory: EngineFactory = nav_engine,
) -> SummaryOut:
    """Replay a log into a directory and return its summary.

    Args:
        log: a .tlog or a sensor folder.
        out: directory for `<lane>.csv` and `summary.json`; made, or an earlier replay's replaced.
        lanes: names of the lanes to run; None = all.
        gnss_outages: stretches (a, b) in seconds after the earliest t_ns of any file whose GNSS is withheld.
        nav_rate_hz: navigation steps a second; None = the default.
        lane_parameters: lane → parameter → value, for what is not to be at its default.
        overrides: further fields of EngineSettings; they win over the log's own.
        overwrite: write into a directory that holds other files.
        block_rows: samples a call of the engine; the results do not depend on it.
        progress: told the share done, 0 to 1.
        engine_factory: builds the engine.

    Raises:
        ReplayError: the log, an option or the directory is not usable; the message names the remedy.
    """
    begun, clock = time.perf_counter(), _Clock()
    with Output(out, log, overwrite=overwrite) as output:
        source = load(log)
        chosen: dict[str, Any] = {} if nav_rate_hz is None else {"nav_rate_hz": nav_rate_hz}
        if lane_parameters is not None:
            chosen["lane_parameters"] = checked_values(lane_parameters)
        told = {
            "lanes": checked_lanes(known_lanes() if lanes is None else lanes),
            "gnss_withheld_s": tuple(checked_outage(stretch) for stretch in gnss_outages),
            "t_origin_ns": source.t_origin_ns,
        }
        settings = merged(source.overrides, overrides or {}, chosen, told)
        clock.read_s = time.perf_counter() - begun
        boots = _run(source, engine_factory(settings, wmm_field), block_rows, clock, progress)
        scored = _lanes(boots, settings, clock)
        _write_lanes(output, boots, settings.lanes, clock)
        found = _summary(source, settings, boots, scored)
        timing = clock.timing(time.perf_counter() - begun, sum(found.samples.values()), found.log.duration_s)
        found = found.model_copy(update={"timing": timing})
        output.write(SUMMARY, found.model_dump_json(indent=2).encode(), b"\n")
        output.commit()
    return found


def _run(
    source: LogInput, engine: Engine, block_rows: int, clock: _Clock, progress: Callable[[float], None] | None
) -> list[Boot]:
    """Drive the engine through the log; return what each power-up gave."""
    boots: list[Boot] = []
    for block in _timed(source.blocks(block_rows), clock):
        if not boots or boots[-1].boot_id != block.boot_id:
            if boots:
                _end(boots[-1], engine, clock)
            boots.append(Boot(boot_id=block.boot_id))
        boots[-1].add_block(block)
        start = time.perf_counter()
        result = engine.step(block)
        clock.engine_s += time.perf_counter() - start
        boots[-1].add_result(result)
        if progress is not None:
            progress(source.fraction())
    if boots:
        _end(boots[-1], engine, clock)
    return boots


def _end(boot: Boot, engine: Engine, clock: _Clock) -> None:
    """Take what the lanes say at the end of a power-up."""
    start = time.perf_counter()
    boot.close(engine.finish(), engine.snapshot)
    clock.finish_s += time.perf_counter() - start


def _timed(blocks: Iterator[SampleBlock], clock: _Clock) -> Iterator[SampleBlock]:
    """Yield the blocks, the time they took to read put on the clock."""
    while True:
        start = time.perf_counter()
        block = next(blocks, None)
        clock.read_s += time.perf_counter() - start
        if block is None:
            return
        yield block


def _lanes(boots: Sequence[Boot], settings: EngineSettings, clock: _Clock) -> dict[str, LaneOut]:
    start = time.perf_counter()
    scored = {
        build.stem(lane, place): build.score_lane(boot, place, lane, settings.gnss_withheld_s, settings.t_origin_ns)
        for place, boot in enumerate(boots or [Boot(boot_id=0)])
        for lane in settings.lanes
    }
    clock.score_s = time.perf_counter() - start
    return scored


def _write_lanes(output: Output, boots: Sequence[Boot], lanes: Sequence[str], clock: _Clock) -> None:
    start = time.perf_counter()
    for place, boot in enumerate(boots or [Boot(boot_id=0)]):
        for lane in lanes:
            output.write(f"{build.stem(lane, place)}.csv", header_line(), csv_lines(*boot.lane(lane)))
    clock.write_s = time.perf_counter() - start


def _summary(
    source: LogInput, settings: EngineSettings, boots: Sequence[Boot], lanes: dict[str, LaneOut]
) -> SummaryOut:
    account = source.account()
    empty = [f"{name}: no row; {_why_empty(name, boots)}" for name, lane in lanes.items() if not lane.rows]
    return SummaryOut(
        navdeck_version=build.navdeck_version(),
        log=build.log_out(source, boots),
        settings=build.settings_out(settings),
        site=build.site_out(boots),
        samples=build.samples_out(boots),
        losses=dict(account.losses),
        sensors=build.sensors_out(boots),
        aids=build.aids_out(boots),
        events=build.events_out(boots),
        timing=_Clock().timing(0.0, 0, 0.0),
        lanes=lanes,
        notes=[
            *account.notes,
            *idle_values(settings.lane_parameters, settings.lanes),
            *build.date_notes(settings, boots),
            *empty,
        ],
    )


def _why_empty(stem: str, boots: Sequence[Boot]) -> str:
    """Return what the lane would have needed."""
    lane = stem.split(".", maxsplit=1)[0]
    needs = {"reference": Kind.REFERENCE, "onboard": Kind.ONBOARD, "dmp": Kind.DMP}.get(lane, Kind.IMU)
    if any(boot.samples[needs] for boot in boots):
        return "its samples never sufficed for a step."
    return f"the log has no {needs.name.lower()} samples."

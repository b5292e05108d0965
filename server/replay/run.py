"""A log through the very engine that runs live, as fast as it goes, into lane files and a summary."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from server.magnetic import wmm_field
from server.nav.types import EngineSettings, FieldModel, SampleBlock, Snapshot, StepResult
from server.replay import result
from server.replay.calibration import read_calibrations
from server.replay.clock import Clock
from server.replay.collect import Boot
from server.replay.contract import SummaryOut
from server.replay.errors import ReplayError
from server.replay.learning import Learner, LearningLog
from server.replay.options import (
    Mode,
    checked_chain,
    checked_lanes,
    checked_outage,
    checked_values,
    known_lanes,
    merged,
)
from server.replay.output import SUMMARY, Output
from server.replay.source import BLOCK_ROWS, LogInput, load


class Engine(Learner, Protocol):
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

    def set_mag_learning(self, run: bool, apply: bool) -> None:
        """Switch learning the magnetic offset in flight, and its use, on or off."""
        ...


EngineFactory = Callable[[EngineSettings, FieldModel], Engine]


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
    chain: Mapping[str, Mapping[str, float]] | None = None,
    calibrations: Iterable[Path] = (),
    mag_learning: Mode | None = None,
    overrides: dict[str, Any] | None = None,
    overwrite: bool = False,
    block_rows: int = BLOCK_ROWS,
    progress: Callable[[float], None] | None = None,
    engine_factory: EngineFactory = nav_engine,
) -> SummaryOut:
    """Replay a log into a directory and return its summary.

    Args:
        log: a .tlog or a sensor folder.
        out: directory for the CSV files and `summary.json`; made, or an earlier replay's replaced.
        lanes: names of the lanes to run; None = all.
        gnss_outages: stretches (a, b) in seconds after the earliest t_ns of any file whose GNSS is withheld.
        nav_rate_hz: navigation steps a second; None = the default.
        lane_parameters: lane → parameter → value, for what is not to be at its default.
        chain: sensor → parameter → value of the preprocessing, likewise.
        calibrations: files that together are in force from the first sample on; the later one of a sensor wins.
        mag_learning: "run" only watches, "apply" also takes off what was learned; None = off.
        overrides: further fields of EngineSettings; they win over the log's own.
        overwrite: write into a directory that holds other files.
        block_rows: samples a call of the engine; the results do not depend on it.
        progress: told the share done, 0 to 1.
        engine_factory: builds the engine.

    Raises:
        ReplayError: the log, an option or the directory is not usable; the message names the remedy.
    """
    begun, clock, given = time.perf_counter(), Clock(), read_calibrations(calibrations)
    with Output(out, log, overwrite=overwrite) as output:
        source = load(log)
        chosen: dict[str, Any] = {} if nav_rate_hz is None else {"nav_rate_hz": nav_rate_hz}
        if lane_parameters is not None:
            chosen["lane_parameters"] = checked_values(lane_parameters)
        if chain is not None:
            chosen["chain"] = checked_chain(chain)
        if given.calibration is not None:
            chosen["calibration"] = given.calibration
        told = {
            "lanes": checked_lanes(known_lanes() if lanes is None else lanes),
            "gnss_withheld_s": tuple(checked_outage(stretch) for stretch in gnss_outages),
            "t_origin_ns": source.t_origin_ns,
        }
        settings = merged(source.overrides, overrides or {}, chosen, told)
        clock.read_s = time.perf_counter() - begun
        engine = engine_factory(settings, wmm_field)
        boots = _run(source, engine, mag_learning, block_rows, clock, progress)
        scored = result.score(boots, settings, clock)
        result.write(output, boots, settings.lanes, clock)
        found = result.summary(source, settings, given, mag_learning, boots, scored)
        timing = clock.timing(time.perf_counter() - begun, sum(found.samples.values()), found.log.duration_s)
        found = found.model_copy(update={"timing": timing})
        output.write(SUMMARY, found.model_dump_json(indent=2).encode(), b"\n")
        output.commit()
    return found


def _run(
    source: LogInput,
    engine: Engine,
    mag_learning: Mode | None,
    block_rows: int,
    clock: Clock,
    progress: Callable[[float], None] | None,
) -> list[Boot]:
    """Drive the engine through the log; return what each power-up gave."""
    boots: list[Boot] = []
    if mag_learning is not None:
        engine.set_mag_learning(run=True, apply=mag_learning == "apply")
    for block in _timed(source.blocks(block_rows), clock):
        if not boots or boots[-1].boot_id != block.boot_id:
            if boots:
                _end(boots[-1], engine, clock)
            learning = LearningLog(engine, block.boot_id, len(boots)) if mag_learning is not None else None
            boots.append(Boot(boot_id=block.boot_id, learning=learning))
        boots[-1].add_block(block)
        _step(boots[-1], block, engine, clock)
        if progress is not None:
            progress(source.fraction())
    if boots:
        _end(boots[-1], engine, clock)
    return boots


def _step(boot: Boot, block: SampleBlock, engine: Engine, clock: Clock) -> None:
    """Give one block to the engine, in parts where what is being learned is to be seen."""
    for part in boot.learning.pieces(block) if boot.learning is not None else (block,):
        start = time.perf_counter()
        found = engine.step(part)
        clock.engine_s += time.perf_counter() - start
        boot.add_result(found)


def _end(boot: Boot, engine: Engine, clock: Clock) -> None:
    """Take what the lanes say at the end of a power-up."""
    if boot.learning is not None:
        boot.learning.close()
    start = time.perf_counter()
    boot.close(engine.finish(), engine.snapshot)
    clock.finish_s += time.perf_counter() - start


def _timed(blocks: Iterator[SampleBlock], clock: Clock) -> Iterator[SampleBlock]:
    """Yield the blocks, the time they took to read put on the clock."""
    while True:
        start = time.perf_counter()
        block = next(blocks, None)
        clock.read_s += time.perf_counter() - start
        if block is None:
            return
        yield block

"""What a navigation step of each lane costs, measured here around the lanes: the core has no clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter_ns
from typing import Any, Final

import numpy as np

from server.compare.contract import CostOut
from server.nav.engine import NavEngine
from server.nav.lanes.bank import LaneBank
from server.nav.lanes.base import Lane, LaneContext, LaneResult
from server.nav.types import EngineSettings, FieldModel, Float, Int, SampleBlock

PASSES: Final = 3
SAMPLES: Final = 262_144
"""The cost is measured over so many samples at most: ten minutes at 400 Hz."""


@dataclass(slots=True)
class Meter:
    """Time spent in one lane during the present block."""

    ns: int = 0
    steps: int = 0


class TimedLane:
    """A lane that is timed from outside and otherwise itself."""

    def __init__(self, lane: Lane, meter: Meter) -> None:
        self._lane, self._meter = lane, meter

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401  # whatever else the lane has
        value = getattr(self._lane, name)
        return partial(self._timed, value) if name == "finish" else value

    def _timed(self, call: Callable[..., LaneResult], *values: object) -> LaneResult:
        begun = perf_counter_ns()
        result = call(*values)
        self._meter.ns += perf_counter_ns() - begun
        return result

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance the lane, its time taken."""
        self._meter.steps += len(steps)
        return self._timed(self._lane.step, steps, meas, t_ns)


class TimedBank(LaneBank):
    """A bank whose lanes are timed."""

    def __init__(self, settings: EngineSettings, meters: dict[str, Meter]) -> None:
        super().__init__(settings)
        self._meters = meters

    def start(self, context: LaneContext) -> None:
        """Make the chosen lanes and put each behind its meter."""
        super().start(context)
        for name, lane in self._running.items():
            if not isinstance(lane, TimedLane):
                timed: Any = TimedLane(lane, self._meters.setdefault(name, Meter()))
                self._running[name] = timed


class TimedEngine(NavEngine):
    """The engine with a timed bank."""

    def __init__(self, settings: EngineSettings, field_model: FieldModel) -> None:
        super().__init__(settings, field_model)
        self.meters: dict[str, Meter] = {}
        self._bank = TimedBank(settings, self.meters)


@dataclass(frozen=True, slots=True, kw_only=True)
class Costs:
    """Cost of each lane that computes, and of the engine without them."""

    lanes: Mapping[str, CostOut] = field(default_factory=dict)
    engine_ns_per_step: float | None = None


def measure(
    blocks: Sequence[SampleBlock], settings: EngineSettings, field_model: FieldModel, passes: int = PASSES
) -> Costs:
    """Return what a step costs: of every block the fastest of several passes, so that other work here counts little."""
    if not blocks:
        return Costs()
    runs = [_times(blocks, settings, field_model) for _ in range(passes)]
    steps = {name: taken for name, taken in runs[0][1].items() if taken}
    fastest = {name: np.min([times.get(name, times[""]) for times, _ in runs], axis=0) for name in ("", *steps)}
    total = max(steps.values(), default=0)
    rest = float(fastest[""].sum()) - sum(float(fastest[name].sum()) for name in steps)
    return Costs(
        lanes={
            name: CostOut(ns_per_step=float(fastest[name].sum()) / count, steps=count, passes=passes)
            for name, count in steps.items()
        },
        engine_ns_per_step=max(rest, 0.0) / total if total else None,
    )


def _times(
    blocks: Sequence[SampleBlock], settings: EngineSettings, field_model: FieldModel
) -> tuple[dict[str, Int], dict[str, int]]:
    """Return ns by lane and block ("" = the whole engine), and steps by lane, of one pass."""
    engine = TimedEngine(settings, field_model)
    times: dict[str, Int] = {"": np.zeros(len(blocks), dtype=np.int64)}
    for place, block in enumerate(blocks):
        for meter in engine.meters.values():
            meter.ns = 0
        begun = perf_counter_ns()
        engine.step(block)
        if place == len(blocks) - 1:
            engine.finish()
        times[""][place] = perf_counter_ns() - begun
        for name, meter in engine.meters.items():
            times.setdefault(name, np.zeros(len(blocks), dtype=np.int64))[place] = meter.ns
    return times, {name: meter.steps for name, meter in engine.meters.items()}

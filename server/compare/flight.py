"""One engine run over one log with every lane in it, and what is kept of it for comparing."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from server.compare.cost import SAMPLES
from server.compare.signals import Rows, quiet_steps, rows_of_lane
from server.nav.types import Float, Int, Kind, SampleBlock, StepResult
from server.replay.collect import Boot
from server.replay.run import Engine


@dataclass(slots=True, kw_only=True, eq=False)
class Flight:
    """One power-up of the board: what `Boot` keeps, and when the board was quiet."""

    boot: Boot
    _steps: list[tuple[Int, Float]] = field(default_factory=list)

    def add(self, block: SampleBlock, result: StepResult) -> None:
        """Keep what one call took and gave."""
        self.boot.add_block(block)
        self.boot.add_result(result)
        if len(result.filtered.t_ns):
            self._steps.append((result.filtered.t_ns, result.filtered.data[:, :6]))

    def quiet(self) -> tuple[Int, Float]:
        """Return stamps of the navigation steps and 1 where the board was quiet."""
        if not self._steps:
            return np.empty(0, dtype=np.int64), np.empty(0)
        t_ns = np.concatenate([stamps for stamps, _ in self._steps])
        data = np.concatenate([rows for _, rows in self._steps])
        return t_ns, quiet_steps(t_ns, data[:, :3], data[:, 3:6])

    def rows(self, lane: str) -> Rows:
        """Return a lane's states; `reference` as it was logged."""
        if lane == "reference":
            return Rows(t_ns=(known := self.boot.reference())[0], data=known[1])
        return rows_of_lane(*self.boot.lane(lane))


@dataclass(slots=True, kw_only=True, eq=False)
class Flown:
    """Everything one run gave.

    Attributes:
        flights: one a power-up, at least one.
        excerpt: the first blocks, kept to measure costs on.
    """

    flights: list[Flight] = field(default_factory=list)
    excerpt: list[SampleBlock] = field(default_factory=list)


def fly(
    blocks: Iterable[SampleBlock],
    engine: Engine,
    *,
    fraction: Callable[[], float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Flown:
    """Run the blocks through the engine.

    Args:
        blocks: in order.
        engine: before its first block.
        fraction: how much of the log has been read, 0 to 1.
        progress: told that share after each block.
    """
    out, kept = Flown(), 0
    for block in blocks:
        if not out.flights or out.flights[-1].boot.boot_id != block.boot_id:
            if out.flights:
                out.flights[-1].boot.close(engine.finish(), engine.snapshot)
            out.flights.append(Flight(boot=Boot(boot_id=block.boot_id)))
        out.flights[-1].add(block, engine.step(block))
        if kept < SAMPLES:
            out.excerpt.append(block)
            kept += len(block.kind)
        if progress is not None and fraction is not None:
            progress(fraction())
    if out.flights:
        out.flights[-1].boot.close(engine.finish(), engine.snapshot)
    else:
        out.flights.append(Flight(boot=Boot(boot_id=0)))
    return out


def has_reference(flown: Flown) -> bool:
    """Return whether the log carries a better source."""
    return any(flight.boot.samples[Kind.REFERENCE] for flight in flown.flights)

"""What a board is made of, as it sees it: a link, a protocol and an engine, and how to make each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from server.link.base import Link
from server.nav.calibration.applied import Calibration
from server.nav.types import Float, Kind, SampleBlock, Snapshot, StepResult
from server.protocol.base import BoardProtocol
from server.traffic import Detect

if TYPE_CHECKING:
    from server.nav.calibration.mag_learning import MagLearnState
    from server.nav.lanes.registry import LaneInfo  # importing it loads every kernel
    from server.nav.preprocess.chain_parameters import ChainInfo


class Engine(Protocol):
    """What a board needs of `server.nav.engine.NavEngine`."""

    def step(self, block: SampleBlock) -> StepResult:
        """Take samples; return everything they produced."""
        ...

    def snapshot(self) -> Snapshot:
        """Return the newest state of everything."""
        ...

    def lanes(self) -> tuple[LaneInfo, ...]:
        """Return every lane there is, with its parameters as they are set."""
        ...

    def choose_lanes(self, names: tuple[str, ...]) -> None:
        """Run these lanes from the next step on; `ValueError` for names that cannot be."""
        ...

    def set_lane_parameters(self, lane: str, values: Mapping[str, float]) -> None:
        """Change parameters from the next step on; `ValueError`, and nothing changed, for what a lane does not take."""
        ...

    def set_calibration(self, calibration: Calibration) -> None:
        """Apply this calibration from the next sample on."""
        ...

    def converted(self, kind: Kind, rows: Float) -> Float:
        """Return raw rows, shape (n, ROW_WIDTH), in SI and body axes."""
        ...

    def chain(self) -> tuple[ChainInfo, ...]:
        """Return the preprocessing of every sensor as it is set."""
        ...

    def set_chain(self, sensor: str, values: Mapping[str, float]) -> None:
        """Change one sensor's preprocessing from the next sample on; `ValueError` for what it does not take."""
        ...

    def set_mag_learning(self, run: bool, apply: bool) -> None:
        """Switch learning the magnetic offset in flight, and its use, on or off."""
        ...

    def mag_learning(self) -> MagLearnState | None:
        """Return what was learned; None when it does not run."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardParts:
    """How to make the parts of a board: a link for every connection, protocol and engine when it starts afresh."""

    link: Callable[[], Link]
    protocol: Callable[[], BoardProtocol]
    engine: Callable[[], Engine]
    detect: Detect = lambda _data, _url: None
    observe_latency: Callable[[float], None] = lambda _latency_s: None

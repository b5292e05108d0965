"""A board at one moment: what the API, the page, the verdict and the metrics are computed from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from server.hub import EventRecord
from server.link.base import LinkStatus
from server.nav.types import Snapshot
from server.protocol.base import ProtocolStats
from server.traffic import Recent

if TYPE_CHECKING:
    from server.nav.lanes.registry import LaneInfo  # importing it loads every kernel

BoardStateName = Literal["running", "ended", "failed"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardView:
    """A board as it was at `now_ns`; nothing in it changes afterwards.

    Attributes:
        lanes: names of the estimators that were chosen; the first is the main one.
        lane_infos: every estimator there is, chosen or not.
        topics: names of the binary topics that are fed, with their columns, below `boards/{id}/`.
        now_ns: host monotonic time of this view.
        t_ns: board time of the newest sample, -1 before the first; `t_rx_ns` is when it arrived.
        recent: what arrived within the last seconds.
        snapshot: None before the engine exists.
        latencies_s: from a byte's arrival to its rows published, newest last.
    """

    id: str
    url: str
    lanes: tuple[str, ...]
    topics: tuple[tuple[str, tuple[str, ...]], ...]
    state: BoardStateName
    cause: str
    remedy: str
    now_ns: int
    t_ns: int
    t_rx_ns: int
    link: LinkStatus
    stats: ProtocolStats
    recent: Recent
    snapshot: Snapshot | None
    events: tuple[EventRecord, ...]
    latencies_s: tuple[float, ...]
    lane_infos: tuple[LaneInfo, ...] = ()

    @property
    def age_s(self) -> float | None:
        """Seconds since the newest sample arrived; None before the first."""
        return None if self.t_rx_ns < 0 else max(0.0, (self.now_ns - self.t_rx_ns) / 1e9)

    def age_of_s(self, t_ns: int) -> float | None:
        """Age now of what was valid at this board time: the time since the newest sample plus its lag behind that."""
        if t_ns < 0 or self.age_s is None:
            return None
        return self.age_s + max(0.0, (self.t_ns - t_ns) / 1e9)

"""What a lane is: one estimator, fed the same navigation steps and measurements as every other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from server.nav.types import AidRows, Event, Float, Int, LaneRows, Site


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaneResult:
    """What one call gave: rows, and for the main lane its aid records and events."""

    rows: LaneRows
    aids: AidRows | None = None
    events: tuple[Event, ...] = ()


class Lane(Protocol):
    """One estimator. `step` and `set_site` are called from one task, in board time."""

    name: str
    provides: str

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance over navigation steps and the measurements that arrived with them.

        Args:
            steps: shape (n, U_SIZE), columns `ekf.layout`.
            meas: shape (k, M_SIZE), in order of arrival.
            t_ns: shape (n,), board time of each step's end.
        """
        ...

    def set_site(self, site: Site) -> None:
        """Take the local frame's origin and magnetic field; steps from here on may use them."""
        ...

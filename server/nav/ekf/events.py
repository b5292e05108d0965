"""Events of the compiled filter: a table of numbers that `lanes.ins_ekf` turns into sentences."""

from __future__ import annotations

from server.nav.ekf.layout import (
    C_EVENTS,
)
from server.nav.kernel import kernel
from server.nav.types import Float, Int


@kernel("void(float64[:, ::1], int64[::1], float64, float64, float64, float64)")
def add_event(events: Float, ctl: Int, code: float, t_ns: float, first: float, second: float) -> None:
    """Append one event row; past the table's end events are lost, the state is not."""
    k = ctl[C_EVENTS]
    if k < events.shape[0]:
        events[k, 0], events[k, 1], events[k, 2], events[k, 3] = code, t_ns, first, second
        ctl[C_EVENTS] += 1

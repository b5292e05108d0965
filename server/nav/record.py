"""What one engine has produced: the parts of a call joined into one result, and the newest of everything kept."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from server.nav.health import AidBook, consistency
from server.nav.lanes.bank import LaneBank
from server.nav.lanes.passthrough import SOURCE, merged, repeat
from server.nav.lanes.registry import provides_of
from server.nav.nees import NeesBook
from server.nav.parts import Part, join, join_aids, join_stages
from server.nav.types import (
    STEP_COLUMNS,
    AidHealth,
    AidRows,
    ConsistencyHealth,
    Event,
    FilteredRows,
    LaneRows,
    LaneState,
    SampleBlock,
    Site,
    StepResult,
)

EVENTS_KEPT: Final = 100
UNDER_WAY_M_S: Final = 1.0  # a receiver at rest shows a few tenths
MAIN: Final = "ins_ekf"
"""The lane whose aids are recorded and whose consistency is judged."""


class Record:
    """Counts, events and newest states of one board, for the snapshot.

    Attributes:
        t_ns: board time of the newest row; −1 before the first.
        newest: lane → its newest state. filtered: newest row of `STEP_COLUMNS`, () before the first.
        events: the last ones; they outlive a reboot of the board.
    """

    def __init__(self) -> None:
        self.events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self.restart()

    def restart(self) -> None:
        """Forget everything that belongs to one power-up."""
        self.t_ns = -1
        self.newest: dict[str, LaneState] = {}
        self.filtered: tuple[float, ...] = ()
        self._book, self._nees = AidBook(), NeesBook(MAIN)

    @property
    def moves(self) -> bool:
        """True when GNSS says that the vehicle is under way."""
        return self._book.gnss_speed_m_s() > UNDER_WAY_M_S

    def keep_only(self, lanes: tuple[str, ...]) -> None:
        """Forget the newest states of all other lanes."""
        self.newest = {name: state for name, state in self.newest.items() if name in lanes}

    def collect(self, block: SampleBlock, parts: list[Part], bank: LaneBank, site: Site | None) -> StepResult:
        """Join what the parts of a call gave and keep the newest of everything."""
        results = [result for part in parts for result in part.results]
        names = dict.fromkeys(r.rows.lane for r in results if len(r.rows.t_ns))
        rows = [join([r.rows for r in results if r.rows.lane == name]) for name in names]
        rows += [repeat(name, block, site) for name in SOURCE if name in bank.chosen]
        lanes = tuple(r for r in rows if r is not None)
        aids = join_aids([r.aids for r in results if r.aids is not None])
        filtered = [p for p in parts if len(p.filtered)]
        events = tuple(e for part in parts for e in (*part.events, *(e for r in part.results for e in r.events)))
        self._keep(lanes, aids, filtered, events, bank)
        return StepResult(
            boot_id=block.boot_id,
            block=block,
            lanes=lanes,
            aids=aids,
            filtered=FilteredRows(
                t_ns=np.concatenate([p.t_ns for p in filtered]) if filtered else np.empty(0, dtype=np.int64),
                data=np.concatenate([p.filtered for p in filtered]) if filtered else np.empty((0, len(STEP_COLUMNS))),
            ),
            events=events,
            stages=join_stages([p.stages for p in parts]),
        )

    def _keep(
        self,
        lanes: tuple[LaneRows, ...],
        aids: AidRows,
        filtered: list[Part],
        events: tuple[Event, ...],
        bank: LaneBank,
    ) -> None:
        self._book.add(aids)
        self._nees.add(lanes)
        self.events.extend(events)
        for rows in lanes:
            t_ns, row = int(rows.t_ns[-1]), rows.data[-1]
            before = self.newest.get(rows.lane)
            if rows.lane in SOURCE and before is not None:  # attitude and position come in turns
                row = merged(row, before.row)
            self.newest[rows.lane] = LaneState(
                lane=rows.lane,
                provides=provides_of(rows.lane),
                t_ns=t_ns,
                row=row,
                failure=bank.failure(rows.lane),
            )
            self.t_ns = max(self.t_ns, t_ns)
        if filtered:
            self.filtered = tuple(filtered[-1].filtered[-1].tolist())

    def aids(self) -> tuple[AidHealth, ...]:
        """Return one entry per aid that was ever seen."""
        return self._book.health()

    def consistency(self) -> tuple[ConsistencyHealth, ...]:
        """Return whether the main lane's errors are as large as its own σ says."""
        return consistency(self._book, self._nees)

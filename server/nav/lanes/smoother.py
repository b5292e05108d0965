"""The best trajectory of a recording: the filter of `ins_ekf` forward, then one pass back. Not for live use.

While samples come it only keeps them; `finish` does the work. The filter runs with everything that was known at the end
(site, field, delays), so its beginning is better than the live lane's. Inside a GNSS outage that ends, the rows say
`navigating`: both ends are known, and σ says how well. After the last fix they say `dead_reckoning`, as there is no
other end. Nothing later can tell about the time before an alignment; a position or heading that was set and not
corrected cuts only itself.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from server.nav.ekf import layout as at
from server.nav.ekf.smooth.layout import T_BOUNDARIES, T_RESETS
from server.nav.lanes.base import LaneContext, LaneResult, Parameter, Provides
from server.nav.lanes.ins_ekf_parameters import PARAMETERS
from server.nav.lanes.smoother_filter import Recorder, smooth_all
from server.nav.types import LANE_COLUMNS, Event, Float, Int, LaneRows, Site


class Smoother:
    """Keeps the steps and measurements of one power-up and smooths them at its end."""

    name: ClassVar[str] = "smoother"
    provides: ClassVar[Provides] = "full"
    parameters: ClassVar[tuple[Parameter, ...]] = PARAMETERS

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        self._context = context
        self._site: Site | None = None
        self._steps: list[Float] = []
        self._meas: list[Float] = []
        self._t_ns: list[Int] = []
        self._count = 0

    def configure(self, context: LaneContext) -> None:
        """Take other parameters; the last ones count for the whole recording."""
        self._context = context

    def set_site(self, site: Site) -> None:
        """Take the origin and its field; they count for the whole recording."""
        self._site = site

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Keep steps and measurements; no rows yet."""
        own = meas.copy()
        own[:, at.M_STEP] += self._count
        self._steps.append(steps.copy())
        self._meas.append(own)
        self._t_ns.append(t_ns.copy())
        self._count += len(steps)
        return self._result(np.empty(0, dtype=np.int64), np.empty((0, len(LANE_COLUMNS))))

    def finish(self) -> LaneResult:
        """Return a row for every step of the recording, smoothed, and an event that says how."""
        if not self._count:
            return self._result(np.empty(0, dtype=np.int64), np.empty((0, len(LANE_COLUMNS))))
        steps, meas, t_ns = np.concatenate(self._steps), np.concatenate(self._meas), np.concatenate(self._t_ns)
        rows, t = smooth_all(self._filter, steps, meas, t_ns)
        return self._result(t_ns, rows, _said(t, int(t_ns[-1])))

    def _filter(self) -> Recorder:
        recorder = Recorder(self._context)
        if self._site is not None:
            recorder.set_site(self._site)
        return recorder

    def _result(self, t_ns: Int, rows: Float, *events: Event) -> LaneResult:
        return LaneResult(rows=LaneRows(lane=self.name, t_ns=t_ns, data=rows), events=events)


def _said(t: Float, t_ns: int) -> Event:
    """Return the event that says what the smoother could not look across."""
    cuts, resets = int(t[T_BOUNDARIES]), int(t[T_RESETS])
    text = "Smoothed after the fact, over the whole recording"
    if cuts:
        text += f", in {cuts + 1} stretches: nothing later tells about the time before an alignment"
    return Event(
        t_ns=t_ns,
        code="smoothed",
        severity="info",
        text=f"{text}; {resets} positions or headings were set, not corrected.",
        values=(("stretches", float(cuts + 1)), ("resets", float(resets))),
    )

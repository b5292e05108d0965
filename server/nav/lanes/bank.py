"""The lanes that run: started, changed and put aside while samples flow, without taking each other down."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from server.nav.codes import FAILED
from server.nav.lanes.base import Lane, LaneContext, LaneResult
from server.nav.lanes.ins_ekf import InsEkf
from server.nav.lanes.registry import (
    COMPUTED,
    LANES,
    RECORDED_LANES,
    LaneInfo,
    check_lanes,
    check_values,
    defaults_of,
    make,
    parameters_of,
    provides_of,
)
from server.nav.preprocess.rebase import Rebase
from server.nav.types import LANE_COLUMNS, DelayState, EngineSettings, Event, Float, Int, LaneRows, Site

STATUS: Final = LANE_COLUMNS.index("status")


class LaneBank:
    """Owns the lanes of one engine. What was chosen outlives a reboot of the board; the lanes themselves do not."""

    def __init__(self, settings: EngineSettings) -> None:
        """Take the first choice.

        Raises:
            ValueError: a lane or parameter that does not exist, or a value outside its limits.
        """
        check_lanes(settings.lanes, RECORDED_LANES)
        for lane, values in settings.lane_parameters.items():
            check_values(lane, values, RECORDED_LANES)
        self.chosen: tuple[str, ...] = settings.lanes
        self._values = {name: defaults_of(name) | dict(settings.lane_parameters.get(name, {})) for name in COMPUTED}
        self._running: dict[str, Lane] = {}
        self._failures: dict[str, str] = {}
        self._untold: list[str] = []
        self._context: LaneContext | None = None
        self._site: Site | None = None

    def clear(self) -> None:
        """Forget the lanes: the board has started again."""
        self._running, self._failures = {}, {}
        self._context = self._site = None

    def start(self, context: LaneContext) -> None:
        """Make the chosen lanes, or give running ones another context."""
        self._context = context
        for name, lane in list(self._running.items()):
            self._try(name, lane.configure, self._for(name, context))
        for name in self.chosen:
            if name in COMPUTED and name not in self._running and name not in self._failures:
                self._try(name, self._begin, name, context)

    def _begin(self, name: str, context: LaneContext) -> None:
        lane = make(name, self._for(name, context))
        if self._site is not None:
            lane.set_site(self._site)
        self._running[name] = lane

    def _try(self, name: str, call: Callable[..., None], *values: object) -> None:
        """Call; a lane that raises is put aside, which the next step tells."""
        try:
            call(*values)
        except Exception as error:  # as in `_guarded`
            self._put_aside(name, error)
            self._untold.append(name)

    def _put_aside(self, name: str, error: Exception) -> None:
        self._running.pop(name, None)
        self._failures[name] = f"{type(error).__name__}: {error}"

    def _for(self, name: str, context: LaneContext) -> LaneContext:
        return replace(context, values=dict(self._values[name]))

    def restart(self) -> None:
        """Start every running lane anew: the body frame has turned, and nothing of their states holds any more."""
        self._running = {}
        if self._context is not None:
            self.start(self._context)

    def rebase(self, change: Rebase) -> None:
        """Tell the lanes that keep biases that the calibration has changed; the others find out by themselves."""
        for name, lane in list(self._running.items()):
            method = getattr(lane, "rebase", None)
            if method is not None:
                self._try(name, method, change)

    def choose(self, names: tuple[str, ...]) -> None:
        """Run these lanes from the next step on: those that run go on, new ones start from nothing.

        Raises:
            ValueError: a lane that does not exist, or none.
        """
        check_lanes(names)
        self.chosen = names
        self._failures = {}
        self._running = {name: lane for name, lane in self._running.items() if name in names}
        if self._context is not None:
            self.start(self._context)

    def set_values(self, name: str, values: Mapping[str, float]) -> None:
        """Change parameters of one lane from the next step on; a lane that was put aside starts again.

        Raises:
            ValueError: unknown lane or parameter, or a value outside its limits; nothing is changed then.
        """
        check_values(name, values)
        if name not in COMPUTED:
            return
        self._values[name] |= dict(values)
        self._failures.pop(name, None)
        if self._context is not None:
            self.start(self._context)

    def set_site(self, site: Site) -> None:
        """Tell every lane the origin and its magnetic field."""
        self._site = site
        for name, lane in list(self._running.items()):
            self._try(name, lane.set_site, site)

    def step(self, steps: Float, meas: Float, t_ns: Int) -> list[LaneResult]:
        """Advance every lane over the same steps; one that raises is put aside and says so."""
        told = [_failed(name, t_ns, self._failures[name]) for name in self._untold if name in self._failures]
        self._untold.clear()
        running = list(self._running.items())
        return told + [self._guarded(name, lane.step, t_ns, steps, meas, t_ns) for name, lane in running]

    def finish(self, t_ns: int) -> list[LaneResult]:
        """Return what the lanes that need the whole recording (`registry.AFTERWARDS`) have to say at its end.

        Args:
            t_ns: board time of the last step, for a lane that fails here.
        """
        ends = {name: getattr(lane, "finish", None) for name, lane in self._running.items()}
        at = np.array([t_ns], dtype=np.int64)
        return [self._guarded(name, end, at) for name, end in ends.items() if end is not None]

    def _guarded(self, name: str, call: Callable[..., LaneResult], t_ns: Int, *values: object) -> LaneResult:
        """Return what a lane's method gives; one that raises is put aside and says so, at the last of the stamps."""
        try:
            return call(*values)
        except Exception as error:  # one estimator's defect must not end the others' flight
            self._put_aside(name, error)
            return _failed(name, t_ns, self._failures[name])

    def failure(self, name: str) -> str:
        """Return why a lane was put aside; "" when it was not."""
        return self._failures.get(name, "")

    def delays(self) -> tuple[DelayState, ...]:
        """Return the delays that the main lane has found on line; () when it does not run or all were told."""
        main = self._running.get("ins_ekf")
        return main.delays() if isinstance(main, InsEkf) else ()

    def mag_bias(self) -> tuple[float, ...]:
        """Return the main lane's own magnetic bias (3) with its σ (3), gauss; () when it has none."""
        main = self._running.get("ins_ekf")
        return main.mag_bias() if isinstance(main, InsEkf) else ()

    def covariance(self, name: str) -> tuple[int, Float] | None:
        """Return (t_ns, P) of a running lane that has a method of that name; else None."""
        method = getattr(self._running.get(name), "covariance", None)
        return method() if method is not None else None

    def info(self) -> tuple[LaneInfo, ...]:
        """Return every lane there is, with its parameters as they are set."""
        return tuple(
            LaneInfo(
                name=name,
                provides=provides_of(name),
                running=name in self.chosen and name not in self._failures,
                failure=self.failure(name),
                parameters=parameters_of(name),
                values=dict(self._values.get(name, {})),
            )
            for name in LANES
        )


def _failed(name: str, t_ns: Int, why: str) -> LaneResult:
    """Return the one row that says so."""
    data = np.full((1, len(LANE_COLUMNS)), np.nan)
    data[0, STATUS] = FAILED
    event = Event(
        t_ns=int(t_ns[-1]),
        code="lane-failed",
        severity="warning",
        text=f"The estimator {name} failed ({why}) and was put aside; choose it again to restart it, and report this.",
    )
    return LaneResult(rows=LaneRows(lane=name, t_ns=t_ns[-1:].copy(), data=data), events=(event,))

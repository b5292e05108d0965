"""The magnetometer's offset from an ordinary flight, drive or walk: the learning of the engine over a recording."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from server.nav.calibration.codes import failure
from server.nav.calibration.learning_feed import RATE_HZ, StepFeed
from server.nav.calibration.learning_track import Track
from server.nav.calibration.mag_learning import CONVERGED_GAUSS, MagLearner, MagLearnState
from server.nav.calibration.types import NAN, CalKind, Check, Failure, Fit, Options, Progress, Residual, Value
from server.nav.ekf import layout as at
from server.nav.types import Float, Int, Kind

GOOD_GAUSS: Final = 0.007  # 1σ of the worst axis: 1° of heading in 0.4 gauss …
FAIR_GAUSS: Final = 0.011  # … 1.5° …; poor up to `CONVERGED_GAUSS`, beyond which nothing is given
CHECK_LIMIT: Final = 0.05  # of the strength: 3° of heading, as for the ellipsoid
CHECK_POINTS: Final = 30
EVERY: Final = round(RATE_HZ / 10.0)
DRAIN: Final = 512  # rows held before they are worked on; no result depends on it
RAW_GAUSS: Final = 0.5  # what the first reading in counts is taken for
WORST_GAUSS: Final = 0.5


class MagInFlight:
    """Learns the offset from raw IMU and magnetometer rows.

    Attributes:
        history: the offset and its 1σ at 10 Hz, bounded; `history.rows()` gives (t_ns, offset, sigma).
    """

    def __init__(self, options: Options) -> None:
        """Start before the first sample; counts (`unit` "raw") are scaled by the first reading, and back."""
        self._raw = options.unit == "raw"
        self._gain = RAW_GAUSS / options.strength if self._raw and options.strength > 0.0 else 0.0 if self._raw else 1.0
        self._feed = StepFeed()
        self._learner = MagLearner()
        self._steps = 0
        self._samples = {Kind.IMU: 0, Kind.MAG: 0}
        self._length = np.zeros(3)  # Σ 1, Σ |m|, Σ |m|²
        self.history = Track(7)
        self._points = Track(3)
        self._point: tuple[float, ...] = ()  # the newest reading of the present 0.1 s

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples in order of arrival; other kinds than IMU and magnetometer are ignored."""
        if kind not in self._samples or not len(t_ns):
            return
        if kind == Kind.MAG:
            rows = self._scaled(rows)
        self._feed.take(kind, t_ns, rows)
        self._samples[kind] += len(t_ns)
        if self._feed.held >= DRAIN:
            self._drain()

    def _scaled(self, rows: Float) -> Float:
        out = rows.copy()
        length = np.linalg.norm(rows[:, :3], axis=1)
        good = length[np.isfinite(length) & (length > 0.0)]
        if self._gain == 0.0 and len(good):
            self._gain = RAW_GAUSS / float(good[0])
        out[:, :3] *= self._gain
        good = good * self._gain
        self._length += (len(good), good.sum(), good @ good)
        return out

    def _drain(self, is_last: bool = False) -> None:
        """Learn from what is complete, in pieces of 0.1 s, each of which is a row of the history."""
        steps, meas = self._feed.steps(is_last)
        begin = 0
        while begin < len(steps):
            end = min(len(steps), begin + EVERY - self._steps % EVERY)
            first, last = np.searchsorted(meas[:, at.M_STEP], (begin, end))
            own = meas[first:last].copy()
            own[:, at.M_STEP] -= begin
            self._learner.step(steps[begin:end], own)
            self._steps += end - begin
            if len(own):
                self._point = tuple((own[-1, at.M_DATA : at.M_DATA + 3] / self._gain).tolist())
            if self._steps % EVERY == 0:
                self._remember(float(steps[end - 1, at.U_T]))
            begin = end

    def _remember(self, t: float) -> None:
        state = self._learner.state()
        self.history.add((t + self._feed.t0_ns, *state.offset_gauss / self._gain, *state.sigma_gauss / self._gain))
        if self._point:
            self._points.add(self._point)
            self._point = ()

    def state(self) -> MagLearnState:
        """Return what the learning says after everything fed so far, in gauss; its times are since the first sample."""
        self._drain(is_last=True)
        return self._learner.state()

    def fit(self) -> Fit:
        """Return the offset, or refuse: no data, too little turning, a field that changes from place to place."""
        state = self.state()
        refusal = self._refusal(state)
        if refusal is not None:
            return Fit(kind=CalKind.MAG_IN_FLIGHT, failure=refusal, samples=self._samples[Kind.MAG])
        unit, worst = "" if self._raw else "gauss", float(state.sigma_gauss.max())
        return Fit(
            kind=CalKind.MAG_IN_FLIGHT,
            parameters={"offset": state.offset_gauss / self._gain},
            sigma={"offset": state.sigma_gauss / self._gain},
            residual_before=Residual(value=self._spread() / self._gain, unit=unit),
            residual_after=Residual(value=state.residual_gauss / self._gain, unit=unit),
            coverage=float(state.excitation.min()),
            grade="good" if worst <= GOOD_GAUSS else "fair" if worst <= FAIR_GAUSS else "poor",
            samples=self._samples[Kind.MAG],
            details=self._details(state),
        )

    def _refusal(self, state: MagLearnState) -> Failure | None:
        if min(self._samples.values()) == 0 or self._steps == 0:
            return failure("no-data")
        if state.contradicted > 0:
            return failure("field-uneven", state.contradicted, 0.0)
        worst = float(state.sigma_gauss.max())
        if not worst < CONVERGED_GAUSS:
            return failure(
                "not-settled", worst / self._gain, CONVERGED_GAUSS / self._gain, "" if self._raw else "gauss"
            )
        return None

    def _details(self, state: MagLearnState) -> dict[str, float]:
        found = {f"excitation_{axis}": float(value) for axis, value in zip("xyz", state.excitation, strict=True)}
        found |= {"changes": float(state.changes), "mag_delay_s": state.delay_s}
        if state.changes:
            found["t_changed_s"] = (state.t_changed_ns + self._feed.t0_ns) * 1e-9
        return found

    def _spread(self) -> float:
        count, total, square = self._length.tolist()
        return math.sqrt(max(0.0, square / count - (total / count) ** 2)) if count else NAN

    def check(self, parameters: Mapping[str, Value]) -> Check:
        """Judge the given parameters by how much the strength of what was collected varies under them."""
        self._drain(is_last=True)
        points = self._points.rows()
        matrix = np.asarray(parameters.get("matrix", np.eye(3)))
        length = np.linalg.norm((points - np.asarray(parameters["offset"])) @ matrix.T, axis=1)
        mean = float(length.mean()) if len(length) else NAN
        spread = Residual(value=float(length.std()) if len(length) else NAN, unit="" if self._raw else "gauss")
        few = len(points) < CHECK_POINTS
        refused = failure("too-few-samples", len(points), CHECK_POINTS) if few else None
        ok = not few and spread.value <= CHECK_LIMIT * mean
        return Check(ok=ok, residual=spread, limit=CHECK_LIMIT * mean, samples=len(points), failure=refused)

    def progress(self) -> Progress:
        """Return how sure the offset is, and what would help."""
        self._drain()
        state = self._learner.state()
        worst = min(float(state.sigma_gauss.max()), WORST_GAUSS)
        known = math.log(WORST_GAUSS / worst) / math.log(WORST_GAUSS / GOOD_GAUSS)
        enough, complete = state.converged, state.converged and worst <= GOOD_GAUSS
        return Progress(
            fraction=min(1.0, known) if complete else min(0.99, known),
            phase="enough" if enough else "rotate" if self._steps else "waiting",
            instruction="done" if complete else "rotate-all-ways" if self._steps else "wait",
            samples=self._samples[Kind.MAG],
            is_enough=enough,
            is_complete=complete,
            values=self._details(state) | {"sigma_gauss": float(state.sigma_gauss.max())},
            points=self._points.rows(),
            offset=tuple((state.offset_gauss / self._gain).tolist()) if enough and self._gain else (),
        )

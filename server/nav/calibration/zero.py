"""The zero of the airspeed sensor and of the barometer: means at rest that must be steady [S0 §3.4, §3.5]."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.codes import failure, outside
from server.nav.calibration.steady import Steady, batch_means, mean_and_sigma
from server.nav.calibration.types import NAN, CalKind, Check, Failure, Fit, Options, Progress, Residual, Value
from server.nav.preprocess.check import height_from_pressure
from server.nav.types import Float, Int, Kind

DURATION_S: Final = 5.0
LEAST_SAMPLES: Final = 10
LEAST_S: Final = 1.0


class _Zero:
    """What both have in common; a subclass names its kind, limits and column."""

    kind: CalKind
    unit: str
    sample_kind: Kind
    instruction: str
    unsteady_code: str
    spread_max: float
    check_limit: float

    def __init__(self, options: Options) -> None:
        """Start without samples."""
        self._options = options
        self._steady = Steady(self.sample_kind)
        self._duration_s = DURATION_S if np.isnan(options.duration_s) else options.duration_s

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples (`types.Collector`)."""
        self._steady.feed(kind, t_ns, rows)

    def _values(self) -> tuple[Int, Float]:
        """Return times and the values whose mean is sought."""
        return self._steady.column(0)

    def _implausible(self, values: Float) -> Failure | None:
        raise NotImplementedError

    def _target(self) -> float:
        return 0.0

    def progress(self) -> Progress:
        """Return how far it is (`types.Collector`)."""
        t, values = self._values()
        share = min(self._steady.span_s / self._duration_s, len(values) / LEAST_SAMPLES) if self._duration_s else 1.0
        mean, sigma, spread = mean_and_sigma(t, values) if len(values) else (NAN, NAN, NAN)
        done = share >= 0.98
        return Progress(
            fraction=1.0 if done else min(share, 0.99),
            phase="enough" if done else "hold-still" if len(values) else "waiting",
            instruction="done" if done else self.instruction if len(values) else "wait",
            restarts=self._steady.restarts,
            samples=len(values),
            is_enough=len(values) >= LEAST_SAMPLES and self._steady.span_s >= LEAST_S,
            is_complete=done,
            values={f"mean_{self.unit}": mean, f"sigma_{self.unit}": sigma, f"spread_{self.unit}": spread},
        )

    def _failure(self) -> Failure | None:
        t, values = self._values()
        if not len(values):
            return failure("no-data")
        if len(values) < LEAST_SAMPLES:
            return failure("too-few-samples", len(values), LEAST_SAMPLES)
        if self._steady.span_s < 0.9 * min(LEAST_S, self._duration_s):
            return failure("too-few-samples", self._steady.span_s, min(LEAST_S, self._duration_s), "s")
        why = self._implausible(values)
        if why is not None:
            return why
        spread = mean_and_sigma(t, values)[2]
        if spread > self.spread_max and not self._in_counts:
            return failure(self.unsteady_code, spread, self.spread_max, self._unit_sign)
        return None

    @property
    def _unit_sign(self) -> str:
        return "counts" if self._in_counts else {"pa": "Pa", "m": "m"}[self.unit]

    @property
    def _in_counts(self) -> bool:
        """Whether the limits, which are in Pa, say nothing; height is in metres in any case."""
        return self._options.unit == "raw" and self.unit == "pa"

    def fit(self) -> Fit:
        """Fit, or refuse (`types.Collector`)."""
        why = self._failure()
        if why is not None:
            return Fit(kind=self.kind, failure=why, samples=self._steady.fed)
        t, values = self._values()
        mean, sigma, spread = mean_and_sigma(t, values)
        bias = mean - self._target()
        batches = batch_means(t, values) - self._target()
        return Fit(
            kind=self.kind,
            parameters={"bias": bias},
            sigma={"bias": sigma},
            residual_before=Residual(value=float(np.sqrt(np.mean(batches**2))), unit=self._unit_sign),
            residual_after=Residual(value=float(np.sqrt(np.mean((batches - bias) ** 2))), unit=self._unit_sign),
            coverage=1.0,
            grade=grades.FAIR if self._in_counts else grades.grade(self.kind, self._judged(bias, spread)),
            samples=len(values),
            temperature_degc=self._steady.temperature(),
            details={
                f"spread_{'counts' if self._in_counts else self.unit}": spread,
                "span_s": self._steady.span_s,
                **self._more(),
            },
        )

    def _judged(self, bias: float, spread: float) -> dict[str, float]:
        raise NotImplementedError

    def _more(self) -> dict[str, float]:
        return {}

    def check(self, parameters: Mapping[str, Value]) -> Check:
        """Judge the bias on fresh samples: the mean that is left (`types.Collector`)."""
        why = self._failure()
        t, values = self._values()
        left = NAN
        if len(values):
            left = abs(mean_and_sigma(t, values)[0] - self._target() - float(parameters["bias"]))
        residual = Residual(value=left, unit=self._unit_sign)
        limit = 5.0 * float(values.std()) if self._in_counts and len(values) else self.check_limit
        ok = why is None and left <= limit
        return Check(ok=ok, residual=residual, limit=limit, samples=len(values), failure=why)


class AirspeedZero(_Zero):
    """The differential pressure without wind: the pitot tube covered."""

    kind = CalKind.AIRSPEED_ZERO
    unit = "pa"
    sample_kind = Kind.AIRSPEED
    instruction = "cover-pitot"
    unsteady_code = "airflow"
    spread_max = grades.AIRSPEED_SPREAD_MAX_PA
    check_limit = grades.CHECK_AIRSPEED_PA

    def _implausible(self, values: Float) -> Failure | None:
        mean = float(values.mean())
        limit = grades.AIRSPEED_BIAS_MAX_PA
        bad = self._options.unit == "si" and abs(mean) > limit
        return failure("out-of-range", mean, limit, "Pa") if bad else None

    def _judged(self, bias: float, spread: float) -> dict[str, float]:
        return {"spread_pa": spread, "bias_pa": abs(bias)}


class BaroReference(_Zero):
    """The height that the barometer shows here, made `Options.height_m` (0 when not given)."""

    kind = CalKind.BARO_REFERENCE
    unit = "m"
    sample_kind = Kind.BARO
    instruction = "hold-still"
    unsteady_code = "motion"
    spread_max = grades.BARO_SPREAD_MAX_M
    check_limit = grades.CHECK_BARO_M

    def _values(self) -> tuple[Int, Float]:
        """Return times and heights: the board's own where it sends them, else from pressure [S0 eq. 3.27]."""
        t, height = self._steady.column(1)
        if len(t):
            return t, height
        t, pressure = self._steady.column(0)
        possible = pressure > 0.0
        return t[possible], np.array([height_from_pressure(float(p)) for p in pressure[possible]])

    def _target(self) -> float:
        return 0.0 if np.isnan(self._options.height_m) else self._options.height_m

    def _implausible(self, values: Float) -> Failure | None:
        pressure = self._steady.column(0)[1]
        if len(pressure):
            why = outside("out-of-range", float(pressure.mean()), grades.BARO_LOW_PA, grades.BARO_HIGH_PA, "Pa")
            if why is not None:
                return why
        height = float(values.mean())
        if abs(height) > grades.BARO_HEIGHT_MAX_M:
            return failure("out-of-range", height, grades.BARO_HEIGHT_MAX_M, "m")
        return None

    def _judged(self, bias: float, spread: float) -> dict[str, float]:
        del bias
        return {"spread_m": spread}

    def _more(self) -> dict[str, float]:
        pressure = self._steady.column(0)[1]
        return {"reference_pa": float(pressure.mean())} if len(pressure) else {}

"""The gyro's bias: its mean at rest [S0 §3.1.2: 50 to 100 samples after power-up, or longer], restarted when moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.blocks import B_MEAN, B_N, B_T0, B_T1, B_TEMPERATURE, B_VAR, BlockTable
from server.nav.calibration.codes import failure
from server.nav.calibration.statistics import mean_known, mean_sigma, weighted_mean, with_resolution
from server.nav.calibration.stillness import Scale, StillLimits, count_step, scale_of_counts, still_runs
from server.nav.calibration.types import NAN, CalKind, Check, Failure, Fit, Grade, Options, Progress, Residual, Value
from server.nav.types import Float, Int, Kind

KIND: Final = CalKind.GYRO_BIAS
LEAST_SAMPLES: Final = 50  # S0 §3.1.2
ENOUGH_SAMPLES: Final = 100
LEAST_S: Final = 1.0  # a shorter rest between two moves is no rest
RESTART_S: Final = 0.5  # what was collected for so long and then thrown away is a restart
ALMOST_ALL: Final = 0.9  # of the samples: a short recording of nothing but rest
DURATION_S: Final = 5.0
LARGEST_STEP_RAD_S: Final = 0.02  # ±2000 °/s in 12 bits; coarser than that is two values, not a resolution
LARGEST_STEP_COUNTS: Final = 16.0
BLOCK_SAMPLES: Final = 10
BLOCK_S: Final = 0.02
BATCHES: Final = 10
LIMITS: Final = StillLimits(
    accel_std=0.03,
    accel_std_cap=0.15,
    accel_shift=0.01,
    gyro_std=0.03,
    gyro_std_cap=0.2,
    gyro_shift=0.02,
    least_blocks=1,
)
"""Tighter than for poses: 0.02 rad/s is 1.1 °/s, which a table never does and a hand always."""


class GyroBias:
    """Averages the gyro over the longest rest."""

    def __init__(self, options: Options) -> None:
        """Start without samples; `Options.duration_s` is how long to average."""
        self._options = options
        self._table = BlockTable(needs=0, least_n=BLOCK_SAMPLES, least_s=BLOCK_S)
        self._duration_s = DURATION_S if np.isnan(options.duration_s) else options.duration_s
        self._unit = "rad/s" if options.unit == "si" else "counts"
        self._known: tuple[int, list[tuple[int, int]]] = (-1, [])

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples (`types.Collector`)."""
        if kind == Kind.IMU:
            self._table.feed(t_ns, rows)

    def fit_ranges(self, t_ns: Int, rows: Float, ranges: Sequence[tuple[int, int]]) -> Fit:
        """Fit the first of these sample ranges [first, end), which must be at rest."""
        a, b = ranges[0]
        self.feed(Kind.IMU, t_ns[a:b], rows[a:b])
        return self.fit()

    def _runs(self) -> list[tuple[int, int]]:
        blocks = self._table.rows
        if self._known[0] != len(blocks):
            scale = Scale(accel=self._options.gravity_m_s2, gyro=1.0)
            if self._options.unit == "raw" and len(blocks):
                scale = scale_of_counts(blocks)
            self._known = (len(blocks), still_runs(blocks, LIMITS, scale))
        return self._known[1]

    def _rest(self) -> Float:
        """Return the blocks of the longest rest; the latest of equals."""
        blocks = self._table.rows
        runs = [run for run in self._runs() if self._is_plausible(blocks[slice(*run)])] or self._runs()
        if not runs:
            return blocks[:0]
        a, b = max(runs, key=lambda run: (run[1] - run[0], run[0]))
        return blocks[a:b]

    def _is_plausible(self, rest: Float) -> bool:
        """Return whether a rest can be one: the steady turn of a table is as quiet, but faster than any bias."""
        rates, n = rest[:, B_MEAN : B_MEAN + 3], rest[:, B_N]
        worst = float(np.abs(weighted_mean(rates, n)).max())
        return self._options.unit == "raw" or worst <= grades.GYRO_BIAS_MAX_RAD_S

    def _restarts(self) -> int:
        """Return how many rests of half a second or more a move ended."""
        blocks = self._table.rows
        return sum(b < len(blocks) and _span_s(blocks[a:b]) >= RESTART_S for a, b in self._runs())

    def _samples(self, rest: Float) -> float:
        """Return the samples of the rest; those of the open block count, so that fifty are fifty."""
        blocks = self._table.rows
        goes_on = len(rest) > 0 and rest[-1, B_T1] == blocks[-1, B_T1]
        return float(rest[:, B_N].sum()) + (self._table.open_samples if goes_on else 0)

    def _is_enough(self, rest: Float) -> bool:
        samples, seconds = self._samples(rest), _span_s(rest)
        asked = 0.0 if np.isnan(self._options.duration_s) else 0.98 * self._duration_s
        whole = samples >= ALMOST_ALL * self._table.samples
        return samples >= LEAST_SAMPLES and seconds >= asked and (whole or seconds >= LEAST_S)

    def progress(self) -> Progress:
        """Return how far it is (`types.Collector`)."""
        rest = self._rest()
        runs, blocks = self._runs(), self._table.rows
        samples, seconds = float(rest[:, B_N].sum()), _span_s(rest)
        is_still = bool(runs) and runs[-1][1] == len(blocks)
        share = min(seconds / self._duration_s, samples / ENOUGH_SAMPLES) if self._duration_s > 0.0 else 1.0
        done = share >= 0.98 and self._is_enough(rest)
        mean = weighted_mean(rest[:, B_MEAN : B_MEAN + 3], rest[:, B_N]) if len(rest) else np.full(3, NAN)
        phase = "enough" if done else "waiting" if not self._table.samples else "hold-still" if is_still else "moving"
        return Progress(
            fraction=1.0 if done else min(share, 0.99),
            phase=phase,
            instruction="done" if done else "hold-still" if self._table.samples else "wait",
            restarts=self._restarts(),
            samples=int(samples),
            is_enough=self._is_enough(rest),
            is_complete=done,
            values={
                "still_s": _span_s(blocks[runs[-1][0] :]) if is_still else 0.0,
                **{f"bias_{axis}": float(mean[i]) for i, axis in enumerate("xyz")},
            },
        )

    def _failure(self, rest: Float) -> Failure | None:
        if self._table.samples == 0:
            return failure("no-data")
        if self._table.samples < LEAST_SAMPLES:
            return failure("too-few-samples", self._table.samples, LEAST_SAMPLES)
        if not self._is_enough(rest):
            asked = LEAST_S if np.isnan(self._options.duration_s) else self._duration_s
            whole = self._samples(rest) >= ALMOST_ALL * self._table.samples
            return failure("too-few-samples" if whole else "motion", _span_s(rest), asked, "s")
        bias = weighted_mean(rest[:, B_MEAN : B_MEAN + 3], rest[:, B_N])
        worst = float(np.max(np.abs(bias)))
        if self._options.unit == "si" and worst > grades.GYRO_BIAS_MAX_RAD_S:
            return failure("out-of-range", worst, grades.GYRO_BIAS_MAX_RAD_S, "rad/s")
        return None

    def fit(self) -> Fit:
        """Fit, or refuse (`types.Collector`)."""
        rest = self._rest()
        why = self._failure(rest)
        if why is not None:
            return Fit(kind=KIND, failure=why, samples=self._table.samples)
        rates, n = rest[:, B_MEAN : B_MEAN + 3], rest[:, B_N]
        bias = weighted_mean(rates, n)
        std = np.sqrt(weighted_mean(rest[:, B_VAR : B_VAR + 3], n))
        step = self._step()
        sigma = with_resolution(mean_sigma(rates, rest[:, B_VAR : B_VAR + 3], n), std, step)
        batches = _batches(rates, n)
        return Fit(
            kind=KIND,
            parameters={"bias": bias},
            sigma={"bias": sigma},
            residual_before=Residual(value=_rms_norm(batches), unit=self._unit),
            residual_after=Residual(value=_rms_norm(batches - bias), unit=self._unit),
            coverage=1.0,
            grade=self._grade(bias, sigma),
            samples=int(n.sum()),
            temperature_degc=mean_known(rest[:, B_TEMPERATURE]),
            details={"rest_s": _span_s(rest), "restarts": float(self._restarts())},
        )

    def _step(self) -> float:
        if self._options.unit == "si":
            return self._table.resolution(0, LARGEST_STEP_RAD_S)
        return self._table.resolution(0, LARGEST_STEP_COUNTS) or count_step(self._table.rows, 0)

    def _grade(self, bias: Float, sigma: Float) -> Grade:
        if self._options.unit == "raw":  # the unit of the limits is not known: judged by time alone, as white noise
            return grades.GOOD if float(self._rest()[:, B_N].sum()) >= ENOUGH_SAMPLES else grades.FAIR
        return grades.grade(KIND, {"sigma_rad_s": float(sigma.max()), "bias_rad_s": float(np.abs(bias).max())})

    def check(self, parameters: Mapping[str, Value]) -> Check:
        """Judge on a fresh rest: the mean rate that is left (`types.Collector`)."""
        rest = self._rest()
        limit = grades.CHECK_RATE_RAD_S
        if not self._is_enough(rest):
            why = self._failure(rest) or failure("motion")
            return Check(ok=False, residual=Residual(value=NAN, unit=self._unit), limit=limit, samples=0, failure=why)
        mean = weighted_mean(rest[:, B_MEAN : B_MEAN + 3], rest[:, B_N])
        scale = np.asarray(parameters.get("scale", np.ones(3)))
        left = scale * (mean - np.asarray(parameters["bias"]))
        if self._options.unit == "raw" and "scale" not in parameters:
            limit = 5.0 * float(np.sqrt(weighted_mean(rest[:, B_VAR : B_VAR + 3], rest[:, B_N]).max()))
        value = float(np.linalg.norm(left))
        samples = int(rest[:, B_N].sum())
        return Check(ok=value <= limit, residual=Residual(value=value, unit=self._unit), limit=limit, samples=samples)


def _span_s(blocks: Float) -> float:
    """Return the seconds that the blocks' samples stand for."""
    if not len(blocks):
        return 0.0
    n = float(blocks[:, B_N].sum())
    return float(blocks[-1, B_T1] - blocks[0, B_T0]) * 1e-9 * n / max(n - 1.0, 1.0)


def _batches(rates: Float, n: Float) -> Float:
    """Return the mean of each tenth of the rest, shape (≤ 10, 3)."""
    parts = np.array_split(np.arange(len(rates)), min(BATCHES, len(rates)))
    return np.array([weighted_mean(rates[part], n[part]) for part in parts])


def _rms_norm(values: Float) -> float:
    return float(np.sqrt(np.mean(np.sum(values**2, axis=1))))

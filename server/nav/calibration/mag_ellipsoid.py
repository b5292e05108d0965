"""Hard and soft iron of the magnetometer: the board is turned every way, its readings lie on an ellipsoid."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from server.nav.calibration.codes import failure
from server.nav.calibration.ellipsoid_judge import MIN_SAMPLES, grade, judged, offset_sigma, provisional
from server.nav.calibration.ellipsoid_kernel import CUBES
from server.nav.calibration.ellipsoid_moments import Cubes, MomentStream
from server.nav.calibration.ellipsoid_robust import Solution
from server.nav.calibration.ellipsoid_solve import Ellipsoid, misfit, rms
from server.nav.calibration.ellipsoid_target import Attitudes, most_useful
from server.nav.calibration.sphere_cells import DIRECTIONS
from server.nav.calibration.types import CalKind, Check, Failure, Fit, Options, Progress, Residual, Value
from server.nav.types import Float, Int, Kind

CHECK_LIMIT: Final = 0.05  # of the strength: 3° of heading
CHECK_APART: Final = 0.5  # cosine of 60°
CHECK_DIRECTIONS: Final = 3
COMPLETE: Final = 0.85  # coverage at which going on gains nothing
COMPLETE_SAMPLES: Final = 200
REFRESH_NS: Final = 400_000_000  # progress looks again after this time, or 64 samples and a tenth more than last time


class MagEllipsoid:
    """Collects magnetometer samples in constant memory, tells which directions miss, fits hard and soft iron.

    The result: |matrix (raw − offset)| = strength, matrix symmetric. Strength: told, else that of the field told
    (unit si), else 1.
    """

    def __init__(self, options: Options) -> None:
        """Start empty.

        Raises:
            ValueError: `ellipsoid_parameters` is neither 6 nor 9, or `strength` is not positive.
        """
        if options.ellipsoid_parameters not in {6, 9}:
            raise ValueError(f"ellipsoid_parameters is {options.ellipsoid_parameters}; it must be 6 or 9")
        if options.strength <= 0.0:
            raise ValueError(f"strength is {options.strength}; it must be positive")
        self._parameters = options.ellipsoid_parameters
        known = (
            float(np.linalg.norm(options.field_n_gauss)) if options.field_n_gauss and options.unit == "si" else np.nan
        )
        told = options.strength if np.isfinite(options.strength) else known
        self._strength = told if np.isfinite(told) else 1.0
        self._expected = told if options.unit == "si" else float("nan")
        self._unit = "gauss" if options.unit == "si" and np.isfinite(told) else ""
        self._stream = MomentStream()
        self._attitudes = Attitudes(options.field_n_gauss)
        self._cached: Progress | None = None
        self._seen, self._seen_ns, self._now_ns = 0, 0, 0

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples; magnetometer samples count, the accelerometer's only tell which way is down."""
        if kind == Kind.IMU:
            self._attitudes.feed_accel(rows[:, 3:6])
        elif kind == Kind.MAG:
            self._stream.feed(rows[:, :3])
            self._attitudes.feed_mag(rows[:, :3])
            self._now_ns = int(t_ns[-1]) if len(t_ns) else self._now_ns

    def fit(self) -> Fit:
        """Fit, or refuse with the reason."""
        cubes = self._stream.cubes()
        found = judged(cubes, self._parameters, self._expected)
        if isinstance(found, Failure):
            return Fit(kind=CalKind.MAG_ELLIPSOID, failure=found, samples=self._stream.samples)
        return self._result(found)

    def _result(self, s: Solution) -> Fit:
        scale = self._strength
        return Fit(
            kind=CalKind.MAG_ELLIPSOID,
            parameters={"offset": s.offset, "matrix": s.matrix * scale},
            sigma={"offset": s.offset_sigma, "matrix": s.matrix_sigma * scale},
            residual_before=Residual(value=length_spread(s.cubes) * scale, unit=self._unit),
            residual_after=Residual(value=s.residual * scale, unit=self._unit),
            coverage=s.coverage,
            grade=grade(s),
            samples=s.samples,
            details={
                "rejected": float(s.rejected),
                "radius_raw": s.radius,
                "relative_residual": s.residual,
                "relative_noise": s.noise,
                "relative_offset_sigma": offset_sigma(s),
                "offset_dilution": s.offset_dilution,
                "matrix_dilution": s.matrix_dilution,
            },
        )

    def check(self, parameters: Mapping[str, Value]) -> Check:
        """Judge these parameters by the length of what was collected since; needs a few directions."""
        cubes = self._stream.cubes()
        offset, matrix = np.asarray(parameters["offset"]), np.asarray(parameters["matrix"]) / self._strength
        count = self._stream.samples
        limit = CHECK_LIMIT * self._strength
        if count < MIN_SAMPLES:
            nothing = Residual(value=float("nan"), unit=self._unit)
            few = failure("too-few-samples", count, MIN_SAMPLES)
            return Check(ok=False, residual=nothing, limit=limit, samples=count, failure=few)
        # lengths do not care for a turn: the symmetric factor of the matrix has the same
        off = misfit(cubes.about(offset, 1.0), Ellipsoid(centre=np.zeros(3), matrix=matrix, noise=0.0))
        value = rms(off, cubes.moments[:, 0]) * self._strength
        apart = directions_apart((cubes.means - offset) @ matrix.T)
        few_ways = failure("coverage-poor", apart, CHECK_DIRECTIONS) if apart < CHECK_DIRECTIONS else None
        ok = few_ways is None and value <= limit
        residual = Residual(value=value, unit=self._unit)
        return Check(ok=ok, residual=residual, limit=limit, samples=count, failure=few_ways)

    def progress(self) -> Progress:
        """Return coverage as seen from the fit so far, and the direction that would help most."""
        count = self._stream.samples
        late = abs(self._now_ns - self._seen_ns) >= REFRESH_NS and count > self._seen
        if self._cached is None or late or count >= self._seen + 64 + self._seen // 10:
            self._cached, self._seen, self._seen_ns = self._look(count), count, self._now_ns
        return self._cached

    def _look(self, count: int) -> Progress:
        cubes = self._stream.cubes()
        found = judged(cubes, self._parameters, self._expected)
        shape = found if isinstance(found, Solution) else provisional(cubes)
        if shape is None:
            return self._blind(cubes, count)
        missing = DIRECTIONS[~shape.cells]
        enough = isinstance(found, Solution)
        complete = enough and shape.coverage >= COMPLETE and shape.samples >= COMPLETE_SAMPLES
        target = most_useful(shape, missing, self._attitudes)
        return Progress(
            fraction=1.0 if complete else min(0.99, shape.coverage / COMPLETE * (1.0 if enough else 0.8)),
            phase="enough" if enough else "rotate",
            instruction="done" if complete else "rotate-all-ways",
            pose_target_b=() if complete else target,
            samples=count,
            is_enough=enough,
            is_complete=complete,
            values={
                "coverage": shape.coverage,
                "relative_residual": shape.residual,
                "radius_raw": shape.radius,
                "rejected": float(shape.rejected),
            },
            points=cubes.origins,
            uncovered_b=missing,
            offset=tuple(shape.offset.tolist()) if enough else (),
            matrix=tuple(tuple(row) for row in (shape.matrix * self._strength).tolist()) if enough else (),
        )

    def _blind(self, cubes: Cubes, count: int) -> Progress:
        """Before any centre is known: nothing is covered as far as can be said."""
        return Progress(
            fraction=min(0.1, 0.1 * len(cubes.origins) / CUBES) if count else 0.0,
            phase="rotate" if count else "waiting",
            instruction="rotate-all-ways" if count else "wait",
            samples=count,
            values={"coverage": 0.0},
            points=cubes.origins,
            uncovered_b=DIRECTIONS,
        )


def length_spread(cubes: Cubes) -> float:
    """RMS of |raw| about its mean, over its mean: what the field's strength seems to vary by without a calibration."""
    count = cubes.moments[:, 0].sum()
    mean = cubes.lengths.sum() / count
    square = cubes.about(np.zeros(3), 1.0)[:, [4, 7, 9]].sum() / count
    return float(np.sqrt(max(square - mean * mean, 0.0)) / mean)


def directions_apart(vectors: Float) -> int:
    """Count directions that are 60° apart from each other, taken greedily, up to what a check asks for."""
    unit = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
    taken: list[Float] = []
    while len(unit) and len(taken) < CHECK_DIRECTIONS:
        taken.append(unit[0])
        unit = unit[unit @ unit[0] < CHECK_APART]
    return len(taken)


def fit_ellipsoid(xyz: Float, parameters: int = 9, strength: float = float("nan")) -> Fit:
    """Fit samples at hand, shape (n, 3) in any unit, through the same accumulator as live; refuses like live."""
    collector = MagEllipsoid(Options(unit="raw", ellipsoid_parameters=parameters, strength=strength))
    collector.feed(Kind.MAG, np.arange(len(xyz), dtype=np.int64), np.asarray(xyz, dtype=np.float64))
    return collector.fit()

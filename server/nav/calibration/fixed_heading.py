"""Hard iron of a vehicle that cannot be spun: heading, tilt and the Earth's field are known, the rest is its own field.

At a known attitude the field in the body is R_bn E; what the magnetometer reads beyond it is the offset. One attitude
cannot tell soft iron from hard: the offset is right near this heading and wrong by the soft iron elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from server.nav.calibration.codes import failure
from server.nav.calibration.running_sums import RunningSums
from server.nav.calibration.types import CalKind, Check, Failure, Fit, Grade, Options, Progress, Residual, Value
from server.nav.types import Float, Int, Kind

ENOUGH_S: Final = 5.0
MIN_SAMPLES: Final = 24
GAP_NS: Final = 1_000_000_000
STILL_RAD_S: Final = 0.035  # RMS of the rate's change from its mean: 2°/s, an idling engine is less
STILL_M_S2: Final = 0.5  # RMS of the specific force about its mean
TURNED_M_S2: Final = 0.2  # between the means of the first and the last half: 1° of tilt
TILT_LIMIT_RAD: Final = float(np.radians(30.0))  # beyond, a heading is hardly what was measured
TILT_SIGMA_RAD: Final = float(np.radians(0.5))  # accelerometer bias of 0.1 m/s²
FIELD_SIGMA: Final = 0.005  # of the model's strength
FIELD_SIGMA_RAD: Final = float(np.radians(1.0))  # of its direction; both are what the crust adds to the model
GOOD, FAIR = 0.04, 0.08  # grades: length of σ over the field
MAG_STILL: Final = 0.05  # of the field: RMS of the readings about their mean


class MagFixedHeading:
    """Collects magnetometer and calibrated accelerometer at rest; the offset is the mean reading minus R_bn E.

    The matrix in force is not touched: the samples are compared as they come (it should be near the identity).
    """

    def __init__(self, options: Options) -> None:
        """Start without samples.

        Raises:
            ValueError: counts without the strength of the field in counts, which one attitude cannot show.
        """
        self._heading, self._heading_sigma = options.heading_rad, options.heading_sigma_rad
        self._field = np.array(options.field_n_gauss, dtype=np.float64)
        self._unit = "gauss" if options.unit == "si" else "counts"
        if options.unit == "raw":
            self._field = _in_counts(self._field, options.strength)
        self._wanted_s = options.duration_s if np.isfinite(options.duration_s) else ENOUGH_S
        self._restarts = 0
        self._last_ns = -1
        self._start()

    def _start(self) -> None:
        self._mag, self._imu, self._first = RunningSums(3), RunningSums(6), RunningSums(3)
        self._from_ns = -1

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples; motion is judged over all of them, a reboot or a hole of a second starts again."""
        if kind not in {Kind.IMU, Kind.MAG} or len(t_ns) == 0:
            return
        steps = np.diff(t_ns, prepend=self._last_ns if self._last_ns >= 0 else t_ns[0])
        broken = np.flatnonzero((steps < -GAP_NS) | (steps > GAP_NS))
        start = int(broken[-1]) if len(broken) else 0
        if len(broken):
            self._restarts += 1
            self._start()
        if self._from_ns < 0:
            self._from_ns = int(t_ns[start])
        self._last_ns = int(t_ns[-1])
        self._take(kind, t_ns[start:], rows[start:])

    def _take(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        if kind == Kind.MAG:
            self._mag.feed(rows, 0)
            return
        self._imu.feed(rows, 0)
        early = t_ns - self._from_ns < 0.5e9 * self._wanted_s
        self._first.feed(rows[early], 3)

    @property
    def _elapsed_s(self) -> float:
        return (self._last_ns - self._from_ns) * 1e-9 if self._from_ns >= 0 else 0.0

    def progress(self) -> Progress:
        """Return how much of the time at rest has passed."""
        refused = self._refusal()
        count = self._mag.count
        enough = refused is None
        time_share = min(1.0, self._elapsed_s / self._wanted_s)
        done = enough and time_share >= 1.0
        return Progress(
            fraction=min(time_share, count / MIN_SAMPLES, 1.0),
            phase="enough" if enough else ("hold-still" if count else "waiting"),
            instruction="done" if done else ("hold-still" if count else "wait"),
            restarts=self._restarts,
            samples=count,
            is_enough=enough,
            is_complete=done,
            values={"still_s": self._elapsed_s},
        )

    def _refusal(self) -> Failure | None:
        """Return why there can be no offset: what was not told first, then what was not held."""
        if not np.isfinite(self._heading):
            return failure("heading-unknown")
        if self._field.shape != (3,) or not np.linalg.norm(self._field) > 0.0:
            return failure("field-unknown")
        if self._mag.count == 0 or self._imu.count == 0:
            return failure("no-data", min(self._mag.count, self._imu.count), MIN_SAMPLES)
        if min(self._mag.count, self._imu.count) < MIN_SAMPLES:
            return failure("too-few-samples", min(self._mag.count, self._imu.count), MIN_SAMPLES)
        return self._moved() or self._tilted()

    def _moved(self) -> Failure | None:
        scatter = self._imu.scatter
        rate, force = float(np.linalg.norm(scatter[:3])), float(np.linalg.norm(scatter[3:]))
        if rate > STILL_RAD_S:
            return failure("motion", rate, STILL_RAD_S, "rad/s")
        if force > STILL_M_S2:
            return failure("motion", force, STILL_M_S2, "m/s²")
        drift = np.linalg.norm(self._first.mean - self._imu.mean[3:]) if self._first.count else 0.0
        if drift > TURNED_M_S2:
            return failure("motion", float(drift), TURNED_M_S2, "m/s²")
        limit = MAG_STILL * float(np.linalg.norm(self._field))
        spread = float(np.linalg.norm(self._mag.scatter))
        return failure("motion", spread, limit, self._unit) if spread > limit else None

    def _tilted(self) -> Failure | None:
        down = self._down()
        if not 0.8 * 9.8 < float(np.linalg.norm(self._imu.mean[3:])) < 1.2 * 9.8:
            return failure("gravity", float(np.linalg.norm(self._imu.mean[3:])), 9.8, "m/s²")
        tilt = float(np.arccos(np.clip(down[2], -1.0, 1.0)))
        return failure("tilt", tilt, TILT_LIMIT_RAD, "rad") if tilt > TILT_LIMIT_RAD else None

    def _down(self) -> Float:
        force = self._imu.mean[3:]
        return -force / np.linalg.norm(force)

    def fit(self) -> Fit:
        """Return the offset, or refuse with the reason."""
        refused = self._refusal()
        if refused is not None:
            return Fit(kind=CalKind.MAG_FIXED_HEADING, failure=refused, samples=self._mag.count)
        strength = float(np.linalg.norm(self._field))
        expected = self._expected()
        offset = self._mag.mean - expected
        sigma = self._sigma(expected)
        before = float(np.linalg.norm(offset))
        noise = float(np.linalg.norm(self._mag.scatter))
        size = float(np.linalg.norm(sigma)) / strength
        grade: Grade = "good" if size <= GOOD else "fair" if size <= FAIR else "poor"
        return Fit(
            kind=CalKind.MAG_FIXED_HEADING,
            parameters={"offset": offset},
            sigma={"offset": sigma},
            residual_before=Residual(value=before, unit=self._unit),
            residual_after=Residual(value=noise, unit=self._unit),
            grade=grade,
            samples=self._mag.count,
            details={"tilt_rad": float(np.arccos(np.clip(self._down()[2], -1.0, 1.0))), f"offset_{self._unit}": before},
        )

    def _expected(self) -> Float:
        return rotation_bn(self._down(), self._heading) @ self._field

    def _sigma(self, expected: Float) -> Float:
        """1σ per axis: heading, tilt and the model's direction turn the field, the model's strength scales it."""
        by_heading = np.cross(self._down(), expected) * self._heading_sigma
        turns = np.eye(3) * float(expected @ expected) - np.outer(expected, expected)  # of a small turn about any axis
        tilt = np.diag(turns) * (TILT_SIGMA_RAD**2 + FIELD_SIGMA_RAD**2)
        noise = self._mag.scatter**2 / max(self._elapsed_s, 1.0)  # samples of one second count once
        return np.sqrt(by_heading**2 + tilt + (FIELD_SIGMA * expected) ** 2 + noise)

    def check(self, parameters: Mapping[str, Value]) -> Check:
        """Judge an offset (and matrix, when given) by the field at this attitude, on fresh data."""
        refused = self._refusal()
        strength = float(np.linalg.norm(self._field)) if self._field.shape == (3,) else float("nan")
        limit = 0.1 * strength
        if refused is not None:
            nothing = Residual(value=float("nan"), unit=self._unit)
            return Check(ok=False, residual=nothing, limit=limit, samples=self._mag.count, failure=refused)
        matrix = np.asarray(parameters.get("matrix", np.eye(3)))
        off = matrix @ (self._mag.mean - np.asarray(parameters["offset"])) - self._expected()
        value = float(np.linalg.norm(off))
        residual = Residual(value=value, unit=self._unit)
        return Check(ok=value <= limit, residual=residual, limit=limit, samples=self._mag.count)


def _in_counts(field_gauss: Float, strength: float) -> Float:
    """Return the field with this length.

    Raises:
        ValueError: the length is not known.
    """
    if not strength > 0.0:
        msg = (
            "strength must be given with raw counts, because one attitude does not show how many a gauss is; "
            "set --strength to the field's magnitude in counts"
        )
        raise ValueError(msg)
    length = float(np.linalg.norm(field_gauss))
    return field_gauss * (strength / length) if length > 0.0 else field_gauss


def rotation_bn(down_b: Float, heading_rad: float) -> Float:
    """Return R_bn, shape (3, 3), of a body whose down is known and whose nose, seen from above, points to the heading.

    Args:
        down_b: shape (3,), unit vector.
        heading_rad: clockwise from true north.
    """
    ahead = np.array([1.0, 0.0, 0.0]) - down_b[0] * down_b  # level component of the nose
    ahead /= np.linalg.norm(ahead)
    right = np.cross(down_b, ahead)
    north = np.cos(heading_rad) * ahead - np.sin(heading_rad) * right
    return np.column_stack([north, np.cross(down_b, north), down_b])

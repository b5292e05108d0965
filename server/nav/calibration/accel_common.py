"""What the calibrations from static poses share: the first refusals, the residuals, the verification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.codes import failure, outside
from server.nav.calibration.pose import Pose
from server.nav.calibration.poses import PoseCollector
from server.nav.calibration.statistics import mean_known, rms
from server.nav.calibration.types import NAN, CalKind, Check, Failure, Fit, Options, Residual, Value
from server.nav.types import Float, Int, Kind

STILL_SHARE = 0.1  # of the time: less is no session of poses
BLINK_SHARE, BLINK_S = 0.5, 1.2  # as is half of it in poses hardly longer than the shortest that counts
MOTION_S = 3.0  # no pose in so long: it was moving


def means_of(poses: Sequence[Pose]) -> Float:
    """Return the poses' mean specific forces, shape (k, 3), board axes, in the unit of the data."""
    return np.array([pose.accel for pose in poses]).reshape(-1, 3)


def temperature_of(poses: Sequence[Pose]) -> float:
    """Return the mean temperature in °C; NaN unknown."""
    return mean_known(np.array([pose.temperature_degc for pose in poses]))


def refused(kind: CalKind, why: Failure, collector: PoseCollector, **more: object) -> Fit:
    """Return the refusal."""
    return Fit(kind=kind, failure=why, samples=collector.samples, **more)  # type: ignore[arg-type]  # `more` names fields of Fit; object loses their types


def early_failure(collector: PoseCollector, options: Options, least: int) -> Failure | None:
    """Return why the poses are not worth fitting, whatever the model: none, saturated, not gravity."""
    poses = collector.poses
    if collector.samples == 0:
        return failure("no-data")
    if not poses:
        lengths = collector.lengths_anyhow() if options.unit == "si" else means_of(())
        wrong = length_failure(float(np.median(lengths)), options.gravity_m_s2) if len(lengths) else None
        if wrong is not None:  # in the unit that is told all of it looks stirred
            return wrong
        long = collector.span_s >= MOTION_S
        return failure("motion", 0, least) if long else failure("too-few-samples", collector.span_s, MOTION_S, "s")
    share = collector.saturated()
    if share > 0.0:
        return failure("saturated", share, 0.3)
    stir, limit = collector.stirred
    if stir > limit:
        return failure("motion", stir, limit, "m/s²" if options.unit == "si" else "counts")
    return gravity_failure(poses, options)


def gravity_failure(poses: Sequence[Pose], options: Options) -> Failure | None:
    """Return the refusal when, in SI, the length at rest is not gravity's."""
    if options.unit == "raw":
        return None
    return length_failure(float(np.median(np.linalg.norm(means_of(poses), axis=1))), options.gravity_m_s2)


def length_failure(length: float, gravity: float) -> Failure | None:
    """Return the refusal of a length at rest that is not gravity's, m/s²."""
    return outside("gravity", length, grades.GRAVITY_LOW * gravity, grades.GRAVITY_HIGH * gravity, "m/s²")


def moving_failure(collector: PoseCollector, least: int) -> Failure | None:
    """Return the refusal of a board that hardly ever was still, or for a blink now and then, as a slow hand is."""
    if collector.span_s < MOTION_S:
        return None
    share, held_s = collector.still_share, collector.held_s
    moving = share < STILL_SHARE or (share < BLINK_SHARE and held_s < BLINK_S)
    return failure("motion", len(collector.poses), least) if moving else None


def residual_before(poses: Sequence[Pose], options: Options) -> Residual:
    """Return the RMS of |raw| − g; counts are first brought to g by the one factor that fits them best."""
    length, g = np.linalg.norm(means_of(poses), axis=1), options.gravity_m_s2
    factor = g * float(length.sum() / (length @ length)) if options.unit == "raw" else 1.0
    return Residual(value=rms(factor * length - g), unit="m/s²")


def check_poses(poses: Sequence[Pose], parameters: Mapping[str, Value], options: Options) -> Check:
    """Judge parameters on fresh poses: RMS of |matrix · (raw − offset)| − g."""
    matrix, offset = np.asarray(parameters["matrix"]), np.asarray(parameters["offset"])
    limit = grades.CHECK_LENGTH_M_S2
    why = None
    if len(poses) < grades.CHECK_POSES:
        why = failure("too-few-poses", len(poses), grades.CHECK_POSES)
    length = np.linalg.norm((means_of(poses) - offset) @ matrix.T, axis=1) - options.gravity_m_s2
    value = rms(length) if len(poses) else NAN
    samples = sum(pose.samples for pose in poses)
    residual = Residual(value=value, unit="m/s²")
    return Check(ok=why is None and value <= limit, residual=residual, limit=limit, samples=samples, failure=why)


class PoseCalibration:
    """What the accelerometer's calibrations have in common: the poses they collect, and how parameters are judged."""

    def __init__(self, options: Options) -> None:
        """Start without samples."""
        self._options = options
        self._poses = PoseCollector(options)

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples (`types.Collector`)."""
        self._poses.feed(kind, t_ns, rows)

    def fit_ranges(self, t_ns: Int, rows: Float, ranges: Sequence[tuple[int, int]]) -> Fit:
        """Fit with these sample ranges [first, end) as the poses, in any order, instead of looking for them."""
        self._poses.take_ranges(t_ns, rows, ranges)
        return self.fit()

    def finish(self) -> None:
        """Take the end of the stream for its end, so that the last few samples count."""
        self._poses.finish()

    def fit(self) -> Fit:
        """Fit, or refuse (`types.Collector`)."""
        raise NotImplementedError

    def check(self, parameters: Mapping[str, Value]) -> Check:
        """Judge parameters on fresh poses, whatever their directions (`types.Collector`)."""
        return check_poses(self._poses.poses, parameters, self._options)

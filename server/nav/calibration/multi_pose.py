"""The accelerometer from any static poses: only that the length at rest is g is used [ALGORITHMS §2, 9 parameters]."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.calibration import grades
from server.nav.calibration.accel_common import (
    PoseCalibration,
    early_failure,
    means_of,
    moving_failure,
    refused,
    residual_before,
    temperature_of,
)
from server.nav.calibration.accel_fit import AccelFit, fit_norm, sphere
from server.nav.calibration.accel_spread import amplification, distinct, farthest, uncovered
from server.nav.calibration.codes import failure
from server.nav.calibration.pose import Pose
from server.nav.calibration.poses import POSE_S
from server.nav.calibration.statistics import directions, rms
from server.nav.calibration.types import CalKind, Failure, Fit, Progress, Residual
from server.nav.types import Float

KIND: Final = CalKind.ACCEL_MULTI_POSE
COMPLETE_POSES: Final = 14  # five more than parameters, so that a bad one shows
COMPLETE_COVERAGE: Final = 0.95
BELIEVED: Final = 0.1  # a pose with less weight was rejected


def triangular(matrix: Float) -> Float:
    """Return the upper triangular matrix of the same lengths: Q · matrix with a rotation Q, positive diagonal.

    The form that imu_tk publishes (misalignment times scale): its body x axis is free, z is the sensor's own.
    """
    r = np.linalg.qr(matrix)[1]
    return np.asarray(r * np.sign(np.diag(r))[:, None])


class MultiPose(PoseCalibration):
    """Collects static poses in any direction and fits offset and a symmetric matrix."""

    def _centred(self) -> Float:
        """Return the poses about their centre in units of the radius, shape (k, 3)."""
        means = means_of(self._poses.poses)
        if self._options.unit == "raw" and len(means) >= 4:
            centre, radius = sphere(means)
            return np.asarray((means - centre) / radius)
        return means / self._options.gravity_m_s2

    def progress(self) -> Progress:
        """Return how far it is (`types.Collector`)."""
        away = self._centred()
        unit = distinct(directions(away))
        missing = uncovered(unit)
        coverage = 1.0 - len(missing) / len(uncovered(unit[:0]))
        still_s = self._poses.still_s
        count = len(unit)
        enough = count >= grades.POSES_LEAST and amplification(away) <= grades.AMPLIFICATION_MAX
        complete = enough and count >= COMPLETE_POSES and coverage >= COMPLETE_COVERAGE
        phase, instruction = _move(self._poses.samples, complete, still_s)
        share = min(count / COMPLETE_POSES, 1.0) * (0.5 + 0.5 * min(coverage / COMPLETE_COVERAGE, 1.0))
        return Progress(
            fraction=1.0 if complete else min(share, 0.99),
            phase=phase,
            instruction=instruction,
            pose_target_b=() if complete else tuple(float(-x) + 0.0 for x in farthest(unit)),
            poses=count,
            samples=self._poses.samples,
            is_enough=enough,
            is_complete=complete,
            values={"still_s": still_s, "coverage": coverage, "poses_all": float(len(away))},
            points=means_of(self._poses.poses),
            uncovered_b=missing,
        )

    def fit(self) -> Fit:
        """Fit, or refuse (`types.Collector`)."""
        poses = self._poses.poses
        why = early_failure(self._poses, self._options, grades.POSES_LEAST)
        away = self._centred()
        count = len(distinct(directions(away)))
        coverage = 1.0 - len(uncovered(directions(away))) / len(uncovered(away[:0]))
        if why is None:
            why = _spread_failure(len(poses), count, away)
            why = (moving_failure(self._poses, grades.POSES_LEAST) or why) if why is not None else None
        if why is not None:
            return refused(KIND, why, self._poses, coverage=coverage)
        return self._judged(fit_norm(poses, self._options.gravity_m_s2), poses, coverage)

    def _judged(self, found: AccelFit, poses: list[Pose], coverage: float) -> Fit:
        believed = found.weights >= BELIEVED
        after = rms(found.length[believed])
        before = residual_before(poses, self._options)
        worst_sigma = _worst_sigma(found, self._options.gravity_m_s2)
        why = _bad_fit(found, believed, after, worst_sigma)
        if why is not None:
            why = moving_failure(self._poses, grades.POSES_LEAST) or why
            more = {"coverage": coverage, "residual_before": before}
            return refused(KIND, why, self._poses, residual_after=Residual(value=after, unit="m/s²"), **more)
        upper = triangular(found.matrix)
        return Fit(
            kind=KIND,
            parameters={"offset": found.offset, "matrix": found.matrix},
            sigma={"offset": found.offset_sigma, "matrix": found.matrix_sigma},
            residual_before=before,
            residual_after=Residual(value=after, unit="m/s²"),
            coverage=coverage,
            grade=grades.grade(KIND, {"residual_m_s2": after, "sigma_share": worst_sigma}),
            samples=sum(pose.samples for pose in poses),
            temperature_degc=temperature_of(poses),
            details={
                "poses": float(len(poses)),
                "poses_rejected": float(np.sum(~believed)),
                "worst_sigma_share": worst_sigma,
                **{f"triangular_{i}{j}": float(upper[i, j]) for i in range(3) for j in range(i, 3)},
            },
        )


def _move(samples: int, complete: bool, still_s: float) -> tuple[str, str]:
    if samples == 0:
        return "waiting", "wait"
    if complete:
        return "enough", "done"
    if still_s == 0.0:
        return "moving", "put-any-pose"
    return ("hold-still", "hold-still") if still_s < 1.5 * POSE_S else ("next-pose", "put-any-pose")


def _spread_failure(poses: int, count: int, away: Float) -> Failure | None:
    if poses < grades.POSES_LEAST:
        return failure("too-few-poses", poses, grades.POSES_LEAST)
    gain = amplification(away)
    if count < grades.POSES_LEAST:
        return failure("poses-alike", count, grades.POSES_LEAST)
    if gain > grades.AMPLIFICATION_MAX:
        return failure("poses-alike", gain, grades.AMPLIFICATION_MAX)
    return None


def _worst_sigma(found: AccelFit, gravity: float) -> float:
    """Return the largest 1σ: of the offset in g, of the matrix in its own scale."""
    scale = float(np.cbrt(abs(np.linalg.det(found.matrix))))
    return max(float(found.offset_sigma.max()) * scale / gravity, float(found.matrix_sigma.max()) / scale)


def _bad_fit(found: AccelFit, believed: NDArray[np.bool_], after: float, worst_sigma: float) -> Failure | None:
    rejected = float(np.mean(~believed))
    limit = grades.RESIDUAL_MAX_M_S2
    if after > limit or rejected > grades.POSES_REJECTED_MAX or np.sum(believed) < grades.POSES_LEAST:
        return failure("residual", max(after, rms(found.length)), limit, "m/s²")
    if np.linalg.eigvalsh(found.matrix)[0] <= 0.0 or worst_sigma > 0.05:
        return failure("poses-alike", worst_sigma, 0.05)
    return None

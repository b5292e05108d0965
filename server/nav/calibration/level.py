"""How the board sits in the vehicle: the rotation that makes gravity vertical while the vehicle stands level."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.accel_common import early_failure, refused, temperature_of
from server.nav.calibration.codes import failure
from server.nav.calibration.pose import Pose
from server.nav.calibration.poses import PoseCollector
from server.nav.calibration.stillness import StillLimits
from server.nav.calibration.types import NAN, CalKind, Check, Failure, Fit, Options, Progress, Residual, Value
from server.nav.types import Float, Int, Kind

KIND: Final = CalKind.LEVEL
DURATION_S: Final = 3.0
LEAST_S: Final = 1.0
LIMITS: Final = StillLimits(accel_shift=0.01, gyro_std=0.1, gyro_shift=0.05)


def level_matrix(accel_b: Float) -> tuple[Float, float, float]:
    """Return R from the board's axes to the vehicle's, roll and pitch of the board in the vehicle, rad.

    R = R_y(pitch) R_x(roll) has no part about the vertical, which gravity cannot show: R · accel = [0, 0, −|accel|].
    """
    x, y, z = accel_b
    roll = float(np.arctan2(-y, -z))
    pitch = float(np.arctan2(x, np.hypot(y, z)))
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    return about_y @ about_x, roll, pitch


class Level:
    """Averages the accelerometer of a vehicle that stands level and still."""

    def __init__(self, options: Options) -> None:
        """Start without samples; samples must be calibrated already, but not levelled."""
        self._options = options
        self._poses = PoseCollector(options, LIMITS)
        self._duration_s = DURATION_S if np.isnan(options.duration_s) else options.duration_s

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples (`types.Collector`)."""
        self._poses.feed(kind, t_ns, rows)

    def _longest(self) -> Pose | None:
        poses = self._poses.poses
        return max(poses, key=lambda pose: (pose.samples, pose.t0_ns)) if poses else None

    def progress(self) -> Progress:
        """Return how far it is (`types.Collector`)."""
        pose = self._longest()
        held_s = 0.0 if pose is None else (pose.t1_ns - pose.t0_ns) * 1e-9
        done = held_s >= self._duration_s
        still_s = self._poses.still_s
        phase = "enough" if done else "waiting" if not self._poses.samples else "hold-still" if still_s else "moving"
        values = {"still_s": still_s}
        if pose is not None:
            _, roll, pitch = level_matrix(pose.accel)
            values |= {"roll_rad": roll, "pitch_rad": pitch}
        return Progress(
            fraction=1.0 if done else min(max(held_s, still_s) / self._duration_s, 0.99),
            phase=phase,
            instruction="done" if done else "hold-still" if self._poses.samples else "wait",
            pose_target_b=() if done else (0.0, 0.0, 1.0),
            poses=len(self._poses.poses),
            restarts=max(len(self._poses.poses) - 1, 0),
            samples=self._poses.samples,
            is_enough=held_s >= min(LEAST_S, self._duration_s),
            is_complete=done,
            values=values,
        )

    def fit(self) -> Fit:
        """Fit, or refuse (`types.Collector`)."""
        pose = self._longest()
        why = early_failure(self._poses, self._options, 1)
        if why is not None or pose is None:
            return refused(KIND, why or failure("motion"), self._poses)
        matrix, roll, pitch = level_matrix(pose.accel)
        tilt = float(np.arccos(np.clip(-pose.accel[2] / np.linalg.norm(pose.accel), -1.0, 1.0)))
        if tilt > grades.LEVEL_TILT_MAX_RAD:
            return refused(KIND, failure("tilt", tilt, grades.LEVEL_TILT_MAX_RAD, "rad"), self._poses)
        length = float(np.linalg.norm(pose.accel))
        sigma_rad = float(np.hypot(*pose.sigma[:2])) / length
        away = abs(length - self._options.gravity_m_s2) if self._options.unit == "si" else 0.0
        left = float(np.linalg.norm((matrix @ pose.accel)[:2])) / length
        return Fit(
            kind=KIND,
            parameters={"matrix": matrix},
            sigma={"matrix": _matrix_sigma(matrix, pose)},
            residual_before=Residual(value=tilt, unit="rad"),
            residual_after=Residual(value=max(left, sigma_rad), unit="rad"),
            coverage=1.0,
            grade=grades.grade(KIND, {"sigma_rad": sigma_rad, "length_m_s2": away}),
            samples=pose.samples,
            temperature_degc=temperature_of([pose]),
            details={
                "roll_rad": roll,
                "pitch_rad": pitch,
                "roll_sigma_rad": float(pose.sigma[1]) / length,
                "pitch_sigma_rad": float(pose.sigma[0]) / length,
                "length_m_s2": length,
            },
        )

    def check(self, parameters: Mapping[str, Value]) -> Check:
        """Judge the rotation on fresh samples at rest: the tilt that is left (`types.Collector`)."""
        pose = self._longest()
        limit = grades.CHECK_LEVEL_RAD
        if pose is None:
            why: Failure = early_failure(self._poses, self._options, 1) or failure("motion")
            return Check(ok=False, residual=Residual(value=NAN, unit="rad"), limit=limit, samples=0, failure=why)
        accel = np.asarray(parameters["matrix"]) @ pose.accel
        tilt = float(np.arctan2(np.hypot(accel[0], accel[1]), -accel[2]))
        return Check(ok=tilt <= limit, residual=Residual(value=tilt, unit="rad"), limit=limit, samples=pose.samples)


def _matrix_sigma(matrix: Float, pose: Pose) -> Float:
    """Return 1σ of each entry; NaN for the one that is 0 by definition.

    A third of the change that three sigma of each axis make, the larger of both senses: where an entry is at its
    largest (the cosine of no tilt) the derivative is 0, but the entry is not known exactly.
    """
    var = np.zeros((3, 3))
    for i in range(3):
        away = np.zeros(3)
        away[i] = 3.0 * pose.sigma[i]
        changes = [np.abs(level_matrix(pose.accel + sign * away)[0] - matrix) for sign in (1.0, -1.0)]
        var += (np.maximum(*changes) / 3.0) ** 2
    sigma = np.sqrt(var)
    sigma[1, 0] = NAN  # gravity does not show the turn about the vertical; this entry of the convention fixes it
    return np.asarray(sigma)

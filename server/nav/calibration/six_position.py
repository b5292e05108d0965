"""The accelerometer from its six faces [S0 §3.2, eq. 3.4-3.8; S1 eq. 3.12]: any order, poses found by themselves."""

from __future__ import annotations

from typing import Final

import numpy as np

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
from server.nav.calibration.accel_faces import face_frame, faces_of, nearest_face, turned_faces
from server.nav.calibration.accel_fit import REFERENCES, AccelFit, closed_form, fit_faces
from server.nav.calibration.blocks import B_MEAN
from server.nav.calibration.codes import failure
from server.nav.calibration.pose import Pose
from server.nav.calibration.poses import POSE_S
from server.nav.calibration.statistics import rms
from server.nav.calibration.types import FACES, CalKind, Failure, Fit, Options, Progress, Residual
from server.nav.types import Float

KIND: Final = CalKind.ACCEL_SIX_POSITION
FACES_BY_CHANCE: Final = 3  # so many come by themselves when a board tumbles slowly


class SixPosition(PoseCalibration):
    """Collects the six faces and fits offset and full matrix.

    The result is the least-squares fit of `accel_fit.fit_faces`; the closed form of S0 stands beside it in the details,
    as the comparison. The sigma covers the sensor's noise and, across the axes, how well the board was put down; a
    table that is not level for all six poses alike is in it only as far as the poses turn against it.
    """

    def _faces(self) -> tuple[list[Pose], list[int]]:
        """Return all poses, and of each its face, −1 where it is none."""
        poses = self._poses.poses
        if not poses:
            return [], []
        means = means_of(poses)
        frame = face_frame(means, self._poses.scale.accel, self._options.unit)
        faces = faces_of(means, *frame)
        if len(poses) >= 6 and len({*faces} - {-1}) < 6:
            faces = turned_faces(means, *frame) or faces
        return poses, faces

    def progress(self) -> Progress:
        """Return how far it is (`types.Collector`)."""
        poses, faces = self._faces()
        done = tuple(i in faces for i in range(6))
        still_s = self._poses.still_s
        now = self._face_now(poses)
        missing = [FACES[i] for i in range(6) if not done[i]]
        target = self._next(done)
        partial = min(still_s / POSE_S, 1.0) if now in missing else 0.0
        phase, instruction = _move(self._poses.samples, missing, now, still_s)
        return Progress(
            fraction=(sum(done) + 0.99 * partial) / 6.0,
            phase=phase,
            instruction=instruction,
            faces=done,
            face_now=now,
            face_next="" if target < 0 else FACES[target],
            pose_target_b=() if target < 0 else tuple(float(-x) + 0.0 for x in REFERENCES[target]),
            poses=len(poses),
            samples=self._poses.samples,
            is_enough=not missing,
            is_complete=not missing,
            values={"still_s": still_s, "poses_off_axis": float(faces.count(-1)), "faces_done": float(sum(done))},
            points=means_of(poses),
        )

    def _face_now(self, poses: list[Pose]) -> str:
        newest = self._poses.newest
        if not len(newest) or (self._options.unit == "raw" and not poses):
            return ""
        mean = newest[-1, B_MEAN + 3 : B_MEAN + 6]
        known = np.vstack([means_of(poses), mean])
        centre, half = face_frame(known, self._poses.scale.accel, self._options.unit)
        face, angle = nearest_face(mean, centre, half)
        return FACES[face] if angle <= grades.FACE_TILT_RAD else ""

    def _next(self, done: tuple[bool, ...]) -> int:
        """Return the missing face that takes the smallest turn from the one that points up now, −1 for none."""
        missing = [i for i in range(6) if not done[i]]
        newest = self._poses.newest
        if not missing or not len(newest):
            return missing[0] if missing else -1
        mean = newest[-1, B_MEAN + 3 : B_MEAN + 6]
        known = np.vstack([means_of(self._poses.poses), mean])
        centre, _ = face_frame(known, self._poses.scale.accel, self._options.unit)
        return max(missing, key=lambda i: (round(float(REFERENCES[i] @ (mean - centre)), 1), -i))

    def fit(self) -> Fit:
        """Fit, or refuse (`types.Collector`)."""
        why = early_failure(self._poses, self._options, 6)
        poses, faces = self._faces()
        taken = [(pose, face) for pose, face in zip(poses, faces, strict=True) if face >= 0]
        done = len({face for _, face in taken})
        if why is None and done < 6:
            moving = moving_failure(self._poses, 6) if done < FACES_BY_CHANCE else None
            why = moving or failure("pose-missing", done, 6)
        if why is not None:
            return refused(KIND, why, self._poses, coverage=done / 6.0)
        used, of = [pose for pose, _ in taken], [face for _, face in taken]
        found = fit_faces(used, of, self._options.gravity_m_s2)
        return self._judged(found, used, of, len(poses) - len(used))

    def _judged(self, found: AccelFit, poses: list[Pose], faces: list[int], others: int) -> Fit:
        after = rms(found.length)
        before = residual_before(poses, self._options)
        placement_deg = float(np.degrees(found.placement_rad))
        why = _bad_fit(after, found, self._options)
        if why is not None:
            after_refused = Residual(value=after, unit="m/s²")
            more = {"coverage": 1.0, "residual_before": before, "residual_after": after_refused}
            return refused(KIND, why, self._poses, **more)
        return Fit(
            kind=KIND,
            parameters={"offset": found.offset, "matrix": found.matrix},
            sigma={"offset": found.offset_sigma, "matrix": found.matrix_sigma},
            residual_before=before,
            residual_after=Residual(value=after, unit="m/s²"),
            coverage=1.0,
            grade=grades.grade(KIND, {"residual_m_s2": after, "placement_deg": placement_deg}),
            samples=sum(pose.samples for pose in poses),
            temperature_degc=temperature_of(poses),
            details={
                "poses": float(len(poses)),
                "poses_off_axis": float(others),
                "placement_deg": placement_deg,
                "turned_deg": turned_deg(found.matrix),
                **_compared(found, poses, faces, self._options.gravity_m_s2),
            },
        )


def _move(samples: int, missing: list[str], now: str, still_s: float) -> tuple[str, str]:
    """Return phase and instruction."""
    if samples == 0:
        return "waiting", "wait"
    if not missing:
        return "enough", "done"
    if still_s == 0.0:
        return "moving", "put-face"
    return ("hold-still", "hold-still") if now in missing else ("next-face", "put-face")


def turned_deg(matrix: Float) -> float:
    """Return the angle of the rotation in a matrix (polar decomposition): how the board sits in its box, degrees."""
    left, _, right = np.linalg.svd(matrix)
    return float(np.degrees(np.arccos(np.clip((np.trace(left @ right) - 1.0) / 2.0, -1.0, 1.0))))


def _bad_fit(after: float, found: AccelFit, options: Options) -> Failure | None:
    if after > grades.RESIDUAL_MAX_M_S2:
        return failure("residual", after, grades.RESIDUAL_MAX_M_S2, "m/s²")
    scale = np.linalg.svd(found.matrix, compute_uv=False)
    if options.unit == "si" and not (np.all(scale > grades.GRAVITY_LOW) and np.all(scale < grades.GRAVITY_HIGH)):
        worst = float(scale[np.argmax(np.abs(scale - 1.0))])
        return failure("gravity", worst, grades.GRAVITY_HIGH if worst > 1.0 else grades.GRAVITY_LOW)
    return None


def _compared(found: AccelFit, poses: list[Pose], faces: list[int], gravity: float) -> dict[str, float]:
    """Return how far S0's closed form is from the result."""
    means = means_of(poses)
    per_face = np.array([means[[f == i for f in faces]].mean(axis=0) for i in range(6)])
    offset, matrix = closed_form(per_face, gravity)
    length = np.linalg.norm((means - offset) @ matrix.T, axis=1) - gravity
    out = {f"closed_form_offset_{axis}": float(offset[i]) for i, axis in enumerate("xyz")}
    out |= {f"closed_form_matrix_{i}{j}": float(matrix[i, j]) for i in range(3) for j in range(3)}
    return out | {"closed_form_residual_m_s2": rms(length)}

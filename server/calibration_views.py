"""From jobs and stored sets to the bodies of the wire."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from typing import TYPE_CHECKING, Final

import numpy as np

from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import FACES, Check, Failure, Fit, Progress, Residual, Sensor, Value
from server.wire_calibration import (
    CheckOut,
    ComparisonOut,
    FailureOut,
    FitOut,
    JobOut,
    ProgressOut,
    ResidualOut,
)
from server.wire_calibration_sets import ChangeOut, SensorSetsOut, SetOut, SetsOut

if TYPE_CHECKING:
    from server.calibration.diff import Change
    from server.calibration.job import Job
    from server.calibration.records import CalibrationSet

MAX_UNCOVERED: Final = 40


def numbers(values: Mapping[str, Value]) -> dict[str, object]:
    """Return parameters as JSON has them: numbers and nested lists; NaN becomes null on the wire."""
    return {name: np.asarray(value, dtype=np.float64).tolist() for name, value in values.items()}


def residual_out(residual: Residual | None) -> ResidualOut | None:
    """Return a residual with its unit."""
    return None if residual is None else ResidualOut(value=residual.value, unit=residual.unit)


def failure_out(failure: Failure | None) -> FailureOut | None:
    """Return why nothing was fitted."""
    if failure is None:
        return None
    return FailureOut(
        code=failure.code,
        measured=failure.measured,
        limit=failure.limit,
        unit=failure.unit,
        advice=failure.advice,
    )


def fit_out(fit: Fit | None) -> FitOut | None:
    """Return what was found; None when it was refused."""
    if fit is None or not fit.ok:
        return None
    fields: dict[str, object] = {
        "parameters": numbers(fit.parameters),
        "sigma": numbers(fit.sigma),
        "residual_before": residual_out(fit.residual_before),
        "residual_after": residual_out(fit.residual_after),
        "coverage": fit.coverage,
        "grade": fit.grade,
        "samples": fit.samples,
        "temperature_degc": fit.temperature_degc,
        "details": dict(fit.details),
    }
    return FitOut.model_validate(fields)


def check_out(check: Check | None) -> CheckOut | None:
    """Return a verification that was judged."""
    if check is None or check.failure is not None:
        return None
    residual = ResidualOut(value=check.residual.value, unit=check.residual.unit)
    return CheckOut(ok=check.ok, residual=residual, limit=check.limit, samples=check.samples)


def progress_out(progress: Progress) -> ProgressOut:
    """Return progress without its points, which the 3D view draws."""
    uncovered = np.asarray(progress.uncovered_b, dtype=np.float64).reshape(-1, 3)
    uncovered = uncovered[:: max(1, -(-len(uncovered) // MAX_UNCOVERED))]
    fields: dict[str, object] = {
        "fraction": progress.fraction,
        "phase": progress.phase,
        "instruction": progress.instruction,
        "faces": dict(zip(FACES, progress.faces, strict=False)),
        "face_now": progress.face_now,
        "face_next": progress.face_next,
        "pose_target_b": tuple(progress.pose_target_b),
        "poses": progress.poses,
        "restarts": progress.restarts,
        "samples": progress.samples,
        "is_enough": progress.is_enough,
        "is_complete": progress.is_complete,
        "values": dict(progress.values),
        "uncovered_b": uncovered.round(4).tolist(),
        "offset": tuple(progress.offset),
        "matrix": tuple(progress.matrix),
    }
    return ProgressOut.model_validate(fields)


def job_out(job: Job, now_s: float) -> JobOut:
    """Return a job as it is now."""
    fields: dict[str, object] = {
        "id": job.id,
        "board_id": job.board_id,
        "kind": job.kind.value,
        "sensor": job.sensor.value,
        "state": job.state.value,
        "active": job.is_active,
        "dry_run": job.dry_run,
        "created_utc": job.created_utc,
        "created_by": job.created_by,
        "elapsed_s": (job.ended_s if np.isfinite(job.ended_s) else now_s) - job.started_s,
        "timeout_s": job.timeout_s,
        "progress": progress_out(job.progress),
        "refusal": failure_out(job.refusal),
        "result": fit_out(job.fit),
        "comparison": _comparison(job),
        "check": check_out(job.check),
        "check_failure": failure_out(job.check_failure),
        "set_id": job.set_id,
        "samples_file": job.samples_file,
        "lost_results": job.lost_results,
    }
    return JobOut.model_validate(fields)


def _comparison(job: Job) -> ComparisonOut | None:
    if job.fit is None or not job.fit.ok:
        return None
    seen = job.present_check
    residual = residual_out(seen.residual) if seen is not None and seen.failure is None else None
    fields: dict[str, object] = {"parameters": numbers(job.present.of(job.sensor)), "residual": residual}
    return ComparisonOut.model_validate(fields)


def set_out(kept: CalibrationSet, in_force: Mapping[Sensor, CalibrationSet]) -> SetOut:
    """Return a stored set."""
    holder = in_force.get(kept.sensor)
    fields: dict[str, object] = {
        "id": kept.id,
        "board_id": kept.board_id,
        "sensor": kept.sensor.value,
        "kind": str(kept.kind),
        "in_force": holder is not None and holder.id == kept.id,
        "created_utc": kept.created_utc,
        "created_by": kept.created_by,
        "software_version": kept.software_version,
        "source": kept.source,
        "note": kept.note,
        "grade": kept.grade,
        "coverage": kept.coverage,
        "parameters": numbers(kept.parameters),
        "sigma": numbers(kept.sigma),
        "residual_before": residual_out(kept.residual_before),
        "residual_after": residual_out(kept.residual_after),
        "temperature_degc": kept.temperature_degc,
        "check": check_out(kept.verified),
        "samples_file": kept.samples_file,
    }
    return SetOut.model_validate(fields)


def sets_out(
    board_id: str,
    calibration: Calibration,
    kept: Sequence[CalibrationSet],
    in_force: Mapping[Sensor, CalibrationSet],
    can_roll_back: AbstractSet[Sensor],
    troubles: tuple[str, ...],
) -> SetsOut:
    """Return the store of one board."""
    fields = [
        {
            "sensor": sensor.value,
            "set_id": in_force[sensor].id if sensor in in_force else "",
            "parameters": numbers(calibration.of(sensor)),
            "can_roll_back": sensor in can_roll_back,
        }
        for sensor in Sensor
    ]
    return SetsOut(
        board_id=board_id,
        sensors=tuple(SensorSetsOut.model_validate(one) for one in fields),
        sets=tuple(set_out(one, in_force) for one in kept),
        troubles=troubles,
    )


def change_out(change: Change) -> ChangeOut:
    """Return one number of a comparison."""
    return ChangeOut(
        name=change.name,
        old=change.old,
        new=change.new,
        change=change.change,
        change_in_sigma=change.change_in_sigma,
    )

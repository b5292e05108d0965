"""What calibration refuses, why, and what to do instead."""

from __future__ import annotations

from typing import Final

from server.calibration.errors import StoreError
from server.calibration.job import Job
from server.commands import Refusal, RefusalKind
from server.nav.calibration.codes import FAILURES
from server.nav.calibration.types import SENSOR_OF, CalKind

KIND_OF_STATUS: Final = {404: RefusalKind.MISSING, 422: RefusalKind.INVALID}


def clash(job: Job, kind: CalKind) -> bool:
    """True when a calibration of this kind would need the sensor of this job."""
    return job.sensor is SENSOR_OF[kind]


def busy(holder: Job) -> Refusal:
    """Say which job holds the sensor."""
    return Refusal(
        kind=RefusalKind.CONFLICT,
        code="calibration-busy",
        detail=f"Job {holder.id} ({holder.kind.value}) is {holder.state.value} on sensor {holder.sensor.value}.",
        remedy=f"Wait for it, or cancel it: POST /api/v1/boards/{holder.board_id}/calibrations/{holder.id}/cancel.",
        name="job",
        value=holder.id,
    )


def no_job(board_id: str, job_id: str) -> Refusal:
    """Say that there is no such job."""
    return Refusal(
        kind=RefusalKind.MISSING,
        code="no-such-job",
        detail=f"Board {board_id} has no calibration job {job_id[:80]!r}.",
        remedy=f"GET /api/v1/boards/{board_id}/calibrations lists them.",
        name="job",
        value=job_id[:80],
    )


def wrong_state(job: Job, what: str, needed: str) -> Refusal:
    """Say in which state the job is and in which it has to be."""
    return Refusal(
        kind=RefusalKind.CONFLICT,
        code="wrong-state",
        detail=f"Job {job.id} is {job.state.value}; to {what} it has to be {needed}.",
        remedy=f"GET /api/v1/boards/{job.board_id}/calibrations/{job.id} says what it needs.",
        name="state",
        value=job.state.value,
    )


def store_failed(error: OSError | StoreError) -> Refusal:
    """Say that the store could not do it; nothing was changed."""
    if isinstance(error, OSError):
        detail = f"The store cannot be written: {error.strerror or error}."
        return Refusal(
            kind=RefusalKind.CONFLICT,
            code="store-failed",
            detail=detail,
            remedy="Make room on the disk, then try again.",
        )
    kind = KIND_OF_STATUS.get(error.status, RefusalKind.CONFLICT)
    return Refusal(kind=kind, code=error.code, detail=str(error), remedy="GET …/calibration-sets lists what there is.")


def bad_option(error: ValueError) -> Refusal:
    """Say which option a collector does not take."""
    return Refusal(
        kind=RefusalKind.INVALID,
        code="bad-option",
        detail=str(error),
        remedy="Correct the option; /docs has the limits.",
        name="options",
    )


def dry_run(job: Job) -> Refusal:
    """Say that this job was for looking only."""
    remedy = "Start it again without dry_run."
    return Refusal(kind=RefusalKind.CONFLICT, code="dry-run", detail=f"Job {job.id} is a dry run.", remedy=remedy)


def not_settled() -> Refusal:
    """Say that learning has not come to a result."""
    return Refusal(
        kind=RefusalKind.CONFLICT,
        code="not-settled",
        detail="Nothing has been learned that may be kept.",
        remedy="Switch learning on, and let the vehicle turn about more than one axis.",
    )


def applying(job: Job) -> Refusal:
    """Say that the result is on its way into force."""
    return Refusal(
        kind=RefusalKind.CONFLICT,
        code="wrong-state",
        detail=f"Job {job.id} is being applied at this moment.",
        remedy="Wait for it; roll back afterwards if it was not wanted.",
        name="state",
        value=job.state.value,
    )


def outdated(job: Job) -> Refusal:
    """Say that a result rests on sensors that are calibrated otherwise by now."""
    return Refusal(
        kind=RefusalKind.CONFLICT,
        code="calibration-changed",
        detail=f"Job {job.id} was made with another calibration of the accelerometer or mounting than is in force now.",
        remedy="Start it again: it takes seconds.",
        name="job",
        value=job.id,
    )


def unknown(code: str, name: str) -> Refusal:
    """Say what has to be known before this kind can begin: `field-unknown`, `heading-unknown`."""
    is_ours = code == "heading-unknown"  # only a person can tell it
    return Refusal(
        kind=RefusalKind.INVALID if is_ours else RefusalKind.CONFLICT,
        code=code,
        detail=FAILURES[code],
        remedy=f"Give {name}." if is_ours else f"Wait for a position, or give {name}.",
        name=name,
    )


def impossible(error: ValueError) -> Refusal:
    """Say why numbers cannot be a calibration; nothing was changed."""
    return Refusal(
        kind=RefusalKind.INVALID,
        code="impossible-calibration",
        detail=f"It cannot be put in force: {error}.",
        remedy="Correct the numbers, or calibrate anew.",
    )

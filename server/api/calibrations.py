"""Calibration jobs of a board: start, look, confirm, verify, apply, cancel."""

from __future__ import annotations

import time
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Request, Response

from server.api.context import BoardDep, ContextDep, RoleDep
from server.api.errors import granted
from server.calibration.job import Job
from server.calibration.keeper import Person
from server.calibration.service import Calibrations
from server.calibration_views import job_out
from server.commands import Refusal
from server.nav.calibration.codes import FAILURES
from server.wire_base import Problem, Role
from server.wire_calibration import CalibrationIn, CodeOut, CodesOut, JobOut, JobsOut

Responses = dict[int | str, dict[str, Any]]
router = APIRouter(prefix="/api/v1", tags=["calibration"])
NOT_FOUND: Responses = {404: {"model": Problem}}
CONFLICT: Responses = {409: {"model": Problem}}
Action = Literal["cancel", "confirm", "verify", "apply"]


def _service(context: ContextDep) -> Calibrations:
    return context.calibrations


CalibrationsDep = Annotated[Calibrations, Depends(_service)]


def person(role: Role | None) -> Person:
    """Return who asks, as far as the door knows."""
    return Person(name=role or "operator")


def _out(reply: Job | Refusal) -> JobOut:
    return job_out(granted(reply), time.monotonic())


@router.get("/calibration-codes")
async def list_codes() -> CodesOut:
    """Return every reason for which a calibration may refuse; the command line uses the same."""
    return CodesOut(codes=tuple(CodeOut(code=code, advice=advice) for code, advice in FAILURES.items()))


@router.get("/boards/{board_id}/calibrations", responses=NOT_FOUND)
async def list_jobs(board: BoardDep, service: CalibrationsDep) -> JobsOut:
    """Return the calibration jobs of a board, newest first."""
    now_s = time.monotonic()
    return JobsOut(board_id=board.id, jobs=tuple(job_out(job, now_s) for job in service.jobs(board.id)))


@router.post("/boards/{board_id}/calibrations", status_code=202, responses=NOT_FOUND | CONFLICT)
async def start_job(
    board: BoardDep, body: CalibrationIn, service: CalibrationsDep, role: RoleDep, request: Request, response: Response
) -> JobOut:
    """Start a job; it belongs to the server and goes on when nobody looks. One at a time for each sensor."""
    out = _out(service.begin(board.id, body, person(role)))
    response.headers["location"] = request.url_for("get_job", board_id=board.id, job_id=out.id).path
    return out


@router.get("/boards/{board_id}/calibrations/{job_id}", responses=NOT_FOUND)
async def get_job(board: BoardDep, job_id: str, service: CalibrationsDep) -> JobOut:
    """Return one job: state, progress, the next move, and its result or the reason why there is none."""
    return _out(service.job(board.id, job_id))


@router.post("/boards/{board_id}/calibrations/{job_id}/{action}", status_code=202, responses=NOT_FOUND | CONFLICT)
async def act_on_job(board: BoardDep, job_id: str, action: Action, service: CalibrationsDep, role: RoleDep) -> JobOut:
    """Do something with a job.

    cancel ends it; confirm fits what was collected so far (a refused attempt loses nothing); verify judges the result
    on fresh data; apply stores the result and puts it in force.
    """
    job = granted(service.job(board.id, job_id))
    if action == "apply":
        return _out(await service.apply(job, person(role)))
    return _out({"cancel": service.cancel, "confirm": service.confirm, "verify": service.verify}[action](job))

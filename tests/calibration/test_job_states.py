"""A job by itself: its progress, its time and its ends, with a collector that says what the test wants."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np
import pytest

from server.calibration.job import PAUSED_TIMEOUT_S, Job, JobState
from server.nav.calibration.applied import Calibration
from server.nav.calibration.codes import failure
from server.nav.calibration.types import CalKind, Check, Fit, Options, Progress, Residual
from server.nav.types import ROW_WIDTH, Kind

ROW = (np.zeros(1, dtype=np.int64), np.zeros((1, ROW_WIDTH)))


@dataclass
class Told:
    """A collector whose progress is what the test says; it counts who asks."""

    fraction: float = 0.0
    asked: int = 0
    fed: list[Kind] = field(default_factory=list)
    broken: bool = False
    takes_s: float = 0.0

    def feed(self, kind, t_ns, rows) -> None:
        self.fed.append(kind)

    def progress(self) -> Progress:
        self.asked += 1
        time.sleep(self.takes_s)
        if self.broken:
            raise ValueError("a defect")
        return Progress(fraction=self.fraction, phase="hold-still", instruction="hold-still")

    def fit(self) -> Fit:
        return Fit(kind=CalKind.GYRO_BIAS, parameters={"bias": np.zeros(3)})

    def check(self, parameters) -> Check:
        return Check(ok=True, residual=Residual(value=0.0, unit="rad/s"), limit=1.0, samples=1)


def made(**more) -> tuple[Job, Told]:
    job = Job(
        id="one",
        board_id="sim",
        kind=CalKind.GYRO_BIAS,
        options=Options(),
        present=Calibration(),
        created_utc="",
        created_by="",
        started_s=100.0,
        timeout_s=60.0,
        **more,
    )
    job._collector = told = Told()
    return job, told


def fitted() -> Job:
    job, told = made()
    job.feed(Kind.IMU, *ROW, 100.0)
    job.begin_fit()
    job.end_fit(told.fit(), None, asked=False, now_s=120.0)
    return job


@pytest.mark.parametrize("end", [lambda job: job.cancel(101.0), lambda job: job.refuse(failure("program"), 101.0)])
def test_nobody_touches_a_collector_that_a_thread_is_fitting_not_even_after_the_job_was_ended(end) -> None:
    job, told = made()
    told.fraction = 0.5
    job.feed(Kind.IMU, *ROW, 100.0)
    job.begin_fit()
    told.asked, told.fed = 0, []
    assert job.progress.fraction == 0.5
    job.feed(Kind.IMU, *ROW, 100.5)
    end(job)
    assert job.progress.fraction == 0.5
    job.feed(Kind.IMU, *ROW, 101.5)
    assert (told.asked, told.fed) == (0, [])


def test_a_restart_does_not_take_progress_back_neither_while_collecting_nor_in_a_verification() -> None:
    job, told = made()
    seen = []
    for told.fraction in (0.2, 0.6, 0.1, 0.7):
        job.feed(Kind.IMU, *ROW, 100.0)
        seen.append(job.progress.fraction)
    assert seen == [0.2, 0.6, 0.6, 0.7]
    job = fitted()
    job.begin_verification(121.0)
    job._verifier = told = Told()
    seen = []
    for told.fraction in (0.0, 0.6, 0.1, 0.7):
        job.feed(Kind.IMU, *ROW, 122.0)
        seen.append(job.progress.fraction)
    assert seen == [0.0, 0.6, 0.6, 0.7]
    job.cancel(123.0)
    assert (job.state, job.progress.fraction) == (JobState.FITTED, 1.0)


def test_a_lost_link_costs_none_of_the_time_and_even_so_ends_some_day() -> None:
    job, _ = made()
    job.feed(Kind.IMU, *ROW, 101.0)
    for now_s in np.arange(101.0, 1000.0):
        job.look(float(now_s))
    assert job.state is JobState.PAUSED
    job.feed(Kind.IMU, *ROW, 1000.0)
    job.look(1000.1)
    assert job.state is JobState.COLLECTING
    for now_s in np.arange(1001.0, 1002.0 + PAUSED_TIMEOUT_S):
        job.look(float(now_s))
    assert job.state is JobState.REFUSED
    assert job.refusal is not None
    assert (job.refusal.code, job.refusal.limit) == ("timed-out", PAUSED_TIMEOUT_S)


def test_collecting_counts_against_the_time_and_says_how_much_it_was() -> None:
    job, _ = made()
    for now_s in np.arange(100.0, 162.0, 0.5):
        job.feed(Kind.IMU, *ROW, float(now_s))
        job.look(float(now_s))
    assert job.refusal is not None
    assert (job.refusal.code, job.refusal.limit, job.refusal.measured) == ("timed-out", 60.0, 60.5)


def test_a_confirmation_before_the_first_sample_leaves_the_job_waiting() -> None:
    job, _ = made()
    job.begin_fit()
    job.end_fit(Fit(kind=CalKind.GYRO_BIAS, failure=failure("no-data")), None, asked=True, now_s=101.0)
    assert job.state is JobState.WAITING
    for now_s in np.arange(101.0, 162.0):
        job.look(float(now_s))
    assert job.refusal is not None
    assert job.refusal.code == "no-data"


def test_what_ends_a_verification_leaves_the_result_and_whether_it_was_applied() -> None:
    for set_id, state in (("", JobState.FITTED), ("kept", JobState.APPLIED)):
        job = fitted()
        if set_id:
            job.applied(set_id)
        job.begin_verification(121.0)
        job.refuse(failure("board-removed"), 122.0)
        assert (job.state, job.refusal, job.fit is not None) == (state, None, True)
        assert job.check_failure is not None
        assert job.check_failure.code == "board-removed"


def test_a_result_that_is_thrown_away_later_did_not_take_longer() -> None:
    job = fitted()
    job.cancel(500.0)
    assert job.ended_s == 120.0


def test_a_defect_of_the_collector_ends_the_job_and_it_can_still_be_shown() -> None:
    job, told = made()
    told.broken = True
    job.feed(Kind.IMU, *ROW, 100.0)
    with pytest.raises(ValueError, match="a defect"):
        _ = job.wants_fit
    job.fail(101.0)
    assert (job.state, job.progress.fraction) == (JobState.REFUSED, 0.0)
    assert job.refusal is not None
    assert job.refusal.code == "program"
    assert math.isnan(job.refusal.measured)


def test_a_progress_that_is_dear_to_build_is_not_built_for_every_sample() -> None:
    job, told = made()
    told.takes_s = 0.02
    for now_s in np.arange(100.0, 102.0, 0.1):  # twenty looks, ten a second
        job.feed(Kind.IMU, *ROW, float(now_s))
        job.look(float(now_s))
        _ = job.progress
    assert 2 <= told.asked <= 6  # 0.02 s · 20 = 0.4 s apart
    told.takes_s, told.asked = 0.0, 0
    for now_s in np.arange(103.0, 105.0, 0.1):
        job.feed(Kind.IMU, *ROW, float(now_s))
        job.look(float(now_s))
        _ = job.progress
    assert told.asked == 20

"""One calibration job: a collector with states, a clock and a result. Knows no task, link or disk.

    waiting → collecting ⇄ paused → fitting → fitted ⇄ verifying → applied
                                        ↘ refused      (any active state) → cancelled

A refused attempt that a person asked for leaves the job collecting: what was collected stays, and the reason is shown.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Final

from server.nav.calibration.applied import Calibration, conditioned
from server.nav.calibration.codes import failure
from server.nav.calibration.registry import collector_for
from server.nav.calibration.types import (
    SENSOR_OF,
    CalKind,
    Check,
    Collector,
    Failure,
    Fit,
    Options,
    Progress,
    Sensor,
)
from server.nav.types import Float, Int, Kind


class JobState(StrEnum):
    """Where a job is."""

    WAITING = "waiting"  # for the first sample
    COLLECTING = "collecting"
    PAUSED = "paused"  # no sample comes: the link is lost; what was collected stays
    FITTING = "fitting"
    FITTED = "fitted"
    VERIFYING = "verifying"
    APPLIED = "applied"
    REFUSED = "refused"
    CANCELLED = "cancelled"


COLLECTS: Final = frozenset({JobState.WAITING, JobState.COLLECTING, JobState.PAUSED})
ACTIVE: Final = COLLECTS | {JobState.FITTING, JobState.VERIFYING}
"""States in which a job holds its sensor."""
SILENT_S: Final = 1.5
"""So long without a sample of its kind, and a job shows itself paused."""
SLOW_KINDS: Final = {Kind.BARO: 4.0, Kind.AIRSPEED: 4.0, Kind.MAG: 3.0}
VERIFY_TIMEOUT_S: Final = 180.0
PAUSED_TIMEOUT_S: Final = 3600.0
"""So long paused in all, and a job is given up; until then a lost link costs none of its time."""
INPUT_OF: Final[dict[Sensor, Kind]] = {
    Sensor.GYRO: Kind.IMU,
    Sensor.ACCEL: Kind.IMU,
    Sensor.BOARD: Kind.IMU,
    Sensor.MAG: Kind.MAG,
    Sensor.AIRSPEED: Kind.AIRSPEED,
    Sensor.BARO: Kind.BARO,
}
DEAR_S: Final = 0.005
LOOK_APART: Final = 20.0
"""A progress that takes longer than that to build is built anew only after so many times as long."""


@dataclass(slots=True, kw_only=True)
class Job:
    """One calibration of one board. Times are host monotonic seconds that the caller gives."""

    id: str
    board_id: str
    kind: CalKind
    options: Options
    present: Calibration
    created_utc: str
    created_by: str
    started_s: float
    timeout_s: float
    dry_run: bool = False
    state: JobState = JobState.WAITING
    fraction: float = 0.0
    fit: Fit | None = None
    refusal: Failure | None = None
    check: Check | None = None
    check_failure: Failure | None = None
    present_check: Check | None = None
    set_id: str = ""
    samples_file: str = ""
    ended_s: float = field(default=float("nan"))
    lost_results: int = 0
    is_applying: bool = False
    _collector: Collector = field(init=False)
    _verifier: Collector | None = field(default=None, init=False)
    _progress: Progress | None = field(default=None, init=False)
    _fed_s: float = field(default=float("nan"), init=False)
    _verify_from_s: float = field(default=0.0, init=False)
    _looked_s: float = field(init=False)
    _look_again_s: float = field(default=0.0, init=False)
    _paused_s: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        self._collector = collector_for(self.kind, self.options)
        self._looked_s = self.started_s

    @property
    def sensor(self) -> Sensor:
        """The sensor it holds while it is active."""
        return SENSOR_OF[self.kind]

    @property
    def is_active(self) -> bool:
        """True while no other job may use its sensor."""
        return self.state in ACTIVE

    @property
    def progress(self) -> Progress:
        """How far it is; its fraction never goes back, but a verification begins at 0 and ends at the result.

        While it fits, this is what was seen before: the collector belongs to the thread then.
        """
        if self._progress is None:
            begun_s = time.perf_counter()
            found = (self._verifier or self._collector).progress()
            took_s = time.perf_counter() - begun_s
            self._look_again_s = self._looked_s + LOOK_APART * took_s if took_s > DEAR_S else 0.0
            self.fraction = max(self.fraction, min(max(found.fraction, 0.0), 1.0))
            self._progress = replace(found, fraction=self.fraction)
        return self._progress

    def feed(self, kind: Kind, t_ns: Int, rows: Float, now_s: float) -> None:
        """Take samples of one kind in order of arrival; ignored where none are collected.

        `t_ns` (n,) are board time; `rows` (n, ROW_WIDTH) as `SAMPLE_COLUMNS[kind]`: raw, SI, body FRD, mag in gauss.
        """
        if self.state not in COLLECTS and self.state is not JobState.VERIFYING:
            return
        if kind is INPUT_OF[self.sensor]:
            self._fed_s = now_s
            if self.state in COLLECTS:
                self.state = JobState.COLLECTING
        (self._verifier or self._collector).feed(kind, t_ns, conditioned(self.kind, kind, rows, self.present))
        if now_s >= self._look_again_s:
            self._progress = None

    def look(self, now_s: float) -> None:
        """Notice silence and the end of the time; a lost link costs none of it."""
        if self.state is JobState.PAUSED:
            self._paused_s += now_s - self._looked_s
        self._looked_s = now_s
        silent_s = SLOW_KINDS.get(INPUT_OF[self.sensor], SILENT_S)
        if self.state is JobState.COLLECTING and now_s - self._fed_s > silent_s:
            self.state = JobState.PAUSED
        if self.state in COLLECTS:
            self._end_in_time(now_s)
        if self.state is JobState.VERIFYING and now_s - self._verify_from_s > VERIFY_TIMEOUT_S:
            self.end_verification()

    def _end_in_time(self, now_s: float) -> None:
        spent_s = now_s - self.started_s - self._paused_s
        if spent_s > self.timeout_s:
            code = "no-data" if self.state is JobState.WAITING else "timed-out"
            self.refuse(failure(code, spent_s, self.timeout_s, "s"), now_s)
        elif self._paused_s > PAUSED_TIMEOUT_S:
            self.refuse(failure("timed-out", self._paused_s, PAUSED_TIMEOUT_S, "s"), now_s)

    @property
    def wants_fit(self) -> bool:
        """True when nothing is gained by collecting on."""
        return self.state is JobState.COLLECTING and self.progress.is_complete

    def begin_fit(self) -> Collector:
        """Stop collecting; return what is to be fitted, in a thread, which nobody else touches meanwhile."""
        self._progress = self.progress
        self.state = JobState.FITTING
        return self._collector

    def end_fit(self, fit: Fit, present_check: Check | None, *, asked: bool, now_s: float) -> None:
        """Take the result. A refused attempt that a person asked for leaves the job collecting."""
        if self.state is not JobState.FITTING:  # cancelled meanwhile
            return
        self.refusal, self._progress = fit.failure, None
        if fit.failure is None:
            self.fit, self.present_check = fit, present_check
            self.fraction, self.state, self.ended_s = 1.0, JobState.FITTED, now_s
        elif asked and math.isnan(self._fed_s):
            self.state = JobState.WAITING
        elif asked:
            self.state, self._fed_s = JobState.COLLECTING, now_s
        else:
            self.fit = fit
            self.refuse(fit.failure, now_s)

    def begin_verification(self, now_s: float) -> None:
        """Collect fresh data under the new parameters."""
        self._verifier = collector_for(self.kind, self.options)
        self.state, self._progress, self._verify_from_s = JobState.VERIFYING, None, now_s
        self.fraction = 0.0
        self.check = self.check_failure = None

    def judge(self) -> bool:
        """Judge the fresh data; True when there was enough of it."""
        if self._verifier is None or self.fit is None:
            return False
        found = self._verifier.check(self.fit.parameters)
        self.check_failure = found.failure
        if found.failure is None:
            self.check = found
        return found.failure is None

    def end_verification(self) -> None:
        """Go back to the result, judged or not."""
        self._verifier, self._progress, self.fraction = None, None, 1.0
        self.state = JobState.APPLIED if self.set_id else JobState.FITTED

    def cancel(self, now_s: float) -> None:
        """End it; a verification alone is given up, the result stays."""
        if self.state is JobState.VERIFYING:
            self.end_verification()
        else:
            self._end(JobState.CANCELLED, now_s)

    def refuse(self, why: Failure, now_s: float) -> None:
        """End it with a reason; of a verification the reason stays, and the result as well."""
        if self.state is JobState.VERIFYING:
            self.check_failure = why
            self.end_verification()
        else:
            self.refusal = why
            self._end(JobState.REFUSED, now_s)

    def fail(self, now_s: float) -> None:
        """End it after a defect of its collector, which is asked nothing more."""
        self.refuse(failure("program"), now_s)
        if self._progress is None:
            self._progress = Progress(fraction=self.fraction, phase="waiting", instruction="wait")

    def _end(self, state: JobState, now_s: float) -> None:
        self.state = state
        if math.isnan(self.ended_s):
            self.ended_s = now_s

    def applied(self, set_id: str) -> None:
        """Note the set that was made of the result and put in force."""
        self.set_id, self.state = set_id, JobState.APPLIED

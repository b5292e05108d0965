"""What a job needs before it may begin, how long it may take, and what its result rests on when it is to be applied."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.calibration.job import Job
from server.calibration.refusals import unknown
from server.commands import Refusal
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import CalKind, Sensor

TIMEOUT_S: Final[dict[CalKind, float]] = {
    CalKind.GYRO_BIAS: 120.0,
    CalKind.LEVEL: 120.0,
    CalKind.AIRSPEED_ZERO: 120.0,
    CalKind.BARO_REFERENCE: 120.0,
    CalKind.MAG_FIXED_HEADING: 120.0,
    CalKind.MAG_IN_FLIGHT: 3600.0,
}
LONG_TIMEOUT_S: Final = 900.0
RESTS_ON: Final = {
    CalKind.LEVEL: (Sensor.ACCEL,),
    CalKind.MAG_FIXED_HEADING: (Sensor.ACCEL, Sensor.BOARD),
}
"""Sensors whose calibration in force goes into a result."""


def is_outdated(job: Job, now: Calibration) -> bool:
    """True when the result rests on sensors that are calibrated otherwise by now."""
    then = job.present
    return any(
        not np.array_equal(value, now.of(sensor)[name])
        for sensor in RESTS_ON.get(job.kind, ())
        for name, value in then.of(sensor).items()
    )


def what_misses(job: Job) -> Refusal | None:
    """Refuse at once what could only be refused after the work: no field, no heading."""
    if job.kind is CalKind.MAG_FIXED_HEADING and not math.isfinite(job.options.heading_rad):
        return unknown("heading-unknown", "options.heading_deg")
    if job.kind is CalKind.MAG_FIXED_HEADING and not job.options.field_n_gauss:
        return unknown("field-unknown", "a site in the settings")
    if job.kind is CalKind.MAG_ELLIPSOID and not math.isfinite(job.options.strength):
        return unknown("field-unknown", "options.strength_gauss, or a site in the settings")
    return None

"""Bodies about calibration jobs: options, progress, results, refusals; the store is in `wire_calibration_sets`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from server.wire_base import In, Num, Out

KindName = Literal[
    "gyro_bias",
    "gyro_scale",
    "accel_six_position",
    "accel_multi_pose",
    "level",
    "mag_ellipsoid",
    "mag_fixed_heading",
    "mag_in_flight",
    "airspeed_zero",
    "baro_reference",
]
SensorName = Literal["gyro", "accel", "mag", "board", "airspeed", "baro"]
StateName = Literal[
    "waiting", "collecting", "paused", "fitting", "fitted", "verifying", "applied", "refused", "cancelled"
]
GradeName = Literal["good", "fair", "poor", ""]
Matrix = tuple[tuple[Num, ...], ...]
ValueOut = Num | tuple[Num, ...] | Matrix
"""A number, a vector [3] or a matrix [3][3]."""

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]


class OptionsIn(In):
    """What a person may tell a calibration; what is left out is found out or has its default."""

    axis: Literal["x", "y", "z"] | None = Field(None, description="axis of the turntable; absent = the one that turned")
    turns: Annotated[Finite, Field(gt=0.0, le=1000.0)] | None = Field(
        None, description="whole turns made; absent = the nearest whole number"
    )
    ellipsoid_parameters: Literal[6, 9] = Field(9, description="6 = axes of the sensor, 9 = tilted")
    duration_s: Annotated[Finite, Field(ge=0.1, le=3600.0)] | None = Field(None, description="how long to collect")
    heading_deg: Annotated[Finite, Field(ge=-360.0, le=360.0)] | None = Field(
        None, description="true heading of the vehicle now, clockwise from north (mag_fixed_heading)"
    )
    heading_sigma_deg: Annotated[Finite, Field(gt=0.0, le=45.0)] = Field(2.0, description="how well it is known, 1σ")
    height_m: Annotated[Finite, Field(ge=-1000.0, le=20_000.0)] | None = Field(
        None, description="what the barometer shall read here; absent = 0"
    )
    strength_gauss: Annotated[Finite, Field(ge=0.1, le=2.0)] | None = Field(
        None, description="strength of the Earth's field here; absent = by the model"
    )
    gravity_m_s2: Annotated[Finite, Field(ge=9.5, le=10.1)] | None = Field(
        None, description="local gravity; absent = by the position, else 9.80665"
    )


class CalibrationIn(In):
    """A calibration to start."""

    kind: KindName
    options: OptionsIn = OptionsIn()
    dry_run: bool = Field(False, description="collect and fit, but never apply")
    timeout_s: Annotated[Finite, Field(ge=5.0, le=7200.0)] | None = Field(
        None, description="give up after; absent = the kind's own"
    )


class FailureOut(Out):
    """Why nothing was fitted, or a check could not be made."""

    code: str = Field(description="kebab-case; GET /api/v1/calibration-codes lists them all")
    measured: Num
    limit: Num
    unit: str
    advice: str


class ResidualOut(Out):
    """RMS of what the parameters leave unexplained."""

    value: Num
    unit: str


class ProgressOut(Out):
    """How far a job is and what to do next."""

    fraction: float = Field(description="0 to 1; never goes back")
    phase: str
    instruction: str = Field(description="code of the next move")
    faces: dict[str, bool] = Field(description="which of the six faces are done; {} for kinds without")
    face_now: str
    face_next: str
    pose_target_b: tuple[float, ...] = Field(description="direction in body FRD that shall point down; [] = none")
    poses: int
    restarts: int
    samples: int
    is_enough: bool = Field(description="a fit may be asked for: confirm")
    is_complete: bool
    values: dict[str, Num] = Field(description="live numbers, unit in the name")
    uncovered_b: tuple[tuple[float, ...], ...] = Field(description="unit directions that miss samples, at most 40")
    offset: tuple[float, ...] = Field(description="the fit so far; [] = none")
    matrix: tuple[tuple[float, ...], ...]


class FitOut(Out):
    """What was found."""

    parameters: dict[str, ValueOut]
    sigma: dict[str, ValueOut] = Field(description="one standard deviation, same shapes; null = not measured")
    residual_before: ResidualOut | None = Field(description="of the raw samples")
    residual_after: ResidualOut | None
    coverage: Num = Field(description="share of what the kind needs, 0 to 1; null where the notion is empty")
    grade: GradeName
    samples: int
    temperature_degc: Num
    details: dict[str, Num]


class CheckOut(Out):
    """Verification on fresh data."""

    ok: bool
    residual: ResidualOut
    limit: Num
    samples: int


class ComparisonOut(Out):
    """The present calibration of the sensor on the very same data."""

    parameters: dict[str, ValueOut]
    residual: ResidualOut | None


class JobOut(Out):
    """One calibration job; it belongs to the server, so pages may come and go."""

    id: str
    board_id: str
    kind: KindName
    sensor: SensorName
    state: StateName
    active: bool = Field(description="it holds its sensor: another job on it would be refused")
    dry_run: bool
    created_utc: str
    created_by: str
    elapsed_s: float
    timeout_s: float
    progress: ProgressOut
    refusal: FailureOut | None = Field(description="of the last attempt to fit, or why the job ended")
    result: FitOut | None
    comparison: ComparisonOut | None
    check: CheckOut | None
    check_failure: FailureOut | None = Field(description="what the verification still misses")
    set_id: str = Field(description='the calibration set it became; "" before it was applied')
    samples_file: str = Field(description='where its raw samples are kept, for `navdeck calibrate`; "" = nowhere')
    lost_results: int = Field(description="batches of samples that were lost on the way to the job")


class JobsOut(Out):
    """Jobs of a board, newest first."""

    board_id: str
    jobs: tuple[JobOut, ...]


class CodeOut(Out):
    """One reason for which a calibration may refuse."""

    code: str
    advice: str


class CodesOut(Out):
    """Every reason, shared by REST, page and command line."""

    codes: tuple[CodeOut, ...]

"""`summary.json` as typed models; the JSON Schema that is shipped is generated from them."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field

from server.replay.contract_base import Out
from server.replay.contract_preprocessing import CalibrationOut, MagLearningOut, StagesOut

SUMMARY_FORMAT: Final = "navdeck.replay.summary/1"


class SpreadOut(Out):
    """Size of an error over a window; percentiles are of its absolute value."""

    rows: int
    rms: float
    p50: float
    p95: float
    p99: float
    max: float


class CoverOut(Out):
    """Share of rows (0 to 1) whose error lies within its own 3σ in every component; null = no σ or no reference."""

    horizontal: float | None = Field(description="north and east both inside")
    vertical: float | None = Field(description="raw height error")
    velocity: float | None = Field(description="north, east and down all inside")
    attitude: float | None = Field(description="x, y and z of the NED error rotation vector all inside")


class ErrorsOut(Out):
    """Lane minus reference at equal t_ns over one window; no fit of any kind. null = nothing to compare."""

    t_from_ns: int
    t_to_ns: int
    rows: int = Field(description="stamps at which anything could be compared")
    attitude_rad: SpreadOut | None = Field(description="total angle between the two attitudes")
    heading_rad: SpreadOut | None = Field(description="z of the NED error rotation vector")
    tilt_rad: SpreadOut | None = Field(description="norm of x and y of the NED error rotation vector")
    horizontal_m: SpreadOut | None = Field(description="2-D norm")
    vertical_m: SpreadOut | None = Field(description="raw, up")
    vertical_median_m: float | None = Field(description="median of the raw vertical error")
    vertical_less_median_m: SpreadOut | None = Field(description="vertical error after its median was taken off")
    vel_n_m_s: SpreadOut | None
    vel_e_m_s: SpreadOut | None
    vel_d_m_s: SpreadOut | None
    cover_3sigma: CoverOut
    sigma_ratio_horizontal: float | None = Field(
        description="median of σ_h = sqrt(σ_n² + σ_e²) divided by the RMS horizontal error"
    )


class OutageOut(Out):
    """One withheld stretch of GNSS and what the lane made of it."""

    from_s: float
    to_s: float
    rows: int
    peak_horizontal_m: float | None
    peak_horizontal_sigmas: float | None = Field(
        description="largest of |north|/σ_n and |east|/σ_e; inside 3σ when ≤ 3"
    )
    end_horizontal_m: float | None = Field(description="at the last row of the stretch")
    end_attitude_rad: float | None


class LaneOut(Out):
    """One lane: its file, how many rows in which state, and its errors; null of what it does not provide."""

    file: str
    provides: Literal["full", "attitude", "altitude"]
    failure: str = Field(description='why the lane was put aside; "" when it was not')
    boot_id: int
    rows: int
    status_rows: dict[str, int] = Field(description="rows by status word; all words are present")
    compared_at: Literal["lane stamps", "reference stamps"] | None = Field(
        description="which side kept its stamps; the other was interpolated between neighbours at most 50 ms apart"
    )
    whole: ErrorsOut | None = Field(description="over everything; null without a reference")
    settled: ErrorsOut | None = Field(description="from 30 s after the first GNSS 3-D fix on; null without either")
    outages: list[OutageOut]


class LogOut(Out):
    """What was replayed."""

    name: str
    kind: Literal["tlog", "folder"]
    bytes_in: int
    board: str
    boots: int = Field(description="power-ups of the board in this log")
    t_first_ns: int | None
    t_last_ns: int | None
    duration_s: float = Field(description="from the first to the last sample, all power-ups together")


class SettingsOut(Out):
    """What the engine was told; null = unknown or its own default."""

    nav_rate_hz: float
    lanes: list[str]
    lane_parameters: dict[str, dict[str, float]] = Field(
        description="lane → parameter → value, only what is not at its default"
    )
    vehicle: str
    gnss_delay_s: float | None
    lever_arm_b_m: list[float]
    aids: dict[str, bool]
    gnss_outages_s: list[tuple[float, float]]
    t_origin_ns: int | None = Field(description="origin of gnss_outages_s: the earliest t_ns of any file")


class ReplaySettingsOut(SettingsOut):
    """What the engine was told of a replay, preprocessing included."""

    preprocess: dict[str, dict[str, float]] = Field(
        default={}, description="sensor → parameter → value, only what is not at its default"
    )
    calibration: list[CalibrationOut] = Field(default=[], description="in the order of the files; [] = none")


class SiteOut(Out):
    """Origin of the local frame, and the magnetic model's date with its source."""

    lat_deg: float | None
    lon_deg: float | None
    alt_m: float | None
    gravity_m_s2: float | None
    declination_rad: float | None
    field_n_gauss: list[float] | None
    decimal_year: float | None
    date_source: str = Field(description='"settings", "board", "model-epoch" or "none"')


class SensorOut(Out):
    """One sensor as the engine saw it."""

    boot_id: int
    name: str
    fresh: int
    repeated: int
    refused: dict[str, int]
    rate_hz: float | None
    scale: float
    note: str


class AidOut(Out):
    """Measurements of one kind: how many corrected the estimate, and why the others did not."""

    fused: int
    refused: dict[str, int] = Field(description="by reason")


class EventOut(Out):
    """Something that happened, in words."""

    boot_id: int
    t_ns: int
    code: str
    severity: str
    text: str
    values: dict[str, float | None]


class TimingOut(Out):
    """Where the time went; the engine apart from files."""

    read_s: float = Field(description="opening, reading and decoding the log")
    engine_s: float = Field(description="inside the engine's step, and nothing else")
    finish_s: float = Field(description="lanes that need the whole recording (smoother), at its end")
    score_s: float = Field(description="comparing with the reference")
    write_s: float = Field(description="formatting and writing the lane files")
    total_s: float
    samples_per_s: float | None = Field(description="samples of every kind per engine second")
    real_time_factor: float | None = Field(description="log seconds per engine second")


class SummaryOut(Out):
    """`summary.json`."""

    format: Literal["navdeck.replay.summary/1"] = SUMMARY_FORMAT
    navdeck_version: str
    log: LogOut
    settings: ReplaySettingsOut
    site: SiteOut | None
    samples: dict[str, int] = Field(description="rows given to the engine, by kind")
    losses: dict[str, int] = Field(description="what was lost or left out before the engine, by reason")
    sensors: list[SensorOut]
    aids: dict[str, AidOut]
    events: list[EventOut]
    timing: TimingOut
    lanes: dict[str, LaneOut] = Field(description="by file stem")
    stages: dict[str, StagesOut] = Field(
        default={}, description="by file stem; of the sensors whose chain or calibration is on"
    )
    mag_learning: MagLearningOut | None = Field(default=None, description="null = it did not run")
    notes: list[str]

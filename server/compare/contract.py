"""`compare.json` as typed models; the JSON Schema that is shipped is generated from them."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from server.replay.contract import ErrorsOut, LogOut, SettingsOut, SpreadOut

COMPARE_FORMAT: Final = "navdeck.compare/1"
FIVE_MOTIONS_FORMAT: Final = "navdeck.five-motions/1"


class _Out(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class DifferenceOut(_Out):
    """Lane minus the chosen lane at equal t_ns; sizes, so never negative. null = one of them does not know."""

    rows: int = Field(description="stamps at which anything could be compared")
    attitude_rad: SpreadOut | None = Field(description="total angle between the two attitudes")
    heading_rad: SpreadOut | None = Field(description="z of the NED rotation vector between them")
    tilt_rad: SpreadOut | None = Field(description="angle between the two verticals, whatever the headings")
    horizontal_m: SpreadOut | None
    vertical_m: SpreadOut | None
    horizontal_m_s: SpreadOut | None
    vertical_m_s: SpreadOut | None


class DelayOut(_Out):
    """How late a lane is, and how well its motion resembles the reference's at that shift."""

    delay_s: float = Field(description="positive = the lane is late; between lags by a parabola")
    standard_error_s: float = Field(description="from how differently ten parts of the record would have it")
    peak: float = Field(description="correlation there, 0.7 to 1")


class DelaysOut(_Out):
    """Delays by what was correlated; null = too little motion to tell, or no resemblance within 1 s."""

    attitude: DelayOut | None = Field(description="body rates derived from the attitude, all three axes")
    vertical: DelayOut | None = Field(description="vertical speed, or the height's derivative where there is none")
    horizontal: DelayOut | None = Field(description="velocity north and east")


class NoiseOut(_Out):
    """Jitter from step to step in quiet seconds: RMS second difference / √6, white noise's σ; null = unknown."""

    tilt_rad: float | None = Field(description="of roll and pitch, RMS of the two")
    heading_rad: float | None
    height_m: float | None
    vertical_m_s: float | None
    horizontal_m_s: float | None = Field(description="of north and east, RMS of the two")


class CostOut(_Out):
    """What one navigation step costs here; smallest of several passes over the same samples."""

    ns_per_step: float
    steps: int
    passes: int


class FiguresOut(_Out):
    """A lane over one window."""

    rows: int
    status_rows: dict[str, int] = Field(description="rows by status word; all words are present")
    difference: DifferenceOut | None = Field(description="to the chosen lane; null for that lane itself")
    error: ErrorsOut | None = Field(description="against the reference, as in replay's summary; null without one")
    tilt_error_rad: SpreadOut | None = Field(description="angle between the verticals, whatever the headings")
    delay: DelaysOut | None
    noise: NoiseOut | None = Field(description="null = never quiet for long enough")


class LaneOut(_Out):
    """One lane."""

    lane: str
    boot_id: int
    provides: Literal["full", "attitude", "altitude"]
    parameters: dict[str, float | None] = Field(description="as they were set; null = the vehicle class's own")
    failure: str = Field(description="why the engine put it aside; empty when it did not")
    compared_at: Literal["lane stamps", "reference stamps"] | None
    cost: CostOut | None = Field(description="null for lanes that repeat what others computed")
    windows: dict[str, FiguresOut] = Field(description="by the window's name")


class WindowOut(_Out):
    """A stretch of time that the figures are for, seconds after `settings.t_origin_ns`; null = open."""

    from_s: float | None
    to_s: float | None


class CompareOut(_Out):
    """`compare.json`."""

    format: Literal["navdeck.compare/1"] = COMPARE_FORMAT
    navdeck_version: str
    log: LogOut
    settings: SettingsOut
    chosen: str = Field(description="the lane that `difference` is to")
    reference: str | None = Field(description="the lane that errors are against; null = the log has none")
    windows: dict[str, WindowOut]
    engine_ns_per_step: float | None = Field(description="preprocessing and bookkeeping, lanes not included")
    lanes: dict[str, LaneOut] = Field(description="by lane; a later power-up's is <lane>.boot1, …")
    notes: list[str]


class MotionLaneOut(_Out):
    """One lane over one motion, against the truth; null = the lane has none of it."""

    provides: Literal["full", "attitude", "altitude"]
    status_rows: dict[str, int]
    roll_rad: SpreadOut | None
    pitch_rad: SpreadOut | None
    heading_rad: SpreadOut | None = Field(description="null too where nothing ties the lane's heading to north")
    height_m: SpreadOut | None = Field(
        description="less its median before the motion began: every lane has its own zero"
    )
    vertical_m_s: SpreadOut | None
    delay: DelaysOut | None
    noise: NoiseOut | None
    cost: CostOut | None


class MotionOut(_Out):
    """One motion and what every lane made of it."""

    motion: str
    baro_disturbance_m: float = Field(description="largest height by which the barometer was misled; 0 = not at all")
    duration_s: float
    lanes: dict[str, MotionLaneOut]


class FiveMotionsOut(_Out):
    """`five_motions.json`: the attitude lanes over five motions, the altitude lanes with and without a disturbance."""

    format: Literal["navdeck.five-motions/1"] = FIVE_MOTIONS_FORMAT
    navdeck_version: str
    seed: int
    parameters: dict[str, dict[str, float]] = Field(
        description="lane → parameter → value that was set, else the default"
    )
    attitude: list[MotionOut]
    altitude: list[MotionOut]
    notes: list[str]

"""Bodies of REST and WebSocket about boards: what leaves and enters the process as JSON.

Keys equal the Python names of `server.nav.types` and end in their unit. Unknown is null, never NaN and never zero.
Binary rows (`server.rows`) carry the same columns. Frames: body FRD, local NED, angles in radians except latitude
and longitude. Ages are computed on the server, so no clock of the browser enters them. Link and protocol
are in `server.wire_link`, the service itself in `server.wire_service`, the WebSocket in `server.wire_stream`.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from server.wire_base import In, Num, Out, Severity
from server.wire_consistency import ConsistencyOut, ConsistencyVerdict
from server.wire_delays import DelayOut
from server.wire_lanes import LaneStatusName, Provides
from server.wire_link import LinkOut, ProtocolOut


class CountOut(Out):
    """A reason and how often."""

    reason: str
    count: int


class SensorOut(Out):
    """One sensor since power-up: imu, mag, baro, gnss or airspeed."""

    name: str
    age_s: Num = Field(description="since the newest sample arrived; null before the first")
    rate_hz: Num
    samples: int
    repeated: int
    refused: tuple[CountOut, ...]
    clipped: int = Field(description="samples that stood at the end of the sensor's range; they are used")
    scale: float = Field(description="factor applied to the reported values")
    note: str = Field(description='a code, "" when all is well')
    columns: tuple[str, ...] = Field(description="of the raw topic of this sensor")


class AidOut(Out):
    """One kind of measurement that corrects the main lane: counts and the last record."""

    aid: str
    fused: int
    refused: tuple[CountOut, ...]
    fused_age_s: Num = Field(description="since it was last fused; null when never")
    last_status: str = Field(description='"fused", "refused-gate", …; "" before the first')
    test_ratio: Num
    innovation: tuple[Num, ...] = Field(description="at most three components; NED m, m/s, gauss")
    innovation_sigma: tuple[Num, ...]
    nis_mean: Num = Field(description="innovation² over its variance, mean per component over a minute; 1 = consistent")
    nis_low: Num = Field(description="two-sided 95 % chi-square bound of the mean, autocorrelation taken into account")
    nis_high: Num
    nis_samples: int = Field(description="measurements in the window")
    verdict: ConsistencyVerdict


class LaneOut(Out):
    """One estimator and its state in short."""

    lane: str
    provides: Provides
    status: LaneStatusName
    failure: str = Field(description='why it was put aside; "" when it was not')
    t_ns: int
    age_s: Num
    sigma_heading_rad: Num
    sigma_tilt_rad: Num
    sigma_h_m: Num = Field(description="one horizontal standard deviation: root of the summed north and east variance")
    sigma_v_m: Num
    dead_reckoning_s: Num


class SiteOut(Out):
    """Origin of the local frame and its field."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    gravity_m_s2: float
    declination_rad: Num
    field_n_gauss: tuple[float, ...]
    decimal_year: Num
    date_source: str


class EventOut(Out):
    """Something a person should be able to read later."""

    seq: int = Field(description="counts the events of this board since it was added; never repeats")
    t_ns: int = Field(description="board time; -1 when there was none yet")
    age_s: float
    source: Literal["engine", "board", "link", "server"]
    code: str
    severity: Literal["info", "caution", "warning"]
    text: str
    values: dict[str, Num] = Field(description="the numbers of the sentence, named with their units")


class VerdictOut(Out):
    """One line of the health list: what is wrong, why, and what to do."""

    severity: Severity
    code: str = Field(description="stable kebab-case key; the page translates it")
    subject: str = Field(description='"link", "protocol", "imu", "mag", "baro", "gnss", "airspeed", "lane:<name>", …')
    cause: str
    remedy: str
    values: dict[str, Num] = Field(default_factory=dict)


class EngineOut(Out):
    """Work of the engine of one board."""

    steps: int
    latency_p50_s: Num = Field(description="from a byte's arrival to its rows published, over the last seconds")
    latency_p99_s: Num


class TopicOut(Out):
    """One topic of the WebSocket; columns null for JSON topics."""

    topic: str
    columns: tuple[str, ...] | None


class BoardOut(Out):
    """One flight board in short."""

    id: str
    name: str
    url: str
    state: Literal["running", "ended", "failed"] = Field(description="of the task that drives it; failed has a cause")
    cause: str = ""
    remedy: str = ""
    severity: Severity = Field(description="worst line of its verdict")
    headline: VerdictOut | None = Field(description="that line; null when all is well")
    link: LinkOut
    boot_id: int
    t_ns: int = Field(description="board time of the newest sample; -1 before the first")
    age_s: Num = Field(description="since the newest sample arrived; null before the first")
    main_lane: str
    lanes: tuple[LaneOut, ...]
    topics: tuple[TopicOut, ...] = Field(description="those that are fed now; a lane has its own once it is chosen")


class BoardsOut(Out):
    """Every board, in the order in which they were added."""

    boards: tuple[BoardOut, ...]


class BoardIn(In):
    """A link to open."""

    url: str = Field(
        min_length=1,
        max_length=1024,
        description="serial:///dev/ttyACM0?baud=921600, tcp://host:port, tcp-listen://:port, udp://:14550, sim:, auto",
    )
    system: int | None = Field(default=None, ge=1, le=255, description="MAVLink system to follow; null = the first")
    component: int | None = Field(default=None, ge=0, le=255, description="MAVLink component; null = its autopilot")


class FlagsOut(Out):
    """What of the state may be used."""

    attitude_valid: bool
    heading_valid: bool
    velocity_valid: bool
    position_valid: bool
    dead_reckoning: bool
    stale: bool = Field(description="no sample for a second or more")


class NavOut(Out):
    """State of one lane of one board; every unknown value is null."""

    board_id: str
    lane: str
    provides: Provides
    boot_id: int
    t_ns: int = Field(description="board time the state is valid at")
    age_s: Num = Field(description="since the newest sample arrived")
    status: LaneStatusName
    flags: FlagsOut
    q_nb: tuple[float, float, float, float] | None = Field(description="[w, x, y, z], body FRD to NED, w ≥ 0")
    roll_rad: Num
    pitch_rad: Num
    yaw_rad: Num = Field(description="clockwise from true north, 0 to 2π")
    vel_n_m_s: Num
    vel_e_m_s: Num
    vel_d_m_s: Num
    pos_n_m: Num
    pos_e_m: Num
    pos_d_m: Num
    lat_deg: Num
    lon_deg: Num
    alt_m: Num
    sigma_att_x_rad: Num = Field(description="error rotation vector in NED: z is heading")
    sigma_att_y_rad: Num
    sigma_att_z_rad: Num
    sigma_vel_n_m_s: Num
    sigma_vel_e_m_s: Num
    sigma_vel_d_m_s: Num
    sigma_pos_n_m: Num
    sigma_pos_e_m: Num
    sigma_pos_d_m: Num
    gyro_bias_x_rad_s: Num
    gyro_bias_y_rad_s: Num
    gyro_bias_z_rad_s: Num
    accel_bias_x_m_s2: Num
    accel_bias_y_m_s2: Num
    accel_bias_z_m_s2: Num
    dead_reckoning_s: Num
    aids: tuple[AidOut, ...]
    sensors: tuple[SensorOut, ...]
    delays: tuple[DelayOut, ...] = Field(description="of every measurement; empty before the first sample")
    site: SiteOut | None


class HealthOut(Out):
    """Everything needed to answer: is it alive, can I trust it, what do I do?"""

    board_id: str
    boot_id: int
    t_ns: int
    age_s: Num
    severity: Severity
    verdict: tuple[VerdictOut, ...] = Field(description="worst first; empty when all is well")
    link: LinkOut
    protocol: ProtocolOut
    engine: EngineOut
    sensors: tuple[SensorOut, ...]
    aids: tuple[AidOut, ...]
    lanes: tuple[LaneOut, ...]
    consistency: tuple[ConsistencyOut, ...] = Field(
        description='of the main lane: state groups that have a reference, then "lane"; empty while it does not run'
    )
    delays: tuple[DelayOut, ...] = Field(description="of every measurement; empty before the first sample")
    site: SiteOut | None
    filtered: dict[str, Num] = Field(description="newest row of the filtered topic, by STEP_COLUMNS; empty before it")
    events: tuple[EventOut, ...] = Field(description="newest last, at most 50")

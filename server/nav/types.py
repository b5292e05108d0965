"""The core's vocabulary: what enters the engine (blocks of samples) and what leaves it (rows, events, a snapshot).

Everything is columnar so that a block of samples costs one call, and every table names its columns, units and
frames once, here; CSV headers, WebSocket rows and plots all take their names from these tuples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from server.nav.calibration.applied import Calibration  # which is written in this module's words

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Byte = NDArray[np.uint8]


class Kind(IntEnum):
    """What one row of a `SampleBlock` holds."""

    IMU = 1
    MAG = 2
    BARO = 3
    GNSS = 4
    AIRSPEED = 5
    REFERENCE = 6
    ONBOARD = 7
    DMP = 8
    DATE = 9  # the board's calendar date, for the magnetic model
    PROFILE = 10  # what the protocol knows of this kind of board: delays and vehicle class


ROW_WIDTH: Final = 14
"""Number of float64 values in a sample row; columns past a kind's own are NaN."""

SAMPLE_COLUMNS: Final[dict[Kind, tuple[str, ...]]] = {
    Kind.IMU: (
        "gyro_x_rad_s",
        "gyro_y_rad_s",
        "gyro_z_rad_s",
        "accel_x_m_s2",
        "accel_y_m_s2",
        "accel_z_m_s2",
        "temperature_degc",
    ),
    Kind.MAG: ("mag_x_gauss", "mag_y_gauss", "mag_z_gauss"),
    Kind.BARO: ("pressure_pa", "altitude_m", "temperature_degc"),
    Kind.GNSS: (
        "lat_deg",
        "lon_deg",
        "alt_m",
        "vel_n_m_s",
        "vel_e_m_s",
        "vel_d_m_s",
        "h_acc_m",
        "v_acc_m",
        "s_acc_m_s",
        "fix_type",  # 0-1 none, 2 two-dimensional, 3 three-dimensional, 4 differential, 5 float, 6 fixed
        "satellites",
    ),
    Kind.AIRSPEED: ("diff_pressure_pa", "tas_m_s", "temperature_degc"),
    Kind.REFERENCE: (
        "q_w",
        "q_x",
        "q_y",
        "q_z",
        "lat_deg",
        "lon_deg",
        "alt_m",
        "vel_n_m_s",
        "vel_e_m_s",
        "vel_d_m_s",
    ),
    Kind.ONBOARD: (
        "q_w",
        "q_x",
        "q_y",
        "q_z",
        "lat_deg",
        "lon_deg",
        "alt_m",
        "vel_n_m_s",
        "vel_e_m_s",
        "vel_d_m_s",
    ),
    Kind.DMP: ("q_w", "q_x", "q_y", "q_z"),
    Kind.DATE: ("decimal_year",),
    Kind.PROFILE: ("imu_delay_s", "mag_delay_s", "gnss_delay_s", "baro_delay_s", "vehicle_class"),
}


class VehicleClass(IntEnum):
    """Sets of default parameters; the value is what `Kind.PROFILE` rows carry."""

    UNKNOWN = 0
    MULTIROTOR = 1
    FIXED_WING = 2
    CAR = 3
    HAND_HELD = 4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampleBlock:
    """Samples in order of arrival, one row each, of one power-up of one board.

    Unknown values are NaN. Arrays are C-contiguous, of equal length n, and never written after construction.

    Attributes:
        kind: shape (n,), uint8, values of `Kind`.
        t_ns: shape (n,), the board's own stamp of the sample, ns since power-up.
        t_rx_ns: shape (n,), host monotonic time at arrival (replay: the log's stamp), ns; never enters an estimate.
        data: shape (n, ROW_WIDTH), columns as in `SAMPLE_COLUMNS[kind]`, frames body FRD and NED, SI, gauss, degrees
            for latitude and longitude. Magnetic field as the board reports it: its scale is found downstream.
        boot_id: counts the power-ups seen on this link, from 0; a new one starts the engine afresh.
    """

    kind: Byte
    t_ns: Int
    t_rx_ns: Int
    data: Float
    boot_id: int = 0


class LaneStatus(IntEnum):
    """State of one estimator, in the order in which it improves; FAILED last."""

    ALIGNING = 0
    ATTITUDE = 1
    NAVIGATING = 2
    DEAD_RECKONING = 3
    FAILED = 4


LANE_COLUMNS: Final = (
    "q_w",
    "q_x",
    "q_y",
    "q_z",
    "vel_n_m_s",
    "vel_e_m_s",
    "vel_d_m_s",
    "lat_deg",
    "lon_deg",
    "alt_m",
    "sigma_att_x_rad",
    "sigma_att_y_rad",
    "sigma_att_z_rad",
    "sigma_vel_n_m_s",
    "sigma_vel_e_m_s",
    "sigma_vel_d_m_s",
    "sigma_pos_n_m",
    "sigma_pos_e_m",
    "sigma_pos_d_m",
    "gyro_bias_x_rad_s",
    "gyro_bias_y_rad_s",
    "gyro_bias_z_rad_s",
    "accel_bias_x_m_s2",
    "accel_bias_y_m_s2",
    "accel_bias_z_m_s2",
    "status",
    "pos_n_m",  # from here on: for the page and the API, not part of the replay CSV
    "pos_e_m",
    "pos_d_m",
    "dead_reckoning_s",
)
CSV_LANE_COLUMNS: Final = 26
"""The leading part of `LANE_COLUMNS` that the replay contract writes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaneRows:
    """States of one lane, one row per navigation step (pass-through lanes: per sample).

    Attributes:
        lane: the lane's name, as in settings.
        t_ns: shape (m,), board time the row is valid at.
        data: shape (m, len(LANE_COLUMNS)); unknown = NaN. Position NED is from the site.
    """

    lane: str
    t_ns: Int
    data: Float


class Aid(IntEnum):
    """A kind of measurement that corrects the main lane."""

    GNSS_POSITION = 0
    GNSS_VELOCITY = 1
    BARO_HEIGHT = 2
    MAG_FIELD = 3
    ZERO_VELOCITY = 4
    ZERO_RATE = 5
    AIRSPEED = 6
    SIDESLIP = 7
    GRAVITY = 8
    GNSS_COURSE = 9
    WHEELS = 10  # a car neither slides sideways nor jumps
    YAW = 11  # heading from accelerations against GNSS velocities
    DRAG = 12  # a multirotor's drag brakes it against the air


class AidStatus(IntEnum):
    """What became of one measurement; everything but FUSED is a refusal with its reason."""

    FUSED = 0
    REFUSED_GATE = 1  # innovation larger than its own covariance allows
    REFUSED_REPEATED = 2  # the same sample again
    REFUSED_STALE = 3  # older than the filter's history
    REFUSED_NO_FIX = 4  # the receiver itself says it has none
    REFUSED_RANGE = 5  # NaN, infinite or physically impossible
    REFUSED_DISABLED = 6  # switched off in the settings
    REFUSED_WITHHELD = 7  # held back on purpose (what-if outage)
    REFUSED_NOT_READY = 8  # the filter was not aligned yet
    REFUSED_DISTURBED = 9  # field strength or inclination wrong
    REFUSED_MOVING = 10  # only valid at rest
    REFUSED_ORDER = 11  # stamped before one that was already taken


AID_COLUMNS: Final = (
    "aid",
    "status",
    "observation_0",
    "observation_1",
    "observation_2",
    "predicted_0",
    "predicted_1",
    "predicted_2",
    "innovation_0",
    "innovation_1",
    "innovation_2",
    "innovation_var_0",
    "innovation_var_1",
    "innovation_var_2",
    "test_ratio",  # worst component: innovation² / (gate² · innovation variance); refused above 1
    "t_valid_ns",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AidRows:
    """One row per measurement, refused ones included.

    Attributes:
        t_ns: shape (k,), board time of the navigation step at which it was handled.
        data: shape (k, len(AID_COLUMNS)). Frames: GNSS NED (m, m/s), baro m up, magnetic field NED gauss.
    """

    t_ns: Int
    data: Float


STEP_COLUMNS: Final = (
    "gyro_x_rad_s",
    "gyro_y_rad_s",
    "gyro_z_rad_s",
    "accel_x_m_s2",
    "accel_y_m_s2",
    "accel_z_m_s2",
    "mag_x_gauss",
    "mag_y_gauss",
    "mag_z_gauss",
    "baro_alt_m",
    "airspeed_m_s",
    "vibration_m_s2",
    "temperature_degc",
    "imu_samples",
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FilteredRows:
    """The preprocessed sensors, one row per navigation step (`STEP_COLUMNS`, body FRD; unknown = NaN)."""

    t_ns: Int
    data: Float


def _stages(unit: str, axes: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{stage}{axis}_{unit}" for stage in ("calibrated", "limited", "filtered") for axis in axes)


STAGE_COLUMNS: Final[dict[str, tuple[str, ...]]] = {
    "gyro": _stages("rad_s", ("_x", "_y", "_z")),
    "accel": _stages("m_s2", ("_x", "_y", "_z")),
    "mag": _stages("gauss", ("_x", "_y", "_z")),
    "baro": _stages("m", ("",)),
    "airspeed": (*_stages("pa", ("",)), "airspeed_m_s"),  # pressures NaN where the board sends only a speed
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StageRows:
    """One sensor on its way through the preprocessing, one row per believed sample; only while its chain is on.

    Attributes:
        sensor: key of `STAGE_COLUMNS`.
        t_ns: shape (n,), the samples' own stamps: what is filtered was valid earlier by the chain's delay.
        data: shape (n, len(STAGE_COLUMNS[sensor])), body FRD.
    """

    sensor: str
    t_ns: Int
    data: Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something a person should be able to read later: an alignment, a reset with its size, a scale found.

    Attributes:
        t_ns: board time.
        code: stable key, kebab-case; the page translates it.
        severity: "info", "caution" or "warning".
        text: English sentence: what happened, why, what to do.
        values: numbers of the sentence, named with their units.
    """

    t_ns: int
    code: str
    severity: str
    text: str
    values: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StepResult:
    """Everything one call of the engine produced, oldest first in each table."""

    boot_id: int
    block: SampleBlock
    lanes: tuple[LaneRows, ...]
    aids: AidRows
    filtered: FilteredRows
    events: tuple[Event, ...]
    stages: tuple[StageRows, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorHealth:
    """Counts of one sensor since power-up.

    Attributes:
        name: "imu", "mag", "baro", "gnss", "airspeed".
        t_last_ns: stamp of the last accepted sample; -1 before the first.
        rate_hz: mean rate of fresh samples over the last seconds; NaN before the second sample.
        samples, repeated: fresh samples, and repeats of an old one (ignored).
        refused: (reason, count) of samples that were not believed.
        scale: factor applied to the reported values (1 unless found otherwise).
        note: a code the page translates, "" when all is well (e.g. "mag-scale-corrected").
        clipped: samples that stood at the end of the sensor's range; they are used.
    """

    name: str
    t_last_ns: int
    rate_hz: float
    samples: int
    repeated: int
    refused: tuple[tuple[str, int], ...]
    scale: float = 1.0
    note: str = ""
    clipped: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class AidHealth:
    """Counts and last record of one aid."""

    aid: Aid
    fused: int
    refused: tuple[tuple[AidStatus, int], ...]
    t_fused_ns: int
    last: tuple[float, ...]  # one row of AID_COLUMNS, () before the first
    nis_mean: float = float("nan")  # windowed mean of innovation² / innovation variance per component; consistent: 1
    nis_low: float = float("nan")  # its two-sided 95 % chi-square bound, autocorrelation taken into account
    nis_high: float = float("nan")
    nis_samples: int = 0  # measurements in the window
    verdict: str = "too-few"  # "over-confident", "conservative", "consistent", "too-few"


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsistencyHealth:
    """Whether errors of a lane are as large as its own σ says, over the last minute (`nav.consistency`).

    Attributes:
        lane: the lane judged.
        group: "attitude", "velocity", "position" against the reference; "lane" is the verdict over everything.
        mean: squared error over published variance, mean per component; 1 for a consistent lane.
        low, high: its two-sided 95 % chi-square bound, autocorrelation taken into account.
        samples: epochs in the window.
        effective: independent squared components that they are worth.
        verdict: "over-confident", "conservative", "consistent" or "too-few".
        reason: what decided, "" when nothing speaks against the lane.
    """

    lane: str
    group: str
    mean: float = float("nan")
    low: float = float("nan")
    high: float = float("nan")
    samples: int = 0
    effective: float = 0.0
    verdict: str = "too-few"
    reason: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """Origin of the local frame and its magnetic field.

    Attributes:
        field_n_gauss: NED field of the magnetic model, or () when unknown.
        decimal_year: date used for the model; NaN when none was used.
        date_source: "settings", "board", "model-epoch" or "none".
    """

    lat_deg: float
    lon_deg: float
    alt_m: float
    gravity_m_s2: float
    declination_rad: float
    field_n_gauss: tuple[float, ...]
    decimal_year: float
    date_source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DelayState:
    """A delay found on line from the innovations: a sample stamped t is valid at t − delay.

    Attributes:
        name: "gnss_position", "gnss_velocity" or "mag".
    """

    name: str
    delay_s: float
    sigma_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ToldDelay:
    """A delay that somebody told: a sample stamped t is valid at t − delay.

    Attributes:
        name: "imu", "mag", "gnss" or "baro".
        source: "settings", "board" (what the protocol knows of this kind of board) or "filter" (our own chain's).
    """

    name: str
    delay_s: float
    source: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaneState:
    """Newest state of one lane: `row` has shape (len(LANE_COLUMNS),), valid at `t_ns`; `failure` says why it ended."""

    lane: str
    provides: str  # "full", "attitude", "altitude"
    t_ns: int
    row: Float
    failure: str = ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """The newest state of everything, for people and the API; built on demand, never per sample."""

    boot_id: int
    t_ns: int
    lanes: tuple[LaneState, ...]
    sensors: tuple[SensorHealth, ...]
    aids: tuple[AidHealth, ...]
    site: Site | None
    filtered: tuple[float, ...]  # newest STEP_COLUMNS row, () before the first step
    events: tuple[Event, ...]  # newest last, bounded
    steps: int
    vehicle: VehicleClass = VehicleClass.UNKNOWN
    delays: tuple[DelayState, ...] = ()  # found on line; () when all were told
    told_delays: tuple[ToldDelay, ...] = ()  # those that nobody told are missing
    mag_bias: tuple[float, ...] = ()  # the main lane's magnetic bias (3) and its σ (3), gauss; () when it has none
    consistency: tuple[ConsistencyHealth, ...] = ()  # the main lane's: groups with a reference, then "lane"
    filter_delays: tuple[
        ToldDelay, ...
    ] = ()  # what the chain's filters add, by sensor: "imu", "mag", "baro", "airspeed"


class FieldModel(Protocol):
    """The magnetic model, computed by the shell (WMM) and called once per site."""

    def __call__(self, lat_deg: float, lon_deg: float, alt_m: float, decimal_year: float) -> tuple[Float, float]:
        """Return the NED field in gauss, shape (3,), and the decimal year used (the epoch when given NaN)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineSettings:
    """What the engine may be told; the defaults are the one default parameter set.

    Attributes:
        nav_rate_hz: navigation steps a second, up to the IMU's own rate.
        lanes: names of the estimators to run.
        lane_parameters: lane → parameter → value, for what differs from the lane's defaults (`lanes.registry`).
        vehicle: class of vehicle; UNKNOWN takes the board's own word, else general defaults.
        site_*: fix the local origin; NaN = the first 3-D fix.
        decimal_year: date of the magnetic model; NaN = the board's date, else the model's epoch.
        *_delay_s: a sample stamped t is valid at t − delay; NaN = the protocol's profile, else 0.
        lever_arm_b_m: from the IMU to the GNSS antenna, body FRD.
        gyro_noise_rad_s_rthz … accel_bias_walk_m_s3_rthz: noise densities; NaN = the class default.
        use_*: aids on or off.
        gnss_withheld_s: intervals [a, b) in seconds after `t_origin_ns` whose GNSS (by time of validity) is withheld.
        t_origin_ns: origin of those intervals; -1 = the first sample the engine sees.
        calibration: in force from the first sample on; None = none.
        chain: sensor → parameter → value, for what differs from the chain's defaults (`preprocess.chain_parameters`).
    """

    nav_rate_hz: float = 50.0
    lanes: tuple[str, ...] = ("ins_ekf", "onboard", "reference")
    lane_parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    vehicle: VehicleClass = VehicleClass.UNKNOWN
    site_lat_deg: float = float("nan")
    site_lon_deg: float = float("nan")
    site_alt_m: float = float("nan")
    decimal_year: float = float("nan")
    imu_delay_s: float = float("nan")
    mag_delay_s: float = float("nan")
    gnss_delay_s: float = float("nan")
    baro_delay_s: float = float("nan")
    lever_arm_b_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_noise_rad_s_rthz: float = float("nan")
    accel_noise_m_s2_rthz: float = float("nan")
    gyro_bias_walk_rad_s2_rthz: float = float("nan")
    accel_bias_walk_m_s3_rthz: float = float("nan")
    use_gnss: bool = True
    use_baro: bool = True
    use_mag: bool = True
    use_airspeed: bool = True
    gnss_withheld_s: tuple[tuple[float, float], ...] = field(default=())
    t_origin_ns: int = -1
    calibration: Calibration | None = None
    chain: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

"""What every calibration has in common: its kinds, what it is told, how far it is, and what it found.

A collector takes samples in order, live or from a file, and fits when asked: both ways give the same numbers because
nothing in it looks at a clock or at where the samples are cut.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Literal, Protocol

import numpy as np

from server.nav.constants import STANDARD_GRAVITY_M_S2
from server.nav.types import Float, Int, Kind

NAN: Final = float("nan")
GRAVITY_M_S2: Final = STANDARD_GRAVITY_M_S2


class CalKind(StrEnum):
    """What can be calibrated, and how."""

    GYRO_BIAS = "gyro_bias"
    GYRO_SCALE = "gyro_scale"
    ACCEL_SIX_POSITION = "accel_six_position"
    ACCEL_MULTI_POSE = "accel_multi_pose"
    LEVEL = "level"
    MAG_ELLIPSOID = "mag_ellipsoid"
    MAG_FIXED_HEADING = "mag_fixed_heading"
    MAG_IN_FLIGHT = "mag_in_flight"
    AIRSPEED_ZERO = "airspeed_zero"
    BARO_REFERENCE = "baro_reference"


class Sensor(StrEnum):
    """What a calibration belongs to; one job at a time on each."""

    GYRO = "gyro"
    ACCEL = "accel"
    MAG = "mag"
    BOARD = "board"  # how the board sits in the vehicle
    AIRSPEED = "airspeed"
    BARO = "baro"


SENSOR_OF: Final[Mapping[CalKind, Sensor]] = {
    CalKind.GYRO_BIAS: Sensor.GYRO,
    CalKind.GYRO_SCALE: Sensor.GYRO,
    CalKind.ACCEL_SIX_POSITION: Sensor.ACCEL,
    CalKind.ACCEL_MULTI_POSE: Sensor.ACCEL,
    CalKind.LEVEL: Sensor.BOARD,
    CalKind.MAG_ELLIPSOID: Sensor.MAG,
    CalKind.MAG_FIXED_HEADING: Sensor.MAG,
    CalKind.MAG_IN_FLIGHT: Sensor.MAG,
    CalKind.AIRSPEED_ZERO: Sensor.AIRSPEED,
    CalKind.BARO_REFERENCE: Sensor.BARO,
}

FACES: Final = ("nose-up", "nose-down", "right-up", "left-up", "upside-down", "level")
"""The six positions in the order of S0 (3.5): specific force +g, −g on x, on y, on z of body FRD."""

Grade = Literal["good", "fair", "poor"]
Value = Float | float
"""A parameter: a number, a vector of shape (3,) or a matrix of shape (3, 3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What a person may tell a calibration; NaN and "" = found out, or the kind's own default.

    Attributes:
        unit: "si" = rad/s, m/s², gauss, Pa; "raw" = the sensor's own counts, whatever they are.
        strength: magnitude of the Earth's field in the unit of the result; NaN = the fit's radius becomes 1.
        gravity_m_s2: magnitude of local gravity.
        axis: "x", "y", "z": the axis of the turntable; "" = the one that turned most.
        turns: whole turns made; NaN = the whole number nearest to the integral.
        ellipsoid_parameters: 6 (axis-aligned) or 9 (tilted).
        duration_s: how long to collect; NaN = the kind's own.
        heading_rad, heading_sigma_rad: true heading of the vehicle now and how well it is known (fixed heading).
        field_n_gauss: Earth's field NED by the model, shape (3,) (fixed heading; live: also the expected strength).
        height_m: what the barometer shall read here.
        rate_hz: sample rate of data without time stamps (a file's business; collectors get stamps in any case).
    """

    unit: Literal["si", "raw"] = "si"
    strength: float = NAN
    gravity_m_s2: float = GRAVITY_M_S2
    axis: Literal["x", "y", "z", ""] = ""
    turns: float = NAN
    ellipsoid_parameters: int = 9
    duration_s: float = NAN
    heading_rad: float = NAN
    heading_sigma_rad: float = float(np.radians(2.0))
    field_n_gauss: tuple[float, ...] = ()
    height_m: float = NAN
    rate_hz: float = NAN


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Why nothing was fitted.

    Attributes:
        code: one of `codes.FAILURES`, kebab-case.
        measured: the number that was too bad; NaN when it is not about one.
        limit: what it had to reach, or stay below.
        unit: of both, "" for a pure number.
        advice: an English sentence: what happened and what to do; the page translates by code.
    """

    code: str
    measured: float
    limit: float
    unit: str
    advice: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Residual:
    """RMS of what the model leaves unexplained; `unit` as in "m/s²"."""

    value: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """What a calibration found, or why it refused.

    Attributes:
        parameters: by name, as far as the kind has them: calibrated = matrix · (raw − offset) for accelerometer and
            magnetometer (offset (3,), matrix (3, 3)); = scale * (raw − bias) for the gyro (each (3,)); raw − bias for
            airspeed and baro (numbers). {} when refused.
        sigma: one standard deviation of each, same names and shapes; NaN where it was not measured.
        residual_before, residual_after: with the present and with the new parameters; None when refused early.
        coverage: share of what the kind needs that the data held, 0 to 1; NaN where the notion is empty.
        grade: by the limits in `grades`; "" when refused.
        temperature_degc: mean while collecting; NaN unknown.
        details: further numbers, unit in the name, for people.
    """

    kind: CalKind
    failure: Failure | None = None
    parameters: Mapping[str, Value] = field(default_factory=dict)
    sigma: Mapping[str, Value] = field(default_factory=dict)
    residual_before: Residual | None = None
    residual_after: Residual | None = None
    coverage: float = NAN
    grade: Grade | Literal[""] = ""
    samples: int = 0
    temperature_degc: float = NAN
    details: Mapping[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """True when something was fitted."""
        return self.failure is None


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """Verification on fresh data: `residual` RMS under the given parameters, accepted up to `limit`."""

    ok: bool
    residual: Residual
    limit: float
    samples: int
    failure: Failure | None = None  # why it could not be judged: too few samples, motion


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Progress:
    """How far a collector is and what to do next; built on demand, a few times a second.

    Attributes:
        fraction: share of the work done, 0 to 1. What was discarded counts no more (the job shows its maximum).
        phase: "waiting", "hold-still", "moving", "turn", "next-face", "next-pose", "rotate", "enough".
        instruction: code of the next move, which the page translates: "hold-still", "put-face", "put-any-pose",
            "turn-table", "rotate-all-ways", "cover-pitot", "wait", "done".
        faces: shape (6,) of `FACES` done, () for kinds without.
        face_now: the face that points up or down now as in `FACES`, "" when none or moving.
        face_next: the one to take next, "".
        pose_target_b: direction that shall point down in body FRD for the next move, shape (3,); () when none.
        poses: static poses collected.
        restarts: how often motion or a gap threw the collected away.
        samples: accepted so far.
        is_enough: a fit may be asked for; is_complete: nothing is gained by going on, the job fits by itself.
        values: live numbers for people, unit in the name: "still_s", "residual_m_s2", "turned_rad", "coverage", …
        points: shape (k, 3), k ≤ 1500, measured values for the 3D view, in the unit of the data; empty without.
        uncovered_b: shape (m, 3), unit directions of the sphere that still miss samples.
        offset, matrix: the fit so far for drawing; () when there is none.
    """

    fraction: float
    phase: str
    instruction: str
    faces: tuple[bool, ...] = ()
    face_now: str = ""
    face_next: str = ""
    pose_target_b: tuple[float, ...] = ()
    poses: int = 0
    restarts: int = 0
    samples: int = 0
    is_enough: bool = False
    is_complete: bool = False
    values: Mapping[str, float] = field(default_factory=dict)
    points: Float = field(default_factory=lambda: np.empty((0, 3)))
    uncovered_b: Float = field(default_factory=lambda: np.empty((0, 3)))
    offset: tuple[float, ...] = ()
    matrix: tuple[tuple[float, ...], ...] = ()


class Collector(Protocol):
    """Collects for one calibration. Not shared between threads; a collector that has fitted may go on collecting."""

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples in order of arrival.

        Args:
            kind: what they are; kinds that a collector does not need are ignored.
            t_ns: shape (n,), the board's stamps; a jump backwards is a reboot, a hole a lost link: what needs
                continuity starts again, what is finished (a pose, a covered direction) stays.
            rows: shape (n, ROW_WIDTH), columns `SAMPLE_COLUMNS[kind]`, as `applied.conditioned` gives them: for most
                kinds not yet calibrated (the magnetometer in gauss). Non-finite samples are ignored.
        """
        ...

    def progress(self) -> Progress:
        """Return how far it is."""
        ...

    def fit(self) -> Fit:
        """Fit what was collected, or refuse; never raises on data. May take a second: call it in a thread."""
        ...

    def check(self, parameters: Mapping[str, Value]) -> Check:
        """Judge given parameters on what was collected, which is fresh data: the verification step."""
        ...

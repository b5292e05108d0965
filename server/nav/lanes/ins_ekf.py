"""The main lane: error-state Kalman filter over attitude, velocity, position and the inertial sensors' biases."""

from __future__ import annotations

import math
from typing import ClassVar, Final

import numpy as np

from server.nav.ekf import defaults
from server.nav.ekf import layout as at
from server.nav.ekf.align import turn_about_down
from server.nav.ekf.blocks import fuse_field_model, start_field, turn_field
from server.nav.ekf.run import run
from server.nav.ekf.states import FIELD, INERTIAL, PACKED, POS, X_POS, X_Q, X_SIZE, packed
from server.nav.lanes.base import LaneContext, LaneResult, Parameter, Provides
from server.nav.types import (
    AID_COLUMNS,
    LANE_COLUMNS,
    AidRows,
    Event,
    Float,
    Int,
    LaneRows,
    LaneStatus,
    Site,
)

EVENT_TEXTS: Final[dict[int, tuple[str, str, str, tuple[str, str]]]] = {
    at.E_ALIGNED: (
        "aligned",
        "info",
        "Aligned; heading σ {0:.3g} rad, tilt σ {1:.3g} rad.",
        ("sigma_heading_rad", "sigma_tilt_rad"),
    ),
    at.E_GNSS_RESET: (
        "gnss-reset",
        "caution",
        "GNSS contradicted the filter for ten seconds; position moved by {0:.1f} m, height by {1:.1f} m.",
        ("horizontal_m", "down_m"),
    ),
    at.E_GNSS_LOST: (
        "gnss-lost",
        "caution",
        "No GNSS fix for {0:.1f} s: dead reckoning. Check the antenna's view of the sky.",
        ("age_s", ""),
    ),
    at.E_GNSS_BACK: (
        "gnss-back",
        "info",
        "GNSS is back after {0:.1f} s; the position was {1:.2f} m away.",
        ("outage_s", "horizontal_m"),
    ),
    at.E_YAW_RESET: ("yaw-reset", "info", "Heading turned by {0:.3f} rad: declination is known now.", ("yaw_rad", "")),
    at.E_HEADING: (
        "heading-found",
        "info",
        "Heading found from the magnetometer, turned by {0:.2f} rad.",
        ("yaw_rad", ""),
    ),
    at.E_COURSE: ("heading-from-course", "info", "Heading taken from the GNSS course: {0:+.2f} rad.", ("yaw_rad", "")),
    at.E_FAILED: ("filter-failed", "warning", "The filter lost its numbers and starts again; report this.", ("", "")),
    at.E_GAP: (
        "imu-gap",
        "warning",
        "No IMU data for {0:.2f} s: aligning again. Check the link and the board's load.",
        ("gap_s", ""),
    ),
}


PARAMETERS: Final = (
    Parameter(
        name="gyro_noise_rad_s_rthz", unit="rad/s/√Hz", default=math.nan, minimum=1e-7, maximum=0.1,
        meaning="Gyro noise density in the vehicle; larger trusts the aids more and the gyro less.",
    ),
    Parameter(
        name="accel_noise_m_s2_rthz", unit="m/s²/√Hz", default=math.nan, minimum=1e-6, maximum=10.0,
        meaning="Accelerometer noise density in the vehicle; measured vibration comes on top.",
    ),
    Parameter(
        name="gyro_bias_walk_rad_s2_rthz", unit="rad/s²/√Hz", default=math.nan, minimum=1e-9, maximum=0.01,
        meaning="How fast the gyro bias may wander, with temperature above all.",
    ),
    Parameter(
        name="accel_bias_walk_m_s3_rthz", unit="m/s³/√Hz", default=math.nan, minimum=1e-8, maximum=1.0,
        meaning="How fast the accelerometer bias may wander.",
    ),
    Parameter(
        name="accel_bias_sigma_m_s2", unit="m/s²", default=defaults.ACCEL_BIAS_SIGMA_M_S2, minimum=1e-4, maximum=5.0,
        meaning="Standard deviation of the accelerometer bias at the start; small after a calibration.",
    ),
    Parameter(
        name="mag_noise_gauss", unit="gauss", default=math.nan, minimum=1e-4, maximum=1.0,
        meaning="Magnetometer noise and unmodelled disturbance; larger trusts its heading less.",
    ),
    Parameter(
        name="mag_bias_sigma_gauss", unit="gauss", default=defaults.MAG_BIAS_SIGMA_GAUSS, minimum=0.0, maximum=1.0,
        meaning="Magnetic field fixed to the body that a calibration leaves; zero trusts the calibration wholly.",
    ),
    Parameter(
        name="baro_noise_m", unit="m", default=math.nan, minimum=0.01, maximum=50.0,
        meaning="Noise of a baro height; larger trusts it less.",
    ),
    Parameter(
        name="gravity_noise_m_s2", unit="m/s²", default=math.nan, minimum=0.01, maximum=20.0,
        meaning="Accelerations that hide gravity while there is no GNSS; larger trusts the accelerometer's tilt less.",
    ),
    Parameter(
        name="declination_sigma_rad", unit="rad", default=math.nan, minimum=0.0, maximum=1.0,
        meaning="Error of the magnetic model's declination; zero keeps the model's value.",
    ),
    Parameter(
        name="gate_sigma", unit="", default=defaults.GATE_SIGMA, minimum=2.0, maximum=100.0,
        meaning="A measurement further from its prediction than this many standard deviations is refused.",
    ),
    Parameter(
        name="gnss_wander_m", unit="m", default=math.nan, minimum=0.0, maximum=100.0,
        meaning="Slow error of the receiver's position per horizontal axis; not a number takes it from the accuracy "
        "that the receiver reports, and none for a carrier-phase solution.",
    ),
    Parameter(
        name="gnss_wander_tau_s", unit="s", default=defaults.GNSS_WANDER_S, minimum=1.0, maximum=3600.0,
        meaning="How long the receiver's slow error lasts.",
    ),
    Parameter(
        name="gnss_jitter_m", unit="m", default=math.nan, minimum=0.0, maximum=100.0,
        meaning="Quick error of the receiver's position per horizontal axis; not a number learns it from the fixes.",
    ),
    Parameter(
        name="gnss_jitter_tau_s", unit="s", default=0.0, minimum=0.0, maximum=60.0,
        meaning="How long a quick error that is given lasts; zero means that every fix has its own.",
    ),
    Parameter(
        name="gnss_speed_m_s", unit="m/s", default=math.nan, minimum=0.0, maximum=10.0,
        meaning="Error of the receiver's velocity per axis; not a number learns it from the fixes.",
    ),
    Parameter(
        name="gnss_speed_tau_s", unit="s", default=0.0, minimum=0.0, maximum=60.0,
        meaning="How long a velocity error that is given lasts; zero means that every fix has its own.",
    ),
    Parameter(
        name="baro_drift_m_rts", unit="m/√s", default=defaults.BARO_DRIFT_M_RTS, minimum=0.0, maximum=10.0,
        meaning="How fast the height that the baro counts from wanders, with weather and draught.",
    ),
    Parameter(
        name="field_sigma", unit="", default=defaults.FIELD_SIGMA, minimum=0.0, maximum=1.0,
        meaning="Error of the magnetic model's strength and dip, and of the sensor's scale, as a share of the field.",
    ),
    Parameter(
        name="field_walk_gauss_rts", unit="gauss/√s", default=defaults.FIELD_WALK_GAUSS_RTS, minimum=0.0, maximum=0.1,
        meaning="How fast the Earth field changes along the way.",
    ),
    Parameter(
        name="mag_bias_walk_gauss_rts", unit="gauss/√s", default=defaults.MAG_BIAS_WALK_GAUSS_RTS, minimum=0.0,
        maximum=0.1, meaning="How fast the magnetic field fixed to the body changes, with currents and temperature.",
    ),
    Parameter(
        name="zero_rate_rad_s", unit="rad/s", default=defaults.ZERO_RATE_RAD_S, minimum=1e-5, maximum=0.1,
        meaning="Rotation that a board at rest still has, noise included.",
    ),
    Parameter(
        name="zero_velocity_m_s", unit="m/s", default=defaults.ZERO_VELOCITY_M_S, minimum=1e-4, maximum=1.0,
        meaning="Velocity that a vehicle at rest still has.",
    ),
    Parameter(
        name="gyro_scale", unit="", default=0.0, minimum=0.0, maximum=0.1,
        meaning="Scale error of the gyro, as a share of the rate; zero leaves it to the noise of the vehicle's class.",
    ),
    Parameter(
        name="gyro_cross", unit="", default=0.0, minimum=0.0, maximum=0.1,
        meaning="Rotation felt across an axis of the gyro, as a share of the rate; zero leaves it to the noise.",
    ),
    Parameter(
        name="vibration_hz", unit="Hz", default=defaults.VIBRATION_BANDWIDTH_HZ, minimum=10.0, maximum=1e6,
        meaning="Measured vibration counts as noise spread over this bandwidth; larger where it is a hum that averages "
        "out.",
    ),
)  # fmt: skip


AS_GIVEN: Final = {
    at.PAR_GNSS_WANDER: "gnss_wander_m",
    at.PAR_GNSS_WANDER_TAU: "gnss_wander_tau_s",
    at.PAR_GNSS_JITTER: "gnss_jitter_m",
    at.PAR_GNSS_JITTER_TAU: "gnss_jitter_tau_s",
    at.PAR_GNSS_SPEED: "gnss_speed_m_s",
    at.PAR_GNSS_SPEED_TAU: "gnss_speed_tau_s",
    at.PAR_ZERO_RATE: "zero_rate_rad_s",
    at.PAR_ZERO_VELOCITY: "zero_velocity_m_s",
    at.PAR_GYRO_SCALE: "gyro_scale",
    at.PAR_GYRO_CROSS: "gyro_cross",
    at.PAR_VIBRATION_BANDWIDTH: "vibration_hz",
}


def kernel_parameters(context: LaneContext) -> Float:
    """Return the kernel's parameter array: the lane's values, else the settings', else the vehicle class's."""
    noise, settings, values = defaults.of_vehicle(context.vehicle), context.settings, context.values

    def given(name: str) -> float:
        candidates = (values[name], getattr(settings, name, math.nan), getattr(noise, name, math.nan))
        return float(next(value for value in candidates if not math.isnan(value)))

    par = np.zeros(at.PAR_SIZE)
    par[at.PAR_GYRO_NOISE] = given("gyro_noise_rad_s_rthz")
    par[at.PAR_ACCEL_NOISE] = given("accel_noise_m_s2_rthz")
    par[at.PAR_GYRO_WALK] = given("gyro_bias_walk_rad_s2_rthz")
    par[at.PAR_ACCEL_WALK] = given("accel_bias_walk_m_s3_rthz")
    par[at.PAR_GATE] = given("gate_sigma")
    par[at.PAR_MAG_NOISE] = given("mag_noise_gauss")
    par[at.PAR_DECLINATION_SIGMA] = given("declination_sigma_rad")
    par[at.PAR_FIELD_WALK] = given("field_walk_gauss_rts")
    par[at.PAR_FIELD_SIGMA] = given("field_sigma")
    par[at.PAR_MAG_BIAS_SIGMA] = given("mag_bias_sigma_gauss")
    par[at.PAR_MAG_BIAS_WALK] = given("mag_bias_walk_gauss_rts")
    par[at.PAR_WIND_SIGMA] = defaults.WIND_SIGMA_M_S
    par[at.PAR_WIND_WALK] = defaults.WIND_WALK_M_S_RTS
    par[at.PAR_BARO_NOISE] = given("baro_noise_m")
    par[at.PAR_GNSS_CORRELATION] = defaults.GNSS_CORRELATION
    par[at.PAR_LEVER : at.PAR_LEVER + 3] = settings.lever_arm_b_m
    delays = [0.0 if math.isnan(delay) else delay for delay in context.delays_s]
    par[at.PAR_IMU_DELAY], par[at.PAR_MAG_DELAY], par[at.PAR_GNSS_DELAY], par[at.PAR_BARO_DELAY] = delays
    par[at.PAR_ACCEL_BIAS_SIGMA] = given("accel_bias_sigma_m_s2")
    par[at.PAR_BARO_DRIFT] = given("baro_drift_m_rts")
    for index, name in AS_GIVEN.items():
        par[index] = values[name]  # NaN: found out by the filter
    par[at.PAR_VEHICLE] = context.vehicle
    par[at.PAR_GRAVITY_NOISE] = given("gravity_noise_m_s2")
    return par


class InsEkf:
    """Owns the filter's arrays and nothing else; `ekf.run.run` computes."""

    name: ClassVar[str] = "ins_ekf"
    provides: ClassVar[Provides] = "full"
    parameters: ClassVar[tuple[Parameter, ...]] = PARAMETERS

    def __init__(self, context: LaneContext) -> None:
        """Start before the first step."""
        settings = context.settings
        slots = max(16, math.ceil(defaults.HISTORY_S * settings.nav_rate_hz))
        self._t0_ns = context.t0_ns
        self._par = kernel_parameters(context)
        self._x, self._P = np.zeros(X_SIZE), np.zeros(PACKED)
        self._x[X_Q] = 1.0
        self._aux, self._ctl = np.zeros(at.A_SIZE), np.zeros(at.C_SIZE, dtype=np.int64)
        for index in (at.A_T_GNSS, at.A_T_GNSS_SEEN, at.A_T_START, at.A_T_QUICK):
            self._aux[index] = at.NEVER_NS
        for index in (at.A_T_RESET, at.A_T_MAG, at.A_T_BARO, at.A_T_STILL, at.A_T_RATE, at.A_T_GRAVITY, at.A_T_WHEELS):
            self._aux[index] = at.NEVER_NS
        for index in (at.A_K_POS, at.A_K_VEL, at.A_K_ALT, at.A_K_BARO, at.A_K_MAG):
            self._aux[index] = 1.0
        self._aux[at.A_GNSS_INTERVAL] = 1.0
        self._aux[at.A_GRAVITY] = 9.80665
        self._work, self._h = np.zeros(at.W_SIZE), np.zeros(at.H_SIZE)
        self._work[at.W_DIM] = INERTIAL
        self._r_u, self._r_x = np.zeros((slots, at.U_SIZE)), np.zeros((slots, X_SIZE))
        self._r_P = np.zeros((slots, PACKED))
        self._r_m = np.zeros((slots, at.SLOT_MEASUREMENTS, at.H_SIZE))
        self._r_n = np.zeros(slots, dtype=np.int64)
        self._pending: list[Event] = []
        self._t_ns = 0

    def configure(self, context: LaneContext) -> None:
        """Take other parameters from the next step on."""
        self._par = kernel_parameters(context)

    def set_site(self, site: Site) -> None:
        """Take the origin and, where the model gave one, the field; a heading held against magnetic north turns."""
        aux, ctl = self._aux, self._ctl
        aux[at.A_SITE : at.A_SITE + 3] = math.radians(site.lat_deg), math.radians(site.lon_deg), site.alt_m
        self._x[X_POS : X_POS + 3] = aux[at.A_SITE : at.A_SITE + 3]
        ctl[at.C_HAS_SITE] = 1
        magnetic = ctl[at.C_HAS_HEADING] and aux[at.A_FIELD_H] > 0.0  # a course heading is true already
        if site.field_n_gauss:
            north, east, down = site.field_n_gauss
            aux[at.A_DECLINATION], aux[at.A_FIELD_D] = site.declination_rad, down
            aux[at.A_FIELD_H], ctl[at.C_HAS_FIELD] = math.hypot(north, east), 1
            if ctl[at.C_MODE] == LaneStatus.ALIGNING or not magnetic:
                if self._P[packed(FIELD, FIELD)] > 0.0:
                    start_field(self._x, self._P, self._par, aux, ctl)
            else:
                turn_about_down(self._x, self._P, site.declination_rad)
                variance = self._par[at.PAR_DECLINATION_SIGMA] ** 2
                turn_field(self._x, self._P, site.declination_rad, variance)
                fuse_field_model(self._x, self._P, self._par, aux, self._work)
                self._pending.append(
                    self._event(at.E_YAW_RESET, self._r_u[self._newest(), 0], site.declination_rad, 0.0)
                )
        if ctl[at.C_VALID] > 0:  # what is older was held in the other frame and cannot be re-run
            self._r_x[self._newest()], self._r_P[self._newest()] = self._x, self._P
            ctl[at.C_VALID] = 1

    def covariance(self) -> tuple[int, Float] | None:
        """Return (t_ns, P) of the newest row, P (9, 9): attitude rad, velocity m/s, position m, NED; None before."""
        if self._ctl[at.C_MODE] == LaneStatus.ALIGNING:
            return None
        P = np.zeros((POS + 3, POS + 3))
        P[np.tril_indices(POS + 3)] = self._P[: packed(POS + 3, 0)]
        return self._t_ns, P + np.tril(P, -1).T

    def _newest(self) -> int:
        return int(self._ctl[at.C_HEAD] - 1) % len(self._r_u)

    def step(self, steps: Float, meas: Float, t_ns: Int) -> LaneResult:
        """Advance over steps and measurements; see `Lane.step`."""
        n = len(steps)
        rows = np.empty((n, len(LANE_COLUMNS)))
        most = 2 * len(meas) + 4 * n
        aids, aid_t = np.empty((most, len(AID_COLUMNS))), np.empty(most)
        events = np.empty((4 * n + len(meas) + 4, at.E_SIZE))
        self._ctl[at.C_AIDS] = self._ctl[at.C_EVENTS] = 0
        run(
            steps, meas, self._x, self._P, self._par, self._aux, self._ctl, self._work,
            self._r_u, self._r_x, self._r_P, self._r_m, self._r_n, rows, aids, aid_t, events, self._h,
        )  # fmt: skip
        self._t_ns = int(t_ns[-1]) if n else self._t_ns
        k = int(self._ctl[at.C_AIDS])
        aid_rows = AidRows(t_ns=aid_t[:k].astype(np.int64) + self._t0_ns, data=aids[:k])
        aid_rows.data[:, 15] += self._t0_ns
        found = self._pending + [self._event(int(e[0]), *e[1:]) for e in events[: self._ctl[at.C_EVENTS]]]
        self._pending = []
        return LaneResult(rows=LaneRows(lane=self.name, t_ns=t_ns, data=rows), aids=aid_rows, events=tuple(found))

    def _event(self, code: int, t: float, first: float, second: float) -> Event:
        key, severity, text, names = EVENT_TEXTS[code]
        numbers = zip(names, (float(first), float(second)), strict=True)
        values = tuple((name, v) for name, v in numbers if name and math.isfinite(v))
        sentence = text.format(first, second)
        if code == at.E_ALIGNED and math.isnan(first):
            sentence = f"Aligned; tilt σ {second:.3g} rad. Heading unknown: no magnetometer was heard."
        return Event(t_ns=int(t) + self._t0_ns, code=key, severity=severity, text=sentence, values=values)

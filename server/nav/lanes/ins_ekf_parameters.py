"""Parameters of the main lane: what a person may change, and the array the kernels read."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.ekf import defaults
from server.nav.ekf import layout as at
from server.nav.lanes.base import LaneContext, Parameter
from server.nav.types import Float

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
        name="mag_timing_s", unit="s", default=math.nan, minimum=0.0, maximum=0.5,
        meaning="How well the magnetometer's delay is known; it widens the noise of the field while the board turns.",
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
        name="gyro_bias_per_k_rad_s", unit="rad/s/K", default=0.0, minimum=0.0, maximum=0.1,
        meaning="How far a kelvin moves the gyro's bias; it counts while the board's temperature changes.",
    ),
    Parameter(
        name="accel_bias_per_k_m_s2", unit="m/s²/K", default=0.0, minimum=0.0, maximum=1.0,
        meaning="How far a kelvin moves the accelerometer's bias; it counts while the board's temperature changes.",
    ),
    Parameter(
        name="drag_sigma_m_s2", unit="m/s²", default=defaults.DRAG_SIGMA_M_S2, minimum=0.0, maximum=10.0,
        meaning="What a multirotor's drag leaves unexplained of the specific force across; zero leaves drag out.",
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
    at.PAR_DRAG: "drag_sigma_m_s2",
    at.PAR_GYRO_PER_K: "gyro_bias_per_k_rad_s",
    at.PAR_ACCEL_PER_K: "accel_bias_per_k_m_s2",
}


def _mag_timing(context: LaneContext) -> float:
    given = context.values["mag_timing_s"]
    if not math.isnan(given):
        return given
    return defaults.MAG_TIMING_S if math.isnan(context.delays_s[1]) else defaults.MAG_TIMING_TOLD_S


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
    par[at.PAR_MAG_TIMING] = _mag_timing(context)
    par[at.PAR_WIND_SIGMA] = defaults.WIND_SIGMA_M_S
    par[at.PAR_WIND_WALK] = defaults.WIND_WALK_M_S_RTS
    par[at.PAR_DRAG_K] = defaults.DRAG_PER_S
    par[at.PAR_DRAG_K_SIGMA] = defaults.DRAG_SPREAD_PER_S
    par[at.PAR_DRAG_WALK] = defaults.DRAG_WALK_PER_S_RTS
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

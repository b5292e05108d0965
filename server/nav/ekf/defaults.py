"""Default parameters of `ins_ekf`: one set for a class of vehicle, never for a file.

Densities are those of the whole measurement in the vehicle, vibration and scale errors in motion included, so they lie
well above a data sheet's: a consumer MEMS gyro's 0.005 °/s/√Hz is 9e-5 rad/s/√Hz at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from server.nav.codes import CAR, FIXED_WING, MULTIROTOR


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseDefaults:
    """Noise densities and measurement noises of one class of vehicle, SI."""

    gyro_noise_rad_s_rthz: float
    accel_noise_m_s2_rthz: float
    gyro_bias_walk_rad_s2_rthz: float = 1e-4  # a ramp of 0.05 °/s a minute, as power-up warming gives, stays inside
    accel_bias_walk_m_s3_rthz: float = 3e-4
    mag_noise_gauss: float = 0.01
    declination_sigma_rad: float = math.radians(0.5)  # WMM's own error, regionally [WMM2025 report, table 10]
    baro_noise_m: float = 0.3
    gravity_noise_m_s2: float = 0.5


GENERAL: Final = NoiseDefaults(gyro_noise_rad_s_rthz=3e-4, accel_noise_m_s2_rthz=0.01)
OF_CLASS: Final[dict[int, NoiseDefaults]] = {
    MULTIROTOR: NoiseDefaults(gyro_noise_rad_s_rthz=4e-4, accel_noise_m_s2_rthz=0.005),
    FIXED_WING: NoiseDefaults(gyro_noise_rad_s_rthz=2e-3, accel_noise_m_s2_rthz=0.1),
    CAR: NoiseDefaults(gyro_noise_rad_s_rthz=1.5e-3, accel_noise_m_s2_rthz=0.05),  # engine vibration aliases
}

GATE_SIGMA: Final = 5.0
ACCEL_BIAS_SIGMA_M_S2: Final = 0.12  # zero-g offset of a consumer accelerometer after board mounting, 12 mg
GNSS_CORRELATION: Final = 4.0
"""Velocity errors of successive fixes are alike: (1 + ρ)/(1 − ρ) with ρ = 0.6 at 5 to 10 Hz."""
VIBRATION_BANDWIDTH_HZ: Final = 100.0
"""Vibration measured over this bandwidth is taken as white: propellers alias into the navigation band. White noise of
0.5 m/s² at 333 Hz is then over-estimated by 1.8, a board's own 20 Hz low-pass under-estimated by as much."""
GNSS_WANDER_S: Final = 60.0  # ionosphere, orbits and multipath of a moving vehicle
ZERO_RATE_RAD_S: Final = 0.004  # mean over one step of a board at rest: noise and sway
ZERO_VELOCITY_M_S: Final = 0.05  # a vehicle that stands still sways on its legs or springs
BARO_DRIFT_M_RTS: Final = 0.02  # weather and cabin pressure: 0.15 m in a minute
FIELD_WALK_GAUSS_RTS: Final = 9e-5  # crustal anomalies met on the way: 0.1° of half a gauss in 100 s
FIELD_SIGMA: Final = 0.05  # strength: anomalies and the sensor's own scale
MAG_BIAS_SIGMA_GAUSS: Final = 0.004  # left by an ordinary calibration
MAG_BIAS_WALK_GAUSS_RTS: Final = 2e-5  # temperature: 0.2 mG in 100 s; what currents do is noise
MAG_TIMING_S: Final = 0.03  # magnetometers are read at 10 to 100 Hz and averaged
MAG_TIMING_TOLD_S: Final = 0.005  # when the delay was measured
WIND_SIGMA_M_S: Final = 8.0  # per axis; the mean wind over land is about 6 m/s
WIND_WALK_M_S_RTS: Final = 0.1  # gusts pass, the mean changes by 1 m/s in 100 s
DRAG_PER_S: Final = 0.3  # drag over mass and air speed: airframes of 1 to 3 kg have 0.2 to 0.5
DRAG_SPREAD_PER_S: Final = 0.2
DRAG_WALK_PER_S_RTS: Final = 0.005  # drag is not quite linear: it changes with the speed flown
DRAG_SIGMA_M_S2: Final = 0.25  # gusts, and rotors that turn differently
HISTORY_S: Final = 1.25  # longest delay that can still be fused at its own time; rests are confirmed late
"""S1 calls 0.1 to 0.3 s usual; receivers on slow serial links reach half a second."""
MAX_AID_ROWS: Final = 64


def of_vehicle(vehicle: int) -> NoiseDefaults:
    """Return the defaults of a `VehicleClass` value; general ones for an unknown class."""
    return OF_CLASS.get(vehicle, GENERAL)

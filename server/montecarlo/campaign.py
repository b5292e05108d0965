"""What is flown: so many demo flights, each with its own seed, wind and sensor errors, and what the filter is told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from server.nav.types import EngineSettings, Float
from server.sim import SimSettings, gnss, sensors

Told = Literal["defaults", "sheet"]
LANE: Final = "ins_ekf"
EPOCH_S: Final = 0.5
FLIGHT_S: Final = 240.0
"""Four times as long as the receiver's slow error lasts: in a short flight all epochs share one draw of it."""
WIND_M_S: Final = 8.0
"""The mean wind of a flight is drawn evenly up to here: a fresh breeze, the most a 2 kg multirotor is flown in."""
STEP_S: Final = 0.02  # of navigation, by default: what the mean rate of a step at rest is taken over
SHEET: Final = {
    "gyro_noise_rad_s_rthz": sensors.GYRO_NOISE_RAD_S_RTHZ,
    "accel_noise_m_s2_rthz": sensors.ACCEL_NOISE_M_S2_RTHZ,
    "gyro_bias_walk_rad_s2_rthz": sensors.GYRO_WALK_RAD_S2_RTHZ,
    "gyro_bias_per_k_rad_s": sensors.GYRO_PER_K_RAD_S / math.sqrt(3.0),  # a limit, drawn evenly
    "accel_bias_walk_m_s3_rthz": sensors.ACCEL_WALK_M_S3_RTHZ,
    "accel_bias_per_k_m_s2": sensors.ACCEL_PER_K_M_S2 / math.sqrt(3.0),
    "accel_bias_sigma_m_s2": math.hypot(sensors.ACCEL_BIAS_M_S2, 9.8 * sensors.CROSS_ERROR) / math.sqrt(3.0),
    "zero_rate_rad_s": sensors.GYRO_NOISE_RAD_S_RTHZ / math.sqrt(STEP_S),  # the demo board does not sway on its legs
    "zero_velocity_m_s": 0.0004,  # it stands exactly
    "vibration_hz": 1e4,  # rotors are a line in the spectrum, and noise is told
    "gyro_scale": sensors.SCALE_ERROR / math.sqrt(3.0),
    "gyro_cross": sensors.CROSS_ERROR / math.sqrt(3.0),
    "mag_timing_s": 0.0,
    "mag_noise_gauss": sensors.MAG_NOISE_GAUSS,
    "mag_bias_sigma_gauss": sensors.HARD_IRON_GAUSS / math.sqrt(3.0),  # of the given length, in any direction
    "mag_bias_walk_gauss_rts": 0.0,
    "declination_sigma_rad": 0.0,  # the field flown in is the model's
    "field_sigma": 0.0,
    "field_walk_gauss_rts": 0.0,
    "baro_noise_m": sensors.BARO_NOISE_M,
    "baro_drift_m_rts": sensors.BARO_DRIFT_M * math.sqrt(2.0 / sensors.BARO_DRIFT_S),
    "gnss_wander_tau_s": gnss.WANDER_S,
    "gnss_jitter_tau_s": gnss.JITTER_S,
    "gnss_speed_tau_s": gnss.VELOCITY_S,
}
"""Noise, bias and drift of the demo board's sensors as their data sheets give them, by parameter of the lane."""


def sheet(quality: gnss.Quality) -> dict[str, float]:
    """Return everything that a data sheet would say of the demo board's sensors, with this receiver."""
    return SHEET | {
        "gnss_wander_m": quality.wander_m,
        "gnss_jitter_m": quality.jitter_m,
        "gnss_speed_m_s": quality.velocity_m_s,
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """Equal campaigns give equal results, bit for bit, however many processes fly them.

    Attributes:
        runs: flights.
        seconds: length of each, board time from power-up.
        seed: draws every flight's own seed and wind.
        told: "sheet" = what the data sheets of the demo board's sensors say, nothing else: only a filter that knows
            the noise can be asked whether its covariance is right [Bar-Shalom, Estimation, § 5.4]; "defaults" = the
            product's defaults for this class of vehicle, as with any board: how far they are from this one.
        rtk: the receiver has a carrier-phase solution.
    """

    runs: int = 100
    seconds: float = FLIGHT_S
    seed: int = 1
    told: Told = "sheet"
    rtk: bool = False

    def board(self, run: int) -> SimSettings:
        """Return the demo board of one flight: all that differs from the others comes from its seed and wind."""
        rng = np.random.default_rng([self.seed, run])
        wind_m_s = float(rng.uniform(0.0, WIND_M_S))
        return SimSettings(seed=int(rng.integers(1_000_000_000)), wind_m_s=wind_m_s, rtk=self.rtk)

    def engine(self) -> EngineSettings:
        """Return what the engine of every flight is told."""
        parameters = {LANE: sheet(gnss.RTK if self.rtk else gnss.STANDARD)} if self.told == "sheet" else {}
        return EngineSettings(lanes=(LANE,), lane_parameters=parameters)

    @property
    def epochs_s(self) -> Float:
        """Board times at which the filter is examined, s since power-up."""
        return np.asarray(np.arange(1, int(self.seconds / EPOCH_S + 1e-9) + 1) * EPOCH_S)

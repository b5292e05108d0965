"""What is flown: so many demo flights, each with its own seed, wind and sensor errors, and what the filter is told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from server.nav.types import EngineSettings, Float
from server.sim import SimSettings, sensors

Told = Literal["defaults", "sheet"]
LANE: Final = "ins_ekf"
EPOCH_S: Final = 0.5
WIND_M_S: Final = 8.0
"""The mean wind of a flight is drawn evenly up to here: a fresh breeze, the most a 2 kg multirotor is flown in."""
SHEET: Final = {
    "gyro_noise_rad_s_rthz": sensors.GYRO_NOISE_RAD_S_RTHZ,
    "accel_noise_m_s2_rthz": sensors.ACCEL_NOISE_M_S2_RTHZ,
    "gyro_bias_walk_rad_s2_rthz": sensors.GYRO_WALK_RAD_S2_RTHZ,
    "accel_bias_walk_m_s3_rthz": sensors.ACCEL_WALK_M_S3_RTHZ,
    "accel_bias_sigma_m_s2": sensors.ACCEL_BIAS_M_S2 / math.sqrt(3.0),  # drawn evenly up to the sheet's figure
    "mag_noise_gauss": sensors.MAG_NOISE_GAUSS,
    "baro_noise_m": sensors.BARO_NOISE_M,
}
"""Noise and bias of the demo board's sensors as their data sheets give them, by parameter of the lane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """Equal campaigns give equal results, bit for bit, however many processes fly them.

    Attributes:
        runs: flights.
        seconds: length of each, board time from power-up.
        seed: draws every flight's own seed and wind.
        told: "defaults" = the product's defaults for this class of vehicle, as with any board; "sheet" = the noise
            densities and the bias of the demo board's data sheets, nothing else.
        rtk: the receiver has a carrier-phase solution.
    """

    runs: int = 100
    seconds: float = 120.0
    seed: int = 1
    told: Told = "defaults"
    rtk: bool = False

    def board(self, run: int) -> SimSettings:
        """Return the demo board of one flight: all that differs from the others comes from its seed and wind."""
        rng = np.random.default_rng([self.seed, run])
        wind_m_s = float(rng.uniform(0.0, WIND_M_S))
        return SimSettings(seed=int(rng.integers(1_000_000_000)), wind_m_s=wind_m_s, rtk=self.rtk)

    def engine(self) -> EngineSettings:
        """Return what the engine of every flight is told."""
        parameters = {LANE: SHEET} if self.told == "sheet" else {}
        return EngineSettings(lanes=(LANE,), lane_parameters=parameters)

    @property
    def epochs_s(self) -> Float:
        """Board times at which the filter is examined, s since power-up."""
        return np.asarray(np.arange(1, int(self.seconds / EPOCH_S + 1e-9) + 1) * EPOCH_S)

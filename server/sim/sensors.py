"""What the demo board's sensors say of the truth, in blocks of 200 ms.

Figures are those of data sheets; where a sheet gives a range, its middle. `noise=0` leaves truth, delays and rates.
Noise densities N are per √Hz in the sense of the Allan deviation N/√τ, as the estimators take them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from server.magnetic import wmm_field
from server.nav.types import Float
from server.sim import earth
from server.sim.errors import RawErrors, raw_errors
from server.sim.gnss import Fix, Receiver
from server.sim.noise import GaussMarkov, LowPass, quantised
from server.sim.pitot import Pitot
from server.sim.settings import SimSettings
from server.sim.stage import Stage
from server.sim.truth import TICK_S, TruthState, imu_between

BLOCK: Final = 200
"""Ticks of 1 ms produced at a time: one GNSS epoch, two magnetometer and two baro samples."""
BLOCK_S: Final = BLOCK * TICK_S
SLOW: Final = 100
"""Ticks between magnetometer and between baro samples (10 Hz)."""
MAG_LATE: Final = 50
"""Ticks by which the magnetometer's value is older than its first appearance."""
IMU_DELAY_S: Final = 0.011
"""By how much the filtered IMU lags: ArduPilot's 20 Hz Butterworth makes 11 ms of it."""
START_YEAR: Final = 2026.41
"""Date of the flight, for the magnetic model; see `messages.START_UNIX_S`."""

# TDK ICM-42688-P (DS-000347): 0.0028 °/s/√Hz, 70 µg/√Hz; Bosch BMI088: 0.014 °/s/√Hz, 175 µg/√Hz. Between the two:
GYRO_NOISE_RAD_S_RTHZ: Final = math.radians(0.005)
ACCEL_NOISE_M_S2_RTHZ: Final = 100e-6 * 9.80665
GYRO_BIAS_RAD_S: Final = math.radians(
    0.3
)  # zero-rate offset after the autopilot's own calibration at another temperature
ACCEL_BIAS_M_S2: Final = 0.04  # 4 mg of a sheet's ±20 mg, the rest calibrated away
GYRO_WALK_RAD_S2_RTHZ: Final = 1e-5  # 5 °/h over a few minutes, seen as bias instability
ACCEL_WALK_M_S3_RTHZ: Final = 1e-4
GYRO_PER_K_RAD_S: Final = math.radians(0.003)  # sheet: ±0.005 °/s/K
ACCEL_PER_K_M_S2: Final = 1e-3  # sheet: ±0.15 mg/K
SCALE_ERROR: Final = 1e-3  # after calibration; the sheet's ±0.5 % is before
CROSS_ERROR: Final = 5e-4
GYRO_LSB_RAD_S: Final = math.radians(2000.0) / 32768.0
ACCEL_LSB_M_S2: Final = 16.0 * 9.80665 / 32768.0
COLD_DEGC: Final = 28.0
WARM_DEGC: Final = 43.0
WARM_UP_S: Final = 240.0
ROTOR_HZ: Final = 163.0
"""Rotor imbalance: a line in the spectrum that the board's filter takes out by a factor of 80."""
ROTOR_M_S2: Final = 2.5
ROTOR_RAD_S: Final = 0.03

MAG_NOISE_GAUSS: Final = 1.5e-3  # between PNI RM3100 (0.15 mG) and iSentek IST8310 (3 mG)
HARD_IRON_GAUSS: Final = 1.2e-3  # what a good calibration leaves: 0.3° of heading at this latitude
BARO_NOISE_M: Final = 0.06
BARO_DRIFT_M: Final = 0.35
BARO_DRIFT_S: Final = 300.0
WEATHER_M: Final = 35.0
"""The day is not a standard day: the pressure altitude is off by this much, 4.2 hPa."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensorBlock:
    """200 ms of samples; row i of `state` is tick `first_tick + i`, row i of `imu` tick `first_tick + 1 + i`.

    Attributes:
        state: truth, 201 rows; the first repeats the last of the block before.
        imu_true: shape (200, 6), rad/s and m/s², mean over the millisecond before each tick.
        imu: shape (200, 6), what the board holds at each tick: late by `IMU_DELAY_S`, with all errors.
        mag_gauss: shape (3, 3): values in force from `first_tick`, 100 and 200 ticks later.
        baro_pa: shape (3,): likewise.
        fixes: GNSS solution in force from `first_tick`, and the one that arrives in this block.
        gyro_bias_rad_s, accel_bias_m_s2: shape (3,), in force in this block.
        temperature_degc: of the IMU and the baro.
        flight_from_ms: board time at which the present flight began; None while the board is in the hand.
        diff_pa: shape (3,), differential pressure in force as the baro's; None without a pressure tube.
    """

    first_tick: int
    state: TruthState
    imu_true: Float
    imu: Float
    mag_gauss: Float
    baro_pa: Float
    fixes: tuple[Fix, Fix]
    gyro_bias_rad_s: Float
    accel_bias_m_s2: Float
    temperature_degc: float
    flight_from_ms: int | None = 0
    diff_pa: Float | None = None


class Sensors:
    """All sensors of one board, block after block."""

    def __init__(self, settings: SimSettings) -> None:
        noise = settings.noise
        self._noise = noise
        self._imu_rng, own, slow, gnss = np.random.default_rng([settings.seed, 2]).spawn(4)
        self._slow_rng = slow
        self._mix_gyro = _misalignment(own, noise)
        self._mix_accel = _misalignment(own, noise)
        self._gyro_bias = noise * GYRO_BIAS_RAD_S * own.uniform(-1.0, 1.0, 3)
        self._accel_bias = noise * ACCEL_BIAS_M_S2 * own.uniform(-1.0, 1.0, 3)
        self._per_k = noise * own.uniform(-1.0, 1.0, (2, 3)) * [[GYRO_PER_K_RAD_S], [ACCEL_PER_K_M_S2]]
        self._rotor_rad = own.uniform(0.0, 2.0 * math.pi, 6)
        direction = own.standard_normal(3)
        self._iron = noise * HARD_IRON_GAUSS * direction / np.linalg.norm(direction)
        self._field_n, _ = wmm_field(earth.SITE_LAT_DEG, earth.SITE_LON_DEG, earth.SITE_ALT_M, START_YEAR)
        self.stage = Stage(settings, self._field_n)
        self._raw: RawErrors | None = None
        self._pitot: Pitot | None = None
        if settings.errors == "raw":
            self._leave_raw(settings)
        self._baro_drift = GaussMarkov(slow, np.array([noise * BARO_DRIFT_M]), BARO_DRIFT_S, BLOCK_S)
        self._low_pass = LowPass(IMU_DELAY_S - 0.5 * TICK_S, 3, TICK_S)
        self._receiver = Receiver(gnss, settings)
        self._tick = 0
        self._mag: Float | None = None
        self._baro: Float | None = None

    @property
    def gnss_error_n_m(self) -> Float:
        """The receiver's slow position error now, NED, shape (3,)."""
        return self._receiver.wander_n_m

    @property
    def truth_errors(self) -> RawErrors:
        """What this board's sensors err by at the present temperature, all in one; what a calibration should find."""
        raw = self._raw or RawErrors()
        warm = self._warm_k(self._tick) * self._per_k
        unmount = raw.R_bs.T
        return RawErrors(
            gyro_matrix=(unmount @ self._mix_gyro).T,
            gyro_offset=self._gyro_bias + warm[0],
            accel_matrix=(unmount @ self._mix_accel).T,
            accel_offset=self._accel_bias + warm[1],
            mag_matrix=raw.mag_matrix,
            mag_offset=raw.mag_offset + self._iron,
            R_bs=raw.R_bs,
            diff_pressure_pa=raw.diff_pressure_pa,
            baro_pa=raw.baro_pa,
        )

    def step(self) -> SensorBlock:
        """Return the next 200 ms."""
        first = self._tick
        self._tick += BLOCK
        state = self.stage.step(first, BLOCK)
        warm_k = self._warm_k(first)
        bias = np.stack([self._gyro_bias, self._accel_bias]) + warm_k * self._per_k
        true = np.concatenate(imu_between(state), axis=1)
        block = SensorBlock(
            first_tick=first,
            state=state,
            imu_true=true,
            imu=self._low_pass.step(self._measured(true, bias.ravel(), state)),
            mag_gauss=self._magnetometer(state),
            baro_pa=self._barometer(state),
            fixes=self._receiver.step(first, state),
            gyro_bias_rad_s=bias[0],
            accel_bias_m_s2=bias[1],
            temperature_degc=COLD_DEGC + warm_k,
            flight_from_ms=self.stage.flight_from_ms,
            diff_pa=self._pitot.step(state, self.stage.is_wind_on_pitot) if self._pitot is not None else None,
        )
        self._walk()
        return block

    def _measured(self, true: Float, bias: Float, state: TruthState) -> Float:
        """Return what the IMU chip samples at 1 kHz, before the board's filter."""
        sigma = np.repeat([GYRO_NOISE_RAD_S_RTHZ, ACCEL_NOISE_M_S2_RTHZ], 3) * (self._noise / math.sqrt(TICK_S))
        rows = np.concatenate([true[:, :3] @ self._mix_gyro, true[:, 3:] @ self._mix_accel], axis=1) + bias
        rows += sigma * self._imu_rng.standard_normal(rows.shape)
        angle = 2.0 * math.pi * ROTOR_HZ * state.t_s[1:, None] + self._rotor_rad
        shake = np.repeat([ROTOR_RAD_S, ROTOR_M_S2], 3) * (self._noise * state.flying[1:, None])
        rows += shake * np.sin(angle)
        resolution = min(self._noise, 1.0)
        rows[:, :3] = quantised(rows[:, :3], GYRO_LSB_RAD_S * resolution)
        rows[:, 3:] = quantised(rows[:, 3:], ACCEL_LSB_M_S2 * resolution)
        return rows

    def _magnetometer(self, state: TruthState) -> Float:
        """Return the values in force at the block's start, middle and end."""
        field_n = self._field_n + self.stage.room_n_gauss if self.stage.room_n_gauss else self._field_n
        fresh = np.vecmat(field_n, state.R_nb[SLOW - MAG_LATE :: SLOW])
        if self.stage.magnet_b_gauss:
            fresh = fresh + self.stage.magnet_b_gauss
        if self._raw is not None:
            fresh = fresh @ (self._raw.mag_matrix @ self._raw.R_bs.T).T + self._raw.mag_offset
        fresh = fresh + self._iron + self._noise * MAG_NOISE_GAUSS * self._slow_rng.standard_normal(fresh.shape)
        values = np.concatenate([fresh[:1] if self._mag is None else self._mag, fresh])
        self._mag = values[-1:]
        return values

    def _barometer(self, state: TruthState) -> Float:
        """Return the pressures in force at the block's start, middle and end."""
        error = self._baro_drift.step() + self._noise * BARO_NOISE_M * self._slow_rng.standard_normal(2)
        height = earth.SITE_ALT_M + WEATHER_M - state.pos_n_m[SLOW::SLOW, 2]
        fresh = earth.pressure_pa(height + error)
        if self._raw is not None:
            fresh = fresh + self._raw.baro_pa
        values = np.concatenate([fresh[:1] if self._baro is None else self._baro, fresh])
        self._baro = values[-1:]
        return values

    def _leave_raw(self, settings: SimSettings) -> None:
        """Put the factory's errors on top of those of a cared-for board; rows times a mix, hence the transposes."""
        self._raw = raw = raw_errors(settings.seed)
        self._mix_gyro = raw.R_bs @ self._mix_gyro @ raw.gyro_matrix.T
        self._mix_accel = raw.R_bs @ self._mix_accel @ raw.accel_matrix.T
        self._gyro_bias = self._gyro_bias + raw.gyro_offset
        self._accel_bias = self._accel_bias + raw.accel_offset
        self._pitot = Pitot(np.random.default_rng([settings.seed, 5]), settings.noise, raw.diff_pressure_pa)

    @staticmethod
    def _warm_k(tick: int) -> float:
        return (WARM_DEGC - COLD_DEGC) * (1.0 - math.exp(-tick * TICK_S / WARM_UP_S))

    def _walk(self) -> None:
        step = self._noise * math.sqrt(BLOCK_S) * self._imu_rng.standard_normal((2, 3))
        self._gyro_bias = self._gyro_bias + GYRO_WALK_RAD_S2_RTHZ * step[0]
        self._accel_bias = self._accel_bias + ACCEL_WALK_M_S3_RTHZ * step[1]


def _misalignment(rng: np.random.Generator, noise: float) -> Float:
    """Return a matrix near one: scale errors on its diagonal, cross-axis errors off it; rows times it."""
    errors = CROSS_ERROR * rng.uniform(-1.0, 1.0, (3, 3))
    np.fill_diagonal(errors, SCALE_ERROR * rng.uniform(-1.0, 1.0, 3))
    return np.asarray(np.eye(3) + noise * errors)

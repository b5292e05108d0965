"""Motions of every vehicle class as sample streams, made from kinematics alone.

A motion is a speed, a heading and a bank angle over time; position, velocity, acceleration and rates follow from them
by numerical differentiation on a millisecond grid. Nothing of the code under test is used.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.nav.types import LANE_COLUMNS, Kind

from .synthetic import EARTH, G_M_S2, LAT_DEG, LON_DEG, METRES_PER_DEG_LAT, METRES_PER_DEG_LON, Stream

Floats = NDArray[np.float64]
GRID_S = 0.001
STATUS = LANE_COLUMNS.index("status")
FIELD_N_GAUSS = np.array([0.25, 0.0, 0.433])
"""What `field_model` says, and what the sensor measures unless told otherwise."""


def ramp(t: Floats, start_s: float, length_s: float) -> Floats:
    """Return 0 before the start, 1 after the length, smooth to the second derivative in between."""
    u = np.clip((t - start_s) / length_s, 0.0, 1.0)
    return np.asarray(u - np.sin(2 * np.pi * u) / (2 * np.pi), np.float64)


class Motion:
    """A level path: at rest to the north until `rest_s`, then speed and turn rate as given; banked if it flies."""

    def __init__(
        self,
        duration_s: float,
        speed_m_s: Callable[[Floats], Floats],
        turn_rad_s: Callable[[Floats], Floats],
        banked: bool,
        bank_rad: Callable[[Floats], Floats] | None = None,
    ) -> None:
        t = np.arange(-0.01, duration_s + 0.01, GRID_S)
        v = speed_m_s(t)
        rate = turn_rad_s(t)
        self.t_s, self.yaw = t, _integral(rate)
        self.yaw -= np.interp(0.0, t, self.yaw)
        roll = np.arctan2(v * rate, G_M_S2) if banked else np.zeros_like(t)
        if bank_rad is not None:
            roll = roll + bank_rad(t)
        self.R_nb = Rotation.from_euler("ZYX", np.stack([self.yaw, np.zeros_like(t), roll], 1))
        self.vel_n = np.stack([v * np.cos(self.yaw), v * np.sin(self.yaw), np.zeros_like(t)], 1)
        self.pos_n = np.stack([_integral(self.vel_n[:, i]) for i in range(3)], 1)
        self.duration_s = duration_s

    def at(self, t_s: Floats, values: Floats) -> Floats:
        """Return rows of a table on the grid at other times."""
        return np.stack([np.interp(t_s, self.t_s, values[:, i]) for i in range(values.shape[1])], 1)

    def imu(self, t_s: Floats) -> tuple[Floats, Floats]:
        """Return body rates (the Earth's included) and specific force at times on the grid."""
        k = np.rint((t_s - self.t_s[0]) / GRID_S).astype(int)
        rate = (self.R_nb[k - 1].inv() * self.R_nb[k + 1]).as_rotvec() / (2 * GRID_S)
        accel = (self.vel_n[k + 1] - self.vel_n[k - 1]) / (2 * GRID_S)
        lat = np.radians(LAT_DEG)
        earth = EARTH * np.array([np.cos(lat), 0.0, -np.sin(lat)])
        force = self.R_nb[k].apply(accel - [0.0, 0.0, G_M_S2], inverse=True)
        return rate + self.R_nb[k].apply(earth, inverse=True), force

    def body(self, t_s: Floats, vector_n: Floats) -> Floats:
        """Return vectors given in NED in the body, at times on the grid."""
        k = np.rint((t_s - self.t_s[0]) / GRID_S).astype(int)
        return np.asarray(self.R_nb[k].apply(vector_n, inverse=True), np.float64)


def _integral(values: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))]) * GRID_S


def s_turns(duration_s: float = 90.0, speed_m_s: float = 15.0, rest_s: float = 10.0, banked: bool = True) -> Motion:
    """A start to the north, then turns to the left and to the right of up to 0.4 rad/s."""
    return Motion(
        duration_s,
        lambda t: speed_m_s * ramp(t, rest_s, 6.0),
        lambda t: 0.4 * ramp(t, rest_s + 6.0, 4.0) * np.sin(2 * np.pi * (t - rest_s - 6.0) / 23.0),
        banked,
    )


def rest(duration_s: float = 90.0) -> Motion:
    """A board that lies still."""
    return Motion(duration_s, np.zeros_like, np.zeros_like, False)


def loiter(duration_s: float = 90.0, speed_m_s: float = 18.0, wind_m_s: tuple[float, float] = (0.0, 0.0)) -> Motion:
    """A fixed wing that circles in the air mass and is carried by the wind; it starts from the ground, in a turn."""
    motion = Motion(
        duration_s,
        lambda t: speed_m_s * ramp(t, 10.0, 6.0),
        lambda t: 0.35 * ramp(t, 14.0, 5.0),
        banked=True,
    )
    carried = ramp(motion.t_s, 10.0, 6.0)[:, None] * np.array([*wind_m_s, 0.0])
    motion.vel_n = motion.vel_n + carried
    motion.pos_n = np.stack([_integral(motion.vel_n[:, i]) for i in range(3)], 1)
    return motion


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """What the board carries and what is wrong with it; None = that sensor is not there."""

    imu_hz: float = 200.0
    gyro_noise: float = 1e-3
    accel_noise: float = 2e-2
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accel_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mag_hz: float | None = 20.0
    field_n_gauss: tuple[float, float, float] = (0.25, 0.0, 0.433)
    hard_iron_gauss: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mag_noise: float = 1e-3
    mag_late_s: float = 0.0
    gnss_hz: float | None = 5.0
    pos_late_s: float = 0.0
    vel_late_s: float = 0.0
    baro_hz: float | None = 10.0
    seed: int = 1
    extra: Callable[[Stream, Motion, np.random.Generator], None] | None = field(default=None)


def stream_of(motion: Motion, sensors: Sensors = Sensors()) -> Stream:  # frozen
    """Return the samples of a motion in a stream."""
    rng, stream, s = np.random.default_rng(sensors.seed), Stream(), sensors
    t = _stamps(motion, s.imu_hz)
    rate, force = motion.imu(t)
    rate = rate + np.array(s.gyro_bias) + s.gyro_noise * rng.standard_normal(rate.shape)
    force = force + np.array(s.accel_bias) + s.accel_noise * rng.standard_normal(force.shape)
    _add(stream, Kind.IMU, t, np.hstack([rate, force]))
    if s.mag_hz:
        t = _stamps(motion, s.mag_hz)
        mag = motion.body(t - s.mag_late_s, np.array(s.field_n_gauss)) + np.array(s.hard_iron_gauss)
        _add(stream, Kind.MAG, t, mag + s.mag_noise * rng.standard_normal(mag.shape))
    if s.gnss_hz:
        _add(stream, Kind.GNSS, t := _stamps(motion, s.gnss_hz), _fixes(motion, t, s, rng))
    if s.baro_hz:
        t = _stamps(motion, s.baro_hz)
        _add(stream, Kind.BARO, t, np.stack([np.full_like(t, np.nan), 100 + 0.05 * rng.standard_normal(len(t))], 1))
    if s.extra is not None:
        s.extra(stream, motion, rng)
    return stream


def _stamps(motion: Motion, rate_hz: float) -> Floats:
    return np.arange(round(motion.duration_s * rate_hz)) / rate_hz


def _fixes(motion: Motion, t: Floats, s: Sensors, rng: np.random.Generator) -> Floats:
    place = motion.at(t - s.pos_late_s, motion.pos_n) + 0.02 * rng.standard_normal((len(t), 3))
    velocity = motion.at(t - s.vel_late_s, motion.vel_n) + 0.03 * rng.standard_normal((len(t), 3))
    lat, lon = LAT_DEG + place[:, 0] / METRES_PER_DEG_LAT, LON_DEG + place[:, 1] / METRES_PER_DEG_LON
    quality = np.tile([0.1, 0.2, 0.05, 3.0], (len(t), 1))
    return np.column_stack([lat, lon, -place[:, 2], velocity, quality])


def _add(stream: Stream, kind: Kind, t_s: Floats, rows: Floats) -> None:
    for t, row in zip(t_s.tolist(), rows.tolist(), strict=True):
        stream.add(kind, t, row)

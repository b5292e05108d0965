"""Motions that carry their truth: S4's five on the bench, and S3's aggressive flight with a disturbed barometer.

S4 scores attitude filters over five motions of a hand-held board: slow tilt and return, fast tilt and return,
horizontal translation, repeated tilting, repeated lifting and putting down. S3 compares height estimators in a flight
that holds its height while it moves violently, whereupon the barometer errs by 5 m. S4's table holds pictures without
figures and S3 gives none of its path, so sizes and times are chosen here (`motion_paths`). Each motion is given as the
samples of a board with the truth beside them as REFERENCE rows. `truth_of` and `inertial` have no noise: rate and
specific force are exact derivatives of place and attitude.

The first rows are DATE and PROFILE. The bench has no GNSS, so give the engine the site (`SITE_LAT_DEG`,
`SITE_LON_DEG`, `SITE_ALT_M` of `sim.earth`) when headings are to count from true north.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np
from vqf import VQF

from server.magnetic import wmm_field
from server.nav.types import ROW_WIDTH, Float, Int, Kind, SampleBlock, VehicleClass
from server.sim import earth
from server.sim.motion_paths import PATHS, Kinematics, Path, kinematics, value
from server.sim.noise import quantised
from server.sim.sensors import (
    ACCEL_BIAS_M_S2,
    ACCEL_LSB_M_S2,
    ACCEL_NOISE_M_S2_RTHZ,
    BARO_NOISE_M,
    GYRO_BIAS_RAD_S,
    GYRO_LSB_RAD_S,
    GYRO_NOISE_RAD_S_RTHZ,
    HARD_IRON_GAUSS,
    MAG_NOISE_GAUSS,
    START_YEAR,
)

IMU_HZ: Final = 200
MAG_HZ: Final = 50
BARO_HZ: Final = 25
GNSS_HZ: Final = 5
DMP_HZ: Final = 100
REFERENCE_HZ: Final = 100
BLOCK_S: Final = 1.0
BARO_DISTURBANCE_M: Final = 5.0
GNSS_DELAY_S: Final = 0.1
"""S1 calls GNSS late; the PROFILE row tells it."""
GNSS_SIGMA_M: Final = (0.5, 0.5, 0.9)
GNSS_SIGMA_M_S: Final = 0.05
Q30: Final = 2.0**30

MOTIONS: Final[tuple[str, ...]] = tuple(PATHS)
"""S4's five, in the order of its table, and S3's."""
GRAVITY_M_S2: Final = float(earth.gravity_m_s2(np.array([earth.SITE_ALT_M]))[0])
"""One value for a whole motion: 20 m of climb would change it by 6e-5 m/s²."""


def path_of(name: str) -> Path:
    """Return the path of a motion.

    Raises:
        ValueError: there is no motion of that name.
    """
    if name not in PATHS:
        raise ValueError(f"no motion called {name}; there are: {', '.join(MOTIONS)}")
    return PATHS[name]


def truth_of(name: str, t_s: Float) -> Kinematics:
    """Return the truth of a motion at times since its start, shape (n,)."""
    return kinematics(path_of(name), t_s, GRAVITY_M_S2)


def baro_error_m(name: str, t_s: Float) -> Float:
    """Return what the airflow adds to the baro height: as the speed squared, 5 m at most; nothing on the bench."""
    path = path_of(name)
    if not path.leaning:
        return np.zeros_like(t_s)
    fastest = max(abs(stroke.size) / stroke.length_s for stroke in path.north) * 35.0 / 16.0  # s'(½) = 35/16
    return np.asarray(BARO_DISTURBANCE_M * (value(path.north, t_s, 1) / fastest) ** 2)


def inertial(truth: Kinematics) -> Float:
    """Return rate in rad/s and specific force in m/s² in the body, shape (n, 6), as an ideal IMU senses them."""
    spin = np.vecmat(earth.EARTH_RATE_N_RAD_S, truth.R_nb)
    coriolis = 2.0 * np.cross(earth.EARTH_RATE_N_RAD_S, truth.vel_n_m_s)
    force = truth.accel_n_m_s2 + coriolis - np.array([0.0, 0.0, GRAVITY_M_S2])
    return np.column_stack([truth.rate_b_rad_s + spin, np.vecmat(force, truth.R_nb)])


def _times(hz: int, duration_s: float) -> Float:
    return np.arange(round(duration_s * hz) + 1) / hz


def _imu(truth: Kinematics, rng: np.random.Generator) -> Float:
    """Return IMU rows: one bias for the whole motion, white noise, and the chip's resolution."""
    bias = rng.uniform(-1.0, 1.0, 6) * np.repeat([GYRO_BIAS_RAD_S, ACCEL_BIAS_M_S2], 3)
    sigma = np.repeat([GYRO_NOISE_RAD_S_RTHZ, ACCEL_NOISE_M_S2_RTHZ], 3) * math.sqrt(IMU_HZ)
    rows = inertial(truth) + bias + sigma * rng.standard_normal((len(truth.q_nb), 6))
    return np.column_stack([quantised(rows[:, :3], GYRO_LSB_RAD_S), quantised(rows[:, 3:], ACCEL_LSB_M_S2)])


def _mag(truth: Kinematics, rng: np.random.Generator) -> Float:
    """Return the field in the body in gauss: the model's, what a good calibration leaves of hard iron, and noise."""
    field, _ = wmm_field(earth.SITE_LAT_DEG, earth.SITE_LON_DEG, earth.SITE_ALT_M, START_YEAR)
    iron = HARD_IRON_GAUSS / math.sqrt(3.0) * rng.uniform(-1.0, 1.0, 3)
    seen = np.vecmat(field, truth.R_nb)
    return np.asarray(seen + iron + MAG_NOISE_GAUSS * rng.standard_normal(seen.shape))


def _baro(name: str, t_s: Float, truth: Kinematics, rng: np.random.Generator) -> Float:
    height = earth.SITE_ALT_M - truth.pos_n_m[:, 2] + baro_error_m(name, t_s)
    height += BARO_NOISE_M * rng.standard_normal(len(t_s))
    return np.column_stack([earth.pressure_pa(height), height])


def _gnss(name: str, t_s: Float, rng: np.random.Generator) -> Float:
    """Return fixes that are GNSS_DELAY_S late."""
    late = truth_of(name, t_s - GNSS_DELAY_S)
    place = earth.geodetic_from_ned(late.pos_n_m + GNSS_SIGMA_M * rng.standard_normal(late.pos_n_m.shape))
    speed = late.vel_n_m_s + GNSS_SIGMA_M_S * rng.standard_normal(late.vel_n_m_s.shape)
    told = np.tile([math.hypot(*GNSS_SIGMA_M[:2]), GNSS_SIGMA_M[2], GNSS_SIGMA_M_S, 3.0, 14.0], (len(t_s), 1))
    return np.column_stack([place, speed, told])


def _dmp(imu: Float) -> Float:
    """Return what a board's motion processor would say, at 100 Hz: six-axis, its heading counts from power-up.

    The chip's algorithm is not published. The `vqf` library's 6D filter at 200 Hz with its default parameters stands in
    for it, on the same noisy samples; the quaternion then takes the chip's form, int32 with 30 binary places.
    """
    found = VQF(1.0 / IMU_HZ).updateBatch(np.ascontiguousarray(imu[:, :3]), np.ascontiguousarray(imu[:, 3:6]))
    w, x, y, z = found["quat6D"][:: IMU_HZ // DMP_HZ].T
    w, x, y, z = -x, w, -z, y  # to a frame with z up; half a turn about its x puts z down
    half = 0.5 * math.atan2(2.0 * (w[0] * z[0] + x[0] * y[0]), 1.0 - 2.0 * (y[0] ** 2 + z[0] ** 2))
    c, s = math.cos(half), math.sin(half)  # the first heading is zero
    q = np.column_stack([c * w + s * z, c * x + s * y, c * y - s * x, c * z - s * w])
    return np.asarray(np.rint(q * Q30) / Q30)


def _reference(truth: Kinematics) -> Float:
    return np.column_stack([truth.q_nb, earth.geodetic_from_ned(truth.pos_n_m), truth.vel_n_m_s])


def motion(name: str, seed: int = 1) -> tuple[SampleBlock, ...]:
    """Return a motion as blocks of one second, samples in order of their stamps, IMU last of each moment.

    Kinds: DATE and PROFILE once, IMU 200 Hz, MAG 50 Hz, BARO 25 Hz, DMP 100 Hz, REFERENCE 100 Hz (truth), and GNSS
    5 Hz for "altitude" only: the others take place on a bench.

    Args:
        name: one of `MOTIONS`.
        seed: of the sensors' errors; the truth does not depend on it.

    Raises:
        ValueError: there is no motion of that name.
    """
    path = path_of(name)
    own = np.random.default_rng([seed, MOTIONS.index(name)])
    imu_rng, mag_rng, baro_rng, gnss_rng = own.spawn(4)
    t = {hz: _times(hz, path.duration_s) for hz in {IMU_HZ, MAG_HZ, BARO_HZ, GNSS_HZ, DMP_HZ, REFERENCE_HZ}}
    imu = _imu(truth_of(name, t[IMU_HZ]), imu_rng)
    gnss_delay_s, vehicle = (GNSS_DELAY_S, VehicleClass.MULTIROTOR) if path.leaning else (0.0, VehicleClass.HAND_HELD)
    tables = [
        (Kind.DATE, t[GNSS_HZ][:1], np.array([[START_YEAR]])),
        (Kind.PROFILE, t[GNSS_HZ][:1], np.array([[0.0, 0.0, gnss_delay_s, 0.0, float(vehicle)]])),
        (Kind.MAG, t[MAG_HZ], _mag(truth_of(name, t[MAG_HZ]), mag_rng)),
        (Kind.BARO, t[BARO_HZ], _baro(name, t[BARO_HZ], truth_of(name, t[BARO_HZ]), baro_rng)),
        (Kind.DMP, t[DMP_HZ], _dmp(imu)),
        (Kind.REFERENCE, t[REFERENCE_HZ], _reference(truth_of(name, t[REFERENCE_HZ]))),
        (Kind.IMU, t[IMU_HZ], imu),
    ]
    if path.leaning:
        tables.insert(2, (Kind.GNSS, t[GNSS_HZ], _gnss(name, t[GNSS_HZ], gnss_rng)))
    return _blocks(tables)


def _blocks(tables: list[tuple[Kind, Float, Float]]) -> tuple[SampleBlock, ...]:
    """Merge the tables by time, keep their order within a moment, and cut every BLOCK_S."""
    data = np.full((sum(len(times) for _, times, _ in tables), ROW_WIDTH), np.nan)
    begin = 0
    for _, _, rows in tables:
        data[begin : begin + len(rows), : rows.shape[1]] = rows
        begin += len(rows)
    kind = np.concatenate([np.full(len(times), int(one), dtype=np.uint8) for one, times, _ in tables])
    t_ns: Int = np.rint(np.concatenate([times for _, times, _ in tables]) * 1e9).astype(np.int64)
    order = np.argsort(t_ns, kind="stable")
    kind, t_ns, data = kind[order], t_ns[order], data[order]
    cuts = np.flatnonzero(np.diff(t_ns // round(BLOCK_S * 1e9))) + 1
    edges = [0, *cuts.tolist(), len(kind)]
    return tuple(
        SampleBlock(kind=kind[a:b], t_ns=t_ns[a:b], t_rx_ns=t_ns[a:b], data=np.ascontiguousarray(data[a:b]))
        for a, b in pairwise(edges)
    )

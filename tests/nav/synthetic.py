"""Sample streams made from laws of motion, independent of the code under test."""

import math

import numpy as np

from server.nav.engine import NavEngine
from server.nav.types import EngineSettings, Kind, SampleBlock

G_M_S2 = 9.8062  # normal gravity at 45°N, sea level, to the digits these tests can see
LAT_DEG, LON_DEG = 45.0, 10.0
EARTH = 7.292115e-5
METRES_PER_DEG_LAT = 111131.745  # meridian arc at 45°N [WGS-84]
METRES_PER_DEG_LON = 78846.8


def field_model(lat_deg, lon_deg, alt_m, decimal_year):
    """A field that points to true north, dips 60° and has half a gauss."""
    return np.array([0.25, 0.0, 0.433]), decimal_year


class Stream:
    """Collects rows in order of arrival and makes blocks of them."""

    def __init__(self):
        self.rows = []

    def add(self, kind, t_s, values, arrives_s=None):
        self.rows.append((t_s if arrives_s is None else arrives_s, kind == Kind.IMU, len(self.rows), kind, t_s, values))

    def block(self, boot_id=0, offset_s=0.0):
        rows = sorted(self.rows, key=lambda r: r[:3])  # arrival first, then aids before the IMU sample of that moment
        data = np.full((len(rows), 14), np.nan)
        for i, row in enumerate(rows):
            data[i, : len(row[5])] = row[5]
        t_ns = np.array([round((r[4] + offset_s) * 1e9) for r in rows], dtype=np.int64)
        kind = np.array([int(r[3]) for r in rows], dtype=np.uint8)
        return SampleBlock(kind=kind, t_ns=t_ns, t_rx_ns=t_ns, data=data, boot_id=boot_id)


def circle(
    duration_s=60.0, rate_hz=200.0, speed_m_s=10.0, radius_m=40.0, rest_s=10.0, seed=1, noise=1.0, gyro_bias=(0, 0, 0),
    gnss_delay_s=0.0, gnss_arrives_s=0.0, gnss_hz=5.0, mag=True, baro=True, accel_bias=(0, 0, 0),
):  # fmt: skip
    """A level vehicle rests facing north, then drives a clockwise circle that starts smoothly.

    Returns (stream, truth) with truth(t_s) -> (north_m, east_m, vel_n, vel_e, heading_rad).
    """
    rng = np.random.default_rng(seed)
    stream = Stream()
    ramp_s = 4.0

    def speed(t):
        u = min(max((t - rest_s) / ramp_s, 0.0), 1.0)
        return speed_m_s * (u - math.sin(2 * math.pi * u) / (2 * math.pi))

    def tangential(t):
        u = (t - rest_s) / ramp_s
        return speed_m_s / ramp_s * (1 - math.cos(2 * math.pi * u)) if 0 < u < 1 else 0.0

    grid = np.arange(0.0, duration_s + 0.0005, 0.001)
    v = np.array([speed(t) for t in grid])
    heading = np.concatenate(([0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) / radius_m) * 0.001))
    vn, ve = v * np.cos(heading), v * np.sin(heading)
    north = radius_m * np.sin(heading)  # ds = r dψ: integrated exactly
    east = radius_m * (1 - np.cos(heading))

    def truth(t):
        return tuple(float(np.interp(t, grid, a)) for a in (north, east, vn, ve, heading))

    earth_n, earth_d = EARTH * math.cos(math.radians(LAT_DEG)), -EARTH * math.sin(math.radians(LAT_DEG))
    for k in range(round(duration_s * rate_hz) + 1):
        t = k / rate_hz
        psi, s = truth(t)[4], speed(t)
        rate = s / radius_m
        gyro = np.array([earth_n * math.cos(psi), -earth_n * math.sin(psi), earth_d + rate]) + gyro_bias
        accel = np.array([tangential(t), s * rate, -G_M_S2]) + accel_bias
        gyro = gyro + noise * 1e-3 * rng.standard_normal(3)
        accel = accel + noise * 2e-2 * rng.standard_normal(3)
        stream.add(Kind.IMU, t, [*gyro, *accel])
    for k in range(round(duration_s * gnss_hz)):
        t = k / gnss_hz
        n, e, a, b, _ = truth(t - gnss_delay_s)
        n, e = np.array([n, e]) + noise * 0.02 * rng.standard_normal(2)
        a, b = np.array([a, b]) + noise * 0.03 * rng.standard_normal(2)
        lat, lon = LAT_DEG + n / METRES_PER_DEG_LAT, LON_DEG + e / METRES_PER_DEG_LON
        stream.add(Kind.GNSS, t, [lat, lon, 0.0, a, b, math.nan, 0.1, 0.2, 0.05, 3.0], arrives_s=t + gnss_arrives_s)
    for k in range(round(duration_s * 10)):
        t = k / 10
        psi = truth(t)[4]
        if mag:
            stream.add(Kind.MAG, t, [0.25 * math.cos(psi), -0.25 * math.sin(psi), 0.433])
        if baro:
            stream.add(Kind.BARO, t, [math.nan, 100.0 + noise * 0.05 * rng.standard_normal()])
    return stream, truth


def navigate(block, cut=10**9, **settings):
    """Run the engine over a block cut into pieces; return (t_ns, rows of ins_ekf, results, engine)."""
    told = {"imu_delay_s": 0.0, "mag_delay_s": 0.0, "gnss_delay_s": 0.0, "baro_delay_s": 0.0}
    engine = NavEngine(EngineSettings(**(told | settings)), field_model)
    results = [engine.step(piece) for piece in pieces(block, cut)]
    rows = [lane for result in results for lane in result.lanes if lane.lane == "ins_ekf"]
    return np.concatenate([r.t_ns for r in rows]), np.concatenate([r.data for r in rows]), results, engine


def pieces(block, cut):
    """Cut a block every `cut` rows, or at the given row numbers."""
    edges = list(range(0, len(block.kind), cut)) if isinstance(cut, int) else [0, *sorted(cut)]
    for a, b in zip(edges, [*edges[1:], len(block.kind)], strict=True):
        if b > a:
            yield SampleBlock(
                kind=block.kind[a:b], t_ns=block.t_ns[a:b], t_rx_ns=block.t_rx_ns[a:b], data=block.data[a:b],
                boot_id=block.boot_id,
            )  # fmt: skip


def heading_of(rows):
    """Return heading in rad of LANE_COLUMNS rows."""
    w, x, y, z = rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3]
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

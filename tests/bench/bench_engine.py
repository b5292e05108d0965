"""The whole engine on made data: real-time factor at 1 kHz and 333 Hz, `ins_ekf` alone. Target ≥ 1,000 × at 1 kHz."""

from time import perf_counter

import numpy as np

from server.nav.engine import NavEngine
from server.nav.types import EngineSettings, Kind, SampleBlock


def field(lat_deg, lon_deg, alt_m, decimal_year):
    """A field of half a gauss to the north."""
    return np.array([0.25, 0.0, 0.433]), decimal_year


def pitch(t):
    """Return the pitch angle of the swing, rad."""
    return np.where(t > 5, 0.2 * (1.0 - np.cos(t - 5)), 0.0)


def stream(rate_hz, duration_s, seed=1):
    """Return one block of a board that swings at its place: IMU, magnetometer 50 Hz, baro 20 Hz, GNSS 5 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, duration_s, 1 / rate_hz)
    imu = np.full((len(t), 14), np.nan)
    imu[:, :6] = rng.normal(size=(len(t), 6)) * [1e-3, 1e-3, 1e-3, 0.02, 0.02, 0.02]
    imu[:, 1] += np.where(t > 5, 0.2 * np.sin(t - 5), 0.0)
    imu[:, 3] += 9.806 * np.sin(pitch(t))
    imu[:, 5] -= 9.806 * np.cos(pitch(t))
    parts = [(Kind.IMU, t, imu)]
    for kind, hz, row in (
        (Kind.MAG, 50, [0.25, 0.0, 0.433]),
        (Kind.BARO, 20, [np.nan, 100.0]),
        (Kind.GNSS, 5, [45.0, 10.0, 100.0, 0.0, 0.0, np.nan, 0.5, 0.8, 0.1, 3.0]),
    ):
        when = np.arange(0, duration_s, 1 / hz)
        data = np.full((len(when), 14), np.nan)
        data[:, : len(row)] = row
        if kind == Kind.MAG:
            c, s = np.cos(pitch(when)), np.sin(pitch(when))
            data[:, 0], data[:, 2] = 0.25 * c - 0.433 * s, 0.25 * s + 0.433 * c
        data[:, 1 if kind == Kind.BARO else 0] += rng.normal(size=len(when)) * 1e-7
        parts.append((kind, when, data))
    time_s = np.concatenate([p[1] for p in parts])
    kinds = np.concatenate([np.full(len(p[1]), int(p[0]), dtype=np.uint8) for p in parts])
    order = np.lexsort((kinds == Kind.IMU, time_s))
    t_ns = np.round(time_s[order] * 1e9).astype(np.int64)
    return SampleBlock(kind=kinds[order], t_ns=t_ns, t_rx_ns=t_ns, data=np.concatenate([p[2] for p in parts])[order])


def engine_seconds(block, nav_rate_hz, rows=8192):
    """Return the seconds one engine needs for the stream, fed in blocks."""
    told = {"imu_delay_s": 0.011, "mag_delay_s": 0.05, "gnss_delay_s": 0.098, "baro_delay_s": 0.0}  # an autopilot's
    engine = NavEngine(EngineSettings(lanes=("ins_ekf",), nav_rate_hz=nav_rate_hz, **told), field)
    cuts = [
        SampleBlock(**{name: getattr(block, name)[i : i + rows] for name in ("kind", "t_ns", "t_rx_ns", "data")})
        for i in range(0, len(block.kind), rows)
    ]
    t = perf_counter()
    for cut in cuts:
        engine.step(cut)
    return perf_counter() - t


def main():
    """Print the real-time factors."""
    for rate_hz, nav_rate_hz in ((1000, 50), (333, 50), (1000, 250), (1000, 1000)):
        block = stream(rate_hz, 120.0)
        engine_seconds(block, nav_rate_hz)
        seconds = sorted(engine_seconds(block, nav_rate_hz) for _ in range(5))
        print(
            f"IMU {rate_hz:4d} Hz, navigation {nav_rate_hz:4d} Hz: {120.0 / seconds[2]:6.0f} x real time"
            f" (worst of 5: {120.0 / seconds[-1]:.0f}), {seconds[2] / (120 * rate_hz) * 1e9:.0f} ns a sample"
        )


if __name__ == "__main__":
    main()

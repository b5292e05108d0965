"""What each lane costs: `replay` of a sensor folder, every lane alone and all together, beside the engine without one.

The flight is made: a multirotor's motion with every sensor, IMU at 333 Hz, written as a sensor folder, so reading is
part of it. Targets: every lane ≥ 300 × real time at 333 Hz, `ins_ekf` alone ≥ 1,000 × at 1 kHz, both in engine seconds
(`timing.engine_s`), and reading included not under half of either.

Run by hand: python tests/bench/bench_lanes.py [minutes]. Trust the ratios; the best of a few runs counts.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from server.nav.lanes.registry import LANES, REPEATERS
from server.replay.run import replay
from tests.sets import folder

G_M_S2 = 9.8062
LAT_DEG, LON_DEG = 47.4, 8.5
FIELD_N_GAUSS = np.array([0.214, 0.011, 0.430])
Q30 = 2.0**30
NOTHING = "reference"
"""A repeater: what the engine costs when no lane computes."""
TARGET_333, TARGET_1000 = 300.0, 1000.0
TIMES = 6


def stamps(minutes: float, rate_hz: float) -> np.ndarray:
    """Return stamps in seconds."""
    return np.arange(round(60 * minutes * rate_hz)) / rate_hz


def attitude(t_s: np.ndarray) -> Rotation:
    """A board that is still for 5 s, then swings in roll and pitch and turns."""
    u = np.clip(t_s - 5.0, 0.0, None)
    return Rotation.from_euler("ZYX", np.stack([0.2 * u, 0.2 * np.sin(0.9 * u), 0.25 * np.sin(1.3 * u)], axis=1))


def to_ns(t_s: np.ndarray) -> np.ndarray:
    """Return whole nanoseconds."""
    return np.round(t_s * 1e9).astype(np.int64) + 1_000_000_000


def write_flight(out: Path, minutes: float, imu_hz: float) -> Path:
    """Write the folder: swinging at its place, IMU, magnetometer 50 Hz, baro 20 Hz, GNSS 5 Hz, airspeed, DMP, truth."""
    rng, t = np.random.default_rng(1), stamps(minutes, imu_hz)
    R_nb, h = attitude(t), 1e-3
    gyro = (attitude(t - h).inv() * attitude(t + h)).as_rotvec() / (2 * h) + 1e-3 * rng.standard_normal((len(t), 3))
    accel = R_nb.apply([0.0, 0.0, -G_M_S2], inverse=True) + 2e-2 * rng.standard_normal((len(t), 3))
    folder.write_imu(out, to_ns(t), gyro, accel)
    t = stamps(minutes, 50.0)
    field = attitude(t).apply(FIELD_N_GAUSS, inverse=True) + 1e-3 * rng.standard_normal((len(t), 3))
    folder.write_mag(out, to_ns(t), field)
    q_nb = folder.quat_columns(attitude(t).as_quat(scalar_first=True))
    folder.write_csv(out, "dmp", to_ns(t), {name: np.rint(q * Q30).astype(np.int64) for name, q in q_nb.items()})
    folder.write_csv(out, "reference", to_ns(t), q_nb)
    t = stamps(minutes, 20.0)
    folder.write_csv(out, "baro", to_ns(t), {"altitude_m": 500.0 + 0.06 * rng.standard_normal(len(t))})
    t = stamps(minutes, 10.0)
    folder.write_csv(out, "airspeed", to_ns(t), {"tas_m_s": np.abs(rng.standard_normal(len(t)))})
    t = stamps(minutes, 5.0)
    lla = np.array([LAT_DEG, LON_DEG, 500.0]) + rng.standard_normal((len(t), 3)) * [2e-7, 2e-7, 0.2]
    fixes = folder.position_columns(lla) | folder.velocity_columns(0.03 * rng.standard_normal((len(t), 3)))
    known = {"h_acc_m": 0.3, "v_acc_m": 0.3, "s_acc_m_s": 0.05, "fix_type": 3.0}
    fixes |= {name: np.full(len(t), value) for name, value in known.items()}
    folder.write_csv(out, "gnss", to_ns(t), fixes)
    folder.write_meta(out, "multirotor", site={"date": "2026-11-22"})
    return out


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Best of a few runs: log seconds per engine second, and with reading included."""

    engine: float
    with_reading: float


def cost(log: Path, out: Path, lanes: tuple[str, ...], nav_rate_hz: float, times: int = TIMES) -> Cost:
    """Replay a few times and return the best."""
    engine_s, read_s, duration_s = [], [], 0.0
    for _ in range(times):
        found = replay(log, out, lanes=lanes, nav_rate_hz=nav_rate_hz, overwrite=True)
        engine_s.append(found.timing.engine_s)
        read_s.append(found.timing.read_s)
        duration_s = found.log.duration_s
    return Cost(engine=duration_s / min(engine_s), with_reading=duration_s / (min(engine_s) + min(read_s)))


def line(label: str, found: Cost, empty: Cost, target: float) -> None:
    """Print one row; a missed target is marked."""
    missed = " MISSED" if found.engine < target or found.with_reading < 0.5 * target else ""
    print(
        f"  {label:24s}{found.engine:8.0f} x real time{empty.engine / found.engine:7.1f} x the empty engine"
        f"{found.with_reading:8.0f} x with reading{missed}"
    )


def main(minutes: float) -> None:
    """Print the table of lanes at two navigation rates, then the main lane at 1 kHz."""
    with tempfile.TemporaryDirectory() as place:
        log, out = write_flight(Path(place) / "log", minutes, 333.0), Path(place) / "out"
        computing = [name for name in LANES if name not in REPEATERS]
        for nav_rate_hz in (50.0, 333.0):
            empty = cost(log, out, (NOTHING,), nav_rate_hz)
            print(f"IMU 333 Hz, navigation {nav_rate_hz:.0f} Hz, {minutes:g} min; empty engine {empty.engine:,.0f} x")
            for name in computing:
                line(name, cost(log, out, (name,), nav_rate_hz), empty, TARGET_333)
            line("all together", cost(log, out, LANES, nav_rate_hz), empty, TARGET_333)
        log = write_flight(Path(place) / "fast", minutes, 1000.0)
        for nav_rate_hz in (50.0, 1000.0):
            empty = cost(log, out, (NOTHING,), nav_rate_hz)
            print(f"IMU 1000 Hz, navigation {nav_rate_hz:.0f} Hz; empty engine {empty.engine:,.0f} x")
            line("ins_ekf", cost(log, out, ("ins_ekf",), nav_rate_hz), empty, TARGET_1000)


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 5.0)

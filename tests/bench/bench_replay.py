"""Reading and writing the tables of `replay` beside the usual ways, and the engine beside real time.

Run by hand: python tests/bench/bench_replay.py [minutes]. Trust the ratios, not the times.
"""

from __future__ import annotations

import csv
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from server.nav.types import LANE_COLUMNS
from server.replay.csv_in import read_table
from server.replay.csv_out import csv_lines
from server.replay.run import replay
from server.replay.tables import TABLES
from tests.replay.sensor_folders import static_board

IMU = next(table for table in TABLES if table.stem == "imu")


def best_s(work: Callable[[], object], times: int = 3) -> float:
    """Return the shortest of a few runs."""

    def once() -> float:
        start = time.perf_counter()
        work()
        return time.perf_counter() - start

    return min(once() for _ in range(times))


def with_csv_module(path: Path) -> list[list[float]]:
    with path.open() as file:
        rows = csv.reader(file)
        next(rows)
        return [[int(row[0]), *map(float, row[1:])] for row in rows]


def write_with_csv_module(path: Path, t_ns: np.ndarray, data: np.ndarray) -> None:
    with path.open("w") as file:
        csv.writer(file).writerows([t, *row] for t, row in zip(t_ns.tolist(), data.tolist(), strict=True))


def main(minutes: float) -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = static_board(Path(place) / "log", duration_s=60 * minutes, imu_hz=1000.0)
        path = folder / "imu.csv"
        ours_s = best_s(lambda: read_table(path, IMU))
        print(f"read imu.csv, {path.stat().st_size / 1e6:.0f} MB: {ours_s:.2f} s")
        for name, work in (
            ("numpy.loadtxt", lambda: np.loadtxt(path, delimiter=",", skiprows=1)),
            ("csv + float()", lambda: with_csv_module(path)),
        ):
            print(f"  {name}: {best_s(work, 1) / ours_s:.1f} x as long")
        t_ns, data = np.arange(30_000) * 20_000_000, np.random.default_rng(0).normal(size=(30_000, len(LANE_COLUMNS)))
        data[:, LANE_COLUMNS.index("status")] = 2
        ours_s = best_s(lambda: (Path(place) / "a.csv").write_bytes(csv_lines(t_ns, data)))
        other_s = best_s(lambda: write_with_csv_module(Path(place) / "b.csv", t_ns, data), 1)
        print(f"write 30,000 lane rows: {ours_s:.2f} s; csv.writer {other_s / ours_s:.1f} x as long")
        for _ in range(3):
            timing = replay(folder, Path(place) / "out", lanes=["ins_ekf"]).timing
            print(
                f"ins_ekf of 1 kHz data: engine {timing.engine_s:.2f} s = {timing.real_time_factor:,.0f} x real time; ",
                end="",
            )
            print(f"read {timing.read_s:.2f} s, write {timing.write_s:.2f} s")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)

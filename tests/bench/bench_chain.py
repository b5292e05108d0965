"""What the preprocessing chain costs a sample: each setting against the engine with none, in turns. IMU at 1 kHz."""

import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from server.chain_values import chain_values
from server.nav.calibration.applied import Calibration
from server.nav.engine import NavEngine
from server.nav.types import EngineSettings, SampleBlock

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # what the tests have too
from tests.bench.bench_engine import field, stream

TOLD = {"imu_delay_s": 0.011, "mag_delay_s": 0.05, "gnss_delay_s": 0.098, "baro_delay_s": 0.0}
CALIBRATION = Calibration(gyro_offset=np.array([1e-3, 0.0, 0.0]), mag_offset=np.array([0.01, 0.0, 0.0]))
WAYS = {
    "nothing": ((), None),
    "calibration": ((), CALIBRATION),
    "Butterworth 2 on gyro and accelerometer": (("imu.butterworth_hz=40",), None),
    "Butterworth 4 on gyro and accelerometer": (("imu.butterworth_hz=40", "imu.butterworth_order=4"), None),
    "window of 16 on gyro and accelerometer": (("imu.window_samples=16",), None),
    "everything on everything": (
        (
            "imu.butterworth_hz=40", "imu.lowpass_hz=80", "imu.window_samples=3", "gyro.limit_rad_s=5",
            "accel.limit_m_s2=50", "mag.lowpass_hz=10", "baro.window_samples=3",
        ),
        CALIBRATION,
    ),
}  # fmt: skip


def seconds(block, texts, calibration):
    """Return the seconds of one engine over the whole block, in blocks of 8192 samples."""
    settings = EngineSettings(lanes=("ins_ekf",), chain=chain_values(texts), calibration=calibration, **TOLD)
    engine = NavEngine(settings, field)
    names = ("kind", "t_ns", "t_rx_ns", "data")
    cuts = [SampleBlock(**{n: getattr(block, n)[i : i + 8192] for n in names}) for i in range(0, len(block.kind), 8192)]
    begin = perf_counter()
    for cut in cuts:
        engine.step(cut)
    return perf_counter() - begin


def main():
    """Print nanoseconds a sample and the ratio to the engine without a chain; the best of 15 rounds in turns."""
    block = stream(1000, 20.0)
    best = dict.fromkeys(WAYS, float("inf"))
    for _ in range(15):
        for name, (texts, calibration) in WAYS.items():
            best[name] = min(best[name], seconds(block, texts, calibration))
    for name, one in best.items():
        print(f"{name:42s} {one / 20_000 * 1e9:6.0f} ns a sample, {one / best['nothing']:.2f} x")


if __name__ == "__main__":
    main()

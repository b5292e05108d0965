"""The library's filter behind the lane: the same answer as run directly, at any step length and field rate."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vqf import VQF  # type: ignore[import-untyped]  # it ships stubs, but no py.typed

from server.nav.engine import NavEngine
from server.nav.types import EngineSettings, Kind, SampleBlock
from tests.nav.attitude_laws import errors_deg, rms, run, tumbling
from tests.nav.synthetic import G_M_S2, Stream, field_model
from tests.sets import broad

NED_FROM_ENU = Rotation.from_matrix([[0, 1, 0], [1, 0, 0], [0, 0, -1]])


def as_block(recorded):
    """All samples of a trial as the sensor gave them; its own axes serve as the body's."""
    t_ns = np.repeat(broad.stamps_ns(recorded), 2)
    data = np.full((len(t_ns), 14), math.nan)
    data[0::2, :3] = recorded["imu_mag"] * broad.GAUSS_PER_MICROTESLA
    data[1::2, :3], data[1::2, 3:6] = recorded["imu_gyr"], recorded["imu_acc"]
    kind = np.tile(np.array([Kind.MAG, Kind.IMU], dtype=np.uint8), len(t_ns) // 2)
    return SampleBlock(kind=kind, t_ns=t_ns, t_rx_ns=t_ns, data=data)


def directly(recorded):
    """q_nb of the library at the full rate, its gyro samples the means over each interval, as the steps take them."""
    gyro, accel, mag = (np.ascontiguousarray(recorded[name]) for name in ("imu_gyr", "imu_acc", "imu_mag"))
    gyro[1:] = 0.5 * (gyro[1:] + gyro[:-1])
    q = VQF(1.0 / float(recorded["sampling_rate"].item())).updateBatch(gyro, accel, mag)["quat9D"]
    return NED_FROM_ENU * Rotation.from_quat(q, scalar_first=True)


@pytest.mark.parametrize("trial", [1, 15, 21, 28])
def test_at_50_hz_it_is_the_library_at_the_full_rate(shared_data: Path, trial: int) -> None:
    recorded = broad.load(shared_data, trial)
    (rows,) = NavEngine(EngineSettings(lanes=("vqf",)), field_model).step(as_block(recorded)).lanes
    at = np.searchsorted(broad.stamps_ns(recorded), rows.t_ns)
    apart = Rotation.from_quat(rows.data[:, :4], scalar_first=True) * directly(recorded)[at].inv()
    assert math.degrees(rms(apart.magnitude())) < 0.1


def test_a_slow_imu_is_counted_with_its_own_period():
    block = tumbling(rate_hz=50.0, noise=0.0, bias=(0.01, 0.0, -0.01)).block()
    at_50, at_500 = (run(block, "vqf", nav_rate_hz=rate)[1] for rate in (50.0, 500.0))
    later = 1000
    apart = np.abs(np.sum(at_50[later:, :4] * at_500[-len(at_50) + later :, :4], axis=1))
    assert np.degrees(2 * np.arccos(np.minimum(1.0, apart))).max() < 0.3
    np.testing.assert_allclose(at_500[-1, 19:22], at_50[-1, 19:22], atol=2e-3)


def test_a_slow_field_is_held_in_the_local_frame():
    t, rows, _ = run(tumbling(mag_hz=2.0, noise=0.0).block(), "vqf")
    assert errors_deg(t, rows, after_s=12.0)[1].max() < 0.2


def test_without_a_field_the_heading_starts_at_zero_and_only_drifts():
    block = tumbling(mag_hz=0.0).block()
    t, rows, _ = run(block, "vqf")
    tilt, heading = errors_deg(t, rows, after_s=1.0)
    assert rms(tilt) < 0.3
    assert abs(heading.mean() - math.degrees(0.3)) < 0.5  # the scene starts at 0.3 rad
    assert np.ptp(heading) < 1.0


def test_a_field_that_stops_leaves_the_heading_where_it_was():
    stream = tumbling(noise=0.0)
    stream.rows = [row for row in stream.rows if row[3] != Kind.MAG or row[4] < 20.0]
    t, rows, _ = run(stream.block(), "vqf")
    assert errors_deg(t, rows, after_s=21.5)[1].max() < 0.5


def test_a_bias_at_rest_is_found():
    stream = Stream()
    for k in range(1000):
        stream.add(Kind.IMU, k / 50.0, [0.01, -0.012, 0.008, 0.0, 0.0, -G_M_S2])
    np.testing.assert_allclose(run(stream.block(), "vqf")[1][-1, 19:22], [0.01, -0.012, 0.008], atol=5e-4)


def test_switches_and_time_constants_act_live_and_keep_the_state():
    _, rows, engine = run(tumbling(bias=(0.01, 0.0, 0.0)).block(), "vqf")
    values = {"tau_accel_s": 30.0, "tau_mag_s": 1.0, "motion_bias": 0.0, "rest_bias": 0.0, "mag_rejection": 0.0}
    engine.set_lane_parameters("vqf", values)
    more = Stream()
    for k in range(200):
        more.rows.append((0.0, True, k, Kind.IMU, 40.005 + 0.005 * k, [0.05, 0.0, 0.0, 0.0, 0.0, -G_M_S2]))
    after = engine.step(more.block()).lanes[0].data
    assert 2 * math.acos(min(1.0, abs(rows[-1, :4] @ after[0, :4]))) < 0.05
    np.testing.assert_array_equal(after[:, 19:22], np.tile(rows[-1, 19:22], (len(after), 1)))

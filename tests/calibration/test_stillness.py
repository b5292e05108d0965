"""Blocks and still runs: the same for every cut, rate and unit; a gap ends a pose and keeps the others."""

import json
from pathlib import Path

import numpy as np
import pytest

from server.nav.calibration.poses import PoseCollector
from server.nav.calibration.types import Options
from server.nav.types import Float, Int, Kind
from tests.calibration.imu_made import GRAVITY, faces_stream, poses_stream, spread_directions, table


def fed(t_ns: Int, rows: Float, **options: object) -> PoseCollector:
    """Return a collector that has seen this stream in one piece."""
    collector = PoseCollector(Options(**options))  # type: ignore[arg-type]  # options by name, of several types
    collector.feed(Kind.IMU, t_ns, rows)
    return collector


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 102.4, 333.0, 1000.0])
@pytest.mark.parametrize("with_gyro", [True, False])
@pytest.mark.parametrize("noise", [0.005, 0.1])
def test_every_held_pose_is_found_once_at_every_rate(rate_hz: float, with_gyro: bool, noise: float) -> None:
    rng = np.random.default_rng(5)
    ups = spread_directions(8, rng)
    t_ns, force, rate = poses_stream(rng, ups, rate_hz, hold_s=3.0)
    accel = force + rng.normal(0.0, noise, force.shape)
    gyro = rate + rng.normal(0.0, 0.005, rate.shape) if with_gyro else None
    for unit, factor, shift in (("si", 1.0, 0.0), ("raw", 208.0, 32768.0)):
        found = fed(t_ns, table(gyro, accel * factor + shift, len(t_ns)), unit=unit).poses
        means = (np.array([pose.accel for pose in found]) - shift) / factor
        assert len(found) == len(ups)
        assert np.max(np.abs(means - GRAVITY * ups)) < 0.03 + 4.0 * noise / np.sqrt(rate_hz)


@pytest.mark.parametrize("step", [1, 7, 333])
def test_where_the_stream_is_cut_changes_no_bit(step: int) -> None:
    rng = np.random.default_rng(6)
    t_ns, force, rate = faces_stream(rng)
    rows = table(rate, force + rng.normal(0.0, 0.03, force.shape), len(t_ns))
    rows[40:45] = np.nan
    whole, cut = fed(t_ns, rows), PoseCollector(Options())
    for at in range(0, len(t_ns), step):
        cut.feed(Kind.IMU, t_ns[at : at + step], rows[at : at + step])
    for a, b in zip(whole.poses, cut.poses, strict=True):
        assert a.accel.tobytes() == b.accel.tobytes()
        assert a.sigma.tobytes() == b.sigma.tobytes()
        assert (a.t0_ns, a.t1_ns, a.samples) == (b.t0_ns, b.t1_ns, b.samples)
    assert len(whole.poses) == 6


def test_a_hole_and_a_step_back_in_time_end_the_open_pose_only() -> None:
    rng = np.random.default_rng(7)
    t_ns, force, rate = faces_stream(rng, hold_s=3.0)
    rows = table(rate, force + rng.normal(0.0, 0.02, force.shape), len(t_ns))
    late = t_ns.copy()
    last_pose = len(t_ns) - 100  # the last second of the sixth pose
    late[last_pose:] += 5_000_000_000
    before = fed(t_ns[:last_pose], rows[:last_pose])
    after = fed(late, rows)
    assert [pose.t0_ns for pose in after.poses[:6]] == [pose.t0_ns for pose in before.poses[:6]]
    rebooted = t_ns.copy()
    rebooted[last_pose:] -= int(t_ns[last_pose])
    assert len(fed(rebooted, rows).poses) >= 6


def test_steady_turning_is_not_a_pose() -> None:
    rate_hz, turn_rad_s = 100.0, 0.2
    angle = turn_rad_s * np.arange(2000) / rate_hz
    force = GRAVITY * np.column_stack([np.sin(angle), np.zeros(2000), -np.cos(angle)])
    noisy = force + np.random.default_rng(8).normal(0.0, 0.02, force.shape)
    t_ns = (np.arange(2000) * 10_000_000).astype(np.int64)
    assert fed(t_ns, table(None, noisy, 2000)).poses == []


def test_a_recorded_session_shows_its_nine_poses_inside_the_published_ranges(shared_data: Path) -> None:
    folder = shared_data / "imucal_ferraris"
    data = np.loadtxt(folder / "example_ferraris_session.csv", delimiter=",", skiprows=1)
    listed = json.loads((folder / "example_ferraris_session_list.json").read_text())
    t_ns = np.round(data[:, 0] / 102.4 * 1e9).astype(np.int64)
    for unit in ("si", "raw"):
        for gyro in (np.radians(data[:, 1:4]), None):
            poses = fed(t_ns, table(gyro, data[:, 4:7], len(data)), unit=unit).poses
            for name in ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a"):
                a, b = listed[name]["start"], listed[name]["end"]
                overlapping = [p for p in poses if p.first < b and p.first + p.samples > a]
                assert len(overlapping) == 1
                assert np.max(np.abs(overlapping[0].accel - data[a:b, 4:7].mean(axis=0))) < 0.01


def test_adc_counts_around_32768_show_their_thirty_odd_poses(shared_data: Path) -> None:
    data = np.loadtxt(shared_data / "imu_tk_xsens" / "xsens_acc.mat")
    t_ns = np.round(data[:, 0] * 1e9).astype(np.int64)
    poses = fed(t_ns, table(None, data[:, 1:], len(data)), unit="raw").poses
    assert 36 <= len(poses) <= 40  # 37 after 50 s of rest, as the set says
    assert (poses[0].t1_ns - poses[0].t0_ns) * 1e-9 > 45.0


def test_a_sensor_at_its_stop_is_saturated_and_a_coarse_one_is_not() -> None:
    rng = np.random.default_rng(9)
    t_ns, force, _ = faces_stream(rng)
    noisy = force + rng.normal(0.0, 0.05, force.shape)
    clipped = np.clip(noisy, -9.78, 9.78)
    coarse = np.round(noisy / 0.15) * 0.15
    assert fed(t_ns, table(None, clipped, len(t_ns))).saturated() > 0.3
    assert fed(t_ns, table(None, noisy, len(t_ns))).saturated() == 0.0
    assert fed(t_ns, table(None, coarse, len(t_ns))).saturated() == 0.0

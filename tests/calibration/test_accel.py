"""The accelerometer from six faces and from any poses: recovery, laws, a second method, refusals."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from server.nav.calibration.codes import FAILURES
from server.nav.calibration.multi_pose import MultiPose, triangular
from server.nav.calibration.six_position import SixPosition
from server.nav.calibration.types import FACES, Fit, Options
from server.nav.types import Float, Int, Kind
from tests.calibration.imu_made import (
    GRAVITY,
    S0_MATRIX,
    S0_OFFSET,
    UP,
    faces_stream,
    poses_stream,
    read,
    spread_directions,
    table,
)


def polar(matrix: Float) -> Float:
    """Return the symmetric matrix of the same lengths."""
    _, values, turned = np.linalg.svd(matrix)
    return np.asarray(turned.T @ np.diag(values) @ turned)


def six(t_ns: Int, accel: Float, **options: object) -> Fit:
    collector = SixPosition(Options(**options))  # type: ignore[arg-type]  # options by name, of several types
    collector.feed(Kind.IMU, t_ns, table(None, accel, len(t_ns)))
    return collector.fit()


def multi(t_ns: Int, accel: Float, **options: object) -> Fit:
    collector = MultiPose(Options(**options))  # type: ignore[arg-type]  # options by name, of several types
    collector.feed(Kind.IMU, t_ns, table(None, accel, len(t_ns)))
    return collector.fit()


@pytest.mark.parametrize("placement_deg", [0.0, 1.0, 2.0])
def test_six_faces_give_the_theses_matrix_and_offset_back_within_three_sigma(placement_deg: float) -> None:
    """S0's T and offset through noise, 40 boards: of 480 numbers hardly one is outside 3σ."""
    outside, spread = 0, []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        order = list(rng.permutation(6))
        t_ns, force, _ = faces_stream(rng, rate_hz=50.0, placement_rad=np.radians(placement_deg), order=order)
        fit = six(t_ns, read(force, S0_MATRIX, S0_OFFSET, 0.03, rng))
        assert fit.ok
        z = np.concatenate([
            (fit.parameters["offset"] - S0_OFFSET) / fit.sigma["offset"],
            ((fit.parameters["matrix"] - S0_MATRIX) / fit.sigma["matrix"]).ravel(),
        ])  # fmt: skip
        outside += int(np.sum(np.abs(z) > 3.0))
        spread.append(z)
    assert outside <= 0.01 * 480
    assert np.sqrt(np.mean(np.square(spread))) < 1.2
    if placement_deg == 1.0:  # the belief's own size: sigma must not be a fairy tale on the other side either
        assert np.sqrt(np.mean(np.square(spread))) > 0.4


@pytest.mark.parametrize("poses", [9, 14, 24])
def test_any_poses_give_offset_and_symmetric_matrix_back_within_three_sigma(poses: int) -> None:
    truth, offset = polar(S0_MATRIX), S0_OFFSET + 0.3
    outside, spread = 0, []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        t_ns, force, _ = poses_stream(rng, spread_directions(poses, rng)[rng.permutation(poses)], 50.0)
        fit = multi(t_ns, read(force, truth, offset, 0.05, rng))
        assert fit.ok
        z = np.concatenate([
            (fit.parameters["offset"] - offset) / fit.sigma["offset"],
            ((fit.parameters["matrix"] - truth) / fit.sigma["matrix"]).ravel(),
        ])  # fmt: skip
        outside += int(np.sum(np.abs(z) > 3.0))
        spread.append(z)
    assert outside <= 0.015 * 30 * 12
    assert 0.3 < np.sqrt(np.mean(np.square(spread))) < 1.3


def test_counts_of_any_offset_and_size_give_the_same_calibration_as_si() -> None:
    rng = np.random.default_rng(3)
    t_ns, force, _ = faces_stream(rng, placement_rad=0.02)
    si = read(force, S0_MATRIX, S0_OFFSET, 0.02, rng)
    fit, raw = six(t_ns, si), six(t_ns, si * 417.0 + 32768.0, unit="raw")
    np.testing.assert_allclose(raw.parameters["matrix"] * 417.0, fit.parameters["matrix"], atol=1e-4)
    np.testing.assert_allclose((raw.parameters["offset"] - 32768.0) / 417.0, fit.parameters["offset"], atol=1e-3)
    in_g = six(t_ns, si / GRAVITY, unit="raw", gravity_m_s2=1.0)
    np.testing.assert_allclose(in_g.parameters["matrix"], fit.parameters["matrix"], atol=1e-4)


def test_the_order_of_the_faces_changes_only_rounding() -> None:
    rng = np.random.default_rng(4)
    t_ns, force, _ = faces_stream(rng)
    accel = read(force, S0_MATRIX, S0_OFFSET, 0.02, rng)
    ranges = [(400 * i + 20, 400 * i + 230) for i in range(6)]
    rows = table(None, accel, len(t_ns))
    forward = SixPosition(Options()).fit_ranges(t_ns, rows, ranges)
    backward = SixPosition(Options()).fit_ranges(t_ns, rows, ranges[::-1])
    np.testing.assert_allclose(forward.parameters["matrix"], backward.parameters["matrix"], atol=1e-7)
    np.testing.assert_allclose(forward.parameters["offset"], backward.parameters["offset"], atol=1e-6)


def test_a_turned_sensor_turns_offset_and_symmetric_matrix_with_it() -> None:
    rng = np.random.default_rng(5)
    t_ns, force, _ = poses_stream(rng, spread_directions(16, rng))
    accel = read(force, polar(S0_MATRIX), S0_OFFSET + 0.2, 0.02, rng)
    turn = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()
    fit, turned = multi(t_ns, accel), multi(t_ns, accel @ turn.T)
    np.testing.assert_allclose(turned.parameters["offset"], turn @ fit.parameters["offset"], atol=2e-4)
    np.testing.assert_allclose(turned.parameters["matrix"], turn @ fit.parameters["matrix"] @ turn.T, atol=2e-5)


def test_one_pose_that_is_wrong_does_not_bend_the_others() -> None:
    rng = np.random.default_rng(6)
    t_ns, force, _ = poses_stream(rng, spread_directions(16, rng))
    accel = read(force, polar(S0_MATRIX), S0_OFFSET, 0.02, rng)
    bad = accel.copy()
    bad[2000:2250] *= 1.04  # the sixth pose: pushed while it was held
    good, fit = multi(t_ns, accel), multi(t_ns, bad)
    assert fit.details["poses_rejected"] == 1.0
    np.testing.assert_allclose(fit.parameters["offset"], good.parameters["offset"], atol=0.01)
    np.testing.assert_allclose(fit.parameters["matrix"], good.parameters["matrix"], atol=0.002)


def test_the_recorded_six_positions_leave_less_than_the_theses_limit(shared_data: Path) -> None:
    folder = shared_data / "imucal_ferraris"
    data = np.loadtxt(folder / "example_ferraris_session.csv", delimiter=",", skiprows=1)
    listed = json.loads((folder / "example_ferraris_session_list.json").read_text())
    names = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a")
    ranges = [(listed[name]["start"], listed[name]["end"]) for name in names]
    t_ns, accel = np.round(data[:, 0] / 102.4 * 1e9).astype(np.int64), data[:, 4:7]
    given = SixPosition(Options()).fit_ranges(t_ns, table(None, accel, len(data)), ranges)
    found = six(t_ns, accel)
    means = np.array([accel[a:b].mean(axis=0) for a, b in ranges])
    middle = np.array([(means[2 * i, i] + means[2 * i + 1, i]) / 2.0 for i in range(3)])  # S0 (3.7) by hand
    for fit in (given, found):
        matrix, offset = np.asarray(fit.parameters["matrix"]), np.asarray(fit.parameters["offset"])
        assert np.max(np.abs(np.linalg.norm((means - offset) @ matrix.T, axis=1) - GRAVITY)) < 0.02
        assert np.max(np.abs(offset - middle)) < 0.01
        assert fit.residual_before is not None
        assert fit.residual_before.value > 0.4


def test_the_recorded_adc_counts_agree_with_a_second_method(shared_data: Path) -> None:
    """Against scipy on plain means of the poses with an upper triangular matrix, as imu_tk has it."""
    gravity = 9.81744
    data = np.loadtxt(shared_data / "imu_tk_xsens" / "xsens_acc.mat")
    t_ns = np.round(data[:, 0] * 1e9).astype(np.int64)
    collector = MultiPose(Options(unit="raw", gravity_m_s2=gravity))
    collector.feed(Kind.IMU, t_ns, table(None, data[:, 1:], len(data)))
    fit, points = collector.fit(), collector.progress().points

    def left(x: Float) -> Float:
        upper = np.array([[x[0], x[3], x[4]], [0.0, x[1], x[5]], [0.0, 0.0, x[2]]]) / 416.0
        return np.asarray(np.linalg.norm((points - 32768.0 - 416.0 * x[6:]) @ upper.T, axis=1) - gravity)

    x = least_squares(left, [gravity / 10.0] * 3 + [0.0] * 6).x
    upper = np.array([[x[0], x[3], x[4]], [0.0, x[1], x[5]], [0.0, 0.0, x[2]]]) / 416.0
    scale = upper[0, 0]
    assert np.max(np.abs(triangular(np.asarray(fit.parameters["matrix"])) - upper)) < 0.001 * scale
    assert np.max(np.abs(np.asarray(fit.parameters["offset"]) - 32768.0 - 416.0 * x[6:])) * scale < 0.001 * gravity
    assert fit.residual_after is not None
    assert fit.residual_after.value < 0.01
    assert fit.grade == "good"


@pytest.mark.parametrize("rate_hz", [50.0, 1000.0])
def test_a_shaking_hand_and_bumps_cost_little(rate_hz: float) -> None:
    rng = np.random.default_rng(8)
    t_ns, force, _ = faces_stream(rng, rate_hz=rate_hz, placement_rad=np.radians(2.0), hold_s=4.0)
    tremor = 0.2 * np.sin(2.0 * np.pi * 9.0 * t_ns[:, None] * 1e-9 + np.arange(3))
    accel = read(force + tremor, S0_MATRIX, S0_OFFSET, 0.03, rng)
    accel[int(2.0 * rate_hz) : int(2.05 * rate_hz)] += 4.0
    fit = six(t_ns, accel)
    assert fit.ok
    assert np.max(np.abs(np.asarray(fit.parameters["offset"]) - S0_OFFSET)) < 0.01 * GRAVITY
    assert np.max(np.abs(np.diag(np.asarray(fit.parameters["matrix"])) - np.diag(S0_MATRIX))) < 0.005


def refusal(fit: Fit) -> str:
    assert fit.failure is not None
    assert fit.failure.code in FAILURES
    assert fit.parameters == {}
    return fit.failure.code


def test_what_cannot_be_fitted_is_refused_with_its_reason() -> None:
    rng = np.random.default_rng(9)
    t_ns, force, _ = faces_stream(rng)
    noisy = force + rng.normal(0.0, 0.02, force.shape)
    assert refusal(six(t_ns[:0], noisy[:0])) == "no-data"
    assert refusal(six(t_ns[:1800], noisy[:1800])) == "pose-missing"
    assert refusal(six(t_ns, noisy * 0.5)) == "gravity"
    assert refusal(six(t_ns, np.clip(noisy, -9.79, 9.79))) == "saturated"
    assert refusal(six(t_ns, noisy + 3.0 * np.sin(np.arange(len(t_ns)) * 0.5)[:, None])) == "motion"
    assert refusal(multi(t_ns, noisy)) == "too-few-poses"
    cone = np.array([[np.sin(0.3) * np.cos(a), np.sin(0.3) * np.sin(a), np.cos(0.3)] for a in np.arange(12) * 2.4])
    t_ns, force, _ = poses_stream(rng, cone)
    assert refusal(multi(t_ns, force + rng.normal(0.0, 0.02, force.shape))) == "poses-alike"


def test_poses_far_from_an_axis_are_no_faces() -> None:
    rng = np.random.default_rng(10)
    ups = np.vstack([UP, Rotation.from_euler("y", 30.0, degrees=True).apply(UP[:1])])
    t_ns, force, _ = poses_stream(rng, ups)
    fit = six(t_ns, force + rng.normal(0.0, 0.02, force.shape))
    assert fit.details["poses_off_axis"] == 1.0
    t_ns, force, _ = poses_stream(rng, ups[1:])  # the tilted one in place of nose-up
    assert refusal(six(t_ns, force + rng.normal(0.0, 0.02, force.shape))) == "pose-missing"


def test_progress_names_the_faces_done_and_the_way_to_the_next() -> None:
    rng = np.random.default_rng(11)
    t_ns, force, _ = faces_stream(rng, order=[5, 0, 3, 1, 2, 4])
    collector = SixPosition(Options())
    rows = table(None, force + rng.normal(0.0, 0.02, force.shape), len(t_ns))
    fractions, seen = [], []
    for at in range(0, len(t_ns), 20):
        collector.feed(Kind.IMU, t_ns[at : at + 20], rows[at : at + 20])
        progress = collector.progress()
        fractions.append(progress.fraction)
        seen.append(progress.faces)
        if not all(progress.faces):
            assert not progress.faces[FACES.index(progress.face_next)]
            assert np.linalg.norm(progress.pose_target_b) == pytest.approx(1.0)
    assert seen[20] == (False, False, False, False, False, True)
    assert collector.progress().is_complete
    assert fractions[-1] == 1.0
    assert np.min(np.diff(np.maximum.accumulate(fractions))) >= 0.0
    assert 0.4 < fractions[len(fractions) // 2] < 0.7


def test_the_result_verifies_on_fresh_poses_and_a_wrong_one_does_not() -> None:
    rng = np.random.default_rng(12)
    t_ns, force, _ = faces_stream(rng)
    fit = six(t_ns, read(force, S0_MATRIX, S0_OFFSET, 0.02, rng))
    t_ns, force, _ = poses_stream(rng, spread_directions(5, rng))
    fresh = SixPosition(Options())
    fresh.feed(Kind.IMU, t_ns, table(None, read(force, S0_MATRIX, S0_OFFSET, 0.02, rng), len(t_ns)))
    assert fresh.check(fit.parameters).ok
    assert not fresh.check({"matrix": np.eye(3), "offset": np.zeros(3)}).ok

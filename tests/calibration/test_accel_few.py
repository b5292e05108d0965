"""Accelerometer poses of few samples, coarse sensors, boards turned in their box, and what is refused among them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.calibration.accel_faces import turned_faces
from server.nav.calibration.multi_pose import MultiPose
from server.nav.calibration.six_position import SixPosition
from server.nav.calibration.types import Fit, Options
from server.nav.types import Float, Kind
from tests.calibration.imu_made import (
    GRAVITY,
    S0_MATRIX,
    S0_OFFSET,
    UP,
    faces_stream,
    read,
    spread_directions,
    table,
)

ORDER = [3, 0, 5, 1, 4, 2]


def taken(collector: SixPosition | MultiPose, accel: Float, each: int) -> Fit:
    """Return the fit of this many samples a pose, one pose after the other."""
    t_ns = (np.arange(len(accel)) * 10_000_000).astype(np.int64)
    ranges = [(a, a + each) for a in range(0, len(accel), each)]
    return collector.fit_ranges(t_ns, table(None, accel, len(accel)), ranges)


def code(fit: Fit) -> str:
    return "" if fit.failure is None else fit.failure.code


@pytest.mark.parametrize("unit", ["si", "raw"])
def test_six_single_samples_give_the_six_positions_and_no_sigma(unit: str) -> None:
    counts = 16384.0 / GRAVITY if unit == "raw" else 1.0
    accel = read(GRAVITY * UP[ORDER], S0_MATRIX, S0_OFFSET, 0.0, np.random.default_rng(1)) * counts
    fit = taken(SixPosition(Options(unit=unit)), accel, 1)  # type: ignore[arg-type]  # parametrized str
    np.testing.assert_allclose(np.asarray(fit.parameters["offset"]) / counts, S0_OFFSET, atol=1e-6)
    np.testing.assert_allclose(np.asarray(fit.parameters["matrix"]) * counts, S0_MATRIX, atol=1e-6)
    assert np.isnan(fit.sigma["offset"]).all()
    assert np.isnan(fit.sigma["matrix"]).all()


@pytest.mark.parametrize("each", [2, 3, 10])
def test_a_few_samples_a_face_share_their_noise_and_are_not_taken_for_a_stop(each: int) -> None:
    z = []
    for seed in range(30):
        force = np.repeat(GRAVITY * UP, each, axis=0)
        accel = read(force, S0_MATRIX, S0_OFFSET, 0.03, np.random.default_rng(seed))
        fit = taken(SixPosition(Options()), accel, each)
        z.append((np.asarray(fit.parameters["offset"]) - S0_OFFSET) / fit.sigma["offset"])
    assert np.mean(np.abs(z) > 3.0) <= 0.02
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.3


@pytest.mark.parametrize(("poses", "noise"), [(12, 0.03), (20, 0.01), (50, 0.01)])
def test_single_samples_of_many_poses_have_the_sigma_of_their_residuals(poses: int, noise: float) -> None:
    z = []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        accel = GRAVITY * spread_directions(poses, rng) + S0_OFFSET + rng.normal(0.0, noise, (poses, 3))
        fit = taken(MultiPose(Options()), accel, 1)
        z.append((np.asarray(fit.parameters["offset"]) - S0_OFFSET) / fit.sigma["offset"])
        z.append(np.diag((np.asarray(fit.parameters["matrix"]) - np.eye(3)) / fit.sigma["matrix"]))
    assert np.mean(np.abs(z) > 3.0) <= 0.02
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.2


@pytest.mark.parametrize(("step_mg", "noise_mg"), [(3.9, 0.0), (3.9, 0.4), (3.9, 4.0)])
def test_the_steps_of_a_coarse_sensor_are_in_the_sigma(step_mg: float, noise_mg: float) -> None:
    """3.9 mg are ±2 g in ten bits; without noise to dither them the mean is wrong by up to half a step."""
    step, z = 1e-3 * step_mg * GRAVITY, []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        t_ns, force, _ = faces_stream(rng, placement_rad=0.01)
        accel = np.round(read(force, S0_MATRIX, S0_OFFSET, 1e-3 * noise_mg * GRAVITY, rng) / step) * step
        collector = SixPosition(Options())
        collector.feed(Kind.IMU, t_ns, table(None, accel, len(t_ns)))
        fit = collector.fit()
        z.append((np.asarray(fit.parameters["offset"]) - S0_OFFSET) / fit.sigma["offset"])
    assert np.mean(np.abs(z) > 3.0) <= 0.02
    assert 0.3 < np.sqrt(np.mean(np.square(z))) < 1.2


@pytest.mark.parametrize("turned_deg", [25.0, 38.0])
def test_a_board_turned_in_its_box_gives_a_matrix_that_turns_it_back(turned_deg: float) -> None:
    R_sb = Rotation.from_euler("zyx", [turned_deg, turned_deg / 6.0, 0.0], degrees=True).as_matrix()
    rng = np.random.default_rng(2)
    t_ns, force, _ = faces_stream(rng)
    collector = SixPosition(Options())
    accel = read(force, S0_MATRIX, S0_OFFSET, 0.02, rng) @ R_sb.T
    collector.feed(Kind.IMU, t_ns, table(None, accel, len(t_ns)))
    fit = collector.fit()
    np.testing.assert_allclose(fit.parameters["matrix"], S0_MATRIX @ R_sb.T, atol=2e-3)
    np.testing.assert_allclose(fit.parameters["offset"], R_sb @ S0_OFFSET, atol=0.01)
    assert fit.details["turned_deg"] == pytest.approx(turned_deg, abs=2.0)


def test_poses_that_no_one_turn_explains_stay_no_faces() -> None:
    each_its_own = [Rotation.from_rotvec([0.0, 0.5 * (-1) ** k, 0.3]).apply(up) for k, up in enumerate(UP)]
    assert turned_faces(np.array(each_its_own), np.zeros(3), np.ones(3)) == []
    assert turned_faces(UP[:5], np.zeros(3), np.ones(3)) == []
    assert turned_faces(UP, np.zeros(3), np.ones(3)) == [0, 1, 2, 3, 4, 5]


def test_a_range_with_motion_in_it_is_refused() -> None:
    t_ns, force, _ = faces_stream(np.random.default_rng(4))
    rows = table(None, force + np.random.default_rng(5).normal(0.0, 0.02, force.shape), len(t_ns))
    good = [(400 * k, 400 * k + 250) for k in range(6)]
    assert SixPosition(Options()).fit_ranges(t_ns, rows, good).ok
    bad = SixPosition(Options()).fit_ranges(t_ns, rows, [(a, min(b + 75, len(t_ns))) for a, b in good])
    assert code(bad) == "motion"


def test_a_thousandth_of_a_unit_is_gravity_and_never_still_is_motion() -> None:
    rng = np.random.default_rng(6)
    t_ns, force, _ = faces_stream(rng)
    millimetres = SixPosition(Options())
    millimetres.feed(Kind.IMU, t_ns, table(None, 1e3 * (force + rng.normal(0.0, 0.02, force.shape)), len(t_ns)))
    assert code(millimetres.fit()) == "gravity"
    tumbling = Rotation.from_rotvec(np.cumsum(rng.normal(0.0, 0.05, (6000, 3)), axis=0)).apply([0.0, 0.0, GRAVITY])
    shaken = table(None, tumbling + rng.normal(0.0, 1.0, (6000, 3)), 6000)
    for collector in (SixPosition(Options()), MultiPose(Options())):
        collector.feed(Kind.IMU, (np.arange(6000) * 10_000_000).astype(np.int64), shaken)
        assert code(collector.fit()) == "motion"

"""The magnetometer's offset learned in motion: simulated worlds of which everything is known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.calibration.mag_learning import MagLearner
from server.nav.ekf import layout as at
from tests.calibration.mag_learning_simulation import World, learn, normalised2, simulate

OFFSET = np.array(World().offset)
MAGNET = np.array([-0.03, 0.0, 0.26])
SMALL = np.array([0.02, 0.0, -0.055])
SOFT_IRON = np.eye(3) + 0.03 * np.array([[1.0, 0.5, -0.3], [0.5, -1.0, 0.4], [-0.3, 0.4, 0.6]])
GYRO_MATRIX = np.eye(3) + 0.02 * np.array([[1.0, 0.3, -0.5], [0.2, -1.0, 0.4], [0.5, -0.4, 0.7]])


def put_on(after_s, field):
    return lambda t_s: np.where(t_s[:, None] > after_s, 1.0, 0.0) * field


def swept(after_s, size):
    def room(t_s):
        angle = 2 * np.pi * (0.05 * t_s + 0.002 * (t_s - after_s) ** 2)
        turning = np.stack([np.sin(angle), np.cos(angle), 0.5 * np.sin(2 * np.pi * 0.13 * t_s)], axis=1)
        return np.where(t_s[:, None] > after_s, size, 0.0) * turning

    return room


@pytest.mark.parametrize(
    ("world", "learner"),
    [
        ({}, {}),
        ({"rate_rad_s": 5.0}, {}),
        ({"gyro_bias": (0.0087, -0.0087, 0.0087)}, {}),
        ({"gyro_matrix": GYRO_MATRIX}, {}),
        ({"mag_hz": 10.0}, {}),
        ({"mag_hz": 100.0}, {}),
        ({"delay_s": 0.05}, {}),
        ({"delay_s": 0.05}, {"mag_delay_s": 0.05}),
    ],
)
def test_an_unknown_offset_is_found_in_a_minute(world, learner):
    state = learn(MagLearner(**learner), *simulate(World(**world)))[-1]
    np.testing.assert_allclose(state.offset_gauss, OFFSET, atol=0.003)
    assert state.converged
    assert state.excitation.min() > 0.99
    assert not state.frozen
    assert state.changes == 0
    assert normalised2(state, OFFSET) < 4.0


def test_the_delay_of_the_magnetometer_is_found_along_the_way():
    state = learn(MagLearner(mag_delay_s=0.01), *simulate(World(delay_s=0.05)))[-1]
    assert state.delay_s == pytest.approx(0.04, abs=0.005)


def test_slow_turning_serves_as_well_when_it_lasts():
    state = learn(MagLearner(), *simulate(World(rate_rad_s=0.1, duration_s=300.0)))[-1]
    np.testing.assert_allclose(state.offset_gauss, OFFSET, atol=0.01)
    assert normalised2(state, OFFSET) < 4.0


@pytest.mark.parametrize("uneven", [0.01, 0.02])
def test_sigma_is_honest_where_the_field_is_uneven(uneven):
    worlds = [World(seed=seed, uneven=uneven) for seed in range(16)]
    found = [normalised2(learn(MagLearner(), *simulate(world))[-1], OFFSET) for world in worlds]
    # 48 numbers, whose chi-square bound at 95 % is 0.65 … 1.44 were they Gaussian and independent; noise that recurs
    # with the place is neither
    assert 0.4 < np.mean(found) < 2.0


def test_soft_iron_makes_the_offset_neither_diverge_nor_too_sure():
    errors, ratios = [], []
    for seed in range(8):
        state = learn(MagLearner(), *simulate(World(seed=seed, soft_iron=SOFT_IRON, duration_s=150.0)))[-1]
        errors.append(np.abs(state.offset_gauss - OFFSET).max())
        ratios.append(normalised2(state, OFFSET))
    assert max(errors) < 0.015  # 3 % of the field
    assert np.mean(ratios) < 2.5


def test_at_rest_noise_moves_nothing():
    states = learn(MagLearner(), *simulate(World(rest_s=120.0, duration_s=120.0, gyro_bias=(0.0087, 0.0, -0.0087))))
    for state in states:
        np.testing.assert_array_equal(state.offset_gauss, 0.0)
    assert states[-1].frozen
    assert states[-1].reason == "rest"
    assert not states[-1].converged
    np.testing.assert_array_equal(states[-1].excitation, 0.0)


def test_turning_about_one_axis_leaves_the_offset_along_it_unknown():
    state = learn(MagLearner(), *simulate(World(one_axis=True)))[-1]
    np.testing.assert_allclose(state.offset_gauss[:2], OFFSET[:2], atol=0.005)
    assert state.sigma_gauss[2] > 0.2
    assert state.excitation[2] < 0.2
    assert not state.converged


@pytest.mark.parametrize("magnet", [MAGNET, SMALL])
@pytest.mark.parametrize("seed", range(4))
def test_a_magnet_put_on_in_motion_is_followed_within_half_a_minute(magnet, seed):
    states = learn(MagLearner(), *simulate(World(seed=seed, attached=put_on(30.0, magnet))))
    state = states[-1]
    np.testing.assert_allclose(state.offset_gauss, OFFSET + magnet, atol=0.01)
    assert state.converged
    assert normalised2(state, OFFSET + magnet) < 4.0


def test_a_magnet_put_on_at_rest_is_seen_at_once_and_learned_when_it_moves():
    world = World(rest_s=30.0, duration_s=70.0, attached=put_on(10.0, MAGNET))
    states = learn(MagLearner(offset_gauss=world.offset, sigma_gauss=0.01), *simulate(world))
    resting = [state for state in states if state.t_ns < 30e9]
    for state in resting:
        np.testing.assert_array_equal(state.offset_gauss, OFFSET)
    assert not resting[-1].converged  # it knows that something changed, not what
    assert resting[30].converged
    np.testing.assert_allclose(states[-1].offset_gauss, OFFSET + MAGNET, atol=0.005)
    assert states[-1].converged
    assert states[-1].changes == 1
    assert states[-1].t_changed_ns == pytest.approx(10e9, abs=1e9)


@pytest.mark.parametrize("size", [0.1, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_a_disturbance_that_sweeps_through_the_room_freezes_it(size, seed):
    states = learn(MagLearner(), *simulate(World(seed=seed, room=swept(30.0, size), duration_s=120.0)))
    disturbed = [state for state in states if state.t_ns > 32e9]
    worst = max(np.abs(state.offset_gauss - OFFSET).max() for state in disturbed)
    assert worst < 0.12 * size
    assert sum(state.reason == "room" for state in disturbed) > 0.8 * len(disturbed)
    assert disturbed[-1].changes == 0


def test_another_room_is_not_another_offset():
    step = put_on(30.0, np.array([0.1, 0.05, -0.1]))
    states = learn(MagLearner(), *simulate(World(room=step)))
    assert any(state.reason == "room" for state in states)
    for state in states[200:]:
        np.testing.assert_allclose(state.offset_gauss, OFFSET, atol=0.003)
    assert states[-1].converged
    assert states[-1].changes == 0


@pytest.mark.parametrize("every", [1, 7, 100_000])
def test_where_the_stream_is_cut_changes_nothing(every):
    world = World(attached=put_on(30.0, MAGNET), mag_hz=33.0)
    whole, cut = (learn(MagLearner(), *simulate(world), every=n)[-1] for n in (5, every))
    np.testing.assert_array_equal(whole.offset_gauss, cut.offset_gauss)
    np.testing.assert_array_equal(whole.sigma_gauss, cut.sigma_gauss)
    assert (whole.changes, whole.t_changed_ns, whole.residual_gauss) == (
        cut.changes,
        cut.t_changed_ns,
        cut.residual_gauss,
    )


def test_a_board_mounted_another_way_learns_the_turned_offset():
    steps, meas = simulate(World(uneven=0.01))
    there = Rotation.from_euler("ZYX", [40.0, -70.0, 110.0], degrees=True)
    turned_steps, turned_meas = steps.copy(), meas.copy()
    turned_steps[:, at.U_DTHETA : at.U_DTHETA + 3] = there.apply(steps[:, at.U_DTHETA : at.U_DTHETA + 3])
    turned_meas[:, at.M_DATA : at.M_DATA + 3] = there.apply(meas[:, at.M_DATA : at.M_DATA + 3])
    one, other = learn(MagLearner(), steps, meas)[-1], learn(MagLearner(), turned_steps, turned_meas)[-1]
    np.testing.assert_allclose(other.offset_gauss, there.apply(one.offset_gauss), atol=1e-5)


def test_samples_that_are_no_numbers_are_passed_over():
    steps, meas = simulate(World(duration_s=30.0))
    bad = meas.copy()
    bad[::3, at.M_DATA] = np.nan
    bad[1::30, at.M_DATA : at.M_DATA + 3] = 100.0
    kept = np.isfinite(bad[:, at.M_DATA]) & (np.abs(bad[:, at.M_DATA]) < 10.0)
    with_bad, without = learn(MagLearner(), steps, bad)[-1], learn(MagLearner(), steps, meas[kept])[-1]
    np.testing.assert_array_equal(with_bad.offset_gauss, without.offset_gauss)
    np.testing.assert_array_equal(with_bad.sigma_gauss, without.sigma_gauss)


def test_a_hole_in_which_it_turned_unseen_does_not_move_the_offset():
    steps, meas = simulate(World(duration_s=90.0))
    first, last = 2000, 2150  # 3 s
    joined = np.concatenate([steps[:first], steps[last:]])
    joined[first, at.U_GAP_S] = 3.0
    inside = (meas[:, at.M_STEP] >= first) & (meas[:, at.M_STEP] < last)
    kept = meas[~inside].copy()
    kept[kept[:, at.M_STEP] >= last, at.M_STEP] -= last - first
    for state in learn(MagLearner(), joined, kept)[first // 5 :]:
        np.testing.assert_allclose(state.offset_gauss, OFFSET, atol=0.004)
    assert state.changes == 0


def test_forgetting_starts_from_what_is_given():
    learner = MagLearner()
    learn(learner, *simulate(World(duration_s=20.0)))
    learner.reset((0.1, 0.2, 0.3), 0.02)
    state = learner.state()
    assert state.t_ns == -1
    np.testing.assert_array_equal(state.offset_gauss, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(state.sigma_gauss, 0.02)

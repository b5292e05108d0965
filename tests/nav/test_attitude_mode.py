"""The nine-axis attitude mode: rest, tilt, bias, start, guards, on motions whose truth is known."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.ekf import layout as at
from server.nav.ekf.attitude import layout as cols

from .attitude_mode_motions import (
    BIAS_RAD_S,
    G_M_S2,
    NOISES,
    Motion,
    after,
    attitude_errors,
    run,
    still,
    tilt_deg,
    wobble,
)


def test_rest_gives_attitude_and_gyro_bias_within_their_sigma():
    motion = Motion(20.0, lambda t: np.tile([0.7, 0.3, -0.5], (len(t), 1)), noises={**NOISES, "mag": 0.005})
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    error = attitude_errors(motion, steps, rows)
    assert rows[-1, cols.O_REST] == 1.0
    assert tilt_deg(error)[-1] < 0.05
    assert abs(math.degrees(error[-1, 2])) < 0.5
    np.testing.assert_allclose(rows[-1, cols.O_GYRO_BIAS : cols.O_GYRO_BIAS + 3], BIAS_RAD_S, atol=2e-4)
    late = after(steps, 3.0)
    assert (np.abs(error[late]) < 3 * rows[late, cols.O_ATT_SIGMA : cols.O_ATT_SIGMA + 3]).mean() > 0.99
    bias_error = rows[late, cols.O_GYRO_BIAS : cols.O_GYRO_BIAS + 3] - BIAS_RAD_S
    assert (np.abs(bias_error) < 3 * rows[late, cols.O_BIAS_SIGMA : cols.O_BIAS_SIGMA + 3]).mean() > 0.95


def test_a_start_in_motion_finds_the_attitude_without_ever_resting():
    begun = wobble(-10.0)
    motion = Motion(30.0, begun, path=lambda t: 0.3 * np.stack((np.sin(3 * t), np.sin(4 * t), np.sin(5 * t)), axis=1))
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    error = attitude_errors(motion, steps, rows)
    assert rows[:, cols.O_REST].max() == 0.0
    late = after(steps, 5.0)
    assert tilt_deg(error)[late].max() < 3.0
    assert np.abs(np.degrees(error[late, 2])).max() < 12.0
    assert tilt_deg(error)[after(steps, 20.0)].max() < 1.0
    assert (np.abs(error) < 3 * rows[:, cols.O_ATT_SIGMA : cols.O_ATT_SIGMA + 3]).mean() > 0.97


@pytest.mark.parametrize("turn_deg", [90.0, 180.0, -37.0])
def test_a_scene_that_starts_at_another_heading_gives_the_same_motion_turned(turn_deg):
    """Not exactly: a tilt error makes a heading error that depends on where north lies from it."""
    turn = math.radians(turn_deg)
    one, other = Motion(40.0, wobble(10.0)), Motion(40.0, wobble(10.0), start_heading_rad=turn)
    (steps, meas), (turned_steps, turned_meas) = one.steps(), other.steps()
    rows, _ = run(steps, meas)
    turned, _ = run(turned_steps, turned_meas)
    back = Rotation.from_euler("z", -turn) * Rotation.from_quat(turned[:, [1, 2, 3, 0]])
    apart = (back * Rotation.from_quat(rows[:, [1, 2, 3, 0]]).inv()).magnitude()
    assert np.degrees(apart[after(steps, 5.0)]).max() < 0.3
    both = slice(cols.O_ATT_SIGMA, cols.O_BIAS_SIGMA + 3)
    np.testing.assert_allclose(rows[-1, both][[2, 3, 4, 5]], turned[-1, both][[2, 3, 4, 5]], rtol=0.05)


@pytest.mark.parametrize("nav_rate_hz", [100.0, 200.0])
def test_the_navigation_rate_does_not_change_the_attitude(nav_rate_hz):
    motion = Motion(40.0, wobble(10.0))
    steps, meas = motion.steps(50.0)
    finer, finer_meas = motion.steps(nav_rate_hz)
    rows, _ = run(steps, meas)
    finer_rows, _ = run(finer, finer_meas)
    index = np.searchsorted(finer[:, at.U_T], steps[:, at.U_T])
    same = finer_rows[np.minimum(index, len(finer_rows) - 1)]
    apart = (Rotation.from_quat(rows[:, [1, 2, 3, 0]]).inv() * Rotation.from_quat(same[:, [1, 2, 3, 0]])).magnitude()
    assert np.degrees(apart[after(steps, 5.0)]).max() < 0.3


def test_cutting_the_block_changes_nothing():
    motion = Motion(15.0, wobble(3.0))
    steps, meas = motion.steps()
    whole, _ = run(steps, meas)
    s, parts = None, []
    for begin in range(0, len(steps), 37):
        chosen = meas[(meas[:, at.M_STEP] >= begin) & (meas[:, at.M_STEP] < begin + 37)].copy()
        chosen[:, at.M_STEP] -= begin
        part, s = run(steps[begin : begin + 37], chosen, s)
        parts.append(part)
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_horizontal_translation_does_not_tilt():
    def path(t):
        u = np.clip(t - 10.0, 0.0, None)
        return np.stack((0.25 * np.sin(6.0 * u) * np.minimum(u, 1), 0.2 * np.sin(4.0 * u) * np.minimum(u, 1), 0 * u), 1)

    motion = Motion(60.0, still, path=path)
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    moving = after(steps, 12.0)
    lean = np.degrees(np.arctan2(np.hypot(*steps[moving, at.U_ACCEL_MEAN : at.U_ACCEL_MEAN + 2].T), G_M_S2))
    assert lean.max() > 40.0
    assert tilt_deg(attitude_errors(motion, steps, rows))[moving].max() < 0.4


def test_gyro_scale_is_learned_from_gravity_alone():
    motion = Motion(120.0, wobble(5.0))
    motion.gyro = (motion.gyro - BIAS_RAD_S) * [1.01, 0.99, 1.0] + BIAS_RAD_S
    steps, meas = motion.steps(with_mag=False)
    _, s = run(steps, meas)
    scale = s[cols.S_X + cols.GYRO_SCALE : cols.S_X + cols.GYRO_SCALE + 9].reshape(3, 3)
    np.testing.assert_allclose(np.diag(scale)[:2], [0.01, -0.01], atol=0.003)


def test_a_slow_steady_turn_is_not_taken_for_a_bias():
    def angles(t):
        return np.stack((math.radians(2.0) * np.clip(t - 15.0, 0.0, None), 0 * t, 0 * t), axis=1)

    motion = Motion(45.0, angles)
    steps, meas = motion.steps(with_mag=False)
    rows, _ = run(steps, meas)
    turned = np.degrees(2 * np.arctan2(rows[-1, 3], rows[-1, 0]) - 2 * np.arctan2(rows[700, 3], rows[700, 0]))
    assert turned == pytest.approx(60.0, abs=1.0)
    np.testing.assert_allclose(rows[-1, cols.O_GYRO_BIAS + 2], BIAS_RAD_S[2], atol=5e-4)


def test_without_a_magnetometer_tilt_is_kept_and_heading_is_said_to_be_unknown():
    motion = Motion(60.0, wobble(5.0))
    steps, meas = motion.steps(with_mag=False)
    rows, _ = run(steps, meas)
    late = after(steps, 5.0)
    assert tilt_deg(attitude_errors(motion, steps, rows))[late].max() < 1.5
    assert (rows[late, cols.O_DISTURBED] == cols.D_NO_MAG).all()
    assert (rows[:, cols.O_HEADING] == cols.H_NONE).all()
    assert rows[late, cols.O_ATT_SIGMA + 2].min() > math.radians(90.0)


def test_a_hole_in_the_data_starts_again_with_the_bias_that_was_learned():
    motion = Motion(40.0, wobble(35.0))
    steps, meas = motion.steps()
    holed = steps.copy()
    n = int(np.searchsorted(steps[:, at.U_T], 20e9))
    holed[n, at.U_GAP_S] = 3.0
    rows, _ = run(holed, meas)
    assert rows[n, cols.O_ATT_SIGMA] > 0.1
    np.testing.assert_allclose(rows[n, cols.O_GYRO_BIAS : cols.O_GYRO_BIAS + 3], BIAS_RAD_S, atol=3e-4)
    assert tilt_deg(attitude_errors(motion, steps, rows))[n + 150] < 0.1


def test_numbers_that_are_none_do_not_stay():
    motion = Motion(20.0, still)
    steps, meas = motion.steps()
    meas[100:120, at.M_DATA] = math.nan
    steps[500, at.U_DTHETA] = math.nan
    rows, s = run(steps, meas)
    assert s[cols.S_FAILURES] == 1.0
    assert np.isfinite(rows[-1]).all()
    assert tilt_deg(attitude_errors(motion, steps[-1:], rows[-1:]))[0] < 0.1


def test_a_free_fall_at_the_start_is_waited_for():
    motion = Motion(10.0, still)
    motion.accel[motion.t < 2.0] *= 0.05
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    assert np.isnan(rows[steps[:, at.U_T] < 1.9e9, :4]).all()
    assert tilt_deg(attitude_errors(motion, steps[150:], rows[150:]))[-1] < 0.1


def test_the_covariance_stays_symmetric_and_positive_over_an_hour_of_turns():
    motion = Motion(60.0, wobble(0.0), noises={**NOISES, "mag": 0.005})
    steps, meas = motion.steps()
    s = cols.new_memory()
    for k in range(60):
        later, later_meas = steps.copy(), meas.copy()
        later[:, at.U_T] += k * 60e9
        later_meas[:, at.M_T] += k * 60e9
        rows, s = run(later, later_meas, s)
    P = s[cols.S_P : cols.S_P + cols.N**2].reshape(cols.N, cols.N)
    np.testing.assert_allclose(P, P.T, rtol=1e-9, atol=1e-15)
    scale = np.sqrt(np.diag(P))
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > -1e-9
    assert s[cols.S_FAILURES] == 0.0
    assert np.isfinite(rows).all()

"""The attitude mode's heading: magnets put on and taken off, spikes, other places, delays, noise."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from server.nav.ekf import layout as at
from server.nav.ekf.attitude import layout as cols
from server.nav.ekf.attitude.start import set_field

from .attitude_mode_motions import FIELD_GAUSS, NOISES, RATE_HZ, Motion, after, attitude_errors, run, still, wobble


def test_a_single_magnetic_spike_is_refused_and_said():
    motion = Motion(40.0, wobble(5.0))
    hit = (motion.t > 30.0) & (motion.t < 30.1)
    clean_steps, clean_meas = motion.steps()
    clean, _ = run(clean_steps, clean_meas)
    motion.mag[hit] += [0.1, 0.4, 0.1]
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    during = (steps[:, at.U_T] > 30.02e9) & (steps[:, at.U_T] < 30.09e9)
    assert (rows[during, cols.O_DISTURBED] == cols.D_GATE).all()
    apart = (Rotation.from_quat(rows[:, [1, 2, 3, 0]]).inv() * Rotation.from_quat(clean[:, [1, 2, 3, 0]])).magnitude()
    assert np.degrees(apart.max()) < 0.1
    assert rows[-1, cols.O_DISTURBED] == cols.D_NONE


@pytest.mark.parametrize("strength_gauss", [0.08, 0.26, 0.6])
def test_a_magnet_put_on_is_learned_in_motion_and_forgotten_when_removed(strength_gauss):
    motion = Motion(120.0, wobble(15.0), noises={**NOISES, "mag": 0.005})
    magnet = strength_gauss * np.array([0.6, -0.48, 0.64])
    worn = (motion.t > 10.0) & (motion.t < 70.0)
    motion.mag[worn] += magnet
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    t_s = steps[:, at.U_T] * 1e-9
    offset, sigma = (
        rows[:, cols.O_MAG_OFFSET : cols.O_MAG_OFFSET + 3],
        rows[:, cols.O_OFFSET_SIGMA : cols.O_OFFSET_SIGMA + 3],
    )
    for at_s, truth in ((68.0, magnet), (118.0, np.zeros(3))):
        n = np.searchsorted(t_s, at_s)
        np.testing.assert_allclose(offset[n], truth, atol=0.015)
        assert (np.abs(offset[n] - truth) < 3 * sigma[n]).all()
    assert (rows[(t_s > 10.5) & (t_s < 15.0), cols.O_DISTURBED] >= cols.D_GATE).any()
    assert np.abs(np.degrees(attitude_errors(motion, steps, rows)[after(steps, 5.0), 2])).max() < 2.5


def test_noise_at_rest_moves_neither_heading_nor_offset():
    motion = Motion(200.0, still, noises={**NOISES, "mag": 0.007})
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    late = after(steps, 10.0)
    heading = np.degrees(2 * np.arctan2(rows[late, 3], rows[late, 0]))
    assert np.ptp(heading) < 0.5
    assert np.ptp(rows[late, cols.O_MAG_OFFSET : cols.O_MAG_OFFSET + 3], axis=0).max() < 0.001


def test_a_magnet_beside_a_resting_board_does_not_turn_it():
    motion = Motion(60.0, still)
    motion.mag[motion.t > 20.0] += [0.03, 0.15, 0.05]
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    error = np.degrees(attitude_errors(motion, steps, rows)[:, 2])
    assert np.abs(error[after(steps, 20.0)] - error[after(steps, 19.0)][0]).max() < 0.5
    assert (rows[after(steps, 20.1), cols.O_DISTURBED] >= cols.D_GATE).any()


def test_another_place_with_another_field_turns_the_heading_only_slowly():
    """Ten degrees of false north in the room's other corner; a filter that believed it would show them at once."""
    motion = Motion(40.0, wobble(5.0))
    beyond = motion.t > 20.0
    motion.mag[beyond] = (
        motion.truth[beyond].inv().apply(Rotation.from_euler("z", 10.0, degrees=True).apply(FIELD_GAUSS))
    )
    steps, meas = motion.steps()
    rows, _ = run(steps, meas)
    error = np.abs(np.degrees(attitude_errors(motion, steps, rows)[:, 2]))
    before_s = steps[:, at.U_T] * 1e-9
    assert error[(before_s > 6.0) & (before_s < 25.0)].max() < 2.5
    assert 3.0 < error[-1] < 7.0


def test_the_magnetometers_delay_is_found_in_motion():
    motion = Motion(90.0, wobble(5.0))
    late = 4 / RATE_HZ
    motion.mag = np.concatenate((np.repeat(motion.mag[:1], 4, axis=0), motion.mag[:-4]))
    steps, meas = motion.steps()
    _, s = run(steps, meas)
    assert abs(s[cols.S_X + cols.MAG_DELAY] - late) < 0.004


def test_a_model_of_the_field_is_kept_and_without_one_it_is_learned():
    motion = Motion(60.0, wobble(5.0))
    steps, meas = motion.steps()
    s = cols.new_memory()
    set_field(s, 0.5, math.radians(60.0))
    _, s = run(steps, meas, s)
    np.testing.assert_allclose(s[cols.S_REF : cols.S_REF + 2], [0.25, 0.433], atol=1e-3)
    _, learned = run(steps, meas)
    np.testing.assert_allclose(learned[cols.S_REF : cols.S_REF + 2], FIELD_GAUSS[[0, 2]], atol=0.02)

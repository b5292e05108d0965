"""Delays found by correlation: laws of shifting."""

import numpy as np
import pytest

from server.compare.delay import correlate, delays
from tests.compare.made import SPACING_S, rows_at

T_S = np.arange(0.0, 60.0, SPACING_S)
FINE_S = np.arange(-2.0, 62.0, 0.01)


@pytest.mark.parametrize("late_s", [-0.113, -0.02, 0.0, 0.007, 0.037, 0.25, 0.801])
def test_a_lane_that_lags_is_found_late_by_as_much(late_s):
    found = delays(rows_at(T_S, late_s), rows_at(FINE_S))
    for one in (found.attitude, found.vertical, found.horizontal):
        assert one.delay_s == pytest.approx(late_s, abs=0.001)
        assert one.peak > 0.999
        assert one.standard_error_s < 0.001


def test_exchanging_lane_and_reference_turns_the_sign():
    there = delays(rows_at(T_S, 0.06), rows_at(FINE_S)).attitude
    back = delays(rows_at(T_S), rows_at(FINE_S, 0.06)).attitude
    assert there.delay_s == pytest.approx(-back.delay_s, abs=0.001)


def test_a_heading_that_counts_from_elsewhere_does_not_matter():
    lane, half = rows_at(T_S, 0.05), np.radians(110.0) / 2
    w, x = lane.data[:, 0].copy(), lane.data[:, 1].copy()
    lane.data[:, 0], lane.data[:, 1] = np.cos(half) * w, np.cos(half) * x
    lane.data[:, 2], lane.data[:, 3] = np.sin(half) * x, np.sin(half) * w
    assert delays(lane, rows_at(FINE_S)).attitude.delay_s == pytest.approx(0.05, abs=0.001)


def test_without_vertical_speed_the_heights_are_lined_up():
    lane = rows_at(T_S, 0.1)
    lane.data[:, 9] = np.nan
    assert delays(lane, rows_at(FINE_S)).vertical.delay_s == pytest.approx(0.1, abs=0.002)


def test_rest_and_strangers_have_no_delay():
    still = rows_at(T_S, roll_amplitude_rad=0.001)
    assert delays(still, rows_at(FINE_S, roll_amplitude_rad=0.001)).attitude is None
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((2, 3000, 1))
    assert correlate(a, b, SPACING_S, 0.1) is None


def test_a_hole_in_the_lane_does_not_move_the_delay():
    lane = rows_at(T_S, 0.04)
    lane.data[1000:1200] = np.nan
    assert delays(lane, rows_at(FINE_S)).attitude.delay_s == pytest.approx(0.04, abs=0.001)


def test_a_shift_beyond_the_search_is_not_reported():
    t = np.arange(0.0, 60.0, SPACING_S)
    rng = np.random.default_rng(2)
    signal = np.convolve(rng.standard_normal(len(t) + 200), np.ones(5), "same")
    late, early = signal[:-200, None], signal[100:-100, None]  # two seconds
    assert correlate(late, early, SPACING_S, 0.1) is None


def test_the_standard_error_says_how_far_noise_moves_the_delay():
    errors, told = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        lane = rows_at(T_S, 0.03)
        lane.data[:, 9] += 0.5 * rng.standard_normal(len(T_S))
        found = delays(lane, rows_at(FINE_S)).vertical
        errors.append(found.delay_s - 0.03)
        told.append(found.standard_error_s)
    assert 0.5 < np.sqrt(np.mean(np.square(told))) / np.std(errors) < 2.0

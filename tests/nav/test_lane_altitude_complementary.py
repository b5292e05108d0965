"""`altitude_complementary` [S3, algorithm 1]: acceleration integrated twice, blended with the barometer."""

from . import height_laws as law
from .heights import aggressive, followed

LANE = "altitude_complementary"


def test_a_climb_and_a_constant_bias_are_recovered():
    law.recovers_a_climb(LANE, height_m=0.06, speed_m_s=0.1, bias_m_s2=0.06)


def test_the_cut_of_the_stream_does_not_matter():
    law.does_not_depend_on_the_cut(LANE)


def test_the_rate_of_the_steps_does_not_matter():
    law.does_not_depend_on_the_rate(LANE, height_m=0.005, speed_m_s=0.02)


def test_there_is_no_height_before_the_zero():
    law.starts_with_the_mean_of_its_zero(LANE)


def test_height_above_the_sea_needs_the_site():
    law.tells_the_height_above_the_sea_once_the_site_is_known(LANE)


def test_gnss_is_not_used():
    law.never_uses_gnss(LANE)


def test_a_lost_barometer_is_dead_reckoning():
    law.says_when_the_barometer_is_gone(LANE, 2.0)


def test_after_a_hole_the_height_is_against_the_same_zero():
    law.starts_again_after_a_hole_against_the_same_zero(LANE)


def test_a_nan_is_a_failure_of_one_step():
    law.never_lets_a_nan_leave(LANE)


def test_a_baro_height_that_is_none_is_passed_over():
    law.survives_a_nan_of_the_barometer(LANE)


def test_a_late_barometer_is_compared_with_its_own_time():
    law.compares_a_late_barometer_with_its_own_time(LANE)


def test_a_row_is_valid_at_its_stamp_however_late_the_imu_is():
    law.carries_on_over_the_imus_delay(LANE, 0.02)


def test_a_parameter_changes_while_it_runs():
    law.takes_a_parameter_without_losing_its_state(LANE, "baro_tau_s", 1.0)


def pulse(length_s):
    """5 m on the barometer from 30 s on."""
    return lambda t: 5.0 if 30.0 <= t < 30.0 + length_s else 0.0


def test_a_baro_disturbance_is_followed_whole_and_at_once():
    assert followed(LANE, pulse(1.0), 25.0, 31.0) > 4.5


def test_the_weight_is_s3s_fifth_a_step_at_50_hz():
    """Ten steps of 20 ms with weight 0.2 leave 0.8¹⁰ of a step of the barometer; so does one update after 0.2 s."""
    step = followed(LANE, lambda t: 5.0 if t >= 29.99 else 0.0, 29.0, 30.19, velocity_tau_s=20.0)
    assert abs(step - 5.0 * (1.0 - 0.8**10)) < 0.35


def test_s3s_flight_with_its_disturbed_barometer_costs_more_than_a_metre():
    height, speed = law.scores_in_s3s_flight(LANE, aggressive)
    assert 0.8 < height < 1.8
    assert speed < 1.6


def test_the_recorded_flight_is_followed(shared_data, tmp_path):
    height, speed = law.on_the_recorded_flight(LANE, shared_data, tmp_path)
    assert height < 0.06
    assert speed < 0.07

"""`altitude_inertial` [S3, algorithm 2]: predict, correct, and feed the accelerometer's bias back."""

from . import height_laws as law
from .heights import aggressive, followed

LANE = "altitude_inertial"


def test_a_climb_and_a_constant_bias_are_recovered():
    law.recovers_a_climb(LANE, height_m=0.25, speed_m_s=0.12, bias_m_s2=0.03)


def test_the_cut_of_the_stream_does_not_matter():
    law.does_not_depend_on_the_cut(LANE)


def test_the_rate_of_the_steps_does_not_matter():
    law.does_not_depend_on_the_rate(LANE, height_m=0.005, speed_m_s=0.005)


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
    law.compares_a_late_barometer_with_its_own_time(LANE, better=1.5)


def test_a_row_is_valid_at_its_stamp_however_late_the_imu_is():
    law.carries_on_over_the_imus_delay(LANE, 0.03)


def test_a_parameter_changes_while_it_runs():
    law.takes_a_parameter_without_losing_its_state(LANE, "baro_weight_per_s", 1.0)


def pulse(length_s):
    """5 m on the barometer from 30 s on."""
    return lambda t: 5.0 if 30.0 <= t < 30.0 + length_s else 0.0


def test_a_baro_disturbance_is_followed_by_its_weight():
    second = followed(LANE, pulse(1.0), 25.0, 31.0)
    assert 1.0 < second < 3.0
    assert (
        followed("altitude_kalman", pulse(1.0), 25.0, 31.0)
        < second
        < followed("altitude_complementary", pulse(1.0), 25.0, 31.0)
    )


def test_a_spike_of_one_sample_moves_it_by_its_weight_times_the_interval():
    """w·e·T for position, 0.5 · 5 m · 0.04 s, and what the speed it got makes until the next samples take it back."""
    assert 0.05 < followed(LANE, pulse(0.03), 25.0, 32.0) < 0.25


def test_a_slow_barometer_does_not_make_it_overshoot():
    """At 1 Hz with the largest weight a held correction would swing up: it is held to half of what is lacking."""
    from .heights import POS_D, calls_of, fly, stream_of

    calls = calls_of(stream_of(lambda _: (0.0, 0.0, 0.0), duration_s=120.0, baro_hz=1.0))
    t, rows = fly(LANE, calls, {"baro_weight_per_s": 10.0})
    assert abs(rows[t > 60.0, POS_D]).max() < 0.5


def test_s3s_flight_with_its_disturbed_barometer_costs_less_than_with_the_complementary_filter():
    height, speed = law.scores_in_s3s_flight(LANE, aggressive)
    other_height, other_speed = law.scores_in_s3s_flight("altitude_complementary", aggressive)
    assert height < 0.7 * other_height
    assert speed < 0.5 * other_speed


def test_the_recorded_flight_is_followed(shared_data, tmp_path):
    height, speed = law.on_the_recorded_flight(LANE, shared_data, tmp_path)
    assert height < 0.09
    assert speed < 0.07

"""`altitude_kalman` [S3, algorithm 3]: height, speed, acceleration and its bias in a Kalman filter."""

import numpy as np

from server.nav.lanes.altitude_kalman import _advance
from server.nav.lanes.vertical import P_OWN, P_SIZE, V_SIZE
from server.nav.lanes.vertical_covariance import take_off

from . import height_laws as law
from .heights import POS_D, VEL_D, aggressive, calls_of, fly, followed, stream_of, truth_of

LANE = "altitude_kalman"


def test_a_climb_and_a_constant_bias_are_recovered():
    law.recovers_a_climb(LANE, height_m=0.03, speed_m_s=0.02, bias_m_s2=0.02)


def test_the_cut_of_the_stream_does_not_matter():
    law.does_not_depend_on_the_cut(LANE)


def test_the_rate_of_the_steps_does_not_matter():
    law.does_not_depend_on_the_rate(LANE, height_m=0.002, speed_m_s=0.005)


def test_there_is_no_height_before_the_zero():
    law.starts_with_the_mean_of_its_zero(LANE)


def test_height_above_the_sea_needs_the_site():
    law.tells_the_height_above_the_sea_once_the_site_is_known(LANE)


def test_gnss_is_not_used():
    law.never_uses_gnss(LANE)


def test_a_lost_barometer_is_dead_reckoning():
    law.says_when_the_barometer_is_gone(LANE, 1.5)


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
    law.takes_a_parameter_without_losing_its_state(LANE, "baro_noise_m", 1.0)


def pulse(length_s):
    """5 m on the barometer from 30 s on."""
    return lambda t: 5.0 if 30.0 <= t < 30.0 + length_s else 0.0


def test_a_baro_disturbance_shorter_than_its_patience_is_refused():
    assert followed(LANE, pulse(0.03), 25.0, 32.0) < 0.15
    assert followed(LANE, pulse(3.0), 25.0, 33.0) < 0.3


def test_a_level_that_stays_is_accepted_after_its_patience():
    assert followed(LANE, pulse(60.0), 25.0, 34.9) < 0.3
    assert followed(LANE, pulse(60.0), 35.2, 40.0) > 4.5
    assert followed(LANE, pulse(60.0), 25.0, 32.9, reaccept_s=2.0) > 4.5


def test_without_its_gate_it_still_follows_less_than_the_complementary_filter():
    ungated = followed(LANE, pulse(1.0), 25.0, 31.0, gate_sigma=100.0)
    assert 0.3 < ungated < 0.95 * followed("altitude_complementary", pulse(1.0), 25.0, 31.0)


def test_s3s_flight_with_its_disturbed_barometer_costs_least():
    height, speed = law.scores_in_s3s_flight(LANE, aggressive)
    for other in ("altitude_complementary", "altitude_inertial"):
        other_height, other_speed = law.scores_in_s3s_flight(other, aggressive)
        assert height < 0.5 * other_height
        assert speed < 0.5 * other_speed


def test_three_sigma_covers_the_errors():
    t, rows = fly(LANE, calls_of(stream_of(accel_bias=(0.0, 0.0, 0.1))))
    late = t > 10.0
    height, speed = truth_of(t)
    for column, sigma, truth in ((POS_D, 18, height), (VEL_D, 15, speed)):
        inside = np.abs(-rows[late, column] - truth[late]) < 3.0 * rows[late, sigma]
        assert inside.mean() > 0.95
        assert rows[late, sigma].max() < 0.5


def test_the_covariance_stays_one_over_a_long_run():
    """200,000 steps with a baro height every fifth: symmetric, positive, and at its steady state."""
    par = np.zeros(P_SIZE)
    par[P_OWN : P_OWN + 4] = 10.0, 0.05, 2e-3, 0.3
    P, early = np.diag([1.0, 1.0, 1.0, 0.1]), np.zeros(4)
    s = np.zeros(V_SIZE)
    for k in range(200_000):
        _advance(0.0, 0.02, s, par, P)
        if k % 5 == 0:
            take_off(P, P[0, 0], P[0, 1], P[0, 2], P[0, 3], P[0, 0] + 0.09)
        if k == 149_999:
            early = np.diag(P).copy()
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P).min() > 0.0
    np.testing.assert_allclose(np.diag(P), early, rtol=1e-6)


def test_the_recorded_flight_is_followed(shared_data, tmp_path):
    height, speed = law.on_the_recorded_flight(LANE, shared_data, tmp_path)
    assert height < 0.06
    assert speed < 0.06

"""The quaternion complementary filter: biases, and the receiver's position and velocity."""

import math

import numpy as np
import pytest

from server.nav.types import Kind, LaneStatus
from tests.nav.attitude_laws import errors_deg, rms, run, tumbling
from tests.nav.synthetic import Stream, circle

BIAS = (0.01, -0.015, 0.02)


def test_gyro_biases_of_all_axes_are_found():
    t, rows, _ = run(tumbling(duration_s=90.0, bias=BIAS).block(), "complementary")
    np.testing.assert_allclose(rows[-1, 19:22], BIAS, atol=2e-3)
    tilt, heading = errors_deg(t, rows, after_s=60.0)
    assert rms(tilt) < 0.9
    assert rms(heading) < 2.5


def test_velocity_and_position_are_the_receivers_brought_to_the_present():
    stream, truth = circle(gnss_delay_s=0.1, gnss_arrives_s=0.05, noise=0.0)
    t, rows, _ = run(stream.block(), "complementary", gnss_delay_s=0.1)
    later = t > 20.0
    true = np.array([truth(when) for when in t[later]])
    off = np.hypot(rows[later, 26] - true[:, 0], rows[later, 27] - true[:, 1])
    assert off.max() < 0.5 * 10.0**2 / 40.0 * 0.36**2 + 0.02  # half the centripetal acceleration times the oldest age²
    assert (rows[later, 25] == LaneStatus.NAVIGATING).all()
    assert np.abs(rows[later, 4] - true[:, 2]).max() < 10.0**2 / 40.0 * 0.36 + 0.05
    assert np.isnan(rows[later, 6]).all()  # this receiver has no vertical velocity


def test_without_gnss_the_position_is_held_and_the_status_says_so():
    stream, _ = circle(duration_s=40.0)
    stream.rows = [row for row in stream.rows if row[3] != Kind.GNSS or row[4] < 30.0]
    t, rows, _ = run(stream.block(), "complementary")
    fresh, lost = (t > 20.0) & (t < 31.7), t > 32.0
    assert (rows[fresh, 25] == LaneStatus.NAVIGATING).all()
    assert (rows[lost, 25] == LaneStatus.DEAD_RECKONING).all()
    np.testing.assert_allclose(rows[lost, 29], t[lost] - 29.8, atol=1e-6)
    assert np.ptp(rows[lost, 26]) == 0.0


def test_before_gnss_there_is_attitude_and_no_position():
    rows = run(tumbling(duration_s=5.0).block(), "complementary")[1]
    assert (rows[1:, 25] == LaneStatus.ATTITUDE).all()
    assert np.isnan(rows[:, 4:10]).all()


@pytest.mark.parametrize("name", ["heading_time_constant_s", "tilt_time_constant_s"])
def test_a_time_constant_changed_live_keeps_attitude_and_biases(name):
    _, rows, engine = run(tumbling(bias=BIAS).block(), "complementary")
    engine.set_lane_parameters("complementary", {name: 0.5})
    more = Stream()
    for k in range(5):
        more.rows.append((0.0, True, k, Kind.IMU, 40.005 + 0.005 * k, [*BIAS, 0.0, 0.0, -9.8]))
    after = engine.step(more.block()).lanes[0].data[0]
    assert 2 * math.acos(min(1.0, abs(rows[-1, :4] @ after[:4]))) < 0.1
    np.testing.assert_allclose(after[19:22], rows[-1, 19:22], atol=0.01)

"""The board's own quaternion: repeated as it is, carried between samples, refused when damaged."""

import math

import numpy as np

from server.nav.rotation import euler_from_quat
from server.nav.types import Kind, LaneStatus
from tests.nav.attitude_laws import attitude, errors_deg, product, rms, run, tumbling


def test_the_quaternion_is_the_boards_where_a_sample_is():
    t, rows, _ = run(tumbling(dmp_hz=50.0).block(), "dmp")
    tilt, heading = errors_deg(t, rows, after_s=0.1)
    assert max(tilt.max(), heading.max()) < 1e-3


def test_slow_samples_are_carried_on_by_the_rate():
    block = tumbling(dmp_hz=4.0, noise=0.0).block()
    t, rows, _ = run(block, "dmp")
    tilt, heading = errors_deg(t, rows, after_s=0.5)
    assert max(rms(tilt), rms(heading)) < 0.01


def test_its_heading_is_free_and_no_field_touches_it():
    with_field, without = tumbling(dmp_hz=50.0), tumbling(dmp_hz=50.0, mag_hz=0.0)
    np.testing.assert_array_equal(run(with_field.block(), "dmp")[1], run(without.block(), "dmp")[1])


def test_without_samples_there_is_no_attitude_and_soon_none_any_more():
    stream = tumbling(dmp_hz=50.0)
    stream.rows = [row for row in stream.rows if row[3] != Kind.DMP or row[4] < 20.0]
    t, rows, _ = run(stream.block(), "dmp")
    assert np.isfinite(rows[(t > 0.1) & (t < 20.4), 0]).all()
    assert np.isnan(rows[t > 20.6, 0]).all()
    assert (rows[t > 20.6, 25] == LaneStatus.ALIGNING).all()


def test_how_long_it_is_held_may_be_changed_live():
    stream = tumbling(dmp_hz=50.0)
    stream.rows = [row for row in stream.rows if row[3] != Kind.DMP or row[4] < 39.0]
    _, rows, engine = run(stream.block(), "dmp")
    assert np.isnan(rows[-1, 0])
    _, rows, engine = run(stream.block(), "dmp", lane_parameters={"hold_s": 5.0})
    assert np.isfinite(rows[-1, 0])
    engine.set_lane_parameters("dmp", {"hold_s": 0.5})
    more = tumbling(duration_s=1.0, mag_hz=0.0)
    assert np.isnan(engine.step(more.block(offset_s=40.005)).lanes[0].data[-1, 0])


def test_euler_angles_for_people_are_s4s():
    q = product(attitude(17.0), np.array([math.cos(0.4), math.sin(0.4), 0.0, 0.0]))
    q0, q1, q2, q3 = q
    pitch = math.asin(-2 * q1 * q3 + 2 * q0 * q2)
    roll = math.atan2(2 * q2 * q3 + 2 * q0 * q1, -2 * q1 * q1 - 2 * q2 * q2 + 1)
    yaw = math.atan2(2 * (q1 * q2 + q0 * q3), q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3)
    np.testing.assert_allclose(euler_from_quat(q), [roll, pitch, yaw % math.tau], atol=1e-12)

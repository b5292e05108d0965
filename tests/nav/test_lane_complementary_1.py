"""The first-order complementary filter against S4's formula and its own limits."""

import math

import numpy as np
import pytest

from server.nav.types import Kind
from tests.nav.attitude_laws import errors_deg, rms, run, tumbling
from tests.nav.synthetic import G_M_S2, Stream


def step_in_tilt(tau_s, rate_hz, roll_rad=0.3):
    """Rows of a board whose accelerometer says level for a second, then a roll that the gyro never felt."""
    stream = Stream()
    for k in range(round(6.0 * rate_hz)):
        roll = roll_rad if k / rate_hz >= 1.0 else 0.0
        up = [0.0, -G_M_S2 * math.sin(roll), -G_M_S2 * math.cos(roll)]
        stream.add(Kind.IMU, k / rate_hz, [0.0, 0.0, 0.0, *up])
    parameters = {"time_constant_s": tau_s}
    t, rows, _ = run(stream.block(), "complementary_1", nav_rate_hz=rate_hz, lane_parameters=parameters)
    return t, 2.0 * np.arctan2(rows[:, 1], rows[:, 0])


@pytest.mark.parametrize("tau_s", [0.25, 2.0])
@pytest.mark.parametrize("rate_hz", [50.0, 200.0])
def test_the_answer_to_a_step_is_the_time_constants_whatever_the_rate(tau_s, rate_hz):
    t, roll = step_in_tilt(tau_s, rate_hz)
    expected = 0.3 * (1.0 - np.exp(-np.maximum(0.0, t - 1.0) / tau_s))
    assert np.abs(roll - expected).max() < 0.3 / (rate_hz * tau_s)  # one step of the fastest slope


def test_s4s_own_numbers_follow_from_the_time_constant():
    """K1 = 0.02 at 200 Hz: `angle = K1·angle_acc + (1 − K1)·(angle + rate·dt)` run beside the lane."""
    tau_s = -0.005 / math.log(1.0 - 0.02)
    t, roll = step_in_tilt(tau_s, 200.0)
    angle, expected = 0.0, []
    for when in t:
        angle = 0.02 * (0.3 if when >= 1.0 + 1e-9 else 0.0) + 0.98 * angle
        expected.append(angle)
    np.testing.assert_allclose(roll[250:], expected[250:], atol=2e-3)  # the lane's force is the step's mean


def test_a_loop_through_the_vertical_gives_no_nan_and_ends_level():
    stream = Stream()
    for k in range(2400):
        t = k / 200.0
        turning = 2.0 <= t < 6.0
        pitch = math.tau * min(1.0, max(0.0, (t - 2.0) / 4.0))
        up = [G_M_S2 * math.sin(pitch), 0.0, -G_M_S2 * math.cos(pitch)]
        stream.add(Kind.IMU, t, [0.0, math.tau / 4.0 if turning else 0.0, 0.0, *up])
    rows = run(stream.block(), "complementary_1")[1]
    assert np.isfinite(rows[:, :4]).all()
    assert abs(rows[-1, 1]) + abs(rows[-1, 2]) < 0.02


def test_a_new_time_constant_acts_at_once_and_keeps_the_angle():
    block = tumbling(bias=(0.02, 0.0, 0.0)).block()
    t, rows, engine = run(block, "complementary_1", lane_parameters={"time_constant_s": 20.0})
    worse = rms(errors_deg(t, rows, after_s=30.0)[0])
    engine.set_lane_parameters("complementary_1", {"time_constant_s": 0.2})
    quiet = Stream()
    for k in range(200):
        quiet.rows.append((0.0, True, k, Kind.IMU, 40.0 + 0.005 * (k + 1), [0.02, 0.0, 0.0, 0.0, 0.0, -G_M_S2]))
    after = engine.step(quiet.block()).lanes[0].data
    before = rows[-1, :4]
    assert 2 * math.acos(min(1.0, abs(before @ after[0, :4]))) < 0.15  # no jump, though the board is now level
    assert math.degrees(2 * math.hypot(after[-1, 1], after[-1, 2])) < 0.3 * worse

"""The angle and bias filter against the Riccati equation and a known bias."""

import math

import numpy as np
from scipy.linalg import solve_discrete_are

from server.nav.lanes.kalman_angle_bias import S_P
from server.nav.types import Kind
from tests.nav.attitude_laws import errors_deg, rms, run, tumbling
from tests.nav.synthetic import G_M_S2, Stream


def resting(duration_s, bias, rate_hz=50.0):
    stream = Stream()
    for k in range(round(duration_s * rate_hz)):
        stream.add(Kind.IMU, k / rate_hz, [*bias, 0.0, 0.0, -G_M_S2])
    return stream.block()


def test_a_bias_at_rest_is_found_and_the_level_kept():
    _, rows, _ = run(resting(120.0, (0.01, -0.02, 0.0)), "kalman_angle_bias")
    np.testing.assert_allclose(rows[-1, 19:21], [0.01, -0.02], atol=5e-4)
    assert np.isnan(rows[-1, 21])  # nothing measures the yaw axis
    assert math.degrees(2 * math.hypot(rows[-1, 1], rows[-1, 2])) < 0.1


def test_the_covariance_settles_at_the_solution_of_the_riccati_equation():
    values = {"gyro_noise_rad_s_rthz": 1e-2, "gyro_bias_walk_rad_s2_rthz": 1e-2, "accel_angle_noise_rad_rthz": 0.05}
    _, _, engine = run(resting(60.0, (0.0, 0.0, 0.0)), "kalman_angle_bias", lane_parameters=values)
    dt = 0.02
    A, H = np.array([[1.0, -dt], [0.0, 1.0]]), np.array([[1.0], [0.0]])
    R = np.array([[0.05**2 / dt]])
    prior = solve_discrete_are(A.T, H, np.diag([1e-4 * dt, 1e-4 * dt]), R)
    posterior = prior - prior @ H @ np.linalg.inv(H.T @ prior @ H + R) @ H.T @ prior
    found = engine._bank._running["kalman_angle_bias"]._s[S_P : S_P + 3]
    np.testing.assert_allclose(found, [posterior[0, 0], posterior[0, 1], posterior[1, 1]], rtol=1e-6)


def test_a_bias_in_motion_costs_less_than_without_a_bias_state():
    block = tumbling(bias=(0.02, -0.01, 0.0)).block()
    t, rows, _ = run(block, "kalman_angle_bias")
    with_bias = rms(errors_deg(t, rows, after_s=10.0)[0])
    t, rows, _ = run(block, "complementary_1", lane_parameters={"time_constant_s": 5.0})
    assert with_bias < 0.5 * rms(errors_deg(t, rows, after_s=10.0)[0])


def test_other_noises_act_live_and_keep_the_state():
    _, rows, engine = run(resting(60.0, (0.01, 0.0, 0.0)), "kalman_angle_bias")
    engine.set_lane_parameters("kalman_angle_bias", {"accel_angle_noise_rad_rthz": 100.0})
    more = Stream()
    for k in range(100):
        more.rows.append((0.0, True, k, Kind.IMU, 60.0 + 0.02 * k, [0.01, 0.0, 0.0, 0.0, -3.0, -G_M_S2]))
    after = engine.step(more.block()).lanes[0].data
    assert abs(after[-1, 19] - rows[-1, 19]) < 1e-3
    assert math.degrees(2 * math.hypot(after[-1, 1], after[-1, 2])) < 0.2  # the sideways force is hardly believed

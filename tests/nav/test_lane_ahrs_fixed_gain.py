"""The fixed-gain attitude reference: its weights are the Riccati equation's, and motion over ground corrects it."""

import math

import numpy as np
import pytest

from server.nav.lanes.fixed_gain import steady_gains
from server.nav.types import Kind, VehicleClass
from tests.nav.attitude_laws import errors_deg, rms, run, tumbling
from tests.nav.synthetic import circle, heading_of


@pytest.mark.parametrize("dt_s", [0.02, 1 / 333, 1 / 2000])
@pytest.mark.parametrize(("gyro", "walk", "angle"), [(5e-3, 3e-5, 0.05), (3e-4, 1e-4, 0.5), (1e-6, 1e-3, 1.0)])
def test_weights_are_where_the_kalman_filters_own_recursion_ends(dt_s, gyro, walk, angle):
    A, H = np.array([[1.0, -dt_s], [0.0, 1.0]]), np.array([1.0, 0.0])
    Q = np.array([[gyro**2 * dt_s + walk**2 * dt_s**3 / 3, -(walk**2) * dt_s**2 / 2], [0.0, walk**2 * dt_s]])
    Q[1, 0] = Q[0, 1]
    R = angle**2 / dt_s
    found = np.array(steady_gains(dt_s, gyro, walk, angle))
    P = _covariance_of(found, A, Q, R)
    for _ in range(3):
        K = P @ H / (P[0, 0] + R)
        np.testing.assert_allclose([K[0], -K[1]], found, rtol=1e-4)
        P = A @ (P - np.outer(K, H @ P)) @ A.T + Q


def _covariance_of(gains, A, Q, R):
    """Prior covariance that constant weights settle at, by the Lyapunov series doubled twenty-five times over."""
    K = np.array([gains[0], -gains[1]])
    F = A @ (np.eye(2) - np.outer(K, [1.0, 0.0]))
    P = A @ np.outer(K, K) @ A.T * R + Q
    for _ in range(40):
        P, F = P + F @ P @ F.T, F @ F
    return P


def test_gyro_biases_of_all_axes_are_found():
    t, rows, _ = run(tumbling(duration_s=90.0, bias=(0.01, -0.015, 0.02)).block(), "ahrs_fixed_gain")
    np.testing.assert_allclose(rows[-1, 19:22], [0.01, -0.015, 0.02], atol=2e-3)
    assert rms(errors_deg(t, rows, after_s=60.0)[0]) < 0.9


def tilt_deg(rows):
    return np.degrees(2 * np.arcsin(np.minimum(1.0, np.hypot(rows[:, 1], rows[:, 2]))))


def test_gnss_takes_the_centripetal_force_out_of_the_tilt():
    """10 m/s on a 40 m circle lean the plumb line by 14°."""
    stream, _ = circle(duration_s=90.0)
    with_gnss = run(stream.block(), "ahrs_fixed_gain")[1]
    without = run(stream.block(), "ahrs_fixed_gain", use_gnss=False)[1]
    assert rms(tilt_deg(with_gnss[2500:])) < 1.0
    assert rms(tilt_deg(without[2500:])) > 3.0 * rms(tilt_deg(with_gnss[2500:]))


@pytest.mark.parametrize("vehicle", [VehicleClass.MULTIROTOR, VehicleClass.CAR])
def test_without_a_field_the_heading_comes_from_motion(vehicle):
    stream, truth = circle(duration_s=120.0, mag=False)
    t, rows, _ = run(stream.block(), "ahrs_fixed_gain", vehicle=vehicle)
    chosen = t > 60.0
    true = np.array([truth(when)[4] for when in t[chosen]])
    off = np.degrees((heading_of(rows[chosen]) - true + math.pi) % math.tau - math.pi)
    assert rms(off) < (3.0 if vehicle == VehicleClass.CAR else 6.0)


def test_a_field_turned_by_a_magnet_is_pulled_towards_the_course_of_a_car():
    def heading_error(vehicle):
        stream, truth = circle(duration_s=150.0)
        for i, (arrives, imu, k, kind, t, v) in enumerate(stream.rows):
            if kind == Kind.MAG:
                c, s = math.cos(0.2), math.sin(0.2)
                stream.rows[i] = (arrives, imu, k, kind, t, [c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]])
        t, rows, _ = run(stream.block(), "ahrs_fixed_gain", vehicle=vehicle)
        off = [heading_of(row[None, :])[0] - truth(when)[4] for when, row in zip(t[5000:], rows[5000:], strict=True)]
        return rms((np.array(off) + math.pi) % math.tau - math.pi)

    assert heading_error(VehicleClass.CAR) < 0.85 * heading_error(VehicleClass.HAND_HELD)


def test_other_noises_give_other_weights_live_and_keep_the_state():
    block = tumbling(bias=(0.01, 0.0, 0.0)).block()
    engine = run(block, "ahrs_fixed_gain")[2]
    lane = engine._bank._running["ahrs_fixed_gain"]
    before, state = lane._par.copy(), lane._s.copy()
    engine.set_lane_parameters("ahrs_fixed_gain", {"accel_angle_noise_rad_rthz": 1.0})
    assert lane is engine._bank._running["ahrs_fixed_gain"]
    np.testing.assert_array_equal(lane._s, state)
    assert lane._par[3] < 0.2 * before[3]
    np.testing.assert_array_equal(lane._par[5:], before[5:])

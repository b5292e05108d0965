"""The motions keep the laws of motion, and their samples are what a board would say of them."""

import math

import numpy as np
import pytest

from server.nav.types import Kind, SampleBlock
from server.sim import earth
from server.sim.motion_paths import Path, Stroke, kinematics, value
from server.sim.motions import (
    BARO_DISTURBANCE_M,
    GNSS_DELAY_S,
    GRAVITY_M_S2,
    IMU_HZ,
    MOTIONS,
    Q30,
    baro_error_m,
    inertial,
    motion,
    path_of,
    truth_of,
)
from server.sim.sensors import ACCEL_BIAS_M_S2, ACCEL_NOISE_M_S2_RTHZ, GYRO_BIAS_RAD_S, GYRO_NOISE_RAD_S_RTHZ


def rows_of(blocks: tuple[SampleBlock, ...], kind: Kind) -> tuple[np.ndarray, np.ndarray]:
    """Return times in s and data of one kind."""
    chosen = [block.kind == kind for block in blocks]
    t_ns = np.concatenate([block.t_ns[own] for block, own in zip(blocks, chosen, strict=True)])
    return t_ns * 1e-9, np.concatenate([block.data[own] for block, own in zip(blocks, chosen, strict=True)])


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the Hamilton products of rows."""
    aw, ax, ay, az = a.T
    bw, bx, by, bz = b.T
    return np.column_stack([
        aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw,
    ])  # fmt: skip


def times(name: str) -> np.ndarray:
    return np.arange(0.5, path_of(name).duration_s - 0.5, 0.0137)


@pytest.mark.parametrize("name", MOTIONS)
def test_the_gyro_senses_the_turning_of_the_true_attitude_and_of_the_earth(name: str) -> None:
    t, h = times(name), 1e-4
    before, now, after = truth_of(name, t - h), truth_of(name, t), truth_of(name, t + h)
    turned = product(before.q_nb * [1.0, -1.0, -1.0, -1.0], after.q_nb)
    rate = 2.0 * turned[:, 1:] / (2.0 * h) * np.sign(turned[:, :1])
    earth_b = np.einsum("nij,i->nj", now.R_nb, earth.EARTH_RATE_N_RAD_S)
    np.testing.assert_allclose(inertial(now)[:, :3], rate + earth_b, atol=2e-5)


@pytest.mark.parametrize("name", MOTIONS)
def test_the_accelerometer_senses_the_change_of_the_true_velocity_less_gravity(name: str) -> None:
    t, h = times(name), 1e-4
    before, now, after = truth_of(name, t - h), truth_of(name, t), truth_of(name, t + h)
    np.testing.assert_allclose(now.vel_n_m_s, (after.pos_n_m - before.pos_n_m) / (2 * h), atol=1e-5)
    coriolis = 2.0 * np.cross(earth.EARTH_RATE_N_RAD_S, now.vel_n_m_s)
    force_n = (after.vel_n_m_s - before.vel_n_m_s) / (2 * h) + coriolis - [0.0, 0.0, GRAVITY_M_S2]
    sensed_n = np.einsum("nij,nj->ni", now.R_nb, inertial(now)[:, 3:])
    np.testing.assert_allclose(sensed_n, force_n, atol=2e-5)


def test_a_multirotor_pushes_along_its_own_vertical_only() -> None:
    force = inertial(truth_of("altitude", times("altitude")))[:, 3:]
    assert np.abs(force[:, :2]).max() < 3e-3  # what is left is the Earth's rotation: 2 Ω v
    assert force[:, 2].max() < 0.0


@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_rests_at_both_ends_and_comes_back(name: str) -> None:
    end_s = path_of(name).duration_s
    rest = truth_of(name, np.concatenate([np.linspace(0.0, 10.0, 50), np.linspace(end_s - 5.0, end_s, 50)]))
    np.testing.assert_allclose(rest.pos_n_m, 0.0, atol=1e-9)
    np.testing.assert_allclose(rest.q_nb, np.tile([1.0, 0.0, 0.0, 0.0], (100, 1)), atol=1e-9)
    moving = truth_of(name, times(name))
    assert max(np.abs(moving.pos_n_m).max(), np.abs(moving.q_nb[:, 1:]).max()) > 0.1


def test_the_five_are_what_their_names_say() -> None:
    def tilt_deg(name: str) -> float:
        return math.degrees(math.acos(truth_of(name, times(name)).R_nb[:, 2, 2].min()))

    def fastest(name: str) -> float:
        return float(np.abs(truth_of(name, times(name)).rate_b_rad_s).max())

    assert MOTIONS[:5] == ("slow_tilt", "fast_tilt", "translation", "repeated_tilt", "repeated_lift")
    assert tilt_deg("slow_tilt") == pytest.approx(60.0, abs=0.1)
    assert tilt_deg("fast_tilt") == pytest.approx(60.0, abs=0.1)
    assert fastest("fast_tilt") > 20.0 * fastest("slow_tilt")
    assert tilt_deg("translation") == 0.0
    level = truth_of("translation", times("translation")).pos_n_m
    assert np.ptp(level, axis=0) == pytest.approx([0.5, 0.5, 0.0], abs=1e-3)
    assert np.ptp(truth_of("repeated_lift", times("repeated_lift")).pos_n_m[:, 2]) == pytest.approx(0.4, abs=1e-3)


@pytest.mark.parametrize("name", MOTIONS)
def test_imu_errors_are_a_mems_chips_bias_and_white_noise(name: str) -> None:
    t, data = rows_of(motion(name), Kind.IMU)
    assert len(t) == path_of(name).duration_s * IMU_HZ + 1
    errors = data[:, :6] - inertial(truth_of(name, t))
    bias, spread = errors.mean(axis=0), errors.std(axis=0)
    assert (np.abs(bias) <= 1.02 * np.repeat([GYRO_BIAS_RAD_S, ACCEL_BIAS_M_S2], 3)).all()
    expected = np.repeat([GYRO_NOISE_RAD_S_RTHZ, ACCEL_NOISE_M_S2_RTHZ], 3) * math.sqrt(IMU_HZ)
    np.testing.assert_allclose(spread, expected, rtol=0.05)
    white = (errors - bias)[:-1] * (errors - bias)[1:]
    assert (np.abs(white.mean(axis=0)) < 0.05 * spread**2).all()


def test_the_barometer_errs_by_five_metres_in_the_violent_part_of_the_flight_only() -> None:
    t, data = rows_of(motion("altitude"), Kind.BARO)
    height = data[:, 1] - earth.SITE_ALT_M
    error = height + truth_of("altitude", t).pos_n_m[:, 2]
    assert error.max() == pytest.approx(BARO_DISTURBANCE_M, abs=0.25)
    calm = (t < 25.0) | (t > 68.0)
    assert np.abs(error[calm]).max() < 0.3
    pressure_height = 44330.8 * (1.0 - (data[:, 0] / 101325.0) ** 0.19026)
    np.testing.assert_allclose(pressure_height, data[:, 1], atol=0.1)
    for name in MOTIONS[:5]:
        assert not baro_error_m(name, times(name)).any()


def test_only_the_flight_has_gnss_and_it_is_late_as_its_profile_says() -> None:
    for name in MOTIONS[:5]:
        assert len(rows_of(motion(name), Kind.GNSS)[0]) == 0
    blocks = motion("altitude")
    _, profile = rows_of(blocks, Kind.PROFILE)
    assert profile[0, 2] == GNSS_DELAY_S
    t, data = rows_of(blocks, Kind.GNSS)
    late, punctual = truth_of("altitude", t - GNSS_DELAY_S).vel_n_m_s, truth_of("altitude", t).vel_n_m_s
    assert (data[:, 3:6] - late).std() < 0.06
    assert (data[:, 3:6] - punctual).std() > 0.2


@pytest.mark.parametrize("name", MOTIONS)
def test_the_motion_processors_quaternion_has_30_places_and_the_true_tilt_on_a_bench(name: str) -> None:
    t, data = rows_of(motion(name), Kind.DMP)
    q = data[:, :4]
    assert (q * Q30 == np.rint(q * Q30)).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=4e-9)
    if name == "altitude":  # pushing along its own vertical only, a six-axis filter is misled there
        return
    w, x, y, z = q.T
    down = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    true_down = truth_of(name, t).R_nb[:, 2, :]
    angle = np.degrees(np.arccos(np.clip((down * true_down).sum(axis=1), -1.0, 1.0)))
    assert math.sqrt((angle**2).mean()) < 1.0


def test_reference_rows_are_the_truth() -> None:
    t, data = rows_of(motion("altitude"), Kind.REFERENCE)
    truth = truth_of("altitude", t)
    np.testing.assert_allclose(data[:, :4], truth.q_nb, rtol=0, atol=1e-12)
    np.testing.assert_allclose(data[:, 4:7], earth.geodetic_from_ned(truth.pos_n_m), rtol=0, atol=1e-12)
    np.testing.assert_allclose(data[:, 7:10], truth.vel_n_m_s, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", MOTIONS)
def test_rows_come_in_order_of_time_with_the_imu_last_of_its_moment(name: str) -> None:
    blocks = motion(name)
    kind = np.concatenate([block.kind for block in blocks])
    t_ns = np.concatenate([block.t_ns for block in blocks])
    assert (np.diff(t_ns) >= 0).all()
    assert kind[0] == Kind.DATE
    last = np.flatnonzero(np.append(np.diff(t_ns) > 0, True))
    assert (kind[last] == Kind.IMU).all()
    assert all(np.ptp(block.t_ns) < 1_000_000_000 for block in blocks)


def test_the_seed_makes_the_errors_and_nothing_else() -> None:
    first, again, other = motion("fast_tilt"), motion("fast_tilt"), motion("fast_tilt", seed=2)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.data, b.data)
    assert not np.array_equal(rows_of(first, Kind.IMU)[1], rows_of(other, Kind.IMU)[1], equal_nan=True)
    np.testing.assert_array_equal(rows_of(first, Kind.REFERENCE)[1], rows_of(other, Kind.REFERENCE)[1])


def test_an_unknown_motion_is_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match="somersault; there are: slow_tilt, fast_tilt"):
        motion("somersault")


def test_a_stroke_moves_its_size_in_its_time_with_no_jolt() -> None:
    stroke = (Stroke(start_s=2.0, length_s=4.0, size=3.0),)
    edge = np.array([2.0 + 1e-9, 6.0 - 1e-9])
    assert value(stroke, np.array([1.0, 4.0, 9.0])).tolist() == pytest.approx([0.0, 1.5, 3.0])
    for order in (1, 2, 3):
        np.testing.assert_allclose(value(stroke, edge, order), 0.0, atol=1e-6)


def test_headings_turn_clockwise_from_north() -> None:
    quarter = (Stroke(start_s=0.0, length_s=1.0, size=math.pi / 2),)
    turned = kinematics(Path(duration_s=2.0, yaw=quarter), np.array([2.0]), GRAVITY_M_S2)
    np.testing.assert_allclose(turned.R_nb[0, :, 0], [0.0, 1.0, 0.0], atol=1e-12)

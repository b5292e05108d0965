"""The demo board in the hand: what its sensors see is what the pose, the spin, the table and the magnet demand."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from server.magnetic import wmm_field
from server.nav.calibration.types import FACES
from server.nav.types import Float
from server.sim import SimSettings, earth
from server.sim import quaternion as quat
from server.sim.sensors import BLOCK, SensorBlock, Sensors
from server.sim.truth import FlightTruth
from server.simulator import (
    Command,
    Fly,
    Magnet,
    Pose,
    RoomMagnet,
    Shake,
    Spin,
    Turntable,
    WindOnPitot,
    face_pose,
    numbered_pose,
)

IDEAL = SimSettings(noise=0.0)
GRAVITY = float(earth.gravity_m_s2(np.array([488.0]))[0])
FIELD_N, _ = wmm_field(47.3977, 8.5456, 488.0, 2026.41)
FACE_FORCE_B = np.concatenate([[axis, -axis] for axis in np.eye(3)])  # `FACES`: specific force +g, −g on x, y, z
FACE_FORCE_B[5] = [0.0, 0.0, -1.0]


def steps(sensors: Sensors, seconds: float) -> list[SensorBlock]:
    return [sensors.step() for _ in range(round(seconds * 1000 / BLOCK))]


def until_done(sensors: Sensors, command: Command) -> Iterator[SensorBlock]:
    """Every block of a motion, from the one that begins it."""
    sensors.stage.take(command)
    yield (block := sensors.step())
    while sensors.stage.state((block.first_tick + BLOCK) * 1e-3).remaining_s > 0.0:
        yield (block := sensors.step())


def on_the_bench(settings: SimSettings = IDEAL) -> Sensors:
    sensors = Sensors(settings)
    list(until_done(sensors, face_pose("level")))
    return sensors


@pytest.mark.parametrize("face", FACES)
def test_a_face_has_the_specific_force_that_its_place_in_the_table_says(face: str) -> None:
    sensors = on_the_bench()
    list(until_done(sensors, face_pose(face)))
    imu = sensors.step().imu
    np.testing.assert_allclose(imu[:, 3:], np.tile(GRAVITY * FACE_FORCE_B[FACES.index(face)], (BLOCK, 1)), atol=2e-3)
    assert np.abs(imu[:, :3]).max() < 1e-4, "nothing but the turning Earth"


def test_any_direction_can_be_had_down() -> None:
    sensors = on_the_bench()
    down_b = np.array([0.3, -0.8, 0.52])
    list(until_done(sensors, Pose(down_b=(0.3, -0.8, 0.52))))
    force = sensors.step().imu[-1, 3:]
    np.testing.assert_allclose(-force / GRAVITY, down_b / np.linalg.norm(down_b), atol=2e-4)
    assert sensors.stage.state(sensors.step().first_tick * 1e-3).down_b == pytest.approx(-force / GRAVITY, abs=1e-3)


def test_the_first_n_numbered_poses_are_spread_over_all_directions() -> None:
    for n in (12, 24, 60):
        down = np.array([numbered_pose(k).down_b for k in range(1, n + 1)])
        np.testing.assert_allclose(np.linalg.norm(down, axis=1), 1.0, atol=1e-12)
        spread = np.linalg.eigvalsh(down.T @ down / n)
        assert spread.min() > 0.2, "one third each would be even"
        assert np.linalg.norm(down.mean(axis=0)) < 0.25


def test_the_hand_moves_smoothly_trembles_while_it_moves_and_lets_go() -> None:
    sensors = on_the_bench()
    blocks = list(until_done(sensors, face_pose("nose-up"))) + steps(sensors, 1.0)
    rate, force = np.split(np.concatenate([block.imu_true for block in blocks]), 2, axis=1)
    assert np.abs(np.diff(rate, axis=0)).max() < 0.02, "20 rad/s² at most"
    assert np.abs(np.diff(force, axis=0)).max() < 0.05
    assert np.linalg.norm(rate, axis=1).max() < 3.0
    assert np.ptp(np.linalg.norm(force[300:1200], axis=1)) > 0.1
    assert np.ptp(force[-800:], axis=0).max() < 1e-9


def test_a_held_pose_goes_on_trembling_and_a_laid_one_does_not() -> None:
    for is_held, (least, most) in ((True, (0.05, 0.5)), (False, (0.0, 1e-9))):
        sensors = on_the_bench()
        list(until_done(sensors, face_pose("level", is_held=is_held)))
        steps(sensors, 1.0)
        force = np.concatenate([block.imu_true[:, 3:] for block in steps(sensors, 3.0)])
        assert least <= force.std(axis=0).max() <= most
        assert sensors.stage.state(8.0).is_moving is is_held


@pytest.mark.parametrize("taken_at_s", [3.0, 36.0, 75.0])
def test_taken_out_of_the_flight_it_is_carried_home_as_an_inertial_navigator_would_have_it(taken_at_s: float) -> None:
    """No jump: gyro and accelerometer of the ideal board integrate from the flight to the bench."""
    sensors = Sensors(IDEAL)
    before = steps(sensors, taken_at_s)[-1].state
    blocks = list(until_done(sensors, face_pose("level")))
    q, v, p = before.q_nb[-1], before.vel_n_m_s[-1], before.pos_n_m[-1]
    for block in blocks:
        for rate, force in zip(block.imu_true[:, :3], block.imu_true[:, 3:], strict=True):
            R = quat.matrices(q[None])[0]
            turn = 2.0 * earth.EARTH_RATE_N_RAD_S
            pull = R @ force + [0.0, 0.0, GRAVITY] - np.cross(turn, v)
            p, v = p + v * 1e-3 + 0.5e-6 * pull, v + pull * 1e-3
            q = quat.product(q, quat.turned((rate - R.T @ earth.EARTH_RATE_N_RAD_S) * 1e-3))
    end = blocks[-1].state
    np.testing.assert_array_equal(end.pos_n_m[-1], 0.0)
    assert np.linalg.norm(p) < 0.05
    assert np.linalg.norm(v) < 0.01
    assert abs(float(q @ end.q_nb[-1])) == pytest.approx(1.0, abs=1e-7)
    assert end.R_nb[-1, 2, 2] == pytest.approx(1.0, abs=1e-9)
    assert max(np.linalg.norm(block.imu_true[:, 3:], axis=1).max() for block in blocks) < 30.0


def cells(direction: Float) -> set[tuple[int, int]]:
    """Which of 100 cells of equal area hold a direction: ten slices of equal height, ten sectors each."""
    slice_ = np.clip((5.0 * (direction[:, 2] + 1.0)).astype(int), 0, 9)
    sector = (np.arctan2(direction[:, 1], direction[:, 0]) / (2.0 * math.pi) * 10.0 % 10.0).astype(int)
    return set(zip(slice_.tolist(), sector.tolist(), strict=True))


def test_spinning_leads_the_field_over_the_whole_sphere_in_forty_seconds_at_a_hands_rates() -> None:
    sensors = on_the_bench(SimSettings())
    blocks = list(until_done(sensors, Spin()))
    assert 30.0 < 0.2 * len(blocks) <= 40.0
    mag = np.concatenate([block.mag_gauss[1:] for block in blocks])
    direction = mag / np.linalg.norm(mag, axis=1, keepdims=True)
    for turned in (np.eye(3), quat.matrices(quat.turned(np.array([[0.7, -1.1, 0.4]])))[0]):
        assert len(cells(direction @ turned)) >= 95
    rate = np.concatenate([block.imu_true[:, :3] for block in blocks])
    assert np.linalg.norm(rate, axis=1).max() < 2.5
    assert 1.0 < np.median(np.linalg.norm(rate, axis=1)) < 2.0
    assert (np.mean(rate**2, axis=0) > 0.2).all(), "about every axis"


def test_spinning_about_one_axis_leaves_the_field_on_one_cone() -> None:
    sensors = on_the_bench()
    blocks = list(until_done(sensors, Spin(about="z", duration_s=15.0)))
    mag = np.concatenate([block.mag_gauss[1:] for block in blocks])[20:]
    assert np.ptp(mag[:, 2]) < 0.02
    assert np.ptp(mag[:, 0]) > 0.35
    assert np.ptp(mag[:, 1]) > 0.35
    assert len(cells(mag / np.linalg.norm(mag, axis=1, keepdims=True))) <= 20


@pytest.mark.parametrize(
    ("axis", "turns", "rate_rad_s"), [("x", 2, 2.0), ("y", -3, 3.0), ("z", 1, 0.7), ("z", -1, 9.0)]
)
def test_the_turntable_turns_by_whole_turns_about_an_upright_axis(axis: str, turns: int, rate_rad_s: float) -> None:
    sensors = on_the_bench()
    blocks = list(until_done(sensors, Turntable(axis=axis, turns=turns, rate_rad_s=rate_rad_s)))
    earth_b = [block.state.spin_b_rad_s for block in blocks]
    rate = np.concatenate([block.imu_true[:, :3] for block in blocks])
    rate -= np.concatenate([0.5 * (rows[1:] + rows[:-1]) for rows in earth_b])
    i = "xyz".index(axis)
    laid = len(rate) - round(1000 * (2.0 * math.pi * abs(turns) / rate_rad_s + 1.0)) - BLOCK - 1000
    assert rate[laid:, i].sum() * 1e-3 == pytest.approx(2.0 * math.pi * turns, abs=1e-4)
    assert np.abs(np.delete(rate[laid:], i, axis=1)).max() < 1e-9
    assert np.abs(rate[laid : laid + 500]).max() < 1e-9, "at rest before"
    assert np.abs(rate).max() < rate_rad_s + 1.5
    upright = np.concatenate([block.state.R_nb[1:, 2, i] for block in blocks])[laid:]
    np.testing.assert_allclose(np.abs(upright), 1.0, atol=1e-9)
    after = np.concatenate([block.imu_true[:, :3] for block in steps(sensors, 1.0)])
    assert np.abs(after).max() < 1e-4, "at rest after"


def test_shaking_has_its_strength_and_leaves_the_pose_as_it_was() -> None:
    sensors = on_the_bench()
    list(until_done(sensors, face_pose("right-up")))
    before = sensors.step()
    blocks = list(until_done(sensors, Shake(duration_s=6.0, strength_m_s2=3.0)))
    force = np.concatenate([block.imu_true[:, 3:] for block in blocks])[1000:5000]
    assert force.std(axis=0) == pytest.approx(3.0, rel=0.35), force.std(axis=0)
    assert np.abs(np.concatenate([block.imu_true[:, :3] for block in blocks])).max() > 0.3
    after = steps(sensors, 0.4)[-1]
    np.testing.assert_allclose(after.imu_true[-1], before.imu_true[-1], atol=1e-9)
    assert sensors.stage.state(after.first_tick * 1e-3).name == "right-up"


def test_a_magnet_adds_its_field_in_the_body_and_the_rooms_iron_adds_its_own_in_the_room() -> None:
    plain, magnetic, iron = (on_the_bench() for _ in range(3))
    magnetic.stage.take(Magnet(is_on=True, field_b_gauss=(0.1, -0.2, 0.3)))
    iron.stage.take(RoomMagnet(is_on=True, field_n_gauss=(0.1, -0.2, 0.3)))
    for command in (Spin(duration_s=10.0), face_pose("nose-down")):
        for a, b, c in zip(*(until_done(one, command) for one in (plain, magnetic, iron)), strict=True):
            R_nb = a.state.R_nb[[50, 150]]
            np.testing.assert_allclose(b.mag_gauss[1:] - a.mag_gauss[1:], [[0.1, -0.2, 0.3]] * 2, atol=1e-12)
            np.testing.assert_allclose(np.vecmat([0.1, -0.2, 0.3], R_nb), c.mag_gauss[1:] - a.mag_gauss[1:], atol=1e-12)
    magnetic.stage.take(Magnet(is_on=False))
    np.testing.assert_array_equal(steps(magnetic, 0.4)[-1].mag_gauss, steps(plain, 0.4)[-1].mag_gauss)


def test_a_magnet_can_be_put_on_in_flight_and_the_flight_goes_on() -> None:
    plain, magnetic = Sensors(SimSettings()), Sensors(SimSettings())
    magnetic.stage.take(Magnet(is_on=True))
    for a, b in zip(steps(plain, 30.0), steps(magnetic, 30.0), strict=True):
        np.testing.assert_array_equal(a.imu, b.imu)
        np.testing.assert_allclose(b.mag_gauss - a.mag_gauss, [[-0.03, 0.05, 0.26]] * 3, atol=1e-12)
    assert magnetic.stage.state(29.0).mode == "flying"


def test_fly_puts_it_back_and_the_flight_begins_as_it_did_at_power_up() -> None:
    sensors = on_the_bench()
    list(until_done(sensors, Spin(duration_s=8.0)))
    blocks = list(until_done(sensors, Fly()))
    rate = np.concatenate([block.imu_true[:, :3] for block in blocks])
    assert np.abs(np.diff(rate, axis=0)).max() < 0.03
    flown = steps(sensors, 60.0)
    first = next(block for block in flown if block.flight_from_ms is not None)
    assert first.flight_from_ms == first.first_tick
    flight = FlightTruth(IDEAL).at(np.arange(0.0, 40_001.0) * 1e-3)
    at = [block for block in flown if block.flight_from_ms is not None][: 40_000 // BLOCK]
    for name in ("pos_n_m", "q_nb", "accel_b_m_s2"):
        flown_again = np.concatenate([getattr(block.state, name)[1:] for block in at])
        np.testing.assert_allclose(flown_again, getattr(flight, name)[1:], atol=1e-9)
    assert [block.state.t_s[0] for block in at] == [block.first_tick * 1e-3 for block in at], "the clock goes on"
    joint = np.abs(np.sum(blocks[-1].state.q_nb[-1] * first.state.q_nb[0]))
    assert joint == pytest.approx(1.0, abs=1e-9)


def test_a_motion_ends_the_one_before_without_a_jerk() -> None:
    sensors = on_the_bench()
    sensors.stage.take(Spin())
    spun = steps(sensors, 9.0)
    stopped = list(until_done(sensors, face_pose("upside-down")))
    both = np.concatenate([block.imu_true for block in spun + stopped])
    assert np.abs(np.diff(both[:, :3], axis=0)).max() < 0.05
    assert sensors.step().imu_true[-1, 5] == pytest.approx(GRAVITY, abs=1e-3)


def test_in_the_hand_the_receiver_says_home() -> None:
    sensors = Sensors(SimSettings())
    steps(sensors, 50.0)
    list(until_done(sensors, Shake()))
    fix = steps(sensors, 1.0)[-1].fixes[1]
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx((47.3977, 8.5456), abs=2e-5)
    assert math.hypot(fix.vel_n_m_s, fix.vel_e_m_s) < 0.3


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: face_pose("sideways"), "face = 'sideways' is not one of nose-up, "),
        (lambda: numbered_pose(0), "number = 0"),
        (lambda: Pose(down_b=(0.0, 0.0, 0.0)), "down_b .* not zero"),
        (lambda: Pose(down_b=(math.nan, 0.0, 1.0)), "down_b"),
        (lambda: Spin(duration_s=1.0), "duration_s = 1.0 is not from 5 to 300 s"),
        (lambda: Turntable(turns=0), "turns = 0"),
        (lambda: Turntable(rate_rad_s=math.nan), "rate_rad_s = nan"),
        (lambda: Shake(strength_m_s2=-1.0), "strength_m_s2"),
        (lambda: Magnet(is_on=True, field_b_gauss=(5.0, 0.0, 0.0)), "at most 2 gauss"),
    ],
)
def test_what_no_hand_does_is_refused_with_its_limit(make: Callable[[], object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        make()


def test_a_board_without_a_pressure_tube_cannot_have_wind_on_it() -> None:
    with pytest.raises(ValueError, match="errors=raw"):
        Sensors(SimSettings()).stage.take(WindOnPitot(is_on=True))

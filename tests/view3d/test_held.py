"""The vehicle is drawn as it is held, and the ghost as it shall be held."""

import math

import numpy as np
import pytest

from server.nav.calibration.types import FACES, GRAVITY_M_S2
from server.nav.rotation import quat_from_euler
from server.view3d.face_shapes import FACE_UP_B
from server.view3d.feed import Quat, Vec3
from server.view3d.geometry import rotate
from server.view3d.held import heading_rad, quat_between, quat_from_gravity, quat_of_target

LEVEL: Quat = (1.0, 0.0, 0.0, 0.0)
FORWARD_B, RIGHT_B, DOWN_B = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def turned(roll_deg: float, pitch_deg: float, yaw_deg: float) -> Quat:
    w, x, y, z = quat_from_euler(*np.radians([roll_deg, pitch_deg, yaw_deg])).tolist()
    return w, x, y, z


def apart_deg(a: Quat, b: Quat) -> float:
    return math.degrees(2.0 * math.acos(min(1.0, abs(float(np.dot(a, b))))))


@pytest.mark.parametrize(
    ("face", "euler_deg"),
    [
        ("nose-up", (0, 90, 0)),
        ("nose-down", (0, -90, 0)),
        ("right-up", (-90, 0, 0)),
        ("left-up", (90, 0, 0)),
        ("level", (0, 0, 0)),
        ("upside-down", (180, 0, 0)),
    ],
)
def test_at_rest_on_a_face_gravity_alone_gives_the_attitude(face: str, euler_deg: Vec3) -> None:
    x, y, z = FACE_UP_B[face]
    accel_b_m_s2 = (GRAVITY_M_S2 * x, GRAVITY_M_S2 * y, GRAVITY_M_S2 * z)
    assert apart_deg(quat_from_gravity(accel_b_m_s2), turned(*euler_deg)) < 1e-3


def test_the_faces_have_the_sides_that_their_names_say() -> None:
    assert [FACE_UP_B[face] for face in FACES] == [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]


def test_without_gravity_the_vehicle_is_drawn_level() -> None:
    assert quat_from_gravity((0.0, 0.0, 0.0)) == LEVEL
    assert quat_from_gravity((math.inf, 0.0, 0.0)) == LEVEL


def test_the_shortest_turn_ends_where_it_shall_from_anywhere() -> None:
    rng = np.random.default_rng(4)
    pairs = [*rng.normal(size=(50, 2, 3)), np.array([[0, 0, 1.0], [0, 0, -1.0]]), np.array([[1.0, 0, 0], [-1.0, 0, 0]])]
    for start, end in pairs:
        a, b = start / np.linalg.norm(start), end / np.linalg.norm(end)
        np.testing.assert_allclose(rotate(quat_between(tuple(a), tuple(b)), tuple(a)), b, atol=1e-7)


def test_the_ghost_holds_the_target_down_from_any_pose() -> None:
    rng = np.random.default_rng(5)
    for target, q in zip(rng.normal(size=(200, 3)), rng.normal(size=(200, 4)), strict=True):
        target_b, q_nb = tuple((target / np.linalg.norm(target)).tolist()), tuple((q / np.linalg.norm(q)).tolist())
        ghost = quat_of_target(q_nb, target_b, None)
        np.testing.assert_allclose(rotate(ghost, target_b), (0.0, 0.0, 1.0), atol=1e-7)


def test_a_vehicle_that_has_taken_the_pose_looks_like_its_ghost() -> None:
    for yaw_deg in (0.0, 70.0, -160.0):
        q_nb = turned(0.0, 90.0, yaw_deg)
        assert apart_deg(quat_of_target(q_nb, (-1.0, 0.0, 0.0), None), q_nb) < 1e-3


def test_upside_down_the_ghost_is_rolled_over_its_nose_and_does_not_jump_with_noise() -> None:
    first = quat_of_target(turned(0.0, 0.0, 30.0), (0.0, 0.0, -1.0), None)
    assert apart_deg(first, turned(180.0, 0.0, 30.0)) < 1e-3
    for roll_deg, pitch_deg in ((2.0, -1.0), (-3.0, 2.0), (0.5, 6.0)):
        assert quat_of_target(turned(roll_deg, pitch_deg, 30.0), (0.0, 0.0, -1.0), first) == first


@pytest.mark.parametrize("pitch_deg", [0.0, 55.0, 90.0, -90.0])
def test_the_heading_is_defined_with_the_nose_up_as_well(pitch_deg: float) -> None:
    """Pitching does not turn the vehicle about the vertical: the law is that the right side keeps its bearing."""
    q_nb = turned(0.0, pitch_deg, 40.0)
    north, east, _ = rotate(q_nb, RIGHT_B)
    assert heading_rad(q_nb) == pytest.approx(math.atan2(east, north) - math.pi / 2, abs=1e-6)

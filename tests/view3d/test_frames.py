"""North, up and a vehicle's nose end where they belong; uncertainty is as large as the covariance says."""

import asyncio
import math

import numpy as np
import pytest
import viser

from server.nav.rotation import matrix_from_quat
from server.nav.types import Float
from server.view3d.camera import Camera, fit_m, next_anchor
from server.view3d.feed import pose_from_row
from server.view3d.geometry import (
    NED_WXYZ,
    Anchor,
    cone_spread_rad,
    cone_vertices_m,
    ellipsoid_axes_m,
    quat_from_x,
    rotate,
    world_from_ned,
    yaw_from_quat,
)
from tests.view3d.synthetic import SyntheticBoard, Watcher, eventually, lane_row, served

EAST_W, UP_W, NORTH_W = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
VEHICLE = "/ned/here/vehicle"


def world_from_node(client: viser.ClientHandle, name: str) -> tuple[Float, Float]:
    """Rotation and origin of a node in viser's world, composed along its path."""
    R, origin = np.eye(3), np.zeros(3)
    parts = name.strip("/").split("/")
    for depth in range(1, len(parts) + 1):
        node = client.scene.get_handle_by_name("/" + "/".join(parts[:depth]))
        assert node is not None
        origin = origin + R @ node.position
        R = R @ matrix_from_quat(np.array(node.wxyz))
    return R, origin


def test_the_ned_node_sends_down_below_and_east_to_the_right_of_north() -> None:
    assert rotate(NED_WXYZ, (0.0, 0.0, 1.0)) == pytest.approx(tuple(-UP_W))
    assert rotate(NED_WXYZ, (1.0, 0.0, 0.0)) == pytest.approx(tuple(NORTH_W))
    assert rotate(NED_WXYZ, (0.0, 1.0, 0.0)) == pytest.approx(tuple(EAST_W))
    assert world_from_ned((1.0, 2.0, 3.0)) == pytest.approx(rotate(NED_WXYZ, (1.0, 2.0, 3.0)))


@pytest.mark.parametrize(
    ("camera", "nose_w"), [("follow", EAST_W), ("top", EAST_W), ("free", EAST_W), ("chase", NORTH_W)]
)
async def test_a_vehicle_facing_east_shows_east_except_to_the_camera_behind_it(camera: str, nose_w: Float) -> None:
    """20 m north, 5 m east, 7 m up, nose east and level: seen from each camera, with all nodes composed."""
    board = SyntheticBoard()
    board.rows = {"ins_ekf": lane_row((0.0, 0.0, math.pi / 2), (20.0, 5.0, -7.0))}
    with served([board], fly=False) as at:
        async with Watcher.connected(at.port, f"camera={camera}") as watcher:
            await watcher.node(VEHICLE)
            (client,) = at.view._server.get_clients().values()
            await eventually(lambda: not np.allclose(client.scene.get_handle_by_name("/ned/site").position, 0))
            R, origin = await asyncio.to_thread(world_from_node, client, VEHICLE)
            _, site = world_from_node(client, "/ned/site")
    np.testing.assert_allclose(R[:, 0], nose_w, atol=1e-5)
    np.testing.assert_allclose(-R[:, 2], UP_W, atol=1e-5)
    np.testing.assert_allclose(origin, 0.0, atol=1e-9)
    assert site[2] == pytest.approx(-7.0)  # the ground is below, whichever way the camera looks
    assert math.hypot(site[0], site[1]) == pytest.approx(math.hypot(20.0, 5.0))


def test_a_free_camera_keeps_its_place_and_a_chasing_one_lags_then_arrives() -> None:
    before = Anchor((1.0, 2.0, 3.0), 0.5)
    turned = pose_from_row(lane_row((0.0, 0.0, 2.0), (9.0, 9.0, -9.0)))
    assert next_anchor(Camera.FREE, before, turned.pos_n_m, turned.q_nb, 0.04) is before
    anchor = next_anchor(Camera.CHASE, before, turned.pos_n_m, turned.q_nb, 0.04)
    assert anchor.origin_n_m == (9.0, 9.0, -9.0)
    assert 0.5 < anchor.yaw_rad < 1.0
    for _ in range(200):
        anchor = next_anchor(Camera.CHASE, anchor, turned.pos_n_m, turned.q_nb, 0.04)
    assert anchor.yaw_rad == pytest.approx(2.0, abs=1e-6)


def test_chasing_across_south_turns_the_short_way() -> None:
    south_east, south_west = math.radians(170.0), math.radians(-170.0)
    pose = pose_from_row(lane_row((0.0, 0.0, south_west)))
    yaw = next_anchor(Camera.CHASE, Anchor(yaw_rad=south_east), pose.pos_n_m, pose.q_nb, 0.1).yaw_rad
    assert abs(math.degrees(yaw)) > 170.0


@pytest.mark.parametrize("yaw_rad", [-3.0, -1.0, 0.0, 0.7, 3.1])
def test_heading_is_read_back_from_any_attitude(yaw_rad: float) -> None:
    pose = pose_from_row(lane_row((0.4, -0.3, yaw_rad)))
    assert yaw_from_quat(pose.q_nb) == pytest.approx(yaw_rad)


def test_fit_all_puts_every_point_inside_the_picture() -> None:
    points = np.random.default_rng(1).uniform([-300, -20, -80], [40, 500, 0], (200, 3))
    anchor = Anchor((30.0, -60.0, -10.0), 1.1)
    position, target = (np.array(v) for v in fit_m(points, anchor, 1.5))
    looking = (target - position) / np.linalg.norm(target - position)
    seen = np.array([world_from_ned(anchor.locate(tuple(p))) for p in points]) - position
    angle = np.arccos(seen @ looking / np.linalg.norm(seen, axis=1))
    assert np.degrees(angle).max() < 0.5 * 55.0
    assert np.degrees(angle).max() > 8.0  # and not from the moon


@pytest.mark.parametrize("towards", [(2.0, 0.0, 0.0), (-3.0, 0.0, 0.0), (0.1, -0.2, 0.7), (-1.0, 1e-3, -2e-3)])
def test_the_tip_of_a_path_points_where_it_should(towards: tuple[float, float, float]) -> None:
    direction = np.array(towards) / np.linalg.norm(towards)
    q = quat_from_x(np.array(towards))
    assert math.hypot(*q) == pytest.approx(1.0)
    np.testing.assert_allclose(rotate(q, (1.0, 0.0, 0.0)), direction, atol=2e-3)


def test_the_ellipsoid_is_three_sigma_along_north_east_down() -> None:
    assert ellipsoid_axes_m((0.1, 0.2, 0.5)) == pytest.approx((0.3, 0.6, 1.5))
    assert ellipsoid_axes_m((0.1, math.nan, 0.5)) is None


@pytest.mark.parametrize("axis_b", [(1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
def test_cones_spread_as_the_axis_does_under_random_attitude_errors(axis_b: tuple[float, float, float]) -> None:
    """Second method: draw error rotations in NED, turn the axis, and measure its covariance in body axes."""
    sigma = np.array([0.004, 0.009, 0.02])
    pose = pose_from_row(lane_row((0.5, -0.4, 2.1)))
    R_nb = matrix_from_quat(np.array(pose.q_nb))
    errors = np.random.default_rng(7).normal(size=(200_000, 3)) * sigma
    moved_b = np.cross(errors, R_nb @ axis_b) @ R_nb
    along = int(np.argmax(np.abs(axis_b)))
    sampled = np.cov(moved_b[:, [(along + 1) % 3, (along + 2) % 3]].T) * 9.0
    spread = cone_spread_rad(pose.q_nb, tuple(sigma), axis_b)
    np.testing.assert_allclose(spread, sampled, atol=0.02 * sampled.max())


def test_a_heading_cone_opens_three_sigma_sideways_and_hardly_upwards() -> None:
    spread = cone_spread_rad((1.0, 0.0, 0.0, 0.0), (0.001, 0.001, 0.1), (1.0, 0.0, 0.0))
    rim = cone_vertices_m((1.0, 0.0, 0.0), spread, 2.0)[1:]
    assert math.degrees(np.arctan2(rim[:, 1], rim[:, 0]).max()) == pytest.approx(math.degrees(0.3), abs=0.1)
    assert np.abs(rim[:, 2]).max() == pytest.approx(2.0 * 0.003, rel=0.05)
    np.testing.assert_allclose(np.linalg.norm(rim, axis=1), 2.0)


def test_unknown_values_hide_the_uncertainty_and_leave_the_vehicle_level_at_the_site() -> None:
    row = lane_row()
    row[:] = math.nan
    pose = pose_from_row(row)
    assert (pose.q_nb, pose.pos_n_m, pose.known) == ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), False)
    assert cone_spread_rad(pose.q_nb, pose.sigma_att_rad, (1.0, 0.0, 0.0)) is None

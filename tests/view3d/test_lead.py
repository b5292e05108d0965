"""The vehicle follows the chosen main lane; where that has no position, another one's place, turning with the main."""

import math

import numpy as np
import pytest

from server.nav.types import LANE_COLUMNS, Float, LaneRows
from server.view3d.lead import Lead
from server.view3d.trail import Track
from tests.view3d.synthetic import (
    RADIUS_M,
    SyntheticBoard,
    Watcher,
    eventually,
    lane_row,
    served,
    snapshot_of,
    step_result,
)

UNKNOWN = (math.nan, math.nan, math.nan)
NORTH, EAST, BACK = 0.0, math.pi / 2, 3.0


def attitude_only(yaw_rad: float) -> Float:
    return lane_row((0.0, 0.0, yaw_rad), UNKNOWN, UNKNOWN, sigma_pos_n_m=UNKNOWN)


def at(north_m: float, yaw_rad: float) -> Float:
    return lane_row((0.0, 0.0, yaw_rad), (north_m, 0.0, -1.0))


def led(rows: dict[str, Float], main: str) -> Lead:
    track, lead = Track(), Lead()
    track.take(snapshot_of(rows))
    lead.choose(main, track)
    return lead


ROWS = {"ins_ekf": at(1.0, NORTH), "nav_position": at(2.0, EAST), "onboard": at(3.0, BACK), "vqf": attitude_only(BACK)}


@pytest.mark.parametrize(
    ("main", "turns", "place"),
    [
        ("ins_ekf", "ins_ekf", "ins_ekf"),
        ("nav_position", "nav_position", "nav_position"),
        ("onboard", "onboard", "onboard"),
        ("vqf", "vqf", "ins_ekf"),
        ("altitude_kalman", "ins_ekf", "ins_ekf"),  # knows neither
        ("dmp", "ins_ekf", "ins_ekf"),  # chosen, and nothing of it seen yet
    ],
)
def test_the_main_lane_is_followed_in_what_it_knows(main: str, turns: str, place: str) -> None:
    lead = led(ROWS, main)
    assert (lead.turns, lead.place) == (turns, place)


@pytest.mark.parametrize(
    ("without", "place"),
    [((), "ins_ekf"), (("ins_ekf",), "nav_position"), (("ins_ekf", "nav_position"), "onboard")],
)
def test_without_a_fix_of_the_main_lane_estimators_stand_in_before_what_repeats(
    without: tuple[str, ...], place: str
) -> None:
    rows = {lane: attitude_only(NORTH) if lane in without else row for lane, row in ROWS.items()}
    lead = led(rows | {"complementary": attitude_only(EAST)}, "complementary")
    assert (lead.turns, lead.place) == ("complementary", place)


def test_before_any_position_the_vehicle_turns_in_place_with_the_main_lane() -> None:
    lead = led({"ins_ekf": attitude_only(NORTH), "vqf": attitude_only(EAST)}, "vqf")
    pose = lead.follow([step_result({"ins_ekf": attitude_only(NORTH), "vqf": attitude_only(EAST)})])
    assert pose is not None
    assert (pose.turned, pose.known, pose.pos_n_m) == (True, False, (0.0, 0.0, 0.0))
    np.testing.assert_allclose(pose.q_nb, attitude_only(EAST)[:4])


def test_a_borrowed_place_comes_with_its_own_uncertainty_and_the_main_lanes_attitude_with_its() -> None:
    lead = led(ROWS, "vqf")
    row = lane_row((0.0, 0.0, EAST), UNKNOWN, UNKNOWN, (0.1, 0.2, 0.3), UNKNOWN)
    pose = lead.follow([step_result({"ins_ekf": at(7.0, NORTH), "vqf": row})])
    assert pose is not None
    assert (pose.pos_n_m, pose.sigma_pos_n_m) == ((7.0, 0.0, -1.0), (0.1, 0.1, 0.15))
    assert pose.sigma_att_rad == (0.1, 0.2, 0.3)
    np.testing.assert_allclose(pose.q_nb, row[:4])


def test_of_a_lane_whose_attitude_and_position_come_in_turns_the_vehicle_loses_neither() -> None:
    """Rows of a board's own report: the attitude of one moment, then the place of the next, in one result or in two."""
    lead = led(ROWS, "onboard")
    place = at(4.0, NORTH)
    place[:4] = math.nan
    place[LANE_COLUMNS.index("sigma_att_x_rad") :][:3] = math.nan
    for rows in ([attitude_only(EAST), place], [place, attitude_only(EAST)]):
        t_ns = np.array([0, 1], dtype=np.int64)
        result = step_result({})
        object.__setattr__(result, "lanes", (LaneRows(lane="onboard", t_ns=t_ns, data=np.array(rows)),))
        pose = lead.follow([result])
        assert pose is not None
        assert pose.pos_n_m == (4.0, 0.0, -1.0)
        np.testing.assert_allclose(pose.q_nb, attitude_only(EAST)[:4])


def test_results_of_other_lanes_alone_move_nothing() -> None:
    lead = led(ROWS, "nav_position")
    assert lead.follow([step_result({"ins_ekf": at(9.0, NORTH)})]) is None
    assert lead.pose() is not None


def circle_of(pos_n_m: tuple[float, float, float]) -> str:
    """The lane of a `SyntheticBoard` on whose circle a place lies; the circles touch where they start."""
    north, east, _ = pos_n_m
    radii = {"ins_ekf": RADIUS_M, "reference": RADIUS_M + 0.5, "onboard": RADIUS_M - 0.8}
    return min(radii, key=lambda lane: abs(math.hypot(north, east - radii[lane]) - radii[lane]))


async def test_who_looks_sees_the_vehicle_go_over_to_the_lane_that_is_chosen() -> None:
    board = SyntheticBoard(more=("vqf",))
    for _ in range(500):
        board.fly(publish=False)
    with served([board]) as site:
        async with Watcher.connected(site.port):

            def lane() -> str:
                viewer = next(iter(site.view._expected.values()), None)  # none yet: the proxy is still connecting
                pose = None if viewer is None else viewer._pose
                return "" if pose is None else circle_of(pose.pos_n_m)

            for main, place in {"ins_ekf": "ins_ekf", "reference": "reference", "vqf": "ins_ekf"}.items():
                board.main_lane = main
                await eventually(lambda place=place: lane() == place)  # type: ignore[misc]
            board.off = frozenset({"ins_ekf", "onboard"})
            await eventually(lambda: lane() == "reference")

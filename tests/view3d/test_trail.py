"""A path of any length stays whole and bounded: in memory, in node names, and in viser's buffers."""

import asyncio
import gc

import numpy as np
import pytest

from server.nav.lanes.registry import RECORDED_LANES
from server.view3d.palette import LANE_RGB, THEMES, lane_rgb, linear_from_srgb, scale_rgb
from server.view3d.trail import CHUNK, PATH_CHUNKS, Track, Trail
from tests.view3d.synthetic import SyntheticBoard, Watcher, circling, eventually, lane_row, served, snapshot_of

UPDATES = 100_000


def test_a_long_path_keeps_its_beginning_its_end_and_an_even_spacing() -> None:
    trail = Trail(PATH_CHUNKS)
    for i in range(UPDATES):
        trail.add((float(i), 0.0, 0.0), float(i), 0.0)
    north = trail.points[:, 0]
    assert PATH_CHUNKS * CHUNK // 2 <= trail.count <= PATH_CHUNKS * CHUNK
    assert north[0] == 0.0
    assert north[-1] > UPDATES - 64
    assert len(set(np.diff(north))) == 1


def test_a_board_that_does_not_move_has_an_empty_path() -> None:
    track = Track()
    noise = np.random.default_rng(3).normal(0, 0.01, (500, 3))
    for offset in noise:
        track.take(snapshot_of({"ins_ekf": lane_row(pos_n_m=tuple(offset))}))
    assert track.lanes["ins_ekf"].count == 1


def test_a_new_power_up_starts_the_paths_over() -> None:
    track = Track()
    for i in range(10):
        track.take(snapshot_of({"ins_ekf": circling(i)}, i, (float(i), 0.0, 0.0)))
    assert (track.lanes["ins_ekf"].count, track.fixes.count) == (10, 10)
    track.take(snapshot_of({"ins_ekf": circling(0)}, 0, boot_id=1))
    assert (track.lanes["ins_ekf"].count, track.fixes.count) == (1, 0)


def test_a_lane_that_is_switched_off_leaves_and_comes_back_without_its_old_path() -> None:
    track = Track()
    both = {"ins_ekf": circling(0), "nav_position": circling(0)}
    for i in range(5):
        track.take(snapshot_of({lane: circling(i) for lane in both}, i))
    track.take(snapshot_of({"ins_ekf": circling(5)}, 5))
    assert (set(track.lanes), set(track.poses)) == ({"ins_ekf"}, {"ins_ekf"})
    track.take(snapshot_of({lane: circling(6) for lane in both}, 6))
    assert (track.lanes["nav_position"].count, track.lanes["ins_ekf"].count) == (1, 7)


def test_the_same_fix_is_marked_once() -> None:
    track = Track()
    for t_ns in (1, 1, 1, 2):
        track.take(snapshot_of({}, t_ns, (1.0, 2.0, 3.0)))
    assert track.fixes.count == 2


async def test_100000_points_use_a_fixed_set_of_names_and_leave_nothing_in_visers_buffers() -> None:
    """Fed through a connected viewer, thinning included: names from the fixed set, buffers as small as at the start."""
    board = SyntheticBoard()
    board.rows = {"ins_ekf": lane_row()}
    with served([board], fly=False) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.node("/ned/here/vehicle")
            server = at.view._server._websock_server
            broadcast_before = len(server._broadcast_buffer.message_from_id)
            await eventually(lambda: "one" in at.view._tracks and bool(at.view._tracks["one"].lanes))
            trail = at.view._tracks["one"].lanes["ins_ekf"]
            for start in range(0, UPDATES, 2_000):
                for i in range(start, start + 2_000):
                    trail.add((i * 0.2, 0.0, -5.0), 1.0, 0.1)
                await asyncio.sleep(0.02)
            last = -(-trail.count // CHUNK) - 1
            await watcher.node(f"/ned/site/path-ins_ekf/{last}")
            (state,) = server._client_state_from_id.values()
            await eventually(lambda: len(state.message_buffer.message_from_id) < 20)
            assert len(server._broadcast_buffer.message_from_id) == broadcast_before
        names = watcher.named("/ned/site/path-")
    assert names <= {"/ned/site/path-ins_ekf"} | {f"/ned/site/path-ins_ekf/{i}" for i in range(PATH_CHUNKS)}
    assert len(names) >= PATH_CHUNKS // 2
    gc.collect()


def test_lane_colours_differ_in_both_themes_and_unknown_lanes_keep_theirs() -> None:
    for theme in THEMES:
        colours = [*LANE_RGB[theme].values(), lane_rgb("of_tomorrow", theme)]
        assert len(set(colours)) == len(colours)
        assert LANE_RGB[theme].keys() == set(RECORDED_LANES)
    assert lane_rgb("of_tomorrow", "dark") == lane_rgb("of_tomorrow", "light")


def test_the_sequential_scale_rises_in_lightness() -> None:
    rgb = scale_rgb(np.linspace(-0.5, 1.5, 60)) / 255.0
    lightness = linear_from_srgb((255 * rgb).astype(np.uint8)) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness) >= -1.0).all()
    assert lightness[-1] > 5 * lightness[0]


@pytest.mark.parametrize(("srgb", "linear"), [(0, 0), (255, 255), (128, 55), (188, 128)])
def test_srgb_is_linearised_by_the_standard_curve(srgb: int, linear: int) -> None:
    assert linear_from_srgb(np.array([srgb], dtype=np.uint8))[0] == linear

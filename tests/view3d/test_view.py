"""Work happens only while somebody looks, each viewer sees its own board, and a late one sees the whole path."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from server.nav.types import Kind, VehicleClass
from server.view3d.trail import CHUNK, PATH_CHUNKS, Trail
from server.view3d.view import MAX_VIEWERS, SAMPLE_S
from tests.view3d.synthetic import SyntheticBoard, Watcher, camera_message, eventually, sample_block, served

VEHICLE = "/ned/here/vehicle"


def is_pose(message: dict[str, object]) -> bool:
    return message["type"] == "SetOrientationMessage" and message["name"] == VEHICLE


async def test_the_hub_has_no_reader_before_a_viewer_comes_and_none_after_it_left() -> None:
    board = SyntheticBoard()
    with served([board]) as at:
        await asyncio.sleep(0.2)
        assert board.hub.results.readers == 0
        async with Watcher.connected(at.port) as watcher:
            await watcher.until(is_pose)
            await eventually(lambda: board.hub.results.readers == 1)
            assert at.view.viewers == 1
        await eventually(lambda: board.hub.results.readers == 0 and at.view.viewers == 0)
        assert at.view._stages == {}
        await eventually(lambda: at.view._server.get_clients() == {})


async def test_without_viewers_nothing_is_queued_for_anybody() -> None:
    board = SyntheticBoard()
    with served([board]) as at:
        buffer = at.view._server._websock_server._broadcast_buffer
        before = buffer.message_counter
        seen = board.snapshots
        await eventually(lambda: board.snapshots > seen + 2)
        assert buffer.message_counter == before


async def test_a_hidden_page_is_sent_nothing_and_catches_up_when_shown() -> None:
    board = SyntheticBoard()
    with served([board]) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.until(is_pose)
            await watcher.command(visible=False)
            await eventually(lambda: board.hub.results.readers == 0)
            await asyncio.sleep(0.2)
            count = len(watcher.messages)
            await asyncio.sleep(3 * SAMPLE_S)
            assert len(watcher.messages) == count
            await watcher.command(visible=True)
            await eventually(lambda: any(map(is_pose, watcher.messages[count:])))


async def test_a_late_viewer_sees_the_path_flown_before_it_came() -> None:
    board = SyntheticBoard()
    with served([board]) as at:
        await eventually(lambda: "one" in at.view._tracks and at.view._tracks["one"].lanes["ins_ekf"].count >= 3)
        async with Watcher.connected(at.port) as watcher:
            for lane in ("ins_ekf", "reference", "onboard"):
                await watcher.node(f"/ned/site/path-{lane}/0")
            await watcher.node("/ned/site/fixes/0")
            await watcher.node("/ned/site/accuracy")


async def test_lanes_switched_on_and_off_appear_and_leave_for_who_looks_already() -> None:
    """A path for one with a position, axes at the vehicle for one with an attitude alone, turning with it."""
    axes, path = "/ned/here/axes-vqf", "/ned/site/path-onboard/0"

    def removed(name: str) -> Callable[[dict[str, object]], bool]:
        return lambda message: message["type"] == "RemoveSceneNodeMessage" and message["name"] == name

    board = SyntheticBoard()
    with served([board]) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.node(path)
            assert axes not in watcher.named("/ned/here")
            board.more = ("vqf",)
            await watcher.node(axes)
            await watcher.until(lambda m: m["type"] == "SetOrientationMessage" and m["name"] == axes)
            board.off = frozenset({"onboard", "vqf"})
            await watcher.until(removed(path))
            await watcher.until(removed(axes))
            count = len(watcher.messages)
            board.off = frozenset()
            await eventually(lambda: any(m.get("name") == path and "props" in m for m in watcher.messages[count:]))


async def test_without_a_lane_that_knows_a_position_the_vehicle_turns_in_place() -> None:
    board = SyntheticBoard(more=("vqf",), off=frozenset({"ins_ekf", "onboard", "reference"}))
    with served([board]) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.until(is_pose)


async def test_frame_by_frame_no_node_of_a_path_is_built_anew() -> None:
    """A browser takes places and directions as they come; what it builds anew at the frame rate starves the rest."""
    board = SyntheticBoard()
    with served([board]) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.node("/ned/site/tip")
            count = len(watcher.messages)
            await asyncio.sleep(2.0)
            built = [m for m in watcher.messages[count:] if "updates" in m or "props" in m]
            turned = [m for m in watcher.messages[count:] if m.get("name") == "/ned/site/tip"]
    lines = [m for m in built if str(m["name"]).startswith("/ned/site/path-")]
    tips = [m for m in built if m["name"] == "/ned/site/tip"]
    assert len(turned) > 10
    assert len(tips) <= 8
    assert len(lines) <= 3 * 14


async def test_two_viewers_look_at_two_boards_and_one_changes_over() -> None:
    boards = [SyntheticBoard("a"), SyntheticBoard("b")]
    with served(boards) as at:
        async with Watcher.connected(at.port, "board=a") as first, Watcher.connected(at.port, "board=b") as second:
            await first.until(is_pose)
            await second.until(is_pose)
            await eventually(lambda: [board.hub.results.readers for board in boards] == [1, 1])
            await second.command(board="a")
            await eventually(lambda: [board.hub.results.readers for board in boards] == [1, 0])
            await asyncio.sleep(0.1)
            count = len(second.messages)
            await eventually(lambda: any(map(is_pose, second.messages[count:])))


async def test_a_board_that_appears_later_is_shown_without_reconnecting() -> None:
    boards: list[SyntheticBoard] = []
    with served(boards) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.node(VEHICLE)
            board = SyntheticBoard("late")
            at.loop.call_soon_threadsafe(board.fly)
            boards.append(board)
            await eventually(lambda: board.hub.results.readers == 1)
            at.loop.call_soon_threadsafe(board.fly)
            await watcher.until(is_pose)


async def test_at_most_25_poses_a_second_are_sent_of_50() -> None:
    with served([SyntheticBoard()]) as at:
        async with Watcher.connected(at.port, "camera=follow") as watcher:
            await watcher.until(is_pose)
            count = len(watcher.messages)
            await asyncio.sleep(2.0)
            poses = sum(map(is_pose, watcher.messages[count:]))
    assert 10 <= poses <= 52


@pytest.mark.parametrize(
    ("kind", "part"),
    [
        (VehicleClass.MULTIROTOR, "front-discs"),
        (VehicleClass.FIXED_WING, "wings"),
        (VehicleClass.UNKNOWN, "rear-discs"),
    ],
)
async def test_the_vehicle_is_drawn_after_its_class(kind: VehicleClass, part: str) -> None:
    with served([SyntheticBoard()], kind) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.node(f"{VEHICLE}/{part}")


async def test_the_boards_own_word_changes_the_drawing_unless_the_settings_said() -> None:
    profile = sample_block([(Kind.PROFILE, (0.0, 0.0, 0.0, 0.0, float(VehicleClass.FIXED_WING)))])
    board = SyntheticBoard(block=profile)
    with served([board], VehicleClass.UNKNOWN) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.node(f"{VEHICLE}/wings")
            await watcher.until(lambda m: m["type"] == "RemoveSceneNodeMessage" and m["name"].startswith(VEHICLE))
    board = SyntheticBoard(block=profile)
    with served([board], VehicleClass.MULTIROTOR) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.until(is_pose)
            await eventually(lambda: at.view._tracks["one"].kind == VehicleClass.FIXED_WING)
            await asyncio.sleep(0.5)
        assert f"{VEHICLE}/wings" not in watcher.named(VEHICLE)


async def test_commands_move_camera_colours_and_ground() -> None:
    with served([SyntheticBoard()]) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.node("/ned/site/path-ins_ekf/0")
            await watcher.command(camera="top")
            high = await watcher.until(lambda m: m["type"] == "SetCameraPositionMessage" and not m.get("initial"))
            assert high["position"][2] > 10
            await watcher.command(theme="light")
            await watcher.until(lambda m: m.get("name") == "/ned/site/ground" and "plane_color" in m.get("updates", {}))
            await watcher.command(fit=True)
            await watcher.until(lambda m: m["type"] == "SetCameraLookAtMessage" and m["look_at"] != [0, 0, 0])


async def test_after_a_reconnect_the_camera_stays_where_the_person_put_it() -> None:
    with served([SyntheticBoard()]) as at:
        async with Watcher.connected(at.port, "camera=chase") as watcher:
            await watcher.until(is_pose)
            await watcher.command(camera="top", resume=True)
            await asyncio.sleep(0.5)
        moves = [m for m in watcher.messages if m["type"] == "SetCameraPositionMessage" and not m.get("initial")]
    assert moves == []


async def test_more_viewers_than_the_limit_are_refused() -> None:
    with served([SyntheticBoard()]) as at:
        at.view._expected = {-i: None for i in range(1, MAX_VIEWERS + 1)}  # type: ignore[misc]
        with pytest.raises(Exception, match="403"):
            async with Watcher.connected(at.port):
                pass
        at.view._expected.clear()


def fill(trail: Trail) -> None:
    """Make the path as long as it can be: repainting it is then 150 kB."""
    for i in range(PATH_CHUNKS * CHUNK):
        trail.add((0.1 * i, 0.0, -5.0), 1.0, 0.1)


async def test_a_browser_that_reads_nothing_piles_up_nothing_and_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Asked for 2 MB of repaints: its queue at viser merges, the other viewer is served, and then it is gone."""
    monkeypatch.setattr("server.view3d.proxy.SEND_TIMEOUT_S", 2.0)
    with served([SyntheticBoard()]) as at:
        async with Watcher.connected(at.port) as stuck:
            await stuck.node("/ned/site/path-ins_ekf/0")
            states = at.view._server._websock_server._client_state_from_id
            (stuck_id,) = states
            await asyncio.get_running_loop().run_in_executor(None, fill, at.view._tracks["one"].lanes["ins_ekf"])
            stuck._socket.transport.pause_reading()
            async with Watcher.connected(at.port) as watcher:
                await watcher.until(is_pose)
                longest = 0
                for i in range(14):
                    await stuck.command(color=("speed", "uncertainty")[i % 2])
                    await asyncio.sleep(0.25)  # one survey each, so that each is really painted
                    if stuck_id in states:
                        longest = max(longest, len(states[stuck_id].message_buffer.message_from_id))
                assert longest < 500
                count = len(watcher.messages)
                await eventually(lambda: sum(map(is_pose, watcher.messages[count:])) > 20)
                await eventually(lambda: stuck_id not in states)
                assert at.view.viewers == 1
            stuck._socket.transport.resume_reading()


async def test_from_afar_the_vehicle_is_drawn_larger_and_the_grid_coarser() -> None:
    def resized(message: dict[str, Any]) -> bool:
        return message.get("name") == f"{VEHICLE}/body" and message.get("updates", {}).get("scale", 1.0) > 3.0

    def coarser(message: dict[str, Any]) -> bool:
        return message.get("name") == "/ned/site/ground" and message.get("updates", {}).get("cell_size") == 10.0

    with served([SyntheticBoard()]) as at:
        async with Watcher.connected(at.port, "camera=follow") as watcher:
            await watcher.until(is_pose)
            assert not any(map(resized, watcher.messages))
            await watcher.send(camera_message(position=[-60, -60, 60]))
            await watcher.until(resized)
            await watcher.until(coarser)

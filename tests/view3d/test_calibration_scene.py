"""The calibration scene: asked for by name, worked for only while looked at, sent only what changed."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from server.calibration.scene import CalibrationScene
from server.nav.calibration.types import FACES, CalKind, Progress
from server.nav.types import Kind, VehicleClass
from server.view3d.feed import Quat
from server.view3d.geometry import rotate
from tests.view3d.jobs import mag_job, six_job
from tests.view3d.synthetic import SyntheticBoard, Watcher, eventually, sample_block, served

NOW = "/ned/cal/now"
QUERY = "scene=calibration"


@dataclass
class Jobs:
    """What the server would say of each board's calibration; counts how often it was asked."""

    job: CalibrationScene | None = None
    make: Callable[[int], CalibrationScene | None] | None = None
    asked: list[str] = field(default_factory=list)

    def __call__(self, board_id: str) -> CalibrationScene | None:
        self.asked.append(board_id)
        return self.job if self.make is None else self.make(len(self.asked))


def made(watcher: Watcher, since: int, name: str) -> list[dict[str, Any]]:
    """Messages that made this node."""
    return [m for m in watcher.messages[since:] if m.get("name") == name and "props" in m]


async def quiet(watcher: Watcher) -> int:
    """Return the number of messages once no node is built any more."""
    while True:
        count = len(watcher.messages)
        await asyncio.sleep(1.0)
        if not any("props" in m for m in watcher.messages[count:]):
            return count


async def test_without_a_job_there_is_the_vehicle_as_it_is_held_and_a_word() -> None:
    with served([SyntheticBoard()], scene_of=Jobs()) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await watcher.node(f"{NOW}/vehicle/body")
            await watcher.until(lambda m: m["type"] == "SetOrientationMessage" and m["name"] == NOW)
            label = await watcher.node("/ned/cal/title-0")
            assert label["props"]["text"] == "no calibration is running"
            assert watcher.named("/ned/site") == set()
            assert watcher.named("/ned/here") == set()


async def test_a_service_without_calibrations_shows_the_same() -> None:
    with served([SyntheticBoard()]) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await watcher.node("/ned/cal/title-0")


async def test_nobody_asks_for_jobs_unless_somebody_looks_at_them() -> None:
    jobs = Jobs(six_job())
    with served([SyntheticBoard("a"), SyntheticBoard("b")], scene_of=jobs) as at:
        async with Watcher.connected(at.port, "board=a") as flight:
            await flight.node("/ned/site/ground")
            await asyncio.sleep(1.0)
            assert jobs.asked == []
        async with Watcher.connected(at.port, f"board=b&{QUERY}") as watcher:
            await watcher.node(f"{NOW}/face-0")
            assert set(jobs.asked) == {"b"}
            await watcher.command(visible=False)
            await asyncio.sleep(0.6)
            before = len(jobs.asked)
            await asyncio.sleep(1.0)
            assert len(jobs.asked) == before
            await watcher.command(visible=True)
            await eventually(lambda: len(jobs.asked) > before)


async def test_it_asks_at_most_four_times_a_second_and_sends_points_no_more_often() -> None:
    jobs = Jobs(make=lambda n: mag_job(seed=n))
    with served([SyntheticBoard()], scene_of=jobs) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await watcher.node(f"{NOW}/dots")
            asked, since = len(jobs.asked), len(watcher.messages)
            await asyncio.sleep(3.0)
            assert 1 <= len(jobs.asked) - asked <= 12
            assert 1 <= len(made(watcher, since, f"{NOW}/dots")) <= 12


async def test_a_job_that_stands_still_is_not_sent_again() -> None:
    with served([SyntheticBoard()], scene_of=Jobs(mag_job(fitted=True))) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await watcher.node("/ned/cal/then/dots")
            since = await quiet(watcher)
            await asyncio.sleep(1.5)
            assert [m["name"] for m in watcher.messages[since:] if "props" in m] == []


async def test_faces_fill_one_by_one_and_each_state_has_its_own_shape() -> None:
    jobs = Jobs(six_job(("level",), "nose-up"))
    with served([SyntheticBoard()], scene_of=jobs) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            for i in range(6):
                await watcher.node(f"{NOW}/face-{i}")
            await watcher.node(f"{NOW}/mark-{FACES.index('level')}")  # the tick
            await watcher.node(f"{NOW}/mark-{FACES.index('nose-up')}")  # the arrow
            assert f"{NOW}/mark-{FACES.index('nose-down')}" not in watcher.named(NOW)
            plates = [made(watcher, 0, f"{NOW}/face-{i}")[0]["props"]["vertices"].size for i in (5, 0, 1)]
            marks = [made(watcher, 0, f"{NOW}/mark-{i}")[0]["props"]["vertices"].size for i in (5, 0)]
            assert len(set(zip(plates, [*marks, 0], strict=True))) == 3
            assert plates[0] > plates[1]  # filled
            since = await quiet(watcher)
            jobs.job = six_job(("level", "nose-up"), "nose-down")
            await eventually(lambda: bool(made(watcher, since, f"{NOW}/mark-1")))
            await quiet(watcher)
            sent = {m["name"] for m in watcher.messages[since:] if "props" in m}
            assert sent == {f"{NOW}/face-0", f"{NOW}/face-1", f"{NOW}/mark-0", f"{NOW}/mark-1", f"{NOW}/side-1"}


def orientation(watcher: Watcher, name: str) -> Quat | None:
    told = [m["wxyz"] for m in watcher.messages if m["type"] == "SetOrientationMessage" and m["name"] == name]
    return (told[-1][0], told[-1][1], told[-1][2], told[-1][3]) if told else None


async def test_the_ghost_shows_the_pose_to_take_and_leaves_with_it() -> None:
    jobs = Jobs(six_job(face_next="right-up"))
    with served([SyntheticBoard()], scene_of=jobs) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await watcher.node("/ned/cal/then/body")
            await eventually(lambda: orientation(watcher, "/ned/cal/then") is not None)
            ghost = orientation(watcher, "/ned/cal/then")
            assert ghost is not None
            np.testing.assert_allclose(rotate(ghost, (0.0, -1.0, 0.0)), (0.0, 0.0, 1.0), atol=1e-5)
            assert made(watcher, 0, "/ned/cal/then/body")[0]["props"]["opacity"] < 1.0
            jobs.job = six_job(FACES, "")
            await watcher.until(lambda m: m["type"] == "RemoveSceneNodeMessage" and m["name"] == "/ned/cal/then")


async def test_a_target_of_no_face_is_shown_as_well() -> None:
    target_b = (0.6, 0.0, 0.8)
    progress = Progress(fraction=0.2, phase="next-pose", instruction="put-any-pose", pose_target_b=target_b)
    kind = CalKind.ACCEL_MULTI_POSE
    job = CalibrationScene(job_id="many", kind=kind, state="collecting", progress=progress, fit=None)
    with served([SyntheticBoard()], scene_of=Jobs(job)) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await eventually(lambda: orientation(watcher, "/ned/cal/then") is not None)
            ghost = orientation(watcher, "/ned/cal/then")
            assert ghost is not None
            np.testing.assert_allclose(rotate(ghost, target_b), (0.0, 0.0, 1.0), atol=1e-5)


async def test_without_lanes_the_vehicle_is_held_as_gravity_says() -> None:
    nose_up = sample_block([(Kind.IMU, (0.0, 0.0, 0.0, 9.81, 0.0, 0.0, 20.0))])
    board = SyntheticBoard(off=frozenset({"ins_ekf", "reference", "onboard"}), block=nose_up)
    with served([board], scene_of=Jobs()) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await eventually(lambda: orientation(watcher, NOW) is not None)
            q = orientation(watcher, NOW)
            assert q is not None
            np.testing.assert_allclose(rotate(q, (1.0, 0.0, 0.0)), (0.0, 0.0, -1.0), atol=1e-6)


async def test_a_field_is_shown_before_and_after_with_its_open_directions_and_offset() -> None:
    jobs = Jobs(mag_job())
    with served([SyntheticBoard()], scene_of=jobs) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            for part in ("dots", "globe", "ball", "open", "zero", "offset"):
                await watcher.node(f"{NOW}/{part}")
            assert watcher.named("/ned/cal/then") == set()
            points = made(watcher, 0, f"{NOW}/dots")[0]["props"]["points"]
            assert 300 < len(points) / 3 <= 1500
            assert 0.9 < np.linalg.norm(points.reshape(-1, 3).astype(float), axis=1).max() < 1.1
            jobs.job = mag_job(fitted=True, share=1.0)
            dots = await watcher.node("/ned/cal/then/dots")
            radii = np.linalg.norm(dots["props"]["points"].reshape(-1, 3).astype(float), axis=1)
            assert np.abs(radii - 1.0).max() < 0.1
            await watcher.until(lambda m: m["type"] == "RemoveSceneNodeMessage" and m["name"] == f"{NOW}/open")


async def test_the_present_sample_lies_in_the_field_in_gauss_and_is_hidden_while_the_scale_is_unknown() -> None:
    sample = (0.45, -0.12, 0.1)  # 0.2 from the offset along x; the ellipsoid's longest half axis is below 0.6
    board = SyntheticBoard(block=sample_block([(Kind.MAG, sample)]), mag_scale=0.0)
    with served([board], scene_of=Jobs(mag_job())) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await watcher.node(f"{NOW}/dots")
            await asyncio.sleep(0.5)
            assert f"{NOW}/sample" not in watcher.named(NOW)
            board.mag_scale = 1.0
            place = await watcher.until(
                lambda m: m["type"] == "SetPositionMessage" and m["name"] == f"{NOW}/sample" and any(m["position"])
            )
            x, y, z = place["position"]
            assert 0.2 / 0.6 < x < 0.2 / 0.5
            assert math.hypot(y, z) < 1e-6


async def test_scenes_change_by_command_both_ways_and_leave_nothing() -> None:
    def removed(watcher: Watcher, since: int) -> set[str]:
        return {m["name"] for m in watcher.messages[since:] if m["type"] == "RemoveSceneNodeMessage"}

    with served([SyntheticBoard()], scene_of=Jobs(six_job())) as at:
        async with Watcher.connected(at.port) as watcher:
            await watcher.node("/ned/site/path-ins_ekf/0")
            since = len(watcher.messages)
            await watcher.command(scene="calibration")
            await watcher.node(f"{NOW}/face-0")
            assert removed(watcher, since) >= {"/ned/site", "/ned/here"}
            assert any(m["type"] == "SetCameraPositionMessage" for m in watcher.messages[since:])
            since = len(watcher.messages)
            await watcher.command(scene="flight")
            await eventually(lambda: bool(made(watcher, since, "/ned/site/path-ins_ekf/0")))
            assert "/ned/cal" in removed(watcher, since)
            since = len(watcher.messages)
            await asyncio.sleep(0.8)
            assert not [m for m in watcher.messages[since:] if str(m.get("name", "")).startswith("/ned/cal")]


async def test_job_after_job_the_same_names_are_used() -> None:
    def make(n: int) -> CalibrationScene | None:
        six, mag = six_job(FACES[: n % 5], FACES[n % 5], f"six-{n // 3}"), mag_job(fitted=n % 2 == 0, job_id=f"mag-{n}")
        return (six, mag, None)[n % 3]

    with served([SyntheticBoard()], scene_of=Jobs(make=make)) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await eventually(lambda: at.view._stages != {})
            await asyncio.sleep(6.0)
            (stage, _) = at.view._stages["one"]
            (viewer,) = stage.viewers
            nodes = viewer._client.scene._handle_from_node_name  # type: ignore[union-attr]
            assert len(nodes) < 60
            assert len(watcher.named("/ned/cal")) < 75


@pytest.mark.parametrize("kind", [VehicleClass.FIXED_WING, VehicleClass.CAR])
async def test_every_class_of_vehicle_is_drawn_to_the_same_size(kind: VehicleClass) -> None:
    with served([SyntheticBoard()], kind, scene_of=Jobs()) as at:
        async with Watcher.connected(at.port, QUERY) as watcher:
            await watcher.node(f"{NOW}/vehicle/front")
            reach = 0.0
            for name in watcher.named(f"{NOW}/vehicle/"):
                vertices = made(watcher, 0, name)[0]["props"]["vertices"].reshape(-1, 3)
                reach = max(reach, float(np.ptp(vertices, axis=0).max()))
            assert 0.5 < reach < 1.6


async def test_a_theme_is_followed_and_the_camera_stays() -> None:
    with served([SyntheticBoard()], scene_of=Jobs(mag_job())) as at:
        async with Watcher.connected(at.port, f"{QUERY}&theme=dark") as watcher:
            await watcher.node(f"{NOW}/globe")
            since = await quiet(watcher)
            await watcher.command(theme="light")
            await eventually(
                lambda: bool(made(watcher, since, f"{NOW}/globe") and made(watcher, since, "/ned/cal/floor-0"))
            )
            assert not [m for m in watcher.messages[since:] if m["type"] == "SetCameraPositionMessage"]

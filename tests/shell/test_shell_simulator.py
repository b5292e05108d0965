"""The demo board turned through REST: a real demo board behind the router, other boards refused."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from server.api import simulator
from server.api.errors import install_errors
from server.link import LinkState, open_link
from server.link.base import Link, Turnable
from server.nav.calibration.types import FACES
from tests.shell.shell_fakes import FakeLink, until
from tests.shell.test_shell_door import assert_problem

PATH = "/api/v1/boards/sim/simulator"


class OneBoard:
    """As much of a board as the router needs."""

    def __init__(self, board_id: str, link: Link) -> None:
        self.id, self.link = board_id, link

    @property
    def simulator(self) -> Turnable | None:
        return self.link if isinstance(self.link, Turnable) else None


class FakeContext:
    def __init__(self, *boards: OneBoard) -> None:
        self.boards = {board.id: board for board in boards}


@contextlib.asynccontextmanager
async def serving(url: str = "sim:", *, is_open: bool = True) -> AsyncIterator[httpx.AsyncClient]:
    """Run the router over a demo board `sim` and a board `uav` that is none."""
    link = open_link(url)
    app = FastAPI()
    app.state.context = FakeContext(OneBoard("sim", link), OneBoard("uav", FakeLink("serial:///dev/ttyACM0")))
    install_errors(app)
    app.include_router(simulator.router)

    async def listen() -> None:
        async for _ in link.chunks():
            pass

    task = asyncio.create_task(listen()) if is_open else None
    try:
        if task is not None:
            await until(lambda: link.status.state is LinkState.OPEN)
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://test") as client:
            yield client
    finally:
        await link.close()
        if task is not None:
            await task


async def told(client: httpx.AsyncClient, **body: Any) -> dict[str, Any]:
    response = await client.post(PATH, json=body)
    assert response.status_code == 202, response.text
    return dict(response.json())


async def test_a_demo_board_says_what_it_does() -> None:
    async with serving() as client:
        body = (await client.get(PATH)).json()
        assert (body["board_id"], body["mode"], body["action"], body["name"]) == ("sim", "flying", "", "")
        assert (body["magnet_b_gauss"], body["room_n_gauss"], body["has_airspeed"]) == ([], [], False)
        assert (body["is_moving"], body["remaining_s"], body["link_back_s"]) == (False, 0.0, 0.0)
        assert body["down_b"][2] == pytest.approx(1.0, abs=0.01)


async def test_every_face_and_every_other_pose_can_be_asked_for() -> None:
    async with serving() as client:
        for face in FACES:
            body = await told(client, action="pose", face=face)
            assert (body["mode"], body["action"], body["name"]) == ("in-hand", "pose", face)
            assert body["remaining_s"] > 1.0
        assert (await told(client, action="pose", number=7))["name"] == "pose 7"
        assert (await told(client, action="pose", down_b=[0, 1, -1], is_held=True))["is_moving"]


async def test_every_motion_and_every_surrounding_answers_with_what_then_is() -> None:
    async with serving("sim:?errors=raw") as client:
        assert 35.0 < (await told(client, action="spin"))["remaining_s"] < 45.0
        assert 10.0 < (await told(client, action="spin", about="y", duration_s=10))["remaining_s"] < 15.0
        assert (await told(client, action="turntable", axis="x", turns=-3, rate_rad_s=2.0))["action"] == "turntable"
        assert (await told(client, action="shake", duration_s=2.0))["is_moving"]
        assert (await told(client, action="magnet", is_on=True))["magnet_b_gauss"] == [-0.03, 0.05, 0.26]
        assert (await told(client, action="magnet", is_on=False))["magnet_b_gauss"] == []
        body = await told(client, action="room_magnet", is_on=True, field_n_gauss=[0.1, 0.2, 0.3])
        assert body["room_n_gauss"] == [0.1, 0.2, 0.3]
        assert (await told(client, action="wind_on_pitot", is_on=True))["is_wind_on_pitot"]
        assert (await told(client, action="fly"))["action"] == "fly"
        assert 0.0 < (await told(client, action="drop_link", duration_s=3.0))["link_back_s"] <= 3.0


@pytest.mark.parametrize(
    ("body", "names"),
    [
        ({}, "action"),
        ({"action": "jump"}, "spin"),
        ({"action": "pose"}, "exactly one of face, down_b and number"),
        ({"action": "pose", "face": "level", "number": 2}, "exactly one of"),
        ({"action": "pose", "face": "sideways"}, "nose-up"),
        ({"action": "pose", "down_b": [0, 0, 0]}, "not zero"),
        ({"action": "pose", "down_b": [0, 1]}, "down_b"),
        ({"action": "pose", "number": 0}, "greater than or equal to 1"),
        ({"action": "pose", "face": "level", "wings": 2}, "wings"),
        ({"action": "spin", "duration_s": 1e9}, "less than or equal to 300"),
        ({"action": "spin", "about": "w"}, "'x', 'y' or 'z'"),
        ({"action": "turntable", "turns": 0}, "not 0"),
        ({"action": "turntable", "turns": 1.5}, "turns"),
        ({"action": "shake", "strength_m_s2": "hard"}, "strength_m_s2"),
        ({"action": "magnet"}, "is_on"),
        ({"action": "magnet", "is_on": 1}, "is_on"),
        ({"action": "magnet", "is_on": True, "field_b_gauss": [9, 0, 0]}, "field_b_gauss"),
        ({"action": "drop_link", "duration_s": 3600}, "less than or equal to 60"),
    ],
)
async def test_what_cannot_be_is_refused_by_name_and_limit_and_the_flight_goes_on(
    body: dict[str, Any], names: str
) -> None:
    async with serving() as client:
        response = await client.post(PATH, json=body)
        assert_problem(response, 422, "invalid-value")
        assert names in response.text
        assert (await client.get(PATH)).json()["mode"] == "flying"


async def test_wind_on_a_tube_that_is_not_there_is_a_conflict_that_names_the_link_to_open() -> None:
    async with serving() as client:
        response = await client.post(PATH, json={"action": "wind_on_pitot", "is_on": True})
        assert_problem(response, 409, "simulator-cannot")
        assert "sim:?errors=raw" in response.json()["remedy"]


async def test_another_board_is_no_simulator_and_a_board_that_is_none_is_unknown() -> None:
    async with serving() as client:
        for ask in (client.get, lambda path: client.post(path, json={"action": "fly"})):
            assert_problem(await ask("/api/v1/boards/uav/simulator"), 404, "not-a-simulator")
            assert_problem(await ask("/api/v1/boards/nobody/simulator"), 404, "no-such-board")


async def test_a_demo_board_whose_link_is_closed_is_a_conflict() -> None:
    async with serving(is_open=False) as client:
        assert_problem(await client.get(PATH), 409, "simulator-not-running")
        assert_problem(await client.post(PATH, json={"action": "spin"}), 409, "simulator-not-running")

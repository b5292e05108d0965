"""Estimators chosen and their numbers set while samples flow: REST, stream, across reconnects and reboots."""

import json
import math
from typing import Any

import pytest

from server.nav.lanes.registry import LANES as REAL_LANES
from server.nav.lanes.registry import parameters_of
from server.nav.types import LANE_COLUMNS
from server.parts import RealFactories
from tests.shell.shell_fakes import BREAK, LANES, REBOOT, SAMPLES_PER_STEP, Running, fake_settings, running, until
from tests.shell.test_shell_door import assert_problem
from tests.shell.test_shell_stream import ask, rows_of

PATH = "/api/v1/boards/sim/lanes"
GAIN = f"{PATH}/steady/parameters"


async def choose(run: Running, *lanes: str) -> dict[str, Any]:
    response = await run.client.put(PATH, json={"lanes": lanes})
    assert response.status_code == 200, response.text
    return response.json()


def of(body: dict[str, Any], lane: str) -> dict[str, Any]:
    return next(one for one in body["lanes"] if one["name"] == lane)


async def stepped(run: Running, steps: int = 1) -> None:
    """Have the newest engine make steps."""
    await until(lambda: run.factories.engines)
    goal = run.factories.engines[-1].steps + steps
    run.push(steps * SAMPLES_PER_STEP)
    await until(lambda: run.factories.engines[-1].steps >= goal)


async def test_every_lane_is_listed_with_its_state_and_its_parameters() -> None:
    async with running() as run:
        await stepped(run)
        body = (await run.client.get(PATH)).json()
        assert (body["board_id"], body["main_lane"]) == ("sim", "ins_ekf")
        assert body["chosen"] == ["ins_ekf", "onboard", "reference"]
        assert [one["name"] for one in body["lanes"]] == list(LANES)
        main, steady = of(body, "ins_ekf"), of(body, "steady")
        assert (main["chosen"], main["running"], main["status"]) == (True, True, "navigating")
        assert (steady["chosen"], steady["running"], steady["status"], steady["provides"]) == (
            False,
            False,
            None,
            "attitude",
        )
        gain = {"name": "gain_hz", "unit": "Hz", "default": 0.5, "minimum": 0.1, "maximum": 2.0, "value": 0.5}
        assert steady["parameters"][0] == {**gain, "meaning": "More follows faster."}
        assert (steady["parameters"][1]["default"], steady["parameters"][1]["value"]) == (None, None)


async def test_lanes_are_switched_while_samples_flow_and_the_first_is_the_main_one() -> None:
    async with running() as run:
        await stepped(run)
        body = await choose(run, "steady", "ins_ekf")
        assert (body["main_lane"], of(body, "steady")["running"], of(body, "onboard")["running"]) == (
            "steady",
            True,
            False,
        )
        await stepped(run)
        nav = (await run.client.get("/api/v1/boards/sim/nav")).json()
        assert (nav["lane"], nav["provides"], nav["status"]) == ("steady", "attitude", "navigating")
        board = (await run.client.get("/api/v1/boards/sim")).json()
        assert [lane["lane"] for lane in board["lanes"]] == ["ins_ekf", "steady"]
        lane_topics = {topic["topic"] for topic in board["topics"] if "/lanes/" in topic["topic"]}
        assert lane_topics == {"boards/sim/lanes/steady", "boards/sim/lanes/ins_ekf"}


@pytest.mark.parametrize(
    ("lanes", "status", "code"),
    [
        (["ins_ekf", "no\u0000pe"], 404, "no-such-lane"),
        (["ins_ekf", "ins_ekf"], 422, "bad-lanes"),
        ([], 422, "invalid-value"),
        (["x" * 81], 422, "invalid-value"),
        ("ins_ekf", 422, "invalid-value"),
        ([1], 422, "invalid-value"),
    ],
)
async def test_a_choice_that_cannot_be_changes_nothing(lanes: object, status: int, code: str) -> None:
    async with running() as run:
        response = await run.client.put(PATH, json={"lanes": lanes})
        assert_problem(response, status, code)
        assert response.json()["remedy"]
        assert (await run.client.get(PATH)).json()["chosen"] == ["ins_ekf", "onboard", "reference"]


async def test_a_parameter_is_set_and_null_takes_it_back_to_its_default() -> None:
    async with running() as run:
        body = (await run.client.patch(GAIN, json={"gain_hz": 2, "window_s": 3.5})).json()
        assert [one["value"] for one in of(body, "steady")["parameters"]] == [2.0, 3.5]
        body = (await run.client.patch(GAIN, json={"gain_hz": None, "window_s": None})).json()
        assert [one["value"] for one in of(body, "steady")["parameters"]] == [0.5, None]
        assert math.isnan(run.factories.engines[-1].values["steady"]["window_s"])


@pytest.mark.parametrize(
    ("values", "code", "named"),
    [
        ({"gain_hz": 2.0001}, "parameter-out-of-range", "gain_hz"),
        ({"gain_hz": 1.0, "window_s": 0.0}, "parameter-out-of-range", "window_s"),
        ({"gain_hz": 1.0, "gain": 1.0}, "no-such-parameter", "gain"),
        ({"gain_hz": "1"}, "invalid-value", "gain_hz"),
        ({"gain_hz": True}, "invalid-value", "gain_hz"),
        ({}, "invalid-value", "body"),
    ],
)
async def test_a_value_that_is_refused_is_named_with_its_limits_and_changes_nothing(
    values: dict[str, Any], code: str, named: str
) -> None:
    async with running() as run:
        response = await run.client.patch(GAIN, json=values)
        assert_problem(response, 422, code)
        problem = response.json()
        assert problem["remedy"]
        assert problem["errors"][0]["name"] == named
        if code == "parameter-out-of-range":
            assert f"{values[named]:g}" in problem["detail"]
            assert ("0.1 to 2 Hz" if named == "gain_hz" else "1 to 10 s") in problem["detail"] + problem["remedy"]
        steady = of((await run.client.get(PATH)).json(), "steady")
        assert [one["value"] for one in steady["parameters"]] == [0.5, None]


@pytest.mark.parametrize("content", [b'{"gain_hz": NaN}', b'{"gain_hz": Infinity}', b'{"gain_hz": 1e999}'])
async def test_a_value_that_is_no_finite_number_is_refused(content: bytes) -> None:
    async with running() as run:
        response = await run.client.patch(GAIN, content=content, headers={"content-type": "application/json"})
        assert_problem(response, 422, "invalid-value")


async def test_parameters_of_no_lane_and_of_no_board_are_not_found() -> None:
    async with running() as run:
        assert_problem(await run.client.patch(f"{PATH}/nope/parameters", json={"a": 1.0}), 404, "no-such-lane")
        assert_problem(
            await run.client.put("/api/v1/boards/x/lanes", json={"lanes": ["ins_ekf"]}), 404, "no-such-board"
        )
        assert_problem(await run.client.get("/api/v1/boards/x/lanes"), 404, "no-such-board")


async def test_what_was_chosen_and_set_outlives_reconnection_reboot_and_failure() -> None:
    async with running() as run:
        await stepped(run)
        await choose(run, "steady")
        await run.client.patch(GAIN, json={"gain_hz": 2.0})
        await run.client.post("/api/v1/boards/sim/reconnect")
        await until(lambda: len(run.factories.links["sim:"]) == 2)
        run.factories.link("sim:").push(bytes([REBOOT]) + bytes(SAMPLES_PER_STEP))
        await until(lambda: run.service.boards.get("sim").view().stats.boot_id == 1)
        assert len(run.factories.engines) == 1
        run.factories.link("sim:").push(bytes([BREAK]))
        await until(lambda: run.service.boards.get("sim").view().state == "failed")
        await run.client.post("/api/v1/boards/sim/reconnect")
        await until(lambda: len(run.factories.engines) == 2)
        body = (await run.client.get(PATH)).json()
        assert body["chosen"] == ["steady"]
        assert of(body, "steady")["parameters"][0]["value"] == 2.0
        assert (run.factories.engines[-1].chosen, run.factories.engines[-1].values["steady"]["gain_hz"]) == (
            ("steady",),
            2.0,
        )


async def test_a_board_that_has_ended_is_a_conflict_that_names_the_remedy() -> None:
    async with running() as run:
        await stepped(run)
        run.factories.link("sim:").end()
        await until(lambda: run.service.boards.get("sim").view().state == "ended")
        for response in (
            await run.client.put(PATH, json={"lanes": ["steady"]}),
            await run.client.patch(GAIN, json={"gain_hz": 1.0}),
        ):
            assert_problem(response, 409, "board-not-running")
            assert "/api/v1/boards/sim/reconnect" in response.json()["remedy"]
        assert (await run.client.get(PATH)).json()["chosen"] == ["ins_ekf", "onboard", "reference"]


async def test_a_viewer_looks_and_only_an_operator_acts() -> None:
    settings = fake_settings(token="operator-token-1234", viewer_token="viewer-token-123456")
    async with running(settings) as run:
        viewer = {"authorization": "Bearer viewer-token-123456"}
        operator = {"authorization": "Bearer operator-token-1234"}
        assert (await run.client.get(PATH, headers=viewer)).status_code == 200
        body = {"lanes": ["steady"]}
        assert_problem(await run.client.put(PATH, json=body, headers=viewer), 403, "operator-needed")
        assert_problem(await run.client.patch(GAIN, json={"gain_hz": 1.0}, headers=viewer), 403, "operator-needed")
        assert (await run.client.put(PATH, json=body, headers=operator)).status_code == 200


async def test_a_lane_chosen_later_has_rows_and_history() -> None:
    async with running() as run, run.stream() as socket:
        await stepped(run)
        await choose(run, "ins_ekf", "steady")
        answer = await ask(socket, op="subscribe", id=3, topic="boards/sim/lanes/steady", rate_hz=1000)
        assert answer["op"] == "subscribed"
        await stepped(run, 2)
        _, data = await rows_of(socket, 2)
        assert data.shape == (2, len(LANE_COLUMNS))
        assert answer["columns"] == list(LANE_COLUMNS)
        history = await run.client.get("/api/v1/boards/sim/history", params={"topic": "lanes/steady"})
        assert history.status_code == 200
        assert int.from_bytes(history.content[2:4], "little") >= 1


async def test_a_topic_of_a_lane_that_does_not_run_says_so_and_gives_rows_once_it_is_chosen() -> None:
    async with running() as run, run.stream() as socket:
        answer = await ask(socket, op="subscribe", id=3, topic="boards/sim/lanes/steady", rate_hz=1000)
        problem: Any = answer["problem"]
        assert (answer["op"], answer["id"], problem["code"]) == ("error", 3, "lane-not-running")
        assert "/api/v1/boards/sim/lanes" in problem["remedy"]
        for path in ("history?topic=lanes/steady", "nav?lane=steady"):
            assert_problem(await run.client.get(f"/api/v1/boards/sim/{path}"), 409, "lane-not-running")
        await choose(run, "ins_ekf", "steady")
        assert (await next_answer(socket))["op"] == "subscribed"
        await stepped(run)
        assert len((await rows_of(socket, 1))[0]) == 1
        await choose(run, "ins_ekf")
        told = await next_answer(socket)
        assert (told["op"], told["problem"]["code"]) == ("error", "lane-not-running")


async def next_answer(socket: Any) -> dict[str, Any]:
    """The next text that is not the tick or data."""
    while True:
        message = await socket.recv()
        answer = json.loads(message) if isinstance(message, str) else {"op": "rows"}
        if answer["op"] not in {"tick", "data", "rows"}:
            return answer


async def test_what_was_chosen_and_set_is_an_event() -> None:
    async with running() as run:
        await choose(run, "steady")
        await run.client.patch(GAIN, json={"gain_hz": 1.25})
        events = (await run.client.get("/api/v1/boards/sim/health")).json()["events"]
        told = {event["code"]: event["text"] for event in events}
        assert "steady" in told["lanes-chosen"]
        assert "gain_hz = 1.25" in told["lane-parameters-set"]


async def test_a_lane_that_failed_is_named_with_its_cause_and_starts_again_when_chosen() -> None:
    async with running() as run:
        await choose(run, "ins_ekf", "steady")
        await stepped(run)
        run.factories.engines[-1].failures["steady"] = "LinAlgError: singular"
        steady = of((await run.client.get(PATH)).json(), "steady")
        assert (steady["chosen"], steady["running"], steady["failure"]) == (True, False, "LinAlgError: singular")
        health = (await run.client.get("/api/v1/boards/sim/health")).json()
        line = next(one for one in health["verdict"] if one["code"] == "lane-put-aside")
        assert (line["severity"], line["subject"]) == ("caution", "lane:steady")
        assert "LinAlgError: singular" in line["cause"]
        assert line["remedy"]
        assert of(await choose(run, "ins_ekf", "steady"), "steady")["running"]


async def test_the_real_engine_lists_every_registered_lane_and_runs_all_at_once() -> None:
    settings = fake_settings()
    factories = RealFactories(settings.settings.engine_settings(), talk=True)
    factories.load()
    async with running(settings, factories) as run:
        body = (await run.client.get(PATH)).json()
        assert [one["name"] for one in body["lanes"]] == list(REAL_LANES)
        for one in body["lanes"]:
            assert [each["name"] for each in one["parameters"]] == [each.name for each in parameters_of(one["name"])]
            assert all(each["meaning"] and each["minimum"] < each["maximum"] for each in one["parameters"])
        body = await choose(run, *REAL_LANES)
        assert all(one["running"] for one in body["lanes"])

        def stepping() -> bool:
            view = run.service.boards.get("sim").view()
            return view.snapshot is not None and "ins_ekf" in {lane.lane for lane in view.snapshot.lanes}

        await until(stepping, 20.0)
        for lane in REAL_LANES:
            for one in parameters_of(lane):
                path = f"{PATH}/{lane}/parameters"
                answer = await run.client.patch(path, json={one.name: one.maximum})
                assert of(answer.json(), lane)["parameters"]
                assert_problem(
                    await run.client.patch(path, json={one.name: one.maximum * 2 + 1}), 422, "parameter-out-of-range"
                )
                assert (await run.client.patch(path, json={one.name: None})).status_code == 200
        assert not [one for one in (await run.client.get(PATH)).json()["lanes"] if one["failure"]]

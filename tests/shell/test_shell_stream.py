"""The WebSocket /api/v1/stream: its topics, rates, layout, and what it does with clients that misbehave."""

import asyncio
import contextlib
import json
import struct
from typing import Any

import numpy as np
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from server.live import socket as live_socket
from server.nav.types import LANE_COLUMNS, SAMPLE_COLUMNS, Kind
from tests.shell.shell_fakes import (
    REBOOT,
    SAMPLE_NS,
    SAMPLES_PER_STEP,
    Running,
    fake_settings,
    lane_row,
    next_binary,
    running,
    until,
)

STEP_NS = SAMPLE_NS * SAMPLES_PER_STEP


async def ask(socket: ClientConnection, **request: object) -> dict[str, object]:
    """Send a request and return the first message that is not the tick or data."""
    await socket.send(json.dumps(request))
    while True:
        message = await asyncio.wait_for(socket.recv(), 5.0)
        answer = json.loads(message) if isinstance(message, str) else {"op": "rows"}
        if answer["op"] not in {"tick", "data", "rows"}:
            return answer


def decode(message: bytes) -> tuple[tuple[int, ...], np.ndarray, np.ndarray]:
    """The header, t_ns and rows of a binary message, read by the documented layout alone."""
    header = struct.unpack_from("<BBHHH", message)
    rows = np.frombuffer(message, "<f8", offset=8).reshape(header[2], header[3] + 1)
    return header, rows[:, 0], rows[:, 1:]


async def rows_of(socket: ClientConnection, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The next `count` rows of the only binary subscription."""
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    while sum(len(t_ns) for t_ns, _ in parts) < count:
        _, t_ns, data = decode(await next_binary(socket))
        parts.append((t_ns, data))
    return np.concatenate([t for t, _ in parts]), np.concatenate([d for _, d in parts])


async def test_lane_rows_have_the_documented_layout_and_columns() -> None:
    async with running() as run, run.stream() as socket:
        answer = await ask(socket, op="subscribe", id=7, topic="boards/sim/lanes/ins_ekf", rate_hz=1000)
        assert answer["columns"] == list(LANE_COLUMNS)
        run.push(3 * SAMPLES_PER_STEP)
        header, t_ns, data = decode(await next_binary(socket))
        assert header == (1, 7, 3, len(LANE_COLUMNS), 0)
        np.testing.assert_array_equal(t_ns, [STEP_NS, 2 * STEP_NS, 3 * STEP_NS])
        np.testing.assert_array_equal(data, [lane_row(1), lane_row(2), lane_row(3)])


async def test_at_its_own_rate_a_topic_gives_every_row_however_the_stream_is_cut() -> None:
    async with running() as run, run.stream() as socket:
        await ask(socket, op="subscribe", id=1, topic="boards/sim/raw/imu", rate_hz=500)
        cuts = [1, 7, 250, 33, 400, 309]
        for cut in cuts:
            run.push(cut)
            await asyncio.sleep(0.3)  # long enough for the rate to be measured in between
        t_ns, data = await rows_of(socket, sum(cuts))
        np.testing.assert_array_equal(t_ns, SAMPLE_NS * np.arange(1, sum(cuts) + 1))
        assert data.shape[1] == len(SAMPLE_COLUMNS[Kind.IMU])


async def test_below_its_own_rate_a_topic_gives_the_first_row_of_each_period() -> None:
    async with running() as run, run.stream() as socket:
        for _ in range(4):  # the native rate is known after two readings a second apart
            run.push(500)
            await asyncio.sleep(0.5)
        await until(lambda: next(iter(run.service.boards)).history.native_rate_hz("raw/imu"))
        await ask(socket, op="subscribe", id=1, topic="boards/sim/raw/imu", rate_hz=10)
        run.push(500)
        t_ns, _ = await rows_of(socket, 10)
        assert len(t_ns) <= 11
        slots = t_ns // 100_000_000
        assert len(set(slots)) == len(slots)
        np.testing.assert_array_equal(t_ns[1:] % 100_000_000, 0)


async def test_two_clients_have_their_own_topics_rates_and_ids() -> None:
    async with running() as run, run.stream() as one, run.stream() as two:
        await ask(one, op="subscribe", id=1, topic="boards/sim/lanes/ins_ekf", rate_hz=1000)
        await ask(two, op="subscribe", id=200, topic="boards/sim/lanes/ins_ekf", rate_hz=1000)
        await ask(two, op="subscribe", id=3, topic="boards/sim/filtered", rate_hz=1000)
        await two.close()
        await until(lambda: run.service.live.clients == 1)
        run.push(SAMPLES_PER_STEP)
        header, _, data = decode(await next_binary(one))
        assert header[1] == 1
        np.testing.assert_array_equal(data, [lane_row(1)])


async def test_rows_are_packed_once_for_all_clients_of_a_topic_and_rate() -> None:
    async with running() as run, run.stream() as one, run.stream() as two:
        for socket in (one, two):
            await ask(socket, op="subscribe", id=1, topic="boards/sim/lanes/ins_ekf", rate_hz=50)
        pump = run.service.live._pumps["sim"]
        assert len(pump.feeds) == 1
        for socket in (one, two):
            await socket.send('{"op":"unsubscribe","id":1}')
        await until(lambda: not pump.feeds)
        assert next(iter(run.service.boards)).hub.results.readers == 0


async def test_a_reboot_changes_the_boot_id_of_the_rows() -> None:
    async with running() as run, run.stream() as socket:
        await ask(socket, op="subscribe", id=1, topic="boards/sim/lanes/ins_ekf", rate_hz=1000)
        run.push(SAMPLES_PER_STEP)
        before, _, _ = decode(await next_binary(socket))
        run.factories.link("sim:").push(bytes([REBOOT]) + bytes(SAMPLES_PER_STEP))
        after, t_ns, _ = decode(await next_binary(socket))
        assert (before[4], after[4]) == (0, 1)
        assert t_ns[0] == STEP_NS


async def test_boards_and_health_arrive_at_once_as_json() -> None:
    async with running() as run, run.stream() as socket:
        await socket.send('{"op":"subscribe","id":1,"topic":"boards"}')
        await socket.send('{"op":"subscribe","id":2,"topic":"boards/sim/health"}')
        data = {}
        while len(data) < 2:
            message = json.loads(await asyncio.wait_for(socket.recv(), 5.0))
            if message["op"] == "data":
                data[message["id"]] = message["data"]
        assert [board["id"] for board in data[1]["boards"]] == ["sim"]
        assert data[2]["board_id"] == "sim"


async def test_events_arrive_as_they_happen() -> None:
    async with running() as run, run.stream() as socket:
        await ask(socket, op="subscribe", id=4, topic="boards/sim/events")
        run.push(SAMPLES_PER_STEP)
        while True:
            message = json.loads(await asyncio.wait_for(socket.recv(), 5.0))
            if message["op"] == "data" and message["data"]["code"] == "born":
                break
        assert message["id"] == 4
        assert message["data"]["source"] == "engine"


async def test_an_unknown_topic_is_answered_with_a_problem_that_names_the_known_ones() -> None:
    async with running() as run, run.stream() as socket:
        for topic in ("boards/nobody/health", "boards/sim/lanes/nothing", "weather"):
            answer = await ask(socket, op="subscribe", id=9, topic=topic)
            assert (answer["op"], answer["id"]) == ("error", 9)
            problem: Any = answer["problem"]
            assert problem["status"] == 404
            assert "boards/sim/lanes/ins_ekf" in problem["remedy"]


async def test_requests_that_make_no_sense_are_answered_and_the_socket_stays_open() -> None:
    async with running() as run, run.stream() as socket:
        for text in ("", "{", '{"op":"dance"}', '{"op":"subscribe","id":0,"topic":"boards"}', "x" * 5000):
            await socket.send(text)
        await socket.send(b"\x00\x01")
        answers = []
        while len(answers) < 6:
            message = json.loads(await asyncio.wait_for(socket.recv(), 5.0))
            if message["op"] != "tick":
                answers.append(message)
        assert [answer["op"] for answer in answers] == ["error"] * 6
        assert (await ask(socket, op="ping", t=12.5)) == {"op": "pong", "t": 12.5}


async def test_a_silent_board_still_ticks_within_a_second() -> None:
    async with running() as run, run.stream() as socket:
        ticks = [json.loads(await asyncio.wait_for(socket.recv(), 1.0)) for _ in range(3)]
        assert {tick["op"] for tick in ticks} == {"tick"}
        assert ticks[0]["t_ns"] < ticks[1]["t_ns"] < ticks[2]["t_ns"]


async def test_removing_a_board_ends_its_subscriptions_with_a_problem() -> None:
    async with running() as run, run.stream() as socket:
        await ask(socket, op="subscribe", id=5, topic="boards/sim/lanes/ins_ekf")
        assert (await run.client.delete("/api/v1/boards/sim")).status_code == 204
        while True:
            message = json.loads(await asyncio.wait_for(socket.recv(), 5.0))
            if message["op"] == "error":
                break
        assert (message["id"], message["problem"]["code"]) == (5, "board-removed")


async def test_the_subprotocol_is_confirmed_when_asked_for() -> None:
    async with running() as run, run.stream(subprotocols=["navdeck.v1"]) as socket:
        assert socket.subprotocol == "navdeck.v1"


async def test_a_client_that_stops_reading_loses_its_own_data_and_is_dropped(monkeypatch) -> None:
    """The other client gets every row; the one that does not read is gone after the send time-out."""
    monkeypatch.setattr(live_socket, "SEND_TIMEOUT_S", 0.5)
    async with running() as run, run.stream(max_queue=1, close_timeout=0.1) as lazy, run.stream(max_queue=None) as keen:
        for socket in (lazy, keen):
            await ask(socket, op="subscribe", id=1, topic="boards/sim/raw/imu", rate_hz=1000)
        lazy.transport.pause_reading()
        total = await _push_until_dropped(run)
        t_ns, _ = await rows_of(keen, total)
        np.testing.assert_array_equal(t_ns, SAMPLE_NS * np.arange(1, total + 1))
        assert run.service.live.dropped_total == 1


async def _push_until_dropped(run: Running) -> int:
    total = 0
    async with asyncio.timeout(20.0):
        while run.service.live.clients == 2:
            run.push(2000)
            total += 2000
            await asyncio.sleep(0.01)
    return total


async def test_a_client_that_asks_faster_than_it_reads_is_disconnected() -> None:
    request = json.dumps({"op": "subscribe", "id": 1, "topic": "x" * 250})
    async with running() as run, run.stream(max_queue=1, close_timeout=0.1) as flood:
        flood.transport.pause_reading()
        with contextlib.suppress(OSError, TimeoutError, ConnectionClosed):
            async with asyncio.timeout(20.0):
                while run.service.live.clients:
                    await asyncio.wait_for(flood.send(request), 0.2)
        await until(lambda: run.service.live.clients == 0, 10.0)


async def test_the_last_client_of_too_many_is_refused_with_a_problem(monkeypatch) -> None:
    monkeypatch.setattr("server.live.live.MAX_CLIENTS", 1)
    async with running(fake_settings()) as run, run.stream():
        response = await run.client.get(
            "/api/v1/stream",
            headers={
                "connection": "upgrade",
                "upgrade": "websocket",
                "sec-websocket-version": "13",
                "sec-websocket-key": "dGhlIHNhbXBsZSBub25jZQ==",
            },
        )
        assert response.status_code == 503
        assert response.headers["content-type"] == "application/problem+json"
        assert response.json()["code"] == "too-many-clients"


@pytest.mark.parametrize("offered", [None, ["viser-v0.0.1"]])
async def test_the_3d_views_socket_without_its_subprotocol_is_refused_with_a_problem(offered: Any) -> None:
    async with running(fake_settings(view3d=True)) as run:
        with pytest.raises(InvalidStatus) as refused:
            await connect(run.url.replace("http:", "ws:") + "/view/", subprotocols=offered, proxy=None)
        response = refused.value.response
        assert (response.status_code, response.headers["content-type"]) == (400, "application/problem+json")
        problem = json.loads(response.body)
        assert problem["code"] == "subprotocol-needed"
        assert "viser-v" in problem["detail"]
        assert problem["remedy"]

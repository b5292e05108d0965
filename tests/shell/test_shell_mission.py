"""The real recorded stream through the whole service: link, protocol, engine, hub, API and socket."""

import asyncio
import json
from pathlib import Path

import numpy as np
import pytest

from server.link.tlog import read_tlog
from server.magnetic import wmm_field
from server.nav.engine import NavEngine
from server.nav.types import LANE_COLUMNS, EngineSettings
from server.parts import RealFactories
from server.protocol.mavlink import MavlinkProtocol
from tests.shell.shell_fakes import fake_settings, next_binary, running, until
from tests.shell.test_shell_stream import ask, decode

CUT_BYTES = 3000


@pytest.fixture(scope="module")
def log(request: pytest.FixtureRequest) -> Path:
    data: Path = request.getfixturevalue("shared_data")
    return data / "ardupilot_sitl" / "static.tlog"


@pytest.fixture(scope="module")
def direct(log: Path) -> tuple[np.ndarray, np.ndarray]:
    """t_ns and rows of ins_ekf from the bare engine, fed the stream in other cuts."""
    stream, protocol = bytes(read_tlog(log).data), MavlinkProtocol(talk=False)
    engine, t_ns, rows = NavEngine(EngineSettings(), wmm_field), [], []
    for start in range(0, len(stream), CUT_BYTES):
        for block in protocol.feed(stream[start : start + CUT_BYTES], 0).blocks:
            for lane in engine.step(block).lanes:
                if lane.lane == "ins_ekf":
                    t_ns.append(lane.t_ns)
                    rows.append(lane.data)
    return np.concatenate(t_ns), np.concatenate(rows)


async def test_every_row_of_the_engine_reaches_the_socket_unchanged(log: Path, direct) -> None:
    """Nothing between a byte and the browser changes, loses or reorders a state."""
    factories = RealFactories(EngineSettings(), talk=False)
    factories.load()
    t_ns, rows = direct
    loaded = fake_settings(links=())
    async with running(loaded, factories) as run, run.stream(max_queue=None) as socket:
        url = f"file://{log}?speed=0"
        from server.commands import AddBoard

        await run.service.boards.add(AddBoard(url=url, trusted=True))
        answer = await ask(socket, op="subscribe", id=1, topic="boards/static/lanes/ins_ekf", rate_hz=1000)
        assert answer["columns"] == list(LANE_COLUMNS)
        got_t, got = [], []
        while sum(map(len, got_t)) < len(t_ns):
            _, part_t, part = decode(await next_binary(socket))
            got_t.append(part_t)
            got.append(part)
        np.testing.assert_array_equal(np.concatenate(got_t), t_ns)
        np.testing.assert_array_equal(np.concatenate(got), rows)
        board = run.service.boards.get("static")
        await until(lambda: board.view().state == "ended")
        nav = (await run.client.get("/api/v1/boards/static/nav")).json()
        last = dict(zip(LANE_COLUMNS, rows[-1], strict=True))
        assert (nav["lat_deg"], nav["vel_d_m_s"], nav["q_nb"][0]) == (last["lat_deg"], last["vel_d_m_s"], last["q_w"])


async def test_the_account_of_the_recorded_bytes_is_exact(log: Path) -> None:
    factories = RealFactories(EngineSettings(), talk=False)
    async with running(fake_settings(links=(f"file://{log}?speed=0",)), factories) as run:
        await until(lambda: run.service.boards.get("static").view().state == "ended", 60.0)
        health = (await run.client.get("/api/v1/boards/static/health")).json()
        protocol = health["protocol"]
        assert protocol["bytes_in"] == len(read_tlog(log).data) == health["link"]["bytes_in"]
        assert protocol["bytes_frames"] + protocol["bytes_junk"] + protocol["bytes_pending"] == protocol["bytes_in"]
        assert {sensor["name"] for sensor in health["sensors"]} >= {"imu", "mag", "baro", "gnss"}
        assert json.loads(json.dumps(health)) == health


async def test_bytes_of_another_protocol_are_named_on_the_page(tmp_path: Path) -> None:
    """A stream of NMEA sentences is called what it is, with a remedy, instead of silence."""
    body = "GPGGA,092750.000,5321.6802,N,00630.3372,W,1,8,1.03,61.7,M,55.2,M,,"
    check = 0
    for character in body:
        check ^= ord(character)
    dump = tmp_path / "receiver.bin"
    dump.write_bytes(f"${body}*{check:02X}\r\n".encode() * 2000)
    factories = RealFactories(EngineSettings(), talk=False)
    loaded = fake_settings(links=(f"file://{dump}?bytes_per_s=20000",))
    async with running(loaded, factories) as run:
        async with asyncio.timeout(10.0):
            while True:
                board = (await run.client.get("/api/v1/boards/receiver")).json()
                if board["link"]["state"] == "foreign-protocol":
                    break
                await asyncio.sleep(0.1)
        assert "NMEA" in board["link"]["cause"]
        assert board["headline"]["code"] == "foreign-protocol"
        assert board["link"]["remedy"]

"""REST under /api/v1: boards come and go, every error is a Problem, and OpenAPI says so."""

import asyncio
import json
import math
from pathlib import Path

import numpy as np
import pytest

from server.api import pages
from server.nav.types import LANE_COLUMNS
from tests.shell.shell_fakes import SAMPLES_PER_STEP, fake_settings, lane_row, running, until
from tests.shell.test_shell_door import assert_problem
from tests.shell.test_shell_stream import STEP_NS, decode


async def test_before_the_first_sample_everything_unknown_is_null() -> None:
    async with running() as run:
        nav = (await run.client.get("/api/v1/boards/sim/nav")).json()
        assert (nav["status"], nav["t_ns"], nav["age_s"], nav["q_nb"], nav["lat_deg"]) == (
            "aligning",
            -1,
            None,
            None,
            None,
        )
        assert not any(nav["flags"][name] for name in ("attitude_valid", "position_valid", "velocity_valid"))
        assert nav["flags"]["stale"]


async def test_nav_has_the_rows_values_and_their_angles() -> None:
    async with running() as run:
        run.push(3 * SAMPLES_PER_STEP)
        await until(lambda: run.factories.engines and run.factories.engines[-1].steps == 3)
        nav = (await run.client.get("/api/v1/boards/sim/nav", params={"lane": "ins_ekf"})).json()
        row = dict(zip(LANE_COLUMNS, lane_row(3), strict=True))
        for name in LANE_COLUMNS[4:]:
            if name not in {"status", "dead_reckoning_s"}:
                assert math.isclose(nav[name], row[name])
        assert nav["dead_reckoning_s"] is None
        assert (nav["q_nb"], nav["roll_rad"], nav["pitch_rad"], nav["yaw_rad"]) == ([1, 0, 0, 0], 0.0, 0.0, 0.0)
        assert (nav["status"], nav["t_ns"]) == ("navigating", 3 * STEP_NS)
        assert 0.0 <= nav["age_s"] < 5.0
        aid = nav["aids"][0]
        assert (aid["aid"], aid["fused"], aid["refused"]) == (
            "baro_height",
            3,
            [{"reason": "refused-gate", "count": 3}],
        )


async def test_a_silent_board_grows_old() -> None:
    async with running() as run:
        run.push(SAMPLES_PER_STEP)
        await until(lambda: run.factories.engines and run.factories.engines[-1].steps)
        ages = []
        for _ in range(2):
            ages.append((await run.client.get("/api/v1/boards/sim")).json()["age_s"])
            await asyncio.sleep(1.05)
        assert ages[1] - ages[0] >= 1.0
        assert (await run.client.get("/api/v1/boards/sim/nav")).json()["flags"]["stale"]


async def test_boards_are_added_listed_reconnected_and_removed() -> None:
    async with running() as run:
        made = await run.client.post("/api/v1/boards", json={"url": "udp://:14550", "system": 7})
        assert made.status_code == 201
        assert made.headers["location"] == "/api/v1/boards/udp-14550"
        assert run.factories.protocols[-1].command.system == 7
        listed = (await run.client.get("/api/v1/boards")).json()["boards"]
        assert [board["id"] for board in listed] == ["sim", "udp-14550"]
        assert (await run.client.post("/api/v1/boards/udp-14550/reconnect")).status_code == 202
        await until(lambda: len(run.factories.links["udp://:14550"]) == 2)
        assert run.factories.links["udp://:14550"][0].closed
        assert (await run.client.delete("/api/v1/boards/udp-14550")).status_code == 204
        assert run.factories.link("udp://:14550").closed
        assert_problem(await run.client.get("/api/v1/boards/udp-14550"), 404, "no-such-board")


async def test_a_link_that_is_in_use_is_a_conflict() -> None:
    async with running() as run:
        body = {"url": "tcp://10.0.0.1:5760"}
        assert (await run.client.post("/api/v1/boards", json=body)).status_code == 201
        for url in ("tcp://10.0.0.1:5760", "TCP://10.0.0.1:5760/", " tcp://10.0.0.1:5760?"):
            assert_problem(await run.client.post("/api/v1/boards", json={"url": url}), 409, "link-in-use")


async def test_what_a_link_refuses_names_the_value_and_the_remedy() -> None:
    async with running() as run:
        response = await run.client.post("/api/v1/boards", json={"url": "tcp://bad"})
        assert_problem(response, 422, "bad-link")
        assert (response.json()["detail"], response.json()["remedy"]) == ("'tcp://bad' is not good.", "Write another.")
        assert response.json()["errors"][0]["value"] == "tcp://bad"


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"url": ""},
        {"url": 5},
        {"url": "sim:", "system": 0},
        {"url": "sim:", "system": 256},
        {"url": "sim:", "x": 1},
    ],
)
async def test_a_value_outside_its_limits_is_named(body: dict[str, object]) -> None:
    async with running() as run:
        response = await run.client.post("/api/v1/boards", json=body)
        assert_problem(response, 422, "invalid-value")
        assert response.json()["errors"][0]["name"] in {"url", "system", "x"}


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"[]"])
async def test_a_body_that_is_no_json_object_is_a_problem(content: bytes) -> None:
    async with running() as run:
        response = await run.client.post(
            "/api/v1/boards", content=content, headers={"content-type": "application/json"}
        )
        assert (response.status_code, response.headers["content-type"]) in {
            (400, "application/problem+json"),
            (422, "application/problem+json"),
        }


async def test_no_file_outside_the_data_folder_can_be_opened_or_even_felt_for(tmp_path: Path) -> None:
    """The answer is the same whether the file exists or not, however the path is written."""
    data = tmp_path / "data"
    data.mkdir()
    (tmp_path / "secret").write_text("x")
    (data / "way-out").symlink_to(tmp_path / "secret")
    async with running(fake_settings(data_dir=data)) as run:
        for url in (
            f"file://{tmp_path}/secret",
            f"file://{tmp_path}/absent",
            f"file://{data}/../secret",
            f"file://{data}/%2e%2e/secret",
            f"file://{data}/way-out",
            f"file:{tmp_path}/secret",
            f"FILE://{tmp_path}/secret",
            "file:///etc/passwd",
            "file://~/secret",
            "file://secret",
            f"file?:{tmp_path}/secret",
            f"file?x:{data}/flight.tlog",
        ):
            assert_problem(await run.client.post("/api/v1/boards", json={"url": url}), 422, "file-not-allowed")
        for url in (
            "/etc/passwd",
            "serial:///etc/passwd",
            "spy:///dev/ttyS0?file=/tmp/x",
            "socket://a:1",
            "serial://x",
            "serial?:/dev/ttyS0",
            "serial:///dev/\x00",
            "file:///etc/%70asswd%00",
        ):
            assert_problem(await run.client.post("/api/v1/boards", json={"url": url}), 422, "bad-link")
        allowed = await run.client.post("/api/v1/boards", json={"url": f"file://{data}/flight.tlog?speed=2"})
        assert (allowed.status_code, allowed.json()["id"]) == (201, "flight")


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/nothing", 404),
        ("GET", "/api/v1/nothing", 404),
        ("GET", "/api/v1/boards/none/nav", 404),
        ("GET", "/api/v1/boards/sim/nav?lane=none", 404),
        ("GET", "/api/v1/boards/sim/history?topic=none", 404),
        ("POST", "/api/v1/boards/none/reconnect", 404),
        ("DELETE", "/api/v1/boards/none", 404),
        ("POST", "/api/v1/nothing", 404),
        ("GET", "/..%2f..%2fetc%2fpasswd", 404),
        ("GET", "/assets/../../settings.py", 404),
        ("GET", "/%00", 404),
        ("POST", "/", 405),
        ("PUT", "/api/v1/boards", 405),
        ("POST", "/healthz", 405),
        ("GET", "/api/v1/session", 405),
        ("GET", "/api/v1/boards/sim/history?topic=aids&seconds=0", 422),
        ("GET", "/api/v1/boards/sim/history", 422),
    ],
)
async def test_every_error_is_the_one_body(method: str, path: str, status: int) -> None:
    async with running() as run:
        response = await run.client.request(method, path)
        assert (response.status_code, response.headers["content-type"]) == (status, "application/problem+json")
        body = response.json()
        assert set(body) == {"type", "title", "status", "detail", "code", "remedy", "errors"}
        assert body["status"] == status
        assert status != 405 or response.headers["allow"]


async def test_a_bug_of_ours_is_a_problem_too_and_the_service_lives(monkeypatch) -> None:
    async with running() as run:
        with monkeypatch.context() as patch:
            patch.setattr("server.api.boards.health_out", lambda view: 1 / 0)
            assert_problem(await run.client.get("/api/v1/boards/sim/health"), 500, "internal-error")
        assert (await run.client.get("/api/v1/boards/sim/health")).status_code == 200


async def test_history_gives_a_late_page_the_past_in_the_layout_of_the_stream() -> None:
    async with running() as run:
        run.push(5000)  # 10 s of samples at 2 ms, 500 steps
        await until(lambda: run.factories.engines and run.factories.engines[-1].steps == 500)
        response = await run.client.get("/api/v1/boards/sim/history", params={"topic": "lanes/ins_ekf", "seconds": 5})
        header, t_ns, data = decode(response.content)
        assert header[:2] == (1, 0)
        assert 49 <= len(t_ns) <= 52  # 10 rows a second
        assert t_ns[0] >= t_ns[-1] - 5e9
        steps = t_ns / STEP_NS
        np.testing.assert_allclose(data[:, 4], steps + 0.04)


async def test_a_topic_without_rows_has_an_empty_history() -> None:
    async with running() as run:
        response = await run.client.get("/api/v1/boards/sim/history", params={"topic": "raw/gnss"})
        header, t_ns, _ = decode(response.content)
        assert (header[2], len(t_ns)) == (0, 0)


async def test_openapi_documents_the_problem_for_every_error() -> None:
    async with running() as run:
        schema = (await run.client.get("/openapi.json")).json()
        for path, operations in schema["paths"].items():
            for operation in operations.values():
                for status, response in operation["responses"].items():
                    if int(status) >= 400:
                        content = response["content"]["application/problem+json"]
                        assert content["schema"]["$ref"].endswith("/Problem"), (path, status)
        assert {"SubscribeIn", "TickOut", "DataOut", "NavOut", "HealthOut"} <= set(schema["components"]["schemas"])
        references = set(json.dumps(schema).split('"#/components/schemas/')[1:])
        assert {text.split('"')[0] for text in references} <= set(schema["components"]["schemas"])


async def test_the_reference_needs_no_script_and_no_other_host() -> None:
    async with running() as run:
        text = (await run.client.get("/docs")).text
        assert "/api/v1/boards/{board_id}/nav" in text
        assert "<script" not in text
        assert "http" not in text.replace("http-error", "")


async def test_secrets_do_not_leave_with_the_settings() -> None:
    async with running(fake_settings(token="hidden-operator", viewer_token="hidden-viewer")) as run:
        headers = {"authorization": "Bearer hidden-viewer"}
        body = (await run.client.get("/api/v1/settings", headers=headers)).text
        assert "hidden-" not in body
        settings = {one["name"]: one for one in json.loads(body)["settings"]}
        assert settings["token"]["value"] == "(set)"
        assert (settings["token"]["source"], settings["nav_rate_hz"]["source"]) == ("flag", "default")
        assert (settings["nav_rate_hz"]["unit"], settings["nav_rate_hz"]["default"]) == ("Hz", 50.0)


async def test_ports_and_doctor_answer() -> None:
    async with running() as run:
        assert isinstance((await run.client.get("/api/v1/ports")).json()["ports"], list)
        report = (await run.client.get("/api/v1/doctor")).json()
        assert {"python", "page", "kernels", "port", "token"} <= {check["name"] for check in report["checks"]}


async def test_readiness_waits_for_the_kernels() -> None:
    async with running() as run:
        assert (await run.client.get("/readyz")).json() == {"status": "ready"}
        run.service.context.ready = False
        assert_problem(await run.client.get("/readyz"), 503, "not-ready")
        assert (await run.client.get("/healthz")).status_code == 200


async def test_metrics_count_what_happened() -> None:
    async with running() as run, run.stream():
        run.push(35)
        await until(lambda: run.factories.engines and run.factories.engines[-1].samples == 35)
        lines = set((await run.client.get("/metrics")).text.splitlines())
        assert {
            'navdeck_steps_total{board="sim"} 3.0',
            'navdeck_frames_total{board="sim"} 35.0',
            'navdeck_samples_total{board="sim",sensor="imu",state="fresh"} 35.0',
            'navdeck_samples_total{board="sim",sensor="imu",state="refused"} 2.0',
            'navdeck_aids_total{aid="baro_height",board="sim",status="refused_gate"} 3.0',
            'navdeck_lane_status{board="sim",lane="ins_ekf",status="navigating"} 1.0',
            'navdeck_link_state{board="sim",state="open"} 1.0',
            'navdeck_step_latency_seconds_count{board="sim"} 1.0',
            "navdeck_ws_clients 1.0",
        } <= lines


async def test_the_places_of_the_page_are_its_one_document(monkeypatch, tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text("<title>the page</title>")
    (tmp_path / "assets" / "app-1a2b.js").write_text("let a = 1")
    monkeypatch.setattr(pages, "WEB_DIST", tmp_path)
    async with running() as run:
        for path in ("/", "/live", "/sensors", "/estimators", "/calibrate", "/logs", "/board"):
            response = await run.client.get(path)
            assert (response.text, response.headers["cache-control"]) == ("<title>the page</title>", "no-cache")
        script = await run.client.get("/assets/app-1a2b.js")
        assert "immutable" in script.headers["cache-control"]
        assert script.headers["content-encoding"] == "gzip"
        assert script.text == "let a = 1"
        assert (await run.client.head("/")).status_code == 200


async def test_without_a_built_page_it_says_what_to_do(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(pages, "WEB_DIST", tmp_path / "none")
    async with running() as run:
        response = await run.client.get("/live")
        assert response.status_code == 200
        assert "./run" in response.text


@pytest.mark.parametrize(
    "path", ["/api/v1/boards", "/api/v1/info", "/healthz", "/metrics", "/docs", "/api/v1/boards/nobody", "/api/v1/none"]
)
async def test_head_is_answered_as_get_without_the_body(path: str) -> None:
    async with running() as run:
        got, head = await run.client.get(path), await run.client.head(path)
        assert (head.status_code, head.content) == (got.status_code, b"")
        assert head.headers["content-type"] == got.headers["content-type"]
        assert head.headers.keys() >= got.headers.keys() - {"date"}

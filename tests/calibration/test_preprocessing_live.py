"""Preprocessing, learning in flight and the store over REST on the demo board; who may look and who may act."""

from __future__ import annotations

from pathlib import Path

import httpx
import numpy as np

from tests.calibration.demo_service import demo
from tests.calibration.test_jobs_live import settled_gyro
from tests.shell.shell_fakes import fake_settings, running

TOKENS = {"token": "operator-token-0123456789", "viewer_token": "viewer-token-0123456789"}


def bearer(name: str) -> dict[str, str]:
    return {"authorization": f"Bearer {TOKENS[name]}"}


async def test_a_viewer_may_look_at_everything_and_start_nothing(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path, **TOKENS)) as run:
        viewer = httpx.AsyncClient(base_url=run.url, headers=bearer("viewer_token"))
        for path in ("calibrations", "calibration-sets", "preprocessing", "mag-learning"):
            assert (await viewer.get(f"/api/v1/boards/sim/{path}")).status_code == 200
        for path, body in (("calibrations", {"kind": "gyro_bias"}), ("calibration-sets", {"text": "x"})):
            answer = await viewer.post(f"/api/v1/boards/sim/{path}", json=body)
            assert (answer.status_code, answer.json()["code"]) == (403, "operator-needed")
        assert (await viewer.put("/api/v1/boards/sim/mag-learning", json={"run": True})).status_code == 403
        await viewer.aclose()
        operator = httpx.AsyncClient(base_url=run.url, headers=bearer("token"))
        answer = await operator.post("/api/v1/boards/sim/calibrations", json={"kind": "gyro_bias"})
        assert answer.status_code == 202
        assert answer.headers["location"].endswith(f"/calibrations/{answer.json()['id']}")
        await operator.aclose()


async def test_what_cannot_be_is_refused_with_the_value_and_the_limit(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:
        path = "/api/v1/boards/sim/calibrations"
        for body, named in (
            ({"kind": "nonsense"}, "kind"),
            ({"kind": "gyro_bias", "options": {"duration_s": -1.0}}, "options.duration_s"),
            ({"kind": "mag_ellipsoid", "options": {"ellipsoid_parameters": 7}}, "options.ellipsoid_parameters"),
            ({"kind": "gyro_bias", "colour": "red"}, "colour"),
        ):
            answer = await run.client.post(path, json=body)
            assert answer.status_code == 422
            assert named in [one["name"] for one in answer.json()["errors"]]
        assert (await run.client.get(f"{path}/none")).json()["code"] == "no-such-job"
        assert (await run.client.get("/api/v1/boards/none/calibrations")).json()["code"] == "no-such-board"
        codes = (await run.client.get("/api/v1/calibration-codes")).json()["codes"]
        assert {"coverage-planar", "motion", "field-strength"} <= {one["code"] for one in codes}


async def test_a_filter_set_by_rest_tells_its_delay_and_goes_back_to_its_default(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        path = "/api/v1/boards/sim/preprocessing/gyro"
        answer = await board.run.client.patch(path, json={"butterworth_hz": 20.0})
        assert answer.status_code == 200
        await board.lie()
        gyro = next(one for one in (await board.get("/preprocessing"))["sensors"] if one["sensor"] == "gyro")
        assert gyro["active"]
        assert 0.005 < gyro["delay_s"] < 0.03  # √2/(2π·20 Hz) = 11 ms for the second order
        delays = (await board.get("/health"))["delays"]
        assert next(one for one in delays if one["measurement"] == "imu")["filter_s"] is not None
        topics = [one["topic"] for one in (await board.get(""))["topics"]]
        assert "boards/sim/stages/gyro" in topics
        bad = await board.run.client.patch(path, json={"butterworth_hz": -3.0})
        assert (bad.status_code, bad.json()["code"]) == (422, "parameter-out-of-range")
        assert (await board.run.client.patch(path, json={"butterworth_hz": None})).status_code == 200
        gyro = next(one for one in (await board.get("/preprocessing"))["sensors"] if one["sensor"] == "gyro")
        assert not gyro["active"]


async def test_learning_that_does_not_run_is_not_applied_and_nothing_unsettled_is_kept(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        client, path = board.run.client, "/api/v1/boards/sim/mag-learning"
        assert (await client.put(path, json={"apply": True})).json()["code"] == "learning-off"
        assert (await client.put(path, json={"run": True})).json()["run"]
        assert (await client.post(f"{path}/keep")).json()["code"] == "not-settled"


async def test_sets_are_exported_imported_compared_and_only_then_applied(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        await board.lie()
        job_id = await board.start("gyro_bias")
        live = await board.ended(job_id)
        await board.post(f"/calibrations/{job_id}/apply")
        text = (await board.run.client.get("/api/v1/boards/sim/calibration-sets/export")).text
        added = await board.post("/calibration-sets", {"name": "mine.json", "text": text}, status=201)
        kept = added["store"]["sets"]
        assert [one["in_force"] for one in kept] == [False, True]
        assert kept[0]["parameters"] == kept[1]["parameters"]
        changes = (await board.get(f"/calibration-sets/{kept[1]['id']}/diff/{kept[0]['id']}"))["changes"]
        assert all(one["change"] == 0.0 for one in changes)
        used = await board.run.client.delete(f"/api/v1/boards/sim/calibration-sets/{kept[1]['id']}")
        assert (used.status_code, used.json()["code"]) == (409, "set-in-force")
        gone = await board.run.client.delete(f"/api/v1/boards/sim/calibration-sets/{kept[0]['id']}")
        assert gone.status_code == 204
        header = (await board.run.client.get("/api/v1/boards/sim/calibration-sets/export?format=c")).text
        assert f"{live['result']['parameters']['bias'][0]:.5g}"[:6] in header
        nonsense = await board.post("/calibration-sets", {"text": "no parameters"}, status=422)
        assert nonsense["code"] == "unreadable-calibration"
        await board.post("/calibration-sets/take-off", {"sensor": "gyro"})
        assert await settled_gyro(board) > 0.04
        assert np.isfinite(await settled_gyro(board))

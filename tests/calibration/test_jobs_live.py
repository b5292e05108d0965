"""Calibration jobs over REST on the demo board: real bytes through a pseudo-terminal, real collectors, a real store."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import numpy as np

from server.sim.settings import sim_settings
from server.sim.stream import SimStream
from tests.calibration.demo_service import demo

TRUTH = SimStream(sim_settings("sim:?errors=raw")).truth_errors


async def test_a_gyro_bias_is_found_verified_applied_and_rolled_back(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        await board.lie()
        job_id = await board.start("gyro_bias")
        job = await board.ended(job_id)
        assert job["state"] == "fitted"
        found = job["result"]
        error = np.subtract(found["parameters"]["bias"], TRUTH.gyro_offset)
        assert np.all(np.abs(error) < 1e-3)  # the board warms up: 0.003 °/s per kelvin
        assert found["residual_after"]["value"] < 0.05 * found["residual_before"]["value"]
        assert job["comparison"]["residual"]["value"] > 10 * found["residual_after"]["value"]
        await board.post(f"/calibrations/{job_id}/verify")
        job = await board.until(job_id, lambda one: one["check"] is not None)
        assert job["check"]["ok"]
        assert (await board.get("/calibration-sets"))["sets"] == []  # nothing is kept before it is applied
        job = await board.post(f"/calibrations/{job_id}/apply")
        assert job["state"] == "applied"
        kept = await board.get("/calibration-sets")
        assert [one["in_force"] for one in kept["sets"]] == [True]
        assert kept["sets"][0]["check"]["ok"]
        assert await settled_gyro(board) < 2e-3
        await board.post("/calibration-sets/roll-back", {"sensor": "gyro"})
        assert not (await board.get("/calibration-sets"))["sets"][0]["in_force"]
        assert await settled_gyro(board) > 0.04
        await board.post(f"/calibration-sets/{kept['sets'][0]['id']}/apply")
        assert await settled_gyro(board) < 2e-3


async def settled_gyro(board) -> float:
    """Length of the rate that the estimators are given at rest, rad/s, once what was changed has arrived."""
    await asyncio.sleep(0.4)
    filtered = (await board.get("/health"))["filtered"]
    return float(np.linalg.norm([filtered[f"gyro_{axis}_rad_s"] for axis in "xyz"]))


async def test_six_faces_in_the_order_of_the_instructions_give_the_offset(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        job_id = await board.start("accel_six_position")
        job = await board.ended(job_id, meanwhile=board.take_faces)
        assert job["state"] == "fitted", job
        assert all(job["progress"]["faces"].values())
        sigma = np.array(job["result"]["sigma"]["offset"])
        error = np.abs(np.subtract(job["result"]["parameters"]["offset"], TRUTH.accel_offset))
        assert np.all(error < 3.0 * sigma + 0.02)  # 0.02 m/s²: what it gains while it warms up by 15 K
        assert job["result"]["residual_after"]["value"] < 0.1  # S1


async def test_the_magnetometer_survives_a_lost_link_and_a_second_job_is_refused_meanwhile(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        job_id = await board.start("mag_ellipsoid")
        await board.until(job_id, lambda one: one["progress"]["samples"] > 60, meanwhile=board.keep_spinning)
        await board.turn(action="drop_link", duration_s=5.0)
        paused = await board.until(job_id, lambda one: one["state"] == "paused")
        busy = await board.post("/calibrations", {"kind": "mag_fixed_heading"}, status=409)
        assert busy["code"] == "calibration-busy"
        assert job_id in busy["detail"]
        other = await board.start("baro_reference")  # another sensor is free
        await board.post(f"/calibrations/{other}/cancel")
        job = await board.ended(job_id, meanwhile=board.keep_spinning, within_s=90.0)
        assert job["state"] == "fitted", job
        assert job["result"]["samples"] >= paused["progress"]["samples"]
        offset = np.array(job["result"]["parameters"]["offset"])
        assert np.linalg.norm(offset - TRUTH.mag_offset) < 0.005  # 1 % of the field
        matrix = np.array(job["result"]["parameters"]["matrix"])
        assert np.array_equal(matrix, matrix.T)


async def test_a_spin_about_one_axis_is_refused_with_the_reason_and_nothing_is_lost(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        await board.lie()
        job_id = await board.start("mag_ellipsoid")
        await board.turn(action="spin", about="z", duration_s=40.0)
        await board.until(job_id, lambda one: one["progress"]["samples"] > 250)
        await board.post(f"/calibrations/{job_id}/confirm")
        job = await board.until(job_id, lambda one: one["refusal"] is not None)
        assert job["refusal"]["code"] == "coverage-planar"
        assert job["refusal"]["advice"]
        assert job["state"] == "collecting"
        assert job["progress"]["samples"] > 250
        job = await board.post(f"/calibrations/{job_id}/cancel")
        assert job["state"] == "cancelled"
        late = await board.post(f"/calibrations/{job_id}/confirm", status=409)
        assert late["code"] == "wrong-state"


async def test_a_shaken_board_starts_again_and_its_progress_does_not_go_back(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        await board.lie()
        job_id = await board.start("gyro_bias", options={"duration_s": 20.0})
        await board.until(job_id, lambda one: one["progress"]["fraction"] > 0.2)
        await board.turn(action="shake", duration_s=3.0)
        job = await board.until(job_id, lambda one: one["progress"]["restarts"] > 0)
        assert job["state"] == "collecting"
        assert (await board.ended(job_id))["state"] == "fitted"


async def test_the_kept_samples_fitted_offline_give_the_very_same_numbers(tmp_path: Path) -> None:
    from server.calibrate.command import run
    from server.calibrate.told import Told, kind_of

    async with demo(tmp_path) as board:
        await board.lie()
        job_id = await board.start("gyro_bias")
        live = await board.ended(job_id)
        await board.post(f"/calibrations/{job_id}/apply")
        await asyncio.sleep(0.5)  # the driver closes its files when no job is active
    told = Told(kind=kind_of("gyro_bias"), files=(Path(live["samples_file"]),))
    offline = json.loads((await asyncio.to_thread(run, told, as_json=True)).text)
    assert offline["parameters"] == live["result"]["parameters"]
    assert offline["sigma"] == live["result"]["sigma"]


async def test_a_dry_run_cannot_be_applied(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        await board.lie()
        job_id = await board.start("level", dry_run=True)
        assert (await board.ended(job_id))["state"] == "fitted"
        assert (await board.post(f"/calibrations/{job_id}/apply", status=409))["code"] == "dry-run"


async def test_a_job_without_data_times_out_with_its_time_and_limit(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        await board.turn(action="drop_link", duration_s=60.0)
        await asyncio.sleep(0.5)
        job_id = await board.start("gyro_bias", timeout_s=5.0)
        job = await board.ended(job_id)
        assert (job["state"], job["refusal"]["code"]) == ("refused", "no-data")
        assert job["refusal"]["measured"] >= job["refusal"]["limit"] == 5.0


async def test_removing_the_board_ends_its_job_and_an_applied_calibration_comes_back_with_the_board(
    tmp_path: Path,
) -> None:
    async with demo(tmp_path) as board:
        await board.lie()
        job_id = await board.start("gyro_bias")
        await board.ended(job_id)
        await board.post(f"/calibrations/{job_id}/apply")
    async with demo(tmp_path) as board:  # another process would find the same folder
        await board.lie()
        assert await settled_gyro(board) < 2e-3
        service = board.run.service.calibrations
        job_id = await board.start("mag_ellipsoid")
        await board.run.client.delete("/api/v1/boards/sim")
        job = next(one for one in service.jobs("sim") if one.id == job_id)
        assert job.refusal is not None
        assert job.refusal.code == "board-removed"


async def test_the_stream_tells_every_tab_of_the_job(tmp_path: Path) -> None:
    async with demo(tmp_path) as board:
        await board.lie()
        job_id = await board.start("gyro_bias", options={"duration_s": 15.0})
        states = [await first_of_stream(board) for _ in range(2)]  # a tab that closes, and one that opens
        assert [state["jobs"][0]["id"] for state in states] == [job_id, job_id]
        assert states[0]["jobs"][0]["progress"]["fraction"] <= states[1]["jobs"][0]["progress"]["fraction"]
        assert (await board.ended(job_id))["state"] == "fitted"


async def first_of_stream(board) -> dict:
    """What a page that opens now is told first of the board's calibrations."""
    async with board.run.stream() as socket:
        await socket.send(json.dumps({"op": "subscribe", "id": 1, "topic": "boards/sim/calibration"}))
        async for text in socket:
            message = json.loads(text)
            if message["op"] == "data":
                return message["data"]
    raise AssertionError("the stream ended")

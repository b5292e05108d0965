"""Two things at the same moment: the service with a board that sends what the test pushes."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from server.calibration.errors import StoreError
from server.calibration.job import Job, JobState
from server.calibration.records import CalibrationSet
from server.calibration.samples import SampleFile
from server.calibration.store import CalibrationStore
from server.nav.calibration.gyro_bias import GyroBias
from server.nav.calibration.types import CalKind, Fit, Sensor
from server.parts import RealFactories
from tests.shell.shell_fakes import BREAK, Running, fake_settings, running

JOBS = "/api/v1/boards/sim/calibrations"


async def begun(run: Running, kind: str = "gyro_bias", **more: Any) -> Job:
    answer = await run.client.post(JOBS, json={"kind": kind, **more})
    assert answer.status_code == 202, answer.text
    return next(job for job in run.service.calibrations.jobs("sim") if job.id == answer.json()["id"])


async def act(run: Running, job: Job, action: str) -> httpx.Response:
    return await run.client.post(f"{JOBS}/{job.id}/{action}")


async def until(truth: Callable[[], object], push: Callable[[], object] = lambda: None, within_s: float = 5.0) -> None:
    end_s = time.monotonic() + within_s
    while not truth():
        assert time.monotonic() < end_s, "it never came"
        push()
        await asyncio.sleep(0.02)


def give(job: Job, scale: tuple[float, ...] | None = None) -> None:
    """Let a job have a result, as if its collector had found it."""
    found = {"bias": np.array([0.01, 0.02, 0.03])} | ({} if scale is None else {"scale": np.array(scale)})
    sigma = {name: np.full(3, 1e-5) for name in found}
    job.state = JobState.COLLECTING
    job.begin_fit()
    job.end_fit(Fit(kind=job.kind, parameters=found, sigma=sigma), None, asked=False, now_s=time.monotonic())


async def test_a_job_that_starts_while_the_files_of_the_last_are_closed_is_fed(tmp_path: Path, monkeypatch) -> None:
    close = SampleFile.close

    def slowly(self: SampleFile) -> object:
        time.sleep(0.6)
        return close(self)

    monkeypatch.setattr(SampleFile, "close", slowly)
    async with running(fake_settings(data_dir=tmp_path)) as run:
        first = await begun(run)
        await until(lambda: first.samples_file, lambda: run.push(10))
        await act(run, first, "cancel")
        await asyncio.sleep(0.3)  # it closes
        second = await begun(run, "gyro_scale")
        await until(lambda: second.state is JobState.COLLECTING, lambda: run.push(10))


async def test_a_board_added_again_at_once_under_its_old_name_feeds_its_new_job(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:
        first = await begun(run)
        await until(lambda: first.state is JobState.COLLECTING, lambda: run.push(10))
        assert (await run.client.delete("/api/v1/boards/sim")).status_code < 300
        assert first.refusal is not None
        assert first.refusal.code == "board-removed"
        assert (await run.client.post("/api/v1/boards", json={"url": "sim:"})).status_code < 300
        second = await begun(run)
        await until(lambda: second.state is JobState.COLLECTING, lambda: run.push(10))


async def test_a_defect_of_a_collector_ends_its_job_and_neither_the_other_jobs_nor_the_service(
    tmp_path: Path, monkeypatch
) -> None:
    def broken(self: GyroBias, *_more: object) -> None:
        raise AttributeError("a defect")

    monkeypatch.setattr(GyroBias, "feed", broken)
    async with running(fake_settings(data_dir=tmp_path)) as run:
        other = await begun(run, "level")
        job = await begun(run)
        await until(lambda: not job.is_active, lambda: run.push(10))
        assert job.refusal is not None
        assert job.refusal.code == "program"
        assert other.is_active
        assert (await run.client.get(JOBS)).status_code == 200


async def test_what_comes_while_a_refused_attempt_is_made_is_not_lost(tmp_path: Path, monkeypatch) -> None:
    fed: list[int] = []
    monkeypatch.setattr(GyroBias, "feed", lambda _self, _kind, t_ns, _rows: fed.extend(t_ns.tolist()))
    fit = GyroBias.fit

    def slowly(self: GyroBias) -> Fit:
        time.sleep(0.5)
        return fit(self)

    monkeypatch.setattr(GyroBias, "fit", slowly)
    async with running(fake_settings(data_dir=tmp_path)) as run:
        job = await begun(run)
        await until(lambda: fed, lambda: run.push(10))
        assert (await act(run, job, "confirm")).json()["state"] == "fitting"
        assert (await act(run, job, "confirm")).json()["code"] == "wrong-state"
        count = len(fed)
        await until(lambda: job.state is JobState.COLLECTING, lambda: run.push(10))
        await until(lambda: len(fed) > count, lambda: run.push(10))
        assert set(np.diff(fed)) == {2_000_000}  # every stamp, in order


async def test_cancel_and_verify_wait_while_a_result_is_being_applied(tmp_path: Path, monkeypatch) -> None:
    add = CalibrationStore.add

    def slowly(self: CalibrationStore, found: Any) -> object:
        time.sleep(0.4)
        return add(self, found)

    monkeypatch.setattr(CalibrationStore, "add", slowly)
    async with running(fake_settings(data_dir=tmp_path)) as run:
        job = await begun(run)
        give(job)
        both = [asyncio.create_task(act(run, job, "apply")) for _ in range(2)]
        await asyncio.sleep(0.15)
        assert (await act(run, job, "cancel")).json()["code"] == "wrong-state"
        assert (await act(run, job, "verify")).json()["code"] == "wrong-state"
        assert sorted([(await one).status_code for one in both]) == [202, 409]
        assert job.state is JobState.APPLIED
        assert len((await run.client.get("/api/v1/boards/sim/calibration-sets")).json()["sets"]) == 1
        await act(run, job, "verify")
        assert job.state is JobState.VERIFYING
        assert (await act(run, job, "cancel")).json()["state"] == "applied"


@pytest.mark.parametrize(
    ("error", "code"),
    [(OSError(28, "No space left on device"), "store-failed"), (StoreError("store-busy", "Held."), "store-busy")],
)
async def test_a_store_that_fails_leaves_the_result_and_a_second_attempt_succeeds(
    tmp_path: Path, monkeypatch, error: Exception, code: str
) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:
        job = await begun(run)
        give(job)
        with monkeypatch.context() as patch:

            def full(*_args: object) -> None:
                raise error

            patch.setattr(CalibrationStore, "add", full)
            answer = await act(run, job, "apply")
            assert answer.json()["code"] == code
        assert (job.state, job.fit is not None) == (JobState.FITTED, True)
        assert not run.service.boards.get("sim").calibration.gyro_offset.any()
        assert (await act(run, job, "apply")).json()["state"] == "applied"
        assert run.service.boards.get("sim").calibration.gyro_offset.any()


async def test_a_result_applied_late_keeps_what_was_put_in_force_since(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:
        bias = await begun(run)
        give(bias)
        scale = await begun(run, "gyro_scale")
        give(scale, scale=(1.0, 1.0, 1.02))
        await act(run, scale, "apply")
        await act(run, bias, "apply")
        gyro = run.service.boards.get("sim").calibration.gyro_matrix
        assert np.array_equal(np.diag(gyro), [1.0, 1.0, 1.02])


async def test_a_level_made_with_another_accelerometer_calibration_is_refused(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:
        level = await begun(run, "level")
        level.begin_fit()
        level.end_fit(Fit(kind=CalKind.LEVEL, parameters={"matrix": np.eye(3)}), None, asked=False, now_s=0.0)
        accel = await begun(run, "accel_multi_pose")
        found = {"matrix": np.eye(3), "offset": np.array([0.3, 0.0, 0.0])}
        accel.begin_fit()
        accel.end_fit(Fit(kind=accel.kind, parameters=found), None, asked=False, now_s=0.0)
        await act(run, accel, "apply")
        answer = await act(run, level, "apply")
        assert (answer.status_code, answer.json()["code"]) == (409, "calibration-changed")
        assert level.state is JobState.FITTED


async def test_what_would_be_of_no_use_is_refused_before_the_work_not_after(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:  # its engine never knows a site
        for body, status, code in (
            ({"kind": "mag_fixed_heading"}, 422, "heading-unknown"),
            ({"kind": "mag_fixed_heading", "options": {"heading_deg": 10.0}}, 409, "field-unknown"),
            ({"kind": "mag_ellipsoid"}, 409, "field-unknown"),
        ):
            answer = await run.client.post(JOBS, json=body)
            assert (answer.status_code, answer.json()["code"]) == (status, code)
        assert run.service.calibrations.jobs("sim") == []
        job = await begun(run, "mag_ellipsoid", options={"strength_gauss": 0.48})
        assert job.options.strength == 0.48


async def test_an_impossible_calibration_is_refused_before_it_is_in_force_anywhere(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:
        job = await begun(run, "gyro_scale")
        give(job, scale=(0.0, 1.0, 1.0))
        answer = await act(run, job, "apply")
        assert (answer.status_code, answer.json()["code"]) == (422, "impossible-calibration")
        kept = (await run.client.get("/api/v1/boards/sim/calibration-sets")).json()
        assert kept["sets"] == []


async def test_the_list_of_jobs_is_bounded_and_keeps_what_is_active(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:
        active = await begun(run, "level")
        for _ in range(40):
            await act(run, await begun(run), "cancel")
        jobs = run.service.calibrations.jobs("sim")
        assert len(jobs) == 30
        assert active in jobs


async def test_a_service_that_stops_while_a_job_collects_leaves_a_whole_file(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:
        job = await begun(run)
        await until(lambda: job.samples_file, lambda: run.push(10))
    lines = (Path(job.samples_file) / "imu.csv").read_bytes()
    assert lines.endswith(b"\n")
    assert lines.count(b"\n") > 10


async def test_an_import_that_holds_one_impossible_set_stores_none_of_them(tmp_path: Path) -> None:
    sets = "/api/v1/boards/sim/calibration-sets"
    async with running(fake_settings(data_dir=tmp_path)) as run:
        accel = await begun(run, "accel_multi_pose")
        found = {"matrix": np.eye(3), "offset": np.array([0.3, 0.0, 0.0])}
        accel.begin_fit()
        accel.end_fit(Fit(kind=accel.kind, parameters=found), None, asked=False, now_s=0.0)
        await act(run, accel, "apply")
        gyro = await begun(run)
        give(gyro)
        await act(run, gyro, "apply")
        file = (await run.client.get(f"{sets}/export")).json()
        before = (await run.client.get(sets)).json()
        for one in file["sets"]:
            if one["sensor"] == "accel":
                one["parameters"]["matrix"] = np.zeros((3, 3)).tolist()
        answer = await run.client.post(sets, json={"text": json.dumps(file)})
        assert (answer.status_code, answer.json()["code"]) == (422, "impossible-calibration")
        assert (await run.client.get(sets)).json() == before


async def test_a_board_whose_program_failed_feeds_its_job_again_once_it_is_reconnected(tmp_path: Path) -> None:
    async with running(fake_settings(data_dir=tmp_path)) as run:
        job = await begun(run)
        await until(lambda: job.state is JobState.COLLECTING, lambda: run.push(10))
        board = run.service.boards.get("sim")
        run.factories.link("sim:").push(bytes([BREAK]))
        await until(lambda: board.state == "failed")
        await until(lambda: job.state is JobState.PAUSED)
        await run.client.post("/api/v1/boards/sim/reconnect")
        await until(lambda: board.state == "running")
        await until(lambda: job.state is JobState.COLLECTING, lambda: run.push(10))


async def test_a_stored_calibration_that_the_engine_does_not_take_is_told_and_does_not_stop_the_start(
    tmp_path: Path,
) -> None:
    store = CalibrationStore(tmp_path / "calibrations")  # as an older version may have left it
    bad = {"scale": np.array([0.0, 1.0, 1.0]), "bias": np.zeros(3)}
    kept = store.add(CalibrationSet(board_id="sim", sensor=Sensor.GYRO, kind="import", parameters=bad))
    store.apply("sim", kept.id, "test")
    store.close()
    loaded = fake_settings(data_dir=tmp_path)
    factories = RealFactories(loaded.settings.engine_settings(), talk=False)
    async with running(loaded, factories) as run:
        events = [one.event.code for one in run.service.boards.get("sim").view().events]
        assert "calibration-unreadable" in events

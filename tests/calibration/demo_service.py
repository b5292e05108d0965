"""A whole service in this process with the real demo board, many times faster than real time, and its REST."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from server.parts import RealFactories
from tests.shell.shell_fakes import Running, fake_settings, running

SPEED = 8.0
"""Board seconds per host second."""
FACES = ("nose-up", "nose-down", "right-up", "left-up", "upside-down", "level")
Json = dict[str, Any]


@dataclass
class Demo:
    """The demo board `sim` of a running service."""

    run: Running

    async def get(self, path: str) -> Json:
        """Body of a GET below the board."""
        answer = await self.run.client.get(f"/api/v1/boards/sim{path}")
        assert answer.status_code == 200, answer.text
        return answer.json()

    async def post(self, path: str, body: Json | None = None, status: int = 202) -> Json:
        """Body of a POST below the board."""
        answer = await self.run.client.post(f"/api/v1/boards/sim{path}", json=body)
        assert answer.status_code == status, answer.text
        return answer.json()

    async def turn(self, **command: Any) -> Json:
        """Tell the demo board to do something."""
        return await self.post("/simulator", command)

    async def start(self, kind: str, **more: Any) -> str:
        """Id of a new job."""
        return str((await self.post("/calibrations", {"kind": kind, **more}))["id"])

    async def job(self, job_id: str) -> Json:
        """The job now."""
        return await self.get(f"/calibrations/{job_id}")

    async def until(
        self,
        job_id: str,
        truth: Callable[[Json], object],
        within_s: float = 60.0,
        meanwhile: Callable[[Json], Awaitable[object]] | None = None,
    ) -> Json:
        """Wait until something holds of a job; its progress must never go back on the way."""
        end_s, fraction = time.monotonic() + within_s, -1.0
        while True:
            job = await self.job(job_id)
            if job["state"] not in {"verifying"}:
                assert job["progress"]["fraction"] >= fraction
                fraction = job["progress"]["fraction"]
            if truth(job):
                return job
            if time.monotonic() > end_s:
                pytest.fail(f"not within {within_s:g} s: {job}", pytrace=False)
            if meanwhile is not None:
                await meanwhile(job)
            await asyncio.sleep(0.05)

    async def ended(self, job_id: str, **more: Any) -> Json:
        """Wait until the job has a result or ended without one."""
        return await self.until(job_id, lambda job: not job["active"], **more)

    async def lie(self, face: str = "level") -> None:
        """Lay the board on a face and wait until it lies there."""
        await self.turn(action="pose", face=face)
        await self.idle()

    async def idle(self, within_s: float = 60.0) -> None:
        """Wait until the demo board has done what it was told."""
        end_s = time.monotonic() + within_s
        while (state := await self.get("/simulator"))["is_moving"] or state["remaining_s"] > 0.0:
            assert time.monotonic() < end_s, state
            await asyncio.sleep(0.05)

    async def take_faces(self, job: Json) -> None:
        """Obey the instruction of the job: take the face it asks for."""
        wanted = job["progress"]["face_next"]
        state = await self.get("/simulator")
        if wanted and state["name"] != wanted and state["remaining_s"] <= 0.0:
            await self.turn(action="pose", face=wanted)

    async def keep_spinning(self, _job: Json) -> None:
        """Turn the board all ways for as long as it is asked."""
        if (await self.get("/simulator"))["remaining_s"] <= 0.0:
            await self.turn(action="spin")


@contextlib.asynccontextmanager
async def demo(data_dir: Path, options: str = "", **settings: Any) -> AsyncIterator[Demo]:
    """A service whose only board is an uncalibrated demo board, heard and aligned."""
    link = f"sim:?errors=raw&speed={SPEED:g}{options}"
    loaded = fake_settings(links=(link,), data_dir=data_dir, **settings)
    factories = RealFactories(loaded.settings.engine_settings(), talk=True)
    factories.load()
    async with running(loaded, factories) as run:
        demo_board = Demo(run)
        end_s = time.monotonic() + 30.0
        while not any(one["name"] == "mag" and one["samples"] for one in (await demo_board.get("/health"))["sensors"]):
            assert time.monotonic() < end_s, "the demo board was never heard"
            await asyncio.sleep(0.05)
        yield demo_board

"""One board: what its failure, its end, its texts and its silence mean, for itself and for the others."""

import asyncio

from server.link.base import LinkState
from server.nav.types import LaneStatus
from tests.shell.shell_fakes import BREAK, SAMPLES_PER_STEP, TEXT, fake_settings, running, until

TWO = {"links": ("sim:", "udp://:14550")}


async def test_a_board_that_fails_takes_down_neither_the_other_nor_the_server() -> None:
    async with running(fake_settings(**TWO)) as run:
        run.factories.link("sim:").push(bytes([BREAK]))
        await until(lambda: run.service.boards.get("sim").view().state == "failed")
        run.push(SAMPLES_PER_STEP, "udp://:14550")
        await until(lambda: run.service.boards.get("udp-14550").view().snapshot.steps == 1)
        board = (await run.client.get("/api/v1/boards/sim")).json()
        assert "the engine broke" in board["cause"]
        assert board["remedy"]
        assert (board["severity"], board["headline"]["code"]) == ("warning", "board-failed")
        assert run.factories.link("sim:").closed


async def test_a_failed_board_starts_afresh_when_it_is_reconnected() -> None:
    async with running() as run:
        run.factories.link("sim:").push(bytes([BREAK]))
        await until(lambda: run.service.boards.get("sim").view().state == "failed")
        await run.client.post("/api/v1/boards/sim/reconnect")
        await until(lambda: len(run.factories.engines) == 2)
        run.push(SAMPLES_PER_STEP)
        await until(lambda: run.factories.engines[-1].steps == 1)
        assert run.service.boards.get("sim").view().state == "running"


async def test_reconnecting_keeps_the_engine_that_works() -> None:
    async with running() as run:
        run.push(SAMPLES_PER_STEP)
        await until(lambda: run.factories.engines and run.factories.engines[-1].steps == 1)
        await run.client.post("/api/v1/boards/sim/reconnect")
        await until(lambda: len(run.factories.links["sim:"]) == 2)
        run.push(SAMPLES_PER_STEP)
        await until(lambda: run.factories.engines[-1].steps == 2)
        assert len(run.factories.engines) == 1
        assert run.factories.protocols[-1].connections == 2


async def test_a_source_that_ends_leaves_its_last_state() -> None:
    async with running() as run:
        run.push(SAMPLES_PER_STEP)
        run.factories.link("sim:").end()
        await until(lambda: run.service.boards.get("sim").view().state == "ended")
        board = (await run.client.get("/api/v1/boards/sim")).json()
        assert (board["link"]["state"], board["lanes"][0]["status"]) == ("ended", "navigating")


async def test_the_board_is_talked_to_ten_times_a_second() -> None:
    async with running() as run:
        await until(lambda: run.factories.link("sim:").written.count(b"beat") >= 3, 1.0)


async def test_texts_and_link_changes_are_events_in_order() -> None:
    async with running() as run:
        run.factories.link("sim:").push(bytes([TEXT]) + bytes(SAMPLES_PER_STEP))
        await until(lambda: run.factories.engines and run.factories.engines[-1].steps == 1)
        run.factories.link("sim:").tell(LinkState.LOST, code="unplugged", cause="It went away.", remedy="Plug it in.")
        await until(lambda: "link-lost" in [one.event.code for one in run.service.boards.get("sim").view().events])
        events = (await run.client.get("/api/v1/boards/sim/health")).json()["events"]
        assert [event["seq"] for event in events] == list(range(1, len(events) + 1))
        told = {event["code"]: event for event in events}
        assert (told["board-text"]["text"], told["board-text"]["source"]) == ("hello", "board")
        assert told["born"]["source"] == "engine"
        assert "Plug it in." in told["link-lost"]["text"]
        assert (told["link-lost"]["source"], told["link-lost"]["severity"]) == ("link", "caution")


async def test_a_lost_link_is_the_headline_with_its_cause_and_remedy() -> None:
    async with running() as run:
        run.factories.link("sim:").tell(LinkState.BUSY, code="port-busy", cause="Held by gcs.", remedy="Close it.")
        await asyncio.sleep(0)
        headline = (await run.client.get("/api/v1/boards/sim")).json()["headline"]
        assert (headline["code"], headline["cause"], headline["remedy"]) == ("port-busy", "Held by gcs.", "Close it.")


async def test_dead_reckoning_is_a_caution_that_says_so() -> None:
    async with running() as run:
        await until(lambda: run.factories.engines)
        run.factories.engines[-1].status = LaneStatus.DEAD_RECKONING
        run.push(SAMPLES_PER_STEP)
        await until(lambda: run.factories.engines[-1].steps == 1)
        health = (await run.client.get("/api/v1/boards/sim/health")).json()
        assert "dead-reckoning" in [line["code"] for line in health["verdict"]]
        assert (await run.client.get("/api/v1/boards/sim/nav")).json()["flags"]["dead_reckoning"]


async def test_a_source_that_never_waits_does_not_starve_the_others() -> None:
    """A link whose bytes are all there at once leaves the page answering."""
    async with running() as run:
        for _ in range(20_000):
            run.push(5)
        response = await asyncio.wait_for(run.client.get("/healthz"), 2.0)
        assert response.status_code == 200
        assert run.factories.engines[-1].samples < 100_000

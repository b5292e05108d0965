"""The Calibrate place with the demo board: every wizard by clicks alone, undone, interrupted and found again."""

import contextlib
import json
import re
import time
import urllib.request
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Locator, Page
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from tests.browser.conftest import OpenPage, Screen, Server, StartServer, wait_for

SIZE = (960, 700)
SPEED = 8
"""Board seconds per second: nobody waits for a hand here."""
CARDS = ("gyro", "accel", "board", "mag", "airspeed", "baro")


@pytest.fixture(scope="module")
def server(start_server: StartServer) -> Server:
    return start_server("--link", f"sim:?errors=raw&speed={SPEED}")


@pytest.fixture
def screen(server: Server, open_page: OpenPage) -> Screen:
    opened = open_page(f"{server.url}/calibrate", size=SIZE)
    opened.page.locator("[data-sensor=gyro]").wait_for(timeout=60_000)
    return opened


def read(server: Server, path: str) -> Any:
    with urllib.request.urlopen(f"{server.url}/api/v1/boards/sim/{path}", timeout=10) as answer:
        return json.load(answer)


def in_force(server: Server, sensor: str) -> str:
    """Id of the set in force, "" for none."""
    return next(str(each["set_id"]) for each in read(server, "calibration-sets")["sensors"] if each["sensor"] == sensor)


def button(page: Page, name: str) -> Locator:
    return page.locator("main").get_by_role("button", name=name, exact=True)


def open_wizard(page: Page, sensor: str, kind: str) -> None:
    page.locator(f"[data-sensor={sensor}]").get_by_role("button", name=kind, exact=True).click()
    button(page, "Start").wait_for()


def step(page: Page) -> str:
    """Which step the wizard says it is at."""
    return page.locator(".steps [aria-current=step]").inner_text().split("\n")[-1]


def obey(page: Page) -> None:
    """Press what the demo panel offers, when it offers something."""
    asked = page.locator(".demo .asked")
    if asked.count() and asked.is_enabled():
        with contextlib.suppress(PlaywrightTimeoutError):  # it asked no more when the pointer got there
            asked.click(timeout=1000)


def until(page: Page, what: str, found: Callable[[], bool], timeout_s: float = 60.0) -> None:
    """Do as the page asks until it is so; its progress never goes back meanwhile."""
    seen = 0.0
    bar = page.locator(".wizard [role=progressbar]").first

    def looked() -> bool:
        nonlocal seen
        if found():
            return True
        obey(page)
        if bar.count() and bar.get_attribute("aria-label") == "Collected":
            now = float(bar.get_attribute("aria-valuenow") or seen)
            assert now >= seen, f"progress went back from {seen} to {now}"
            seen = now
        return False

    wait_for(what, looked, timeout_s, every_s=0.25)


def finish(page: Page, timeout_s: float = 60.0) -> None:
    """Do as asked until the wizard shows a result."""
    until(page, "a result", lambda: page.locator(".wizard [data-grade]").count() > 0, timeout_s)


def verify_and_apply(server: Server, page: Page, sensor: str) -> None:
    button(page, "Verify on fresh data").click()
    until(page, "verified", lambda: page.locator("[data-check=ok]").count() > 0)
    button(page, "Apply").click()
    page.get_by_text("In force from now on").wait_for(timeout=20_000)
    assert in_force(server, sensor)
    assert step(page) == "In force"


@pytest.mark.parametrize(
    ("sensor", "kind"),
    [
        ("gyro", "Zero rate"),
        ("gyro", "Scale on a turntable"),
        ("accel", "Any poses"),
        ("board", "Level"),
        ("airspeed", "Zero of the pitot tube"),
    ],
)
def test_wizard_is_done_by_clicks_alone(server: Server, screen: Screen, sensor: str, kind: str) -> None:
    page = screen.page
    open_wizard(page, sensor, kind)
    button(page, "Start").click()
    finish(page)
    assert page.locator(".wizard [data-grade]").get_attribute("data-grade") in {"good", "fair"}
    before = in_force(server, sensor)
    verify_and_apply(server, page, sensor)
    assert in_force(server, sensor) != before
    assert screen.errors == []


def test_six_positions_survive_a_reload_in_the_middle(server: Server, screen: Screen) -> None:
    page = screen.page
    open_wizard(page, "accel", "Six positions")
    button(page, "Start").click()
    done = page.locator("[data-face][data-mark=done]")
    until(page, "three sides", lambda: done.count() >= 3)
    faces = {tile.get_attribute("data-face") for tile in done.all()}
    assert step(page) == "Collect"
    page.reload()
    wait_for("the same sides after the reload", lambda: done.count() >= len(faces))
    assert faces <= {tile.get_attribute("data-face") for tile in done.all()}
    finish(page)
    assert page.locator(".wizard [data-grade]").get_attribute("data-grade") in {"good", "fair"}
    verify_and_apply(server, page, "accel")


def test_applied_is_rolled_back_at_once(server: Server, screen: Screen) -> None:
    page = screen.page
    before = in_force(server, "baro")
    open_wizard(page, "baro", "Height here")
    page.get_by_label("Height here").last.fill("12,5")
    button(page, "Start").click()
    finish(page)
    verify_and_apply(server, page, "baro")
    page.locator(".wizard").get_by_role("button", name="Roll back").click()
    page.get_by_text("No longer in force").wait_for(timeout=20_000)
    assert in_force(server, "baro") == before


def test_magnetometer_pauses_while_the_link_is_lost_and_goes_on(server: Server, screen: Screen) -> None:
    page = screen.page
    open_wizard(page, "mag", "Turn in every direction")
    button(page, "Start").click()
    bar = page.get_by_role("progressbar", name="Collected")

    def collected() -> float:
        return float(bar.get_attribute("aria-valuenow") or 0.0)

    until(page, "some directions", lambda: collected() >= 15)
    button(page, "Drop the link for 6 s").click()
    page.locator("[data-instruction='cal.do.paused']").wait_for(timeout=20_000)
    kept = collected()
    assert kept >= 15
    finish(page)
    verify_and_apply(server, page, "mag")


def test_planar_spin_is_refused_with_its_reason_and_loses_nothing(server: Server, screen: Screen) -> None:
    page = screen.page
    open_wizard(page, "mag", "Turn in every direction")
    button(page, "Start").click()
    button(page, "Turn about z only").click()
    wait_for("half a minute of turning about z", lambda: samples(page) > 300)
    button(page, "Fit now").click()
    page.get_by_text("near one plane or one cone").wait_for(timeout=20_000)
    assert step(page) == "Collect"
    held = samples(page)
    wait_for("more samples after the refusal", lambda: samples(page) > held)
    button(page, "Cancel").click()
    page.get_by_text("Cancelled. Nothing was changed.").wait_for()
    assert step(page) == "Prepare"


def samples(page: Page) -> int:
    """Samples that the wizard says it has."""
    text = page.locator(".wizard dl div", has_text="Samples").locator("dd").inner_text()
    return int(re.sub(r"\D", "", text) or 0)

"""The Calibrate place with the demo board: every wizard by clicks alone, undone, interrupted and found again."""

import contextlib
import json
import re
import urllib.request
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Locator, Page
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from tests.browser.conftest import OpenPage, Screen, Server, StartServer, picture, wait_for

SIZE = (960, 700)
PHONE = (360, 720)
SPEED = 8
"""Board seconds per second: nobody waits for a hand here."""


@pytest.fixture(scope="module")
def server(start_server: StartServer) -> Server:
    """Without the 3D scene, which Chromium draws in software here: that slows every click."""
    return start_server("--no-view3d", "--link", f"sim:?errors=raw&speed={SPEED}")


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


def prepare(page: Page) -> None:
    """Take the board out of its flight and lay it level before anything begins."""
    button(page, "level").click()
    page.locator(".demo .state", has_text="At rest: belly down").wait_for(timeout=20_000)


def until(page: Page, what: str, found: Callable[[], bool], timeout_s: float = 60.0) -> None:
    """Do as the page asks until it is so; its progress never goes back meanwhile."""
    seen = 0.0
    bars = page.locator(".wizard [role=progressbar][aria-label=Collected]")

    def looked() -> bool:
        nonlocal seen
        if found():
            return True
        obey(page)
        for now in bars.evaluate_all("all => all.map(each => Number(each.getAttribute('aria-valuenow')))"):
            assert now >= seen, f"progress went back from {seen} to {now}"
            seen = now
        return False

    wait_for(what, looked, timeout_s, every_s=0.25)


def finish(page: Page, timeout_s: float = 60.0) -> None:
    """Do as asked until the wizard shows a result."""
    until(page, "a result", lambda: page.locator(".wizard [data-grade]").count() > 0, timeout_s)


def verify_and_apply(server: Server, page: Page, sensor: str) -> None:
    page.locator(".demo .state", has_text="At rest").wait_for(timeout=30_000)  # fresh data begins with a rest
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
        ("mag", "Known heading"),
        ("airspeed", "Zero of the pitot tube"),
    ],
)
def test_wizard_is_done_by_clicks_alone(server: Server, screen: Screen, sensor: str, kind: str) -> None:
    page = screen.page
    open_wizard(page, sensor, kind)
    prepare(page)
    if kind == "Known heading":
        page.get_by_label("True heading").fill("20")
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
    prepare(page)
    button(page, "Start").click()
    button(page, "Turn about z only").click()
    wait_for("a while of turning about z", lambda: samples(page) > 600)
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


def test_running_job_is_found_from_another_tab_and_the_overview(server: Server, open_page: OpenPage) -> None:
    first = open_page(f"{server.url}/calibrate?kind=accel_multi_pose&new=1", size=SIZE).page
    button(first, "Start").click()
    second = open_page(f"{server.url}/calibrate", size=SIZE).page
    card = second.locator("[data-sensor=accel]")
    card.get_by_text("Being calibrated").wait_for(timeout=20_000)
    card.get_by_role("button", name="Six positions", exact=True).click()
    second.get_by_text("Any poses is running on this sensor").wait_for()
    button(second, "Open").click()
    button(second, "Cancel").click()
    first.get_by_text("Cancelled. Nothing was changed.").wait_for(timeout=10_000)


def test_history_compares_puts_back_in_force_takes_off_and_deletes(server: Server, screen: Screen) -> None:
    page = screen.page
    for height in ("3", "4"):
        page.goto(f"{server.url}/calibrate?kind=baro_reference&new=1")
        prepare(page)
        page.get_by_label("Height here").last.fill(height)
        button(page, "Start").click()
        finish(page)
        button(page, "Apply").click()
        page.get_by_text("In force from now on").wait_for(timeout=20_000)
    newest = in_force(server, "baro")
    page.goto(f"{server.url}/calibrate?sensor=baro")
    rows = page.locator("[data-set]")
    rows.first.wait_for()
    assert rows.first.get_attribute("data-set") == newest
    older = rows.nth(1)
    older_id = older.get_attribute("data-set") or ""
    older.get_by_role("button", name="Compare").click()
    change = page.locator(".diff tbody tr td").nth(3).inner_text()
    assert abs(abs(float(change.replace("\u2212", "-"))) - 1.0) < 0.5, "one metre higher, and the barometer's noise"
    older.get_by_role("button", name="Apply").click()
    wait_for("the older one in force", lambda: in_force(server, "baro") == older_id)
    page.locator(".history").get_by_role("button", name="Take off").click()
    wait_for("none in force", lambda: in_force(server, "baro") == "")
    count = rows.count()
    older.get_by_role("button", name="Delete").click()
    assert rows.count() == count
    older.get_by_role("button", name="Really delete").click()
    wait_for("one less", lambda: rows.count() == count - 1)


def test_learning_in_flight_is_switched_and_says_what_it_does(server: Server, screen: Screen) -> None:
    page = screen.page
    page.locator("[data-sensor=mag]").get_by_role("button", name="Learn in flight").click()
    learn = page.get_by_role("switch", name="Learn", exact=True)
    learn.wait_for()
    wanted = learn.get_attribute("aria-checked") != "true"
    learn.click()
    wait_for("the switch", lambda: (learn.get_attribute("aria-checked") == "true") == wanted)
    assert read(server, "mag-learning")["run"] is wanted
    if not wanted:
        learn.click()
    page.get_by_text("Learned offset").wait_for(timeout=20_000)
    assert screen.errors == []


@pytest.mark.parametrize("address", ["calibrate", "calibrate?kind=accel_six_position&new=1", "calibrate?sensor=accel"])
def test_phone_shows_everything_within_its_width(server: Server, open_page: OpenPage, address: str) -> None:
    screen = open_page(f"{server.url}/{address}", size=PHONE)
    page = screen.page
    page.locator("main section, main [data-sensor]").first.wait_for(timeout=20_000)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE[0]
    assert page.evaluate("document.querySelector('main').scrollWidth <= document.querySelector('main').clientWidth")
    small = page.locator("main .button:visible").evaluate_all(
        "all => all.map(b => [b.textContent.trim(), b.getBoundingClientRect()])"
        ".filter(([, box]) => box.height < 43.5).map(([text]) => text)"
    )
    assert small == []
    assert screen.errors == []


def test_phone_has_instruction_progress_and_next_button_first(server: Server, open_page: OpenPage) -> None:
    page = open_page(f"{server.url}/calibrate?kind=accel_six_position&new=1", size=PHONE).page
    button(page, "Start").click()
    for found in (page.locator(".say"), page.get_by_role("progressbar").first, button(page, "Fit now")):
        found.wait_for()
        box = found.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < PHONE[1] - 64, "above the fold and the bar of places"
    button(page, "Cancel").click()
    page.get_by_text("Cancelled. Nothing was changed.").wait_for()


def test_viewer_sees_everything_and_is_told_why_not_more(start_server: StartServer, open_page: OpenPage) -> None:
    tokens = {"NAVDECK_TOKEN": "operator-token-1", "NAVDECK_VIEWER_TOKEN": "viewer-token-1"}
    guarded = start_server("--no-view3d", "--link", "sim:?errors=raw", **tokens)
    page = open_page(f"{guarded.url}/calibrate?kind=gyro_bias", size=SIZE).page
    page.get_by_role("textbox", name="Token").fill("viewer-token-1")
    page.keyboard.press("Enter")
    start = button(page, "Start")
    start.wait_for(timeout=60_000)
    assert start.is_disabled()
    assert "operator token" in (start.get_attribute("title") or "")


def test_scene_shows_how_to_hold_the_vehicle(start_server: StartServer, open_page: OpenPage) -> None:
    drawn = start_server("--link", f"sim:?errors=raw&speed={SPEED}")
    screen = open_page(f"{drawn.url}/calibrate?kind=accel_six_position", size=(800, 500))
    frame = "section.scene iframe"
    screen.page.wait_for_selector(frame, timeout=60_000)

    def is_drawn() -> bool:
        grey = np.asarray(picture(screen.page, frame).convert("L"), dtype=float)
        return bool(grey.std() > 3.0 and np.unique(grey).size > 20)

    wait_for("a scene in the 3D view", is_drawn, timeout_s=90, every_s=1.0)
    assert screen.errors == []

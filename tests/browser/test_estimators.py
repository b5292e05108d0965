"""The Estimators place with the demo board: lanes switched on by clicks, compared, set, and found again."""

import io
import json
import math
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import Locator, Page

from tests.browser.conftest import OpenPage, Screen, Server, StartServer, wait_for

DESK = (1280, 800)
PHONE = (360, 720)
LANES = {"vqf": "VQF", "nav_position": "Position filter", "altitude_kalman": "Height, Kalman"}


@pytest.fixture(scope="module")
def server(start_server: StartServer) -> Server:
    return start_server("--link", "sim:")


@pytest.fixture
def screen(server: Server, open_page: OpenPage) -> Screen:
    opened = open_page(f"{server.url}/estimators", size=DESK)
    opened.page.get_by_role("listitem", name="INS (EKF)").wait_for(timeout=60_000)
    return opened


def lanes_of(server: Server) -> dict[str, Any]:
    with urllib.request.urlopen(f"{server.url}/api/v1/boards/sim/lanes", timeout=10) as answer:
        body: dict[str, Any] = json.load(answer)
    return body


def card(page: Page, name: str) -> Locator:
    return page.get_by_role("listitem", name=name, exact=True)


def switch(page: Page, name: str, on: bool) -> None:
    """Click the lane's switch until it is as wanted."""
    knob = card(page, name).get_by_role("switch").first
    if (knob.get_attribute("aria-checked") == "true") != on:
        knob.click()
    wait_for(f"{name} switched {on}", lambda: (knob.get_attribute("aria-checked") == "true") == on)


def cells(page: Page, lane: str) -> list[str]:
    """Texts of the lane's row: each value, below it the difference."""
    return page.locator(f"tr[data-lane={lane}] td").all_inner_texts()


def number(text: str) -> float | None:
    try:
        return float(text.split("\u202f", maxsplit=1)[0].replace("\u2212", "-"))
    except ValueError:
        return None


def filled(page: Page, lane: str, column: int) -> Callable[[], bool]:
    """True once the cell holds a value and a difference."""

    def is_filled() -> bool:
        lines = [line for line in cells(page, lane)[column].splitlines() if line.strip()]
        return len(lines) >= 2 and number(lines[0]) is not None and number(lines[-1].split(": ")[-1]) is not None

    return is_filled


def value_of(server: Server, lane: str, parameter: str) -> float:
    lane_body = next(each for each in lanes_of(server)["lanes"] if each["name"] == lane)
    return next(float(each["value"]) for each in lane_body["parameters"] if each["name"] == parameter)


def test_three_lanes_switched_on_fill_the_table_and_stay_after_reload(server: Server, screen: Screen) -> None:
    page = screen.page
    for name in LANES.values():
        switch(page, name, on=True)
    assert set(LANES) <= set(lanes_of(server)["chosen"])
    page.get_by_label("Compared with").select_option("INS (EKF)")
    wait_for("VQF's roll and its difference", filled(page, "vqf", 0), timeout_s=60)
    wait_for("the position filter's speed and its difference", filled(page, "nav_position", 4), timeout_s=60)
    wait_for("the height filter's height and its difference", filled(page, "altitude_kalman", 3), timeout_s=60)
    assert number(cells(page, "altitude_kalman")[0].splitlines()[0]) is None  # it knows no roll, and says so
    page.get_by_label("Compared with").select_option("VQF")
    page.reload()
    page.locator("tr[data-lane=vqf]").wait_for()
    assert page.url.endswith("/estimators")
    assert page.get_by_label("Compared with").input_value() == "vqf"
    wait_for("the table after the reload", filled(page, "ins_ekf", 0), timeout_s=30)
    assert screen.errors == []


def test_a_lane_switched_off_leaves_the_table_and_undo_brings_it_back(server: Server, screen: Screen) -> None:
    page = screen.page
    switch(page, "VQF", on=True)
    page.locator("tr[data-lane=vqf]").wait_for()
    switch(page, "VQF", on=False)
    page.locator("tr[data-lane=vqf]").wait_for(state="detached")
    page.get_by_role("button", name="Undo", exact=True).click()
    page.locator("tr[data-lane=vqf]").wait_for()
    assert "vqf" in lanes_of(server)["chosen"]


def test_a_setting_acts_at_once_is_refused_beside_its_field_and_undone(server: Server, screen: Screen) -> None:
    page, name = screen.page, "tau_accel_s"
    switch(page, "VQF", on=True)
    card(page, "VQF").get_by_role("button", name="Settings").click()
    field = page.get_by_role("textbox", name="Time constant of the tilt")
    field.fill("7,5")
    field.press("Enter")
    wait_for("the service has it", lambda: value_of(server, "vqf", name) == 7.5)
    field.fill("500")
    field.press("Enter")
    page.get_by_text("Give a value from 0.05 to 100 s.").wait_for()
    assert field.get_attribute("aria-invalid") == "true"
    field.press("Escape")
    wait_for("the value in force", lambda: field.input_value() == "7.5")
    assert value_of(server, "vqf", name) == 7.5
    page.reload()  # the open form, and what was set, are found again
    field.wait_for()
    wait_for("what was set", lambda: field.input_value() == "7.5")
    page.get_by_role("button", name="Time constant of the tilt: Back to the default, 3 s").click()
    wait_for("the default", lambda: value_of(server, "vqf", name) == 3.0)
    page.get_by_role("button", name="Undo: Time constant of the tilt").click()
    wait_for("what was before", lambda: value_of(server, "vqf", name) == 7.5)
    assert screen.errors == []


def test_innovations_are_plotted_within_their_bounds_and_judged(screen: Screen) -> None:
    page = screen.page
    screen.wait_for_sentence("Navigating", timeout_s=60)
    aid = page.get_by_role("region", name="Barometric height")
    aid.locator("canvas").first.wait_for(timeout=30_000)
    words = ("Consistent", "Over-confident", "Conservative", "Too few")
    assert any(word in aid.inner_text() for word in words)
    page.get_by_role("region", name="Consistency of INS (EKF)").wait_for()


def test_plots_of_values_and_differences_are_drawn_for_the_lanes_shown(screen: Screen) -> None:
    page = screen.page
    switch(page, "Position filter", on=True)
    page.get_by_label("Compared with").select_option("INS (EKF)")
    page.get_by_role("group", name="Roll", exact=True).locator("canvas").wait_for()
    difference = page.get_by_role("group", name="Roll minus INS (EKF)'s")
    difference.locator("canvas").wait_for()

    def has_number() -> bool:
        return number(difference.locator("b").first.inner_text()) is not None

    wait_for("a difference in the legend", has_number, timeout_s=30)
    page.get_by_role("button", name="Roll", exact=True).click()
    page.get_by_role("group", name="Roll", exact=True).wait_for(state="detached")


def saved(page: Page, button: str, region: str = "Plots") -> tuple[str, bytes]:
    """Name and bytes of the file that a button gives."""
    with page.expect_download() as coming:
        page.get_by_role("region", name=region).get_by_role("button", name=button, exact=True).click()
    return coming.value.suggested_filename, Path(coming.value.path()).read_bytes()


def test_a_plot_is_saved_as_a_picture_and_as_numbers_that_are_those_of_the_lanes(screen: Screen) -> None:
    page = screen.page
    screen.wait_for_sentence("Navigating", timeout_s=60)
    page.get_by_role("group", name="Roll", exact=True).locator("canvas").wait_for()
    page.wait_for_timeout(4000)  # of rows
    name, raw = saved(page, "Save as CSV: Roll")
    assert (name[:13], name[-4:]) == ("navdeck-roll-", ".csv")
    head, *lines = raw.decode().splitlines()
    titles = head.split(",")
    assert titles[0] == "t_s"
    assert {"lanes/ins_ekf:roll [°]", "lanes/onboard:roll [°]"} <= set(titles[1:])
    rows = [[float(cell or "nan") for cell in line.split(",")] for line in lines]
    for title in ("lanes/ins_ekf:roll [°]", "lanes/onboard:roll [°]"):  # attitude and place of the latter come in turns
        known = [row[0] for row in rows if not math.isnan(row[titles.index(title)])]
        assert len(known) > 0.8 * 10 * (known[-1] - known[0]) > 20
    assert max(len(cell) for line in lines for cell in line.split(",")[1:]) >= 15  # every digit of a double
    name, raw = saved(page, "Save as PNG: Roll")
    assert (name[:13], name[-4:]) == ("navdeck-roll-", ".png")
    assert len(Image.open(io.BytesIO(raw)).convert("RGB").getcolors(1 << 20) or ()) > 20
    everything = Image.open(io.BytesIO(saved(page, "Save as PNG")[1]))
    assert everything.height > 3 * Image.open(io.BytesIO(raw)).height
    name, raw = saved(page, "Save as CSV: Barometric height: Height", "Aids: innovations and their bounds")
    assert name.startswith("navdeck-baro_height-innovation_0-")
    titles = [f"aids/baro_height:{each}_0 [m]" for each in ("innovation", "sigma", "refused")]
    assert raw.decode().splitlines()[0].split(",") == ["t_s", *titles]
    assert screen.errors == []


def test_each_measurements_delay_is_shown_with_who_told_it(server: Server, screen: Screen) -> None:
    page = screen.page
    row = page.locator("tr[data-delay=gnss_position]")
    row.wait_for(timeout=30_000)
    assert "98\u202fms" in row.inner_text()
    assert "known of this kind of board" in row.inner_text()
    with urllib.request.urlopen(f"{server.url}/api/v1/boards/sim/health", timeout=10) as answer:
        told = {one["measurement"]: one for one in json.load(answer)["delays"]}
    assert told["mag"] == {"measurement": "mag", "delay_s": 0.05, "sigma_s": None, "filter_s": None, "source": "board"}


def test_who_may_only_look_is_told_so_and_cannot_switch(start_server: StartServer, open_page: OpenPage) -> None:
    server = start_server("--link", "sim:", NAVDECK_TOKEN="o" * 24, NAVDECK_VIEWER_TOKEN="v" * 24)
    screen = open_page(f"{server.url}/estimators", size=DESK)
    page = screen.page
    page.get_by_label("Token", exact=True).fill("v" * 24)
    page.get_by_role("button", name="Open", exact=True).click()
    knob = card(page, "VQF").get_by_role("switch")
    knob.wait_for(timeout=30_000)
    assert knob.is_disabled()
    page.get_by_role("region", name="Choose estimators").get_by_text("Needs the operator token").first.wait_for()


def test_on_a_phone_each_part_is_a_tab_that_is_found_again(server: Server, open_page: OpenPage) -> None:
    screen = open_page(f"{server.url}/estimators", size=PHONE)
    page = screen.page
    for tab in ("Compare", "Plots", "Aids", "Choose", "Compare"):
        page.get_by_role("tab", name=tab).click()
        page.wait_for_timeout(300)
        width = page.evaluate("document.querySelector('main').scrollWidth")
        assert width <= page.evaluate("document.querySelector('main').clientWidth"), tab
    page.reload()
    page.get_by_role("tab", name="Compare", selected=True).wait_for()
    page.get_by_role("region", name="Lanes side by side").wait_for()
    assert screen.errors == []

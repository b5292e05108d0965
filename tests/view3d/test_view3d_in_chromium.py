"""A real Chromium draws the scene: sky, ground, vehicle and paths, from the first frame, and it moves."""

import io
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.view3d.synthetic import Served, SyntheticBoard, served

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.browser
SIZE = {"width": 400, "height": 300}
HOST_PAGE = """<!doctype html><body style="margin:0"><iframe style="border:0;width:400px;height:300px"></iframe>"""


@pytest.fixture
def flying() -> Iterator[Served]:
    board = SyntheticBoard()
    for _ in range(1500):
        board.fly(publish=False)
    with served([board]) as at:
        yield at


@pytest.fixture
def page(browser: "Browser") -> "Iterator[Page]":
    context = browser.new_context(viewport=SIZE)
    opened = context.new_page()
    errors: list[str] = []
    opened.on("pageerror", lambda error: errors.append(str(error)))
    yield opened
    context.close()
    assert errors == []


def picture(page: "Page") -> NDArray[np.float64]:
    """What the person sees, shape (300, 400, 3)."""
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), dtype=np.float64)


def share_of(image: NDArray[np.float64], rgb: tuple[int, int, int], near: float = 60.0) -> float:
    """Share of the pixels that are near a colour."""
    return float((np.linalg.norm(image - rgb, axis=2) < near).mean())


def wait_for_vehicle(page: "Page") -> NDArray[np.float64]:
    """Return the first picture with the vehicle's orange front in it; it fails after 90 s: software draws slowly."""
    for _ in range(90):
        image = picture(page)
        if share_of(image, (255, 150, 70)) > 0.0001:  # a dozen pixels: the vehicle is small from the chase camera
            return image
        page.wait_for_timeout(1000)
    raise AssertionError("no orange front appeared in 90 s")


def open_view(page: "Page", at: Served, query: str) -> None:
    page.goto(f"http://127.0.0.1:{at.port}/view/?fixedDpr=0.5&{query}")
    page.wait_for_selector("canvas[data-engine]", timeout=20_000)


@pytest.mark.parametrize("theme", ["darkMode", "theme=light"])
def test_the_scene_is_drawn_with_sky_ground_and_vehicle(page: "Page", flying: Served, theme: str) -> None:
    open_view(page, flying, f"camera=chase&{theme}")
    image = wait_for_vehicle(page)
    sky, ground = image[20:60].mean(), image[-40:].mean()
    assert (sky < 90 and ground < 90) if theme == "darkMode" else (sky > 150 and ground > 150)
    assert image.std() > 5
    assert np.abs(np.diff(image[150:], axis=1)).max() > 15  # the grid's lines
    panel = page.get_by_text("Reset View").first
    panel.wait_for(state="attached")
    assert panel.is_hidden()  # viser's own panel, which a narrow screen has at the bottom


def test_from_behind_the_path_is_seen_up_to_the_vehicle(page: "Page", flying: Served) -> None:
    """The camera flies beside the path, not on it, and the path keeps up however slow the browser draws."""
    open_view(page, flying, "camera=chase&darkMode&color=lane")
    wait_for_vehicle(page)
    seen = 0
    for _ in range(6):
        page.wait_for_timeout(500)
        seen += share_of(picture(page)[150:], (89, 160, 249), near=50.0) > 0.0008
    assert seen >= 4


def test_the_picture_moves_with_the_board(page: "Page", flying: Served) -> None:
    open_view(page, flying, "camera=follow&darkMode")
    before = wait_for_vehicle(page)
    page.wait_for_timeout(1000)
    assert np.abs(picture(page) - before).mean() > 0.3


def test_our_page_steers_the_view_in_its_iframe_without_the_focus(page: "Page", flying: Served) -> None:
    """Reconnects by itself as well: an iframe without the focus never would, as viser's client comes."""
    origin = f"http://127.0.0.1:{flying.port}"
    page.route(f"{origin}/", lambda route: route.fulfill(body=HOST_PAGE, content_type="text/html"))
    page.goto(f"{origin}/")
    page.evaluate("document.querySelector('iframe').src = '/view/?fixedDpr=0.5&camera=chase&darkMode'")
    behind = wait_for_vehicle(page)
    page.evaluate(
        "frames[0].postMessage({navdeck: 'view', camera: 'top', theme: 'light'}, location.origin)",
    )
    page.wait_for_timeout(2500)
    above = picture(page)
    assert above.mean() > behind.mean() + 60
    (viewer,) = flying.view._expected.values()
    assert (viewer.wishes.camera, viewer.wishes.theme) == ("top", "light")

    flying.loop.call_soon_threadsafe(flying.view._server._websock_server.disconnect_all_clients)
    page.wait_for_timeout(4000)
    (again,) = flying.view._expected.values()
    assert again is not viewer
    assert (again.wishes.camera, again.wishes.theme) == ("top", "light")
    assert again.active


def test_a_key_changes_the_camera_and_tells_our_page(page: "Page", flying: Served) -> None:
    origin = f"http://127.0.0.1:{flying.port}"
    page.route(f"{origin}/", lambda route: route.fulfill(body=HOST_PAGE, content_type="text/html"))
    page.goto(f"{origin}/")
    page.evaluate("told = []; addEventListener('message', (event) => told.push(event.data))")
    page.evaluate("document.querySelector('iframe').src = '/view/?fixedDpr=0.5&darkMode'")
    wait_for_vehicle(page)
    page.mouse.click(380, 20)
    page.keyboard.press("f")
    page.wait_for_function("told.some((each) => each.navdeck === 'view' && each.camera === 'free')")
    page.keyboard.press("2")
    page.wait_for_function("told.at(-1).camera === 'follow'")
    (viewer,) = flying.view._expected.values()
    page.wait_for_timeout(300)
    assert viewer.wishes.camera == "follow"

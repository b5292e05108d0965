"""The page with the demo board: drawn, alive, in both languages and themes, on a desk and on a phone."""

import numpy as np
import pytest
from PIL import Image

from tests.browser.conftest import OpenPage, Screen, Server, StartServer, picture, wait_for
from tests.browser.horizon import Horizon, read_horizon

PFD = "section.pfd canvas"
VIEW = "section.view iframe"
PHONE = (360, 720)


@pytest.fixture(scope="module")
def server(start_server: StartServer) -> Server:
    return start_server("--link", "sim:?speed=4")


def horizon_of(screen: Screen) -> Horizon | None:
    seen = read_horizon(picture(screen.page, PFD))
    return seen if seen.is_drawn else None


def centre(image: Image.Image) -> np.ndarray:
    """The middle half of a picture as grey values: nothing of the page lies over the scene there."""
    width, height = image.size
    box = (width // 4, height // 4, 3 * width // 4, 3 * height // 4)
    return np.asarray(image.crop(box).convert("L"), dtype=float)


def test_horizon_is_drawn_and_moves(server: Server, open_page: OpenPage) -> None:
    screen = open_page(server.url)
    screen.wait_for_sentence("Navigating", timeout_s=60)
    first = wait_for("sky and earth", lambda: horizon_of(screen))
    moved = wait_for("another horizon", lambda: first.moved_px(horizon_of(screen) or first) >= 4, timeout_s=60)
    assert moved
    assert screen.errors == []


def test_3d_scene_is_drawn(server: Server, open_page: OpenPage) -> None:
    """Blank WebGL is one colour; a scene has a vehicle on a grid, and so many shades."""
    screen = open_page(server.url)
    screen.page.wait_for_selector(VIEW, timeout=20_000)

    def is_drawn() -> bool:
        grey = centre(picture(screen.page, VIEW))
        return grey.std() > 3.0 and np.unique(grey).size > 20

    wait_for("a scene in the 3D view", is_drawn, timeout_s=90, every_s=1.0)
    gl = screen.page.frame_locator(VIEW).locator("canvas[data-engine^=three]")
    assert gl.evaluate("canvas => canvas.getContext('webgl2') !== null && canvas.width * canvas.height > 10000")
    assert screen.errors == []


@pytest.mark.parametrize("width_px", [250, 600, 1200])
def test_controls_of_the_3d_library_stay_out_of_sight(server: Server, open_page: OpenPage, width_px: int) -> None:
    """The library shows a floating panel in a wide frame and one along the bottom of a narrow one."""
    page = open_page(f"{server.url}/view/", size=(width_px, 400)).page
    page.locator("canvas[data-engine^=three]").wait_for(state="attached", timeout=60_000)
    page.wait_for_timeout(3000)
    for words in ("Save Canvas", "Reset View", "Connected"):
        assert not any(found.is_visible() for found in page.get_by_text(words).all()), words


def test_language_is_switched_and_remembered(server: Server, open_page: OpenPage) -> None:
    screen = open_page(server.url)
    page = screen.page
    page.get_by_role("button", name="中文").click()
    page.wait_for_function("document.documentElement.lang === 'zh-CN'")
    wait_for("a Chinese sentence", lambda: any("一" <= letter <= "鿿" for letter in screen.sentence()))
    page.reload()
    page.wait_for_function("document.documentElement.lang === 'zh-CN'")
    page.get_by_role("button", name="English").click()
    page.wait_for_function("document.documentElement.lang === 'en'")


def test_chinese_browser_is_greeted_in_chinese(server: Server, open_page: OpenPage) -> None:
    page = open_page(server.url, locale="zh-CN").page
    page.wait_for_function("document.documentElement.lang === 'zh-CN'")


def test_theme_key_changes_the_colours_and_is_remembered(server: Server, open_page: OpenPage) -> None:
    page = open_page(server.url).page
    page.wait_for_selector("#state-sentence")
    seen = set()
    for _ in range(3):
        page.keyboard.press("t")
        page.wait_for_timeout(100)
        theme = page.evaluate("document.documentElement.dataset.theme")
        seen.add((theme, page.evaluate("getComputedStyle(document.body).backgroundColor")))
    assert {theme for theme, _ in seen} == {"dark", "light"}
    assert len({colour for _, colour in seen}) == 2
    page.reload()
    page.wait_for_selector("#state-sentence")
    assert page.evaluate("document.documentElement.dataset.theme") == theme


@pytest.mark.parametrize("place", ["live", "sensors", "estimators", "calibrate", "logs", "board"])
def test_phone_is_never_wider_than_its_screen(server: Server, open_page: OpenPage, place: str) -> None:
    screen = open_page(f"{server.url}/{place}", size=PHONE)
    page = screen.page
    page.wait_for_selector("main > *")
    screen.wait_for_sentence("Navigating", timeout_s=60)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE[0]
    assert page.evaluate("document.querySelector('main').scrollWidth <= document.querySelector('main').clientWidth")
    assert screen.errors == []


def test_places_have_addresses_that_survive_reload_and_back(server: Server, open_page: OpenPage) -> None:
    page = open_page(f"{server.url}/live").page
    page.get_by_role("link", name="Sensors", exact=True).click()
    page.wait_for_url("**/sensors*")
    page.reload()
    page.wait_for_selector("nav a[aria-current=page]")
    assert page.locator("nav a[aria-current=page]").inner_text() == "Sensors"
    page.go_back()
    page.wait_for_url("**/live*")
    wait_for("the Live place", lambda: page.locator("nav a[aria-current=page]").inner_text() == "Live")


def test_two_tabs_do_not_disturb_each_other(server: Server, open_page: OpenPage) -> None:
    first, second = open_page(server.url), open_page(f"{server.url}/board")
    for screen in (first, second):
        screen.wait_for_sentence("Navigating", timeout_s=60)
    assert first.page.locator("nav a[aria-current=page]").inner_text() == "Live"
    assert second.page.locator("nav a[aria-current=page]").inner_text() == "Board"

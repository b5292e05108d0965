"""A real Chromium draws the scene: sky, ground, vehicle and paths, from the first frame, and it moves."""

import io
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from server.calibration.scene import CalibrationScene
from server.view3d import palette
from server.view3d.camera import FOV_RAD, PLAIN_SPAN_M, Camera, place_m
from server.view3d.vehicles import Vehicle
from server.view3d.viewer import Viewer
from tests.view3d.jobs import mag_job, six_job
from tests.view3d.synthetic import Served, SyntheticBoard, served

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.browser
SIZE = {"width": 400, "height": 300}
HOST_PAGE = """<!doctype html><body style="margin:0"><iframe style="border:0;width:400px;height:300px"></iframe>"""


@pytest.fixture
def flying() -> Iterator[Served]:
    board = SyntheticBoard(off=frozenset({"onboard"}))  # its path is orange too
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


def soon(page: "Page", what: str, true: Callable[[], bool]) -> None:
    """Return as soon as it is true. Patient: software draws slowly, beside other work very slowly."""
    end_s = time.monotonic() + 240.0
    while not true():
        assert time.monotonic() < end_s, f"{what}: not within 240 s"
        page.wait_for_timeout(200)


def around_the_vehicle(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """The square of one span about the place where the chase camera sees the vehicle: the origin of viser's world."""
    camera, target = (np.array(place) for place in place_m(Camera.CHASE, PLAIN_SPAN_M))
    ahead = (target - camera) / np.linalg.norm(target - camera)
    right = np.cross(ahead, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(ahead, [0.0, 0.0, 1.0]))
    px_per_m = image.shape[0] / 2 / math.tan(FOV_RAD / 2) / float(-camera @ ahead)
    x = image.shape[1] / 2 + px_per_m * float(-camera @ right)
    y = image.shape[0] / 2 - px_per_m * float(-camera @ np.cross(right, ahead))
    half = PLAIN_SPAN_M / 2 * px_per_m
    return image[round(y - half) : round(y + half), round(x - half) : round(x + half)]


def orange_pixels(image: NDArray[np.float64]) -> int:
    """How many pixels about the vehicle have the hue of its front: 70 to 100 with it, at most 20 (axes) without."""
    red, green, blue = np.moveaxis(around_the_vehicle(image), 2, 0)
    return int(((red - green > 35) & (green - blue > 10) & (green - blue < 1.3 * (red - green))).sum())


ENOUGH_PIXELS = 45


def wait_for_vehicle(page: "Page") -> NDArray[np.float64]:
    """Return the first picture from the chase camera with the vehicle's orange front in it."""
    images: list[NDArray[np.float64]] = []

    def seen() -> bool:
        images.append(picture(page))
        return orange_pixels(images[-1]) > ENOUGH_PIXELS

    soon(page, "the vehicle's orange front", seen)
    return images[-1]


def sees_path(page: "Page") -> bool:
    """Whether the main lane's path, in the lane's own colour, is in the lower half of the picture."""
    return share_of(picture(page)[150:], (89, 160, 249), near=50.0) > 0.0008


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
    soon(page, "the path", lambda: sees_path(page))
    seen = 0
    for _ in range(6):
        page.wait_for_timeout(500)
        seen += sees_path(page)
    assert seen >= 4


def test_what_tells_that_the_vehicle_is_there_is_not_told_by_the_rest_of_the_scene(
    page: "Page", flying: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The control of `wait_for_vehicle`: paths, axes, cones and compass are drawn, the vehicle's body is not."""
    monkeypatch.setattr("server.view3d.scene.vehicle", lambda _kind: Vehicle((), PLAIN_SPAN_M))
    open_view(page, flying, "camera=chase&darkMode&color=lane")
    soon(page, "the path", lambda: sees_path(page))
    for _ in range(8):
        page.wait_for_timeout(500)
        assert orange_pixels(picture(page)) < ENOUGH_PIXELS


def test_the_picture_moves_with_the_board(page: "Page", flying: Served) -> None:
    open_view(page, flying, "camera=chase&darkMode")
    wait_for_vehicle(page)
    page.keyboard.press("2")  # follow: a chase camera alone would move the ground
    page.wait_for_timeout(1000)
    before = picture(page)
    soon(page, "another picture", lambda: float(np.abs(picture(page) - before).mean()) > 0.3)


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
    soon(page, "a light picture", lambda: float(picture(page).mean()) > behind.mean() + 60)
    (viewer,) = flying.view._expected.values()
    assert (viewer.wishes.camera, viewer.wishes.theme) == ("top", "light")

    flying.loop.call_soon_threadsafe(flying.view._server._websock_server.disconnect_all_clients)

    def others() -> list[Viewer]:
        return [each for each in flying.view._expected.values() if each is not viewer and each.active]

    soon(page, "another viewer", lambda: len(others()) == 1)
    (again,) = others()
    assert (again.wishes.camera, again.wishes.theme) == ("top", "light")


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
    soon(page, "the server has it", lambda: viewer.wishes.camera == "follow")


def near_hue(image: NDArray[np.float64], rgb: tuple[int, int, int], near_rad: float = 0.25) -> float:
    """Share of the pixels that have nearly this hue and are not grey, lit or in the shade."""
    grey = image - image.mean(axis=2, keepdims=True)
    wanted = np.array(rgb, dtype=np.float64) - np.mean(rgb)
    length = np.linalg.norm(grey, axis=2)
    cosine = (grey @ wanted) / np.maximum(length * np.linalg.norm(wanted), 1e-9)
    return float(((cosine > math.cos(near_rad)) & (length > 45.0)).mean())


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_a_calibration_shows_ellipsoid_points_and_open_directions(page: "Page", theme: str) -> None:
    """One after the other, each with the picture before it as the control."""
    jobs: list[CalibrationScene | None] = [None]

    def lines() -> float:
        return float(np.abs(np.diff(picture(page)[80:220, 130:270], axis=1)).mean())

    def opened() -> float:
        return near_hue(picture(page)[165:], palette.OPEN_RGB[theme])  # below the vehicle, which is orange too

    def points() -> float:
        return min(share_of(half, palette.RESIDUAL_RGB[0]) for half in halves(picture(page)))

    with served([SyntheticBoard()], scene_of=lambda _board_id: jobs[-1]) as at:
        open_view(page, at, f"scene=calibration&theme={theme}")
        soon(page, "the vehicle", lambda: lines() > 1.0)
        page.wait_for_timeout(1000)
        before = lines()
        jobs.append(bare_ellipsoid())
        soon(page, "the ellipsoid", lambda: lines() > 2.0 * before)
        page.wait_for_timeout(1000)
        assert points() < 0.001
        assert opened() < 0.0001
        jobs.append(mag_job(noise_gauss=0.0))
        soon(page, "the points", lambda: points() > 0.02)
        soon(page, "the open directions", lambda: opened() > 0.0003)
        jobs.append(mag_job(fitted=True, share=1.0, noise_gauss=0.0))
        soon(page, "all directions closed, and two fields", lambda: opened() < 0.0001 and points() > 0.02)


def bare_ellipsoid() -> CalibrationScene:
    """A job that has a fit so far and shows nothing else."""
    job = mag_job(count=0)
    return replace(job, progress=replace(job.progress, uncovered_b=np.empty((0, 3))))


def test_a_calibration_shows_faces_that_fill(page: "Page") -> None:
    jobs = [six_job((), "nose-up")]
    with served([SyntheticBoard()], scene_of=lambda _board_id: jobs[-1]) as at:
        open_view(page, at, "scene=calibration&theme=dark")
        soon(page, "the ghost", lambda: near_hue(halves(picture(page))[1], palette.GHOST_RGB) > 0.005)
        assert near_hue(picture(page), palette.FACE_DONE_RGB) < 0.001
        jobs.append(six_job(("level", "nose-up", "right-up", "left-up"), "nose-down"))
        soon(page, "filled faces", lambda: near_hue(halves(picture(page))[0], palette.FACE_DONE_RGB) > 0.005)


def halves(image: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The left and the right half of a picture."""
    middle = image.shape[1] // 2
    return image[:, :middle], image[:, middle:]


def test_our_page_changes_the_scene_in_its_iframe(page: "Page", flying: Served) -> None:
    origin = f"http://127.0.0.1:{flying.port}"
    page.route(f"{origin}/", lambda route: route.fulfill(body=HOST_PAGE, content_type="text/html"))
    page.goto(f"{origin}/")
    page.evaluate("document.querySelector('iframe').src = '/view/?fixedDpr=0.5&scene=calibration&theme=light'")
    soon(page, "a viewer", lambda: any(each.calibrates for each in flying.view._expected.values()))
    (viewer,) = flying.view._expected.values()
    page.evaluate("frames[0].postMessage({navdeck: 'view', scene: 'flight', camera: 'chase'}, location.origin)")
    wait_for_vehicle(page)
    assert (viewer.wishes.scene, viewer.calibrates) == ("flight", False)
    page.evaluate("frames[0].postMessage({navdeck: 'view', scene: 'calibration'}, location.origin)")
    soon(page, "calibration again", lambda: viewer.calibrates)

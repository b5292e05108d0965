"""What the page does when something goes away: the board, the server, the permission."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from server.emulate import Emulator
from tests.browser.conftest import OpenPage, StartServer, wait_for


class DeskBoard:
    """The recorded autopilot on a pseudo-terminal with a stable name, to be pulled and plugged in again."""

    def __init__(self, log: Path, device: Path) -> None:
        self._log, self.device = log, device
        self._stop: threading.Event | None = None
        self._thread: threading.Thread | None = None

    def plug_in(self) -> None:
        stop, emulator = threading.Event(), Emulator(self._log, loop=True, now=True, link=self.device)

        def play() -> None:
            with emulator:
                emulator.run(stop)

        self._stop, self._thread = stop, threading.Thread(target=play, daemon=True)
        self._thread.start()

    def pull(self) -> None:
        if self._stop is not None and self._thread is not None:
            self._stop.set()
            self._thread.join(timeout=10)
        self._stop = self._thread = None


@pytest.fixture
def board(shared_data: Path, tmp_path: Path) -> Iterator[DeskBoard]:
    board = DeskBoard(shared_data / "ardupilot_sitl" / "mission.tlog", tmp_path / "board")
    board.plug_in()
    yield board
    board.pull()


def test_pulled_board_is_said_to_be_gone_and_comes_back_by_itself(
    board: DeskBoard, start_server: StartServer, open_page: OpenPage
) -> None:
    server = start_server("--link", f"serial://{board.device}?baud=921600")
    screen = open_page(server.url)
    screen.wait_for_sentence("Navigating", timeout_s=60)
    board.pull()
    screen.wait_for_sentence("No data", timeout_s=10)  # three seconds on a quiet machine
    canvas = screen.page.locator("section.pfd canvas")
    wait_for("a grey display", lambda: "stale" in (canvas.get_attribute("class") or ""), timeout_s=5)
    board.plug_in()
    screen.wait_for_sentence("Navigating", "Aligning", timeout_s=20)


def test_browser_finds_a_restarted_server_by_itself(start_server: StartServer, open_page: OpenPage) -> None:
    server = start_server("--link", "sim:?speed=4")
    screen = open_page(server.url)
    screen.wait_for_sentence("Navigating", timeout_s=60)
    assert server.stop() == 0
    screen.wait_for_sentence("Connection to navdeck lost", timeout_s=10)
    server.start()
    screen.wait_for_sentence("Navigating", "Aligning", timeout_s=30)


def test_token_is_asked_for_once_and_opens_the_page(start_server: StartServer, open_page: OpenPage) -> None:
    server = start_server("--link", "sim:?speed=4", NAVDECK_TOKEN="open-sesame", NAVDECK_VIEWER_TOKEN="look-only")
    screen = open_page(server.url)
    page = screen.page
    field = page.locator("#token")
    field.fill("wrong")
    field.press("Enter")
    wait_for("a word about the wrong token", lambda: page.locator("#door-problem").inner_text())
    field.fill("look-only")
    field.press("Enter")
    field.wait_for(state="detached")
    screen.wait_for_sentence("Navigating", timeout_s=60)
    page.reload()
    screen.wait_for_sentence("Navigating", timeout_s=60)
    assert page.locator("#token").count() == 0
    assert page.locator(".role").count() == 1
    assert "look-only" not in page.evaluate("document.cookie + JSON.stringify(localStorage)")

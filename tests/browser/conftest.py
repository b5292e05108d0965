"""A real `navdeck serve` and a real Chromium: what a person would see."""

import io
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import pytest
from PIL import Image
from playwright.sync_api import Browser, ConsoleMessage, Page

Value = TypeVar("Value")
NAVDECK = Path(sys.executable).with_name("navdeck")
DESK = (900, 640)
"""Viewport of the tests: small, because Chromium draws 3D in software here."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Everything in this folder needs Chromium."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.browser)


def free_port() -> int:
    """Return a port of this machine that nobody listened at a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def wait_for(what: str, found: Callable[[], Value | None], timeout_s: float = 30.0, every_s: float = 0.2) -> Value:
    """Return the first value that is not None, False or empty; fail naming what never came."""
    end_s = time.monotonic() + timeout_s
    while True:
        value = found()
        if value:
            return value
        if time.monotonic() > end_s:
            pytest.fail(f"{what}: not within {timeout_s:g} s", pytrace=False)
        time.sleep(every_s)


@dataclass
class Server:
    """One `navdeck serve`, which can be ended and started again on the same port."""

    folder: Path
    flags: tuple[str, ...]
    variables: dict[str, str] = field(default_factory=dict)
    port: int = field(default_factory=free_port)
    process: subprocess.Popen[bytes] | None = None

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.port}"

    @property
    def log(self) -> str:
        """What the service said so far."""
        return (self.folder / "log").read_text(errors="replace")

    def start(self) -> None:
        """Start it and wait until it answers."""
        env = {name: value for name, value in os.environ.items() if not name.startswith("NAVDECK_")}
        env |= {"HOME": str(self.folder), "NAVDECK_DATA_DIR": str(self.folder / "data"), **self.variables}
        command = [str(NAVDECK), "serve", "--port", str(self.port), *self.flags]
        with (self.folder / "log").open("ab") as log:
            self.process = subprocess.Popen(command, env=env, cwd=self.folder, stdout=log, stderr=log)
        wait_for(f"{' '.join(command)} answers", self._answers, timeout_s=60)

    def _answers(self) -> bool:
        if self.process is None or self.process.poll() is not None:
            pytest.fail(f"navdeck serve ended:\n{self.log[-4000:]}", pytrace=False)
        try:
            with urllib.request.urlopen(f"{self.url}/healthz", timeout=2) as answer:
                return bool(answer.status == 200)
        except OSError:
            return False

    def stop(self) -> int:
        """End it as an operator would; returns its exit code."""
        if self.process is None:
            return 0
        self.process.send_signal(signal.SIGTERM)
        try:
            code = self.process.wait(timeout=15)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            pytest.fail(f"SIGTERM did not end navdeck within 15 s:\n{self.log[-4000:]}", pytrace=False)
        self.process = None
        return code


StartServer = Callable[..., Server]


@pytest.fixture(scope="module")
def start_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StartServer]:
    """Starts services with the given flags; all of them end with the module."""
    started: list[Server] = []

    def start(*flags: str, **variables: str) -> Server:
        server = Server(folder=tmp_path_factory.mktemp("navdeck"), flags=flags, variables=variables)
        started.append(server)
        server.start()
        return server

    yield start
    for server in started:
        server.stop()


@dataclass
class Screen:
    """A page and the errors that its console showed."""

    page: Page
    errors: list[str]

    def sentence(self) -> str:
        """What the top bar says about the board."""
        return self.page.locator("#state-sentence").inner_text()

    def wait_for_sentence(self, *words: str, timeout_s: float = 30.0) -> float:
        """Return the seconds until the sentence held one of the words."""
        start_s = time.monotonic()
        wait_for(
            f"one of {words} in the top bar (it says {self.sentence()!r})",
            lambda: any(word in self.sentence() for word in words),
            timeout_s,
        )
        return time.monotonic() - start_s


OpenPage = Callable[..., Screen]


@pytest.fixture
def open_page(browser: Browser) -> Iterator[OpenPage]:
    """Opens pages, each in a browser profile of its own, and notes what the console calls an error."""
    contexts = []

    def open_one(url: str, size: tuple[int, int] = DESK, locale: str = "en-US") -> Screen:
        width, height = size
        context = browser.new_context(viewport={"width": width, "height": height}, locale=locale)
        contexts.append(context)
        page = context.new_page()
        errors: list[str] = []

        def note(message: ConsoleMessage) -> None:
            if message.type == "error":
                errors.append(f"{message.text} ({message.location.get('url', '')})")

        page.on("console", note)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(url, wait_until="domcontentloaded")
        return Screen(page=page, errors=errors)

    yield open_one
    for context in contexts:
        context.close()


def picture(page: Page, selector: str) -> Image.Image:
    """Return a screenshot of one element, in RGB."""
    return Image.open(io.BytesIO(page.locator(selector).first.screenshot())).convert("RGB")

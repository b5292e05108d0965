"""The build hook: the page is built with npm once, and again only when its sources change."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from hatch_build import NODE_PACKAGE, Page, PageBuildHook

BUILD = """
const fs = require("fs");
fs.mkdirSync("../server/web_dist");
fs.copyFileSync("page", "../server/web_dist/index.html");
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A checkout whose page needs no packages, so that npm needs no registry."""
    web = tmp_path / "web"
    web.mkdir()
    (tmp_path / "server").mkdir()
    (web / "build.cjs").write_text(BUILD)
    (web / "page").write_text("first")
    about = {"name": "page", "version": "1.0.0", "scripts": {"build": "node build.cjs"}}
    (web / "package.json").write_text(json.dumps(about))
    lock = {"name": "page", "version": "1.0.0", "lockfileVersion": 3, "packages": {"": {"name": "page"}}}
    (web / "package-lock.json").write_text(json.dumps(lock))
    return tmp_path


def hook(root: Path) -> PageBuildHook:
    app = SimpleNamespace(display_waiting=lambda text: None)
    return PageBuildHook(str(root), {}, None, None, str(root), "wheel", app)


def test_changed_page_is_built_and_an_unchanged_one_is_not_built_again(root: Path) -> None:
    page, built = Page(root), root / "server" / "web_dist" / "index.html"
    assert hook(root).dependencies() == [NODE_PACKAGE]
    build_data: dict[str, list[str]] = {"artifacts": []}
    hook(root).initialize("standard", build_data)
    assert (built.read_text(), build_data["artifacts"]) == ("first", ["/server/web_dist/"])
    assert hook(root).dependencies() == []
    (root / "web" / "page").write_text("second")
    assert not page.is_built()
    hook(root).initialize("editable", build_data)
    assert built.read_text() == "second"


def test_packages_and_tests_of_the_page_do_not_count_as_its_sources(root: Path) -> None:
    before = Page(root).digest()
    for name in ("node_modules", "tests"):
        (root / "web" / name).mkdir()
        (root / "web" / name / "file.js").write_text("x")
    assert Page(root).digest() == before


def test_failing_build_names_its_command_and_leaves_no_page(root: Path) -> None:
    (root / "web" / "build.cjs").write_text("process.exit(3)")
    with pytest.raises(RuntimeError, match=r"`npm run build` in web/ failed with code 3"):
        Page(root).build()
    assert not Page(root).is_built()


def test_checkout_without_a_page_builds_nothing(root: Path) -> None:
    shutil.rmtree(root / "web")
    assert hook(root).dependencies() == []
    hook(root).initialize("standard", {"artifacts": []})
    assert not (root / "server" / "web_dist").exists()

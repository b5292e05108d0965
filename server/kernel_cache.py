"""Where compiled kernels are kept: beside their source where that is writable, else in a folder of the user's own.

Numba's own rule has two gaps. It refuses a cache folder that it cannot write, so a container with a read-only root, or
a package that root installed and a user runs, would compile everything at every start. And it takes a kernel for fresh
as long as its own file is unchanged, although kernels and constants imported from other files are compiled into it.
`server/__init__.py` names `KernelCacheLocator` in NUMBA_CACHE_LOCATOR_CLASSES, Numba's setting for such a rule.
"""

from __future__ import annotations

import ast
import hashlib
import os
import stat
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numba
from numba.core import config
from numba.core.caching import InTreeCacheLocator
from numba.core.dispatcher import Dispatcher

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PACKAGE = Path(__file__).resolve().parent
CACHE_SUFFIXES = (".nbi", ".nbc")


class KernelCacheLocator(InTreeCacheLocator):
    """Numba's cache beside the source, readable also where it cannot be written, and stale when an import changed."""

    @classmethod
    def from_function(cls, py_func: Callable[..., object], py_file: str) -> KernelCacheLocator | None:
        """Return a locator for a kernel of this package; None leaves the function to Numba's own locators."""
        if getattr(config, "CACHE_DIR", "") or PACKAGE not in Path(py_file).resolve().parents:
            return None
        locator = cls(py_func, py_file)
        if _is_writable(Path(py_file).resolve().parent / "__pycache__"):
            return locator
        folder = borrowed_folder(Path(py_file).resolve())
        if folder is None:
            return None
        locator._cache_path = str(folder)
        return locator

    def get_source_stamp(self) -> str:
        """Hash of the kernel's file and of every file of this package that it imports, near or far."""
        return source_digest(Path(self._py_file).resolve())


@cache
def _is_writable(folder: Path) -> bool:
    """Make the folder and a file in it: permission bits do not tell of a read-only mount."""
    try:
        folder.mkdir(exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


@cache
def source_digest(path: Path) -> str:
    """Return the SHA-256 over `path` and everything of this package that it imports, transitively."""
    known, todo = {path}, [path]
    while todo:
        found = imported_files(todo.pop()) - known
        known |= found
        todo += found
    total = hashlib.sha256()
    for file in sorted(known):
        total.update(file.read_bytes())
    return total.hexdigest()


@cache
def imported_files(path: Path) -> frozenset[Path]:
    """Return the files of this package that `path` imports with absolute imports, wherever in the file."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return frozenset(file for name in names for file in _module_files(name))


def _module_files(name: str) -> Iterator[Path]:
    root, *parts = name.split(".")
    if root != PACKAGE.name:
        return
    base = PACKAGE.joinpath(*parts)
    yield from (file for file in (base.with_suffix(".py"), base / "__init__.py") if file.is_file())


@cache
def borrowed_folder(py_file: Path) -> Path | None:
    """Return a private, writable folder that shows the kernels compiled at installation, or None.

    The folder's name covers source, place and Numba's version, so a new installation never meets an old copy. The files
    are links: Numba replaces files as a whole, so what it adds for another processor stays in this folder.
    """
    text = f"{py_file}\0{source_digest(py_file)}\0{numba.__version__}"
    name = f"{py_file.stem}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    for base in _private_bases():
        try:
            folder = base / name
            base.mkdir(mode=0o700, parents=True, exist_ok=True)
            _refuse_foreign(base)
            if not _is_writable(folder):
                continue
            _link_compiled(py_file, folder)
        except OSError:
            continue
        return folder
    return None


def _private_bases() -> Iterator[Path]:
    home = os.path.expanduser(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    if os.path.isabs(home):
        yield Path(home) / "navdeck" / "kernels"
    for shared in (tempfile.gettempdir(), "/dev/shm"):  # noqa: S108  # owner and mode are checked
        yield Path(shared) / f"navdeck-kernels-{os.getuid()}"


def _refuse_foreign(base: Path) -> None:
    """Cache files are code: take none from a folder that another user owns or may write."""
    status = base.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o022:
        raise PermissionError(f"{base} belongs to someone else")


def _link_compiled(py_file: Path, folder: Path) -> None:
    for source in (py_file.parent / "__pycache__").glob(f"{py_file.stem}.*"):
        target = folder / source.name
        if source.suffix in CACHE_SUFFIXES and not target.is_symlink() and not target.exists():
            target.symlink_to(source)


class KernelStats(NamedTuple):
    """Counts over all kernels of this package that are loaded: signatures found in the cache, and compiled here."""

    cached: int
    compiled: int


def kernel_stats() -> KernelStats:
    """Return how many compiled signatures came from the cache so far, and how many were compiled by this process."""
    kernels: dict[int, Any] = {}
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] == PACKAGE.name:
            found = (value for value in vars(module).values() if isinstance(value, Dispatcher))
            kernels.update((id(kernel), kernel) for kernel in found)
    stats = [kernel.stats for kernel in kernels.values()]
    cached = sum(sum(one.cache_hits.values()) for one in stats)
    return KernelStats(cached, sum(sum(one.cache_misses.values()) for one in stats))

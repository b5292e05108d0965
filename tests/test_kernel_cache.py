"""The kernels' cache: found again, stale when an import changed, readable where it cannot be written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import server
from server.kernel_cache import _refuse_foreign, imported_files, source_digest
from server.warm import defines_kernel

OWN = Path(server.__file__).parent
KERNEL = """
from numba import njit
from server.factor import FACTOR

@njit("float64(float64)", cache=True)
def scaled(x: float) -> float:
    return FACTOR * x
"""
ASK = """
from server.kernel import scaled
from server.kernel_cache import kernel_stats
print(scaled(1.0), *kernel_stats())
"""
READ_ONLY = """
import server.kernel_cache as k
writable = k._is_writable
k._is_writable = lambda folder: folder.name != "__pycache__" and writable(folder)
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package of the same name with one kernel, which takes a constant from another file."""
    folder = tmp_path / "site" / "server"
    folder.mkdir(parents=True)
    for name in ("__init__.py", "kernel_cache.py"):
        shutil.copy(OWN / name, folder)
    (folder / "kernel.py").write_text(KERNEL)
    (folder / "factor.py").write_text("FACTOR = 2.0\n")
    return folder


def ask(package: Path, home: Path, before: str = "") -> tuple[float, int, int]:
    """In a new process: the kernel's value of 1, signatures from the cache, signatures compiled."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    env |= {"PYTHONPATH": str(package.parent), "HOME": str(home), "XDG_CACHE_HOME": ""}
    command = [sys.executable, "-P", "-c", before + ASK]
    out = subprocess.run(command, env=env, check=True, capture_output=True, text=True).stdout.split()
    return float(out[0]), int(out[1]), int(out[2])


def test_second_process_compiles_nothing(package: Path, tmp_path: Path) -> None:
    assert ask(package, tmp_path) == (2.0, 0, 1)
    assert ask(package, tmp_path) == (2.0, 1, 0)


def test_changed_constant_of_another_file_recompiles_the_kernel(package: Path, tmp_path: Path) -> None:
    ask(package, tmp_path)
    (package / "factor.py").write_text("FACTOR = 3.0\n")
    assert ask(package, tmp_path) == (3.0, 0, 1)


def test_installation_that_cannot_be_written_lends_its_kernels(package: Path, tmp_path: Path) -> None:
    ask(package, tmp_path)
    before = {path: path.read_bytes() for path in (package / "__pycache__").glob("kernel.*.nb?")}
    assert ask(package, tmp_path, READ_ONLY) == (2.0, 1, 0)
    assert {path: path.read_bytes() for path in before} == before
    assert list((tmp_path / ".cache" / "navdeck" / "kernels").glob("kernel-*/*.nbi"))


def test_kernels_compiled_beside_a_read_only_installation_are_kept_for_the_next_start(
    package: Path, tmp_path: Path
) -> None:
    assert ask(package, tmp_path, READ_ONLY) == (2.0, 0, 1)
    assert ask(package, tmp_path, READ_ONLY) == (2.0, 1, 0)


def test_cache_folder_that_others_may_write_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    with pytest.raises(PermissionError):
        _refuse_foreign(tmp_path)


def test_digest_covers_near_and_far_imports_and_nothing_else(tmp_path: Path) -> None:
    file = OWN / "warm.py"
    assert imported_files(file) == {OWN / "__init__.py", OWN / "kernel_cache.py"}
    assert source_digest(file) != source_digest(OWN / "kernel_cache.py")


def test_a_mention_of_njit_is_not_a_kernel(tmp_path: Path) -> None:
    (tmp_path / "text.py").write_text('TEMPLATE = """\n@njit\ndef f(): ...\n"""\n')
    (tmp_path / "kernel.py").write_text("@njit(cache=True)\ndef f(): ...\n")
    assert not defines_kernel(tmp_path / "text.py")
    assert defines_kernel(tmp_path / "kernel.py")

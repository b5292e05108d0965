"""Compile every kernel once, at installation or image build: `python -m server.warm`.

`--expect-cached` fails when a kernel had to be compiled, which proves that the cache works where the service runs.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import pkgutil
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import server
from server.kernel_cache import kernel_stats

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

WARMED = ("server.nav.engine", "server.protocol.mavlink", "server.replay", "server.sim")
"""Modules whose `warm()` calls their kernels, for those that are only compiled when called."""

DECORATORS = ("njit", "kernel")
"""Numba's own, and that of `server.nav.kernel`."""


def modules_with_kernels() -> Iterator[str]:
    """Names of all modules of this package that define a kernel; importing one compiles its explicit signatures."""
    for module in pkgutil.walk_packages(server.__path__, "server."):
        spec = importlib.util.find_spec(module.name)
        if spec is not None and spec.origin is not None and defines_kernel(Path(spec.origin)):
            yield module.name


def defines_kernel(path: Path) -> bool:
    """True when a function of the file is compiled by a decorator; a mention of the word is not enough."""
    source = path.read_text(encoding="utf-8")
    if not any(f"@{name}" in source for name in DECORATORS):
        return False
    functions = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef))
    decorators = (ast.unparse(decorator) for node in functions for decorator in node.decorator_list)
    return any(decorator.partition("(")[0] in DECORATORS for decorator in decorators)


def warm_functions() -> Iterator[Callable[[], object]]:
    """The `warm()` of every module in `WARMED` that has one; one that is absent has none."""
    for name in WARMED:
        if importlib.util.find_spec(name) is not None:
            function = getattr(importlib.import_module(name), "warm", None)
            if function is not None:
                yield function


def main(args: list[str]) -> int:
    """Load all kernels and say how many came from the cache; returns the exit code."""
    start_s = time.perf_counter()
    for name in modules_with_kernels():
        importlib.import_module(name)
    for warm in warm_functions():
        warm()
    stats = kernel_stats()
    took_s = time.perf_counter() - start_s
    sys.stdout.write(f"kernels: {stats.cached} from the cache, {stats.compiled} compiled, {took_s:.1f} s\n")
    return 1 if "--expect-cached" in args and stats.compiled else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

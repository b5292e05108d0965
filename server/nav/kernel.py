"""How every kernel of the core is compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def kernel(signature: str, *, contract: bool = False, inline: bool = False) -> Callable[[F], F]:
    """Compile for exactly this signature, cached on disk, without reference counting.

    A kernel allocates nothing, so its arrays belong to the caller throughout; counting references at every nested call
    would cost more than the arithmetic (a factor of two to four, `tests/bench/bench_engine.py`). Assigning one array
    to a slice of another needs a temporary and is refused by the compiler here: copy in a loop.

    Args:
        signature: with `[::1]` for every array.
        contract: allow fused multiply-add; nothing else that would change a comparison with NaN.
        inline: paste the function into its callers.
    """
    options: dict[str, Any] = {"cache": True, "_nrt": False}
    if contract:
        options["fastmath"] = {"contract"}
    if inline:
        options["inline"] = "always"
    return cast("Callable[[F], F]", njit(signature, **options))

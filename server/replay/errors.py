"""The one error a replay raises for what a person can put right."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class ReplayError(ValueError):
    """A log, an option or an output directory is not usable; the message says where, what and the remedy."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return " (did you mean …?)" with the closest known name, or "" when none is close."""
    found = get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f" (did you mean {found[0]}?)" if found else ""

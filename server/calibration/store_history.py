"""What was in force when: the log of applications of one sensor, and where a roll back leads."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

Action = Literal["apply", "take_off", "roll_back", "recovered"]
NONE: Final = ""
"""Stands for "no calibration" where a set's id would stand."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Applied:
    """One change of what is in force.

    Attributes:
        old, new: ids of sets, "" = none.
        by: who, as the caller gave it.
        utc: ISO 8601.
    """

    action: Action
    old: str
    new: str
    by: str
    utc: str


def roll_back_target(log: Iterable[Applied], is_there: frozenset[str]) -> str | None:
    """Return the id a roll back puts in force, "" for none, or None when nothing came before.

    Applications pile up, a roll back takes from the pile; so a second one goes further back, and one after a new
    application comes back to what that replaced. Sets that were deleted since are passed over.

    Args:
        log: oldest first.
        is_there: ids that still exist.
    """
    pile = _pile(log)
    if not pile:
        return None
    now = pile[-1]
    for before in reversed(pile[:-1]):
        if before != now and (before == NONE or before in is_there):
            return before
    return None


def _pile(log: Iterable[Applied]) -> list[str]:
    pile: list[str] = []
    for one in log:
        if not pile:
            pile.append(one.old)
        if one.action == "roll_back":
            while pile and pile[-1] != one.new:
                pile.pop()
            pile = pile or [one.new]
        else:
            pile.append(one.new)
    return pile

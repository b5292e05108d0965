"""What a person may ask for, typed, and the typed answer: the one door from the API to the boards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


class RefusalKind(StrEnum):
    """Why a command was not carried out; the API gives each its status."""

    INVALID = "invalid"  # 422
    MISSING = "missing"  # 404
    CONFLICT = "conflict"  # 409


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """A command that was not carried out.

    Attributes:
        name: what the offending value is called; "" when it is not about one value.
        code: stable kebab-case key; `detail` says what and why, `remedy` what to do.
    """

    kind: RefusalKind
    code: str
    detail: str
    remedy: str
    name: str = ""
    value: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class AddBoard:
    """Open a link and run a board on it; `trusted` is a link from the command line, which may be any file."""

    url: str
    system: int | None = None
    component: int | None = None
    trusted: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoveBoard:
    """Close the link of a board and forget it."""

    board_id: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReconnectBoard:
    """Close the link of a board and open it anew; a board that had failed starts afresh."""

    board_id: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ChooseLanes:
    """Run these estimators of a board from the next step on, and no others; the first is the main one."""

    board_id: str
    lanes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SetLaneParameters:
    """Change numbers of one estimator from the next step on; None = back to the default."""

    board_id: str
    lane: str
    values: Mapping[str, float | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """A command that was carried out, and on which board."""

    board_id: str

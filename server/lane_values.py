"""LANE.PARAMETER=VALUE as a person writes it in a setting or on the command line, and the reverse."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

LaneValues = dict[str, dict[str, float]]
"""Lane → parameter → value."""


def lane_values(texts: Iterable[str]) -> LaneValues:
    """Return what the texts say; the last one of the same parameter wins.

    Raises:
        ValueError: a text is not LANE.PARAMETER=VALUE with a finite number. Whether there is such a lane and
            parameter, and its limits, is the engine's to say.
    """
    found: LaneValues = {}
    for text in texts:
        place, equals, number = text.partition("=")
        lane, dot, name = (part.strip() for part in place.partition("."))
        if not (equals and dot and lane and name):
            raise ValueError(f"{text[:80]!r} is not LANE.PARAMETER=VALUE, as in lane.gain=0.02")
        found.setdefault(lane, {})[name] = _number(text, number)
    return found


def _number(text: str, number: str) -> float:
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{text[:80]!r}: {number.strip()[:40]!r} is not a finite number")
    return value


def changed_values(values: Mapping[str, Mapping[str, float]]) -> LaneValues:
    """Return those that differ from the lane's default."""
    from server.nav.lanes.registry import defaults_of  # loads every kernel

    changed = {
        lane: {name: value for name, value in own.items() if value != defaults_of(lane).get(name)}
        for lane, own in values.items()
    }
    return {lane: own for lane, own in changed.items() if own}

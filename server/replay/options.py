"""What a replay may be told on the command line, parsed once: lanes, outages, rate."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, Literal

from server.chain_values import chain_values
from server.lane_values import LaneValues, lane_values
from server.nav.types import EngineSettings
from server.replay.errors import ReplayError, nearest

Stretch = tuple[float, float]
Mode = Literal["run", "apply"]
"""Of learning the magnetic offset in flight: only watched, or taken off what the estimators are given."""


def known_lanes() -> tuple[str, ...]:
    """Return the names of every lane that a recording can be run through."""
    from server.nav.lanes.registry import RECORDED_LANES

    return RECORDED_LANES


def lanes_from_text(text: str) -> tuple[str, ...]:
    """Return the lanes of "a,b" or "all"; "" is all of them.

    Raises:
        ReplayError: a lane is not known; the message lists those that are.
    """
    names = [name.strip() for name in text.split(",") if name.strip()]
    return checked_lanes(known_lanes() if not names or names == ["all"] else names)


def checked_lanes(lanes: Iterable[str]) -> tuple[str, ...]:
    """Return the lanes without repetition, in the order given.

    Raises:
        ReplayError: a lane is not known, or none is given.
    """
    names = tuple(dict.fromkeys(lanes))
    for name in names:
        if name not in known_lanes():
            known = ", ".join(known_lanes())
            raise ReplayError(f"lane {name!r} is not known{nearest(name, known_lanes())}. Known: {known}, or all.")
    if not names:
        raise ReplayError(f"no lane is given. Known: {', '.join(known_lanes())}, or all.")
    return names


def values_from_texts(texts: Iterable[str]) -> LaneValues:
    """Return lane → parameter → value of texts LANE.PARAMETER=VALUE.

    Raises:
        ReplayError: not of that form, no such lane or parameter, or outside its limits.
    """
    try:
        values = lane_values(texts)
    except ValueError as error:
        raise ReplayError(f"--set {error}.") from None
    return checked_values(values)


def checked_values(values: Mapping[str, Mapping[str, float]]) -> LaneValues:
    """Return the values as they are.

    Raises:
        ReplayError: there is no such lane or parameter, or a value is outside its limits.
    """
    from server.nav.lanes.registry import RECORDED_LANES, check_values

    try:
        for lane, own in values.items():
            check_values(lane, own, RECORDED_LANES)
    except ValueError as error:
        raise ReplayError(f"--set: {error}.") from None
    return {lane: dict(own) for lane, own in values.items()}


def idle_values(values: Mapping[str, Mapping[str, float]], lanes: Sequence[str]) -> list[str]:
    """Return a note for each lane of which something was set and which does not run."""
    return [f"--set {lane}.…: this lane does not run, so nothing comes of it." for lane in values if lane not in lanes]


def chain_from_texts(texts: Iterable[str]) -> LaneValues:
    """Return sensor → parameter → value of texts SENSOR.PARAMETER=VALUE, as the setting `preprocess` takes them.

    Raises:
        ReplayError: not of that form, no such sensor or parameter, or outside its limits.
    """
    told = tuple(texts)
    for text in told:
        place, _, value = text.partition("=")
        sensor, _, name = (part.strip() for part in place.partition("."))
        if not (sensor and name and value.strip()):
            form = "SENSOR.PARAMETER=VALUE, as in gyro.butterworth_hz=40"
            raise ReplayError(f"--preprocess {text[:80]!r} is not {form}.")
    try:
        return checked_chain(chain_values(told))
    except ReplayError:
        raise
    except ValueError as error:
        raise ReplayError(f"--preprocess {error}.") from None


def checked_chain(values: Mapping[str, Mapping[str, float]]) -> LaneValues:
    """Return the values as they are.

    Raises:
        ReplayError: there is no such sensor or parameter, or a value is outside its limits.
    """
    from server.nav.preprocess.chain_parameters import check_chain  # loads kernels

    try:
        for sensor, own in values.items():
            check_chain(sensor, own)
    except ValueError as error:
        raise ReplayError(f"--preprocess: {error}.") from None
    return {sensor: dict(own) for sensor, own in values.items()}


def learning_from_text(text: str) -> Mode:
    """Return "run" or "apply".

    Raises:
        ReplayError: neither.
    """
    if text == "run":
        return "run"
    if text == "apply":
        return "apply"
    raise ReplayError(
        f"--mag-learning {text[:40]!r} is not known. Give run (only watch) or apply (take what was learned off)."
    )


def outage_from_text(text: str) -> Stretch:
    """Return (a, b) of "A:B", seconds after the earliest t_ns of any file.

    Raises:
        ReplayError: not two numbers with 0 ≤ A < B.
    """
    try:
        start_s, stop_s = (float(part) for part in text.split(":"))
    except ValueError:
        raise ReplayError(f"--gnss-outage {text!r} is not A:B in seconds. Write for example 60:90.") from None
    return checked_outage((start_s, stop_s))


def checked_outage(stretch_s: Sequence[float]) -> Stretch:
    """Return the stretch when 0 ≤ a < b and both are finite, else raise ReplayError."""
    start_s, stop_s = stretch_s
    if not (math.isfinite(start_s) and math.isfinite(stop_s) and 0.0 <= start_s < stop_s):
        raise ReplayError(
            f"--gnss-outage {start_s:g}:{stop_s:g} is not a stretch: A and B are seconds after the log's "
            "first sample, with 0 ≤ A < B."
        )
    return float(start_s), float(stop_s)


def merged(*overrides: dict[str, Any]) -> EngineSettings:
    """Return the default settings with each set of overrides on top, the last one winning.

    Raises:
        ReplayError: a name that is not a setting.
    """
    known = [field.name for field in fields(EngineSettings)]
    values = {name: value for part in overrides for name, value in part.items()}
    for name in values:
        if name not in known:
            raise ReplayError(f"setting {name!r} is not known{nearest(name, known)}.")
    return replace(EngineSettings(), **values)

"""What a person told the command, parsed once: the collectors' options, and the stretches of the poses."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, cast

from server.calibrate.errors import CalibrateError
from server.nav.calibration.types import NAN, CalKind
from server.replay.errors import nearest

Ranges = tuple[tuple[int, int], ...]

UNITS: Final = ("si", "raw")
PARAMETERS: Final = (6, 9)
TURNTABLE: Final = "_rot"  # how a Ferraris session names its turns


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """The command line, NaN, None or "" where nothing was said.

    Attributes:
        kind: what to calibrate.
        files: CSV files, "-" for standard input, one sensor folder, or one .tlog.
        unit: "" = every column says its own.
        columns: names for files without a header.
        verify: fresh data of the same form.
        applied: results of earlier calibrations to put on the raw samples, for kinds that need calibrated ones.
        others: as `nav.calibration.types.Options`, but angles in degrees.
    """

    kind: CalKind
    files: tuple[Path, ...]
    unit: Literal["si", "raw", ""] = ""
    strength: float = NAN
    gravity_m_s2: float = NAN
    axis: Literal["x", "y", "z", ""] = ""
    turns: float = NAN
    rate_hz: float = NAN
    ranges: str = ""
    parameters: int = 9
    heading_deg: float = NAN
    heading_sigma_deg: float = 2.0
    lat_deg: float = NAN
    lon_deg: float = NAN
    alt_m: float = NAN
    year: float = NAN
    height_m: float = NAN
    duration_s: float = NAN
    columns: tuple[str, ...] = ()
    verify: tuple[Path, ...] = ()
    applied: tuple[Path, ...] = field(default=())

    def __post_init__(self) -> None:
        _check(self)


def kind_of(text: str) -> CalKind:
    """Return the kind of a name; hyphens count as underscores.

    Raises:
        CalibrateError: there is no such kind; the message lists them.
    """
    known = [kind.value for kind in CalKind]
    name = text.strip().lower().replace("-", "_")
    if name not in known:
        raise CalibrateError(f"KIND {text!r} is not known{nearest(name, known)}. Known: {', '.join(known)}.")
    return CalKind(name)


def _check(told: Told) -> None:
    """Raise CalibrateError for a value outside its limits."""
    _one_of("--unit", told.unit, ("", *UNITS))
    _one_of("--axis", told.axis, ("", "x", "y", "z"))
    _one_of("--parameters", told.parameters, PARAMETERS)
    _within("--strength", told.strength, 0.0, math.inf)
    _within("--gravity", told.gravity_m_s2, 0.0, math.inf)
    _within("--rate-hz", told.rate_hz, 0.0, 1e6)
    _within("--turns", told.turns, 0.0, math.inf)
    _within("--duration-s", told.duration_s, 0.0, math.inf)
    _within("--heading-sigma-deg", told.heading_sigma_deg, 0.0, 180.0)
    _within("--heading-deg", told.heading_deg, -360.0, 360.0, closed=True)
    _within("--lat-deg", told.lat_deg, -90.0, 90.0, closed=True)
    _within("--lon-deg", told.lon_deg, -360.0, 360.0, closed=True)
    _within("--alt-m", told.alt_m, -1e4, 1e6)
    _within("--height-m", told.height_m, -1e4, 1e5)
    _within("--year", told.year, 1900.0, 2200.0)
    if math.isnan(told.lat_deg) != math.isnan(told.lon_deg):
        raise CalibrateError("--lat-deg and --lon-deg go together: give both or neither.")
    if not told.files:
        raise CalibrateError("no FILE is given. Give CSV files, a sensor folder, a .tlog, or - for standard input.")


def _one_of(flag: str, value: object, allowed: tuple[object, ...]) -> None:
    if value not in allowed:
        names = " or ".join(str(each) for each in allowed if each != "")
        raise CalibrateError(f"{flag} {value} is not known. Give {names}.")


def _within(flag: str, value: float, low: float, high: float, *, closed: bool = False) -> None:
    """NaN is "not told"; anything else must be finite and inside (low, high), or [low, high] when closed."""
    good = math.isnan(value) or (math.isfinite(value) and (low <= value <= high if closed else low < value < high))
    if not good:
        limits = f"above {low:g}" if math.isinf(high) else f"in {low:g} to {high:g}"
        raise CalibrateError(f"{flag} {value:g} is refused: it must be a finite number {limits}.")


def ranges_of(text: str, kind: CalKind, axis: str) -> Ranges:
    """Return the stretches of `--ranges`, in their order: half-open sample indices.

    Args:
        text: "a:b,c:d", a JSON list [[a, b], …], or a JSON file of either a list or {name: {"start": a, "end": b}}.
        kind: of named stretches, those whose name ends in _rot are turns and the others poses; a kind takes its own.
        axis: of the turns, the one about this axis ("" = all).

    Raises:
        CalibrateError: none of these forms, or a stretch without samples.
    """
    found: Any = _ranges_json(text)
    if isinstance(found, dict):
        found = _named(found, kind, axis)
    if not isinstance(found, list) or not found:
        raise CalibrateError(_form(text))
    return tuple(_stretch(each, text) for each in found)


def _form(text: str) -> str:
    return (
        f"--ranges {text[:60]!r} is refused. Write sample indices a:b,c:d (b is not part of it), a JSON list "
        '[[a, b], …], or a JSON file of {"name": {"start": a, "end": b}, …}.'
    )


def _ranges_json(text: str) -> object:
    path = Path(text)
    try:
        if text.lstrip()[:1] in {"[", "{"}:
            return json.loads(text)
        if text.lower().endswith(".json"):
            return json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise CalibrateError(f"--ranges {path} cannot be read: {error.strerror}. Check the path.") from error
    except ValueError as error:
        raise CalibrateError(f"--ranges {text[:60]} is not JSON: {error}.") from error
    return [part.split(":") for part in text.split(",") if part.strip()]


def _named(found: dict[str, Any], kind: CalKind, axis: str) -> list[Any]:
    turns = {name: each for name, each in found.items() if name.endswith(TURNTABLE)}
    poses = {name: each for name, each in found.items() if name not in turns}
    if kind is not CalKind.GYRO_SCALE:
        return list(poses.values()) or list(turns.values())
    mine = [each for name, each in turns.items() if not axis or name == f"{axis}{TURNTABLE}"]
    if not mine:
        known = ", ".join(turns) or "none"
        raise CalibrateError(f"--ranges names the turns {known}; --axis {axis} has none. Give another --axis or none.")
    return [*poses.values(), *mine]  # the poses are the rests between which the turns lie


def _stretch(each: object, text: str) -> tuple[int, int]:
    pair = [each.get("start"), each.get("end")] if isinstance(each, dict) else each
    try:
        start, stop = (int(cast(Any, value)) for value in cast(Any, pair))
    except (TypeError, ValueError):
        raise CalibrateError(_form(text)) from None
    if not 0 <= start < stop:
        raise CalibrateError(f"--ranges {start}:{stop} holds no sample. Give a:b with 0 ≤ a < b; b is not part of it.")
    return start, stop

"""Parameter files of autopilots: names and float32 values as text, read in every common form."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from server.calibration.errors import ExchangeError
from server.nav.calibration.types import Sensor, Value
from server.nav.types import Float

Parameters = Mapping[str, float]
_NAME = re.compile(r"[A-Z][A-Z0-9_]{1,15}")
_MAX_CHARACTERS = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Warned:
    """What a format cannot hold, or what a person must know before using the file.

    Attributes:
        code: "cross-axis-lost", "scale-lost", "out-of-range", "board-unknown", "relearned", ….
        size: how much, in `unit`; NaN when it is not about a number.
        text: English sentence.
    """

    code: str
    text: str
    sensor: Sensor | None = None
    size: float = math.nan
    unit: str = ""


@dataclass(slots=True)
class Found:
    """Parameters to be written, or what was read, with the warnings on the way."""

    parameters: dict[str, float] = field(default_factory=dict)
    sensors: dict[Sensor, dict[str, Value]] = field(default_factory=dict)
    warnings: list[Warned] = field(default_factory=list)

    def warn(self, code: str, text: str, sensor: Sensor, size: float = math.nan, unit: str = "") -> None:
        """Note a warning."""
        self.warnings.append(Warned(code=code, text=text, sensor=sensor, size=float(size), unit=unit))

    def put(self, names: Sequence[str], values: Iterable[float]) -> None:
        """Set parameters."""
        self.parameters.update(zip(names, (float(value) for value in values), strict=True))


def read_parameters(text: str) -> dict[str, float]:
    """Return names and values of an ArduPilot (`NAME,VALUE` or `NAME VALUE`) or a QGroundControl file (5 columns).

    Raises:
        ExchangeError: a line is neither a parameter nor a comment; it names the line.
    """
    if len(text) > _MAX_CHARACTERS:
        raise ExchangeError(f"The file is longer than {_MAX_CHARACTERS} characters: it is not a parameter file.")
    found: dict[str, float] = {}
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        plain = line.split("#", maxsplit=1)[0].split("//", maxsplit=1)[0].strip()
        if plain:
            name, value = _parameter(plain, number)
            found[name] = value
    if not found:
        raise ExchangeError("The file holds no parameter. Save the parameters of the board from the ground station.")
    return found


def _parameter(line: str, number: int) -> tuple[str, float]:
    cells = [cell for cell in re.split(r"[,\s=]+", line) if cell]
    if len(cells) == 5 and cells[0].isdigit() and cells[1].isdigit():  # vehicle, component, name, value, type
        cells = cells[2:4]
    try:
        value = float(cells[1])
    except (IndexError, ValueError):
        value = math.nan
    if not _NAME.fullmatch(cells[0]) or not math.isfinite(value):
        raise ExchangeError(f"Line {number} is not a parameter: {line[:60]!r}. It must be a name and a number.")
    return cells[0], value


def axes(prefix: str, suffix: str = "") -> tuple[str, str, str]:
    """Return the names of a vector's three parameters."""
    return (f"{prefix}X{suffix}", f"{prefix}Y{suffix}", f"{prefix}Z{suffix}")


def vector(parameters: Parameters, names: Sequence[str], default: float) -> Float:
    """Return the values, shape (len(names),); a parameter that is not there has its default."""
    return np.array([parameters.get(name, default) for name in names], dtype=np.float64)


def has_any(parameters: Parameters, *groups: Sequence[str]) -> bool:
    """True when one of the names is there."""
    return any(name in parameters for names in groups for name in names)


def float32_text(value: float) -> str:
    """Return the shortest decimal that reads back to the float32 the board will hold."""
    if not math.isfinite(value):
        raise ExchangeError("A parameter to be written is not a finite number. Calibrate again.")
    return str(np.float32(value))


def comment_lines(texts: Iterable[str]) -> list[str]:
    """Return texts as comments, whatever is in them kept from becoming a line of its own."""
    return [f"# {' '.join(text.split())}" for text in texts]

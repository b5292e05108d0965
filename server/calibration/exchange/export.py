"""What is in force on a board as a file that another program takes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from server.calibration.exchange import ardupilot, px4
from server.calibration.exchange.c_header import c_header
from server.calibration.exchange.native import native_text
from server.calibration.exchange.parameters import Found, Parameters, Warned, comment_lines, float32_text
from server.calibration.records import CalibrationSet, composed
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import Sensor, Value

Format = Literal["native", "ardupilot", "px4", "c"]
FORMATS: Final[Mapping[str, tuple[str, str]]] = {
    "native": (".navdeck.json", "application/json"),
    "ardupilot": (".param", "text/plain; charset=utf-8"),
    "px4": (".params", "text/plain; charset=utf-8"),
    "c": (".h", "text/x-c; charset=utf-8"),
}
"""Format → end of the file's name, media type."""
_UNKNOWN_BOARD: Final = (
    "The board's own parameters were not given: these are right only for a board that applies no calibration yet "
    "(offsets 0, scales 1, no rotation). Otherwise export again with the board's parameter file."
)
_REAL32: Final = 9  # MAV_PARAM_TYPE


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported:
    """A file to be handed out; `warnings` say what it does not hold, and are in it as comments."""

    name: str
    media_type: str
    text: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[Warned, ...] = ()


def export_calibration(
    form: Format,
    in_force: Mapping[Sensor, CalibrationSet],
    *,
    board_id: str,
    software_version: str,
    now_utc: str,
    board: Parameters | None = None,
) -> Exported:
    """Return what is in force in another program's words.

    Args:
        form: which words.
        in_force: as `CalibrationStore.in_force` returns it; sensors that are not in it are left alone.
        board_id: whose it is.
        software_version: of navdeck.
        now_utc: ISO 8601.
        board: the parameters the board has now (`read_parameters`); the file's are composed with them, because what
            navdeck calibrated had gone through them. None = the file says that the board is taken to apply nothing.

    Raises:
        ExchangeError: a number in force is not finite.
    """
    whole = composed(in_force)
    about = _provenance(in_force.values(), board_id, software_version, now_utc)
    found = Found()
    if form == "native":
        sets = [in_force[sensor] for sensor in Sensor if sensor in in_force]
        text = native_text(sets, board_id=board_id, software_version=software_version, exported_utc=now_utc)
    elif form == "c":
        text = c_header(whole, about)
    else:
        found = (ardupilot if form == "ardupilot" else px4).written(whole, set(in_force), board)
        if board is None:
            found.warnings.insert(0, Warned(code="board-unknown", text=_UNKNOWN_BOARD))
        text = _parameter_text(form, found, about)
    suffix, media_type = FORMATS[form]
    return Exported(
        name=f"{_plain(board_id)}{suffix}",
        media_type=media_type,
        text=text,
        parameters=dict(found.parameters),
        warnings=tuple(found.warnings),
    )


def _parameter_text(form: str, found: Found, about: Iterable[str]) -> str:
    lines = comment_lines(about)
    lines += comment_lines(f"NOTE: {warning.text}" for warning in found.warnings)
    if form == "ardupilot":
        lines += [f"{name},{float32_text(value)}" for name, value in found.parameters.items()]
    else:
        lines.append("# Vehicle-Id Component-Id Name Value Type")
        lines += [f"1\t1\t{name}\t{float32_text(value)}\t{_REAL32}" for name, value in found.parameters.items()]
    return "\n".join(lines) + "\n"


def _provenance(sets: Iterable[CalibrationSet], board_id: str, version: str, now_utc: str) -> list[str]:
    lines = [f"Calibration of board {board_id}, written {now_utc} by navdeck {version}."]
    for kept in sets:
        grade = f", {kept.grade}" if kept.grade else ""
        lines.append(f"{kept.sensor}: {kept.kind}{grade}, set {kept.id} of {kept.created_utc} by {kept.created_by}.")
    return lines


def _plain(board_id: str) -> str:
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "-" for c in board_id)[:60] or "board"


def is_identity(sensor: Sensor, parameters: Mapping[str, Value]) -> bool:
    """True when they change nothing that a float32 parameter can hold."""
    flat = Calibration().having(sensor, parameters).flat() - Calibration().flat()
    return bool(np.abs(flat).max() < 1e-9)

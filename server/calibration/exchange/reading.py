"""A calibration from a file of another program, as sets that can be kept and applied."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from server.calibration.errors import ExchangeError
from server.calibration.exchange import ardupilot, px4
from server.calibration.exchange.export import is_identity
from server.calibration.exchange.native import from_native
from server.calibration.exchange.parameters import Parameters, Warned, read_parameters
from server.calibration.records import CalibrationSet
from server.nav.calibration.types import Sensor, Value

_PX4: Final = ("CAL_ACC0_", "CAL_GYRO0_", "CAL_MAG0_", "SENS_BOARD_", "SENS_DPRES_OFF")
_ARDUPILOT: Final = ("COMPASS_", "INS_", "AHRS_", "ARSPD_", "BARO_")
_UNKNOWN_BOARD: Final = (
    "The board's own parameters were not given: the file is taken as relative to what the board sends, which is right "
    "only while the board itself applies no calibration."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """Sets to be added to the store (their ids are empty), and what a person should know."""

    form: str
    sets: tuple[CalibrationSet, ...]
    warnings: tuple[Warned, ...] = ()


def import_calibration(
    text: str, *, name: str, board_id: str, created_by: str, software_version: str, board: Parameters | None = None
) -> Imported:
    """Return a file's calibration as sets of this board; the format is found out.

    Args:
        text: the file.
        name: the file's name, for the provenance.
        board_id: whose it becomes.
        created_by: who brings it.
        software_version: of navdeck.
        board: the parameters the board has now; what they do already is taken out of what the file's would do.

    Raises:
        ExchangeError: the file is none of the formats, or damaged.
    """
    given: dict[str, Any] = {"board_id": board_id, "created_by": created_by}
    if text.lstrip("\ufeff \r\n\t").startswith("{"):
        return Imported(form="native", sets=tuple(_adopted(kept, name, given) for kept in from_native(text)))
    parameters = read_parameters(text)
    form = form_of(parameters)
    found = (px4 if form == "px4" else ardupilot).read(parameters, board)
    if board is None:
        found.warnings.insert(0, Warned(code="board-unknown", text=_UNKNOWN_BOARD))
    for sensor in [one for one, values in found.sensors.items() if is_identity(one, values)]:
        del found.sensors[sensor]
        found.warn("nothing-to-do", f"The file changes nothing on the {sensor}; no set was made of it.", sensor)
    given |= {"source": f"import:{form}", "software_version": software_version, "note": f"from {name}"}
    sets = tuple(_set(sensor, values, given) for sensor, values in found.sensors.items())
    return Imported(form=form, sets=sets, warnings=tuple(found.warnings))


def form_of(parameters: Parameters) -> str:
    """Return "px4" or "ardupilot".

    Raises:
        ExchangeError: no name of either's calibration is there.
    """
    for form, starts in (("px4", _PX4), ("ardupilot", _ARDUPILOT)):
        if any(name.startswith(starts) for name in parameters):
            return form
    raise ExchangeError("The file has no calibration parameter of ArduPilot or PX4. Save all parameters of the board.")


def _set(sensor: Sensor, values: Mapping[str, Value], given: Mapping[str, Any]) -> CalibrationSet:
    return CalibrationSet(sensor=sensor, kind="import", parameters=values, **given)


def _adopted(kept: CalibrationSet, name: str, given: Mapping[str, Any]) -> CalibrationSet:
    """Return a set from elsewhere as one of this board: new id, and where it was from in the note."""
    origin = f"from {name}: set {kept.id} of board {kept.board_id}, made by {kept.created_by}"
    note = f"{kept.note}; {origin}" if kept.note else origin
    return replace(kept, id="", samples_file="", source="import:native", note=note, **given)

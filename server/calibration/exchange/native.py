"""navdeck's own JSON: the sets in force of one board, every number exact."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, Final

from server.calibration.errors import ExchangeError
from server.calibration.records import CalibrationSet
from server.calibration.records_json import from_json, to_json

FORMAT: Final = "navdeck.calibration/1"
_FAMILY: Final = "navdeck.calibration/"


def native_text(sets: Iterable[CalibrationSet], *, board_id: str, software_version: str, exported_utc: str) -> str:
    """Return the sets as JSON; `from_native` gives them back exactly. Sample folders are not part of it."""
    body = {
        "format": FORMAT,
        "board_id": board_id,
        "software_version": software_version,
        "exported_utc": exported_utc,
        "units": {"gyro": "rad/s", "accel": "m/s²", "mag": "gauss", "airspeed": "Pa", "baro": "m"},
        "formula": "calibrated = matrix · (raw − offset); gyro: scale * (raw − bias); airspeed, baro: raw − bias",
        "sets": [to_json(kept) for kept in sets],
    }
    return json.dumps(body, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def from_native(text: str) -> list[CalibrationSet]:
    """Return the sets of `native_text`.

    Raises:
        ExchangeError: it is not JSON, another format or version, or a set is not well formed.
    """
    try:
        body: Any = json.loads(text)
    except ValueError as error:
        raise ExchangeError(f"The file is not JSON: {error}.") from error
    name = body.get("format") if isinstance(body, dict) else None
    if name != FORMAT:
        newer = isinstance(name, str) and name.startswith(_FAMILY)
        remedy = "A newer navdeck wrote it; update this one." if newer else f'It must say "format": "{FORMAT}".'
        raise ExchangeError(f"The file is not a calibration of navdeck that can be read here. {remedy}")
    if not isinstance(body.get("sets"), list):
        raise ExchangeError('The file has no list "sets".')
    return [_one(index, given) for index, given in enumerate(body["sets"])]


def _one(index: int, given: object) -> CalibrationSet:
    if not isinstance(given, dict):
        raise ExchangeError(f"Set {index} of the file is not an object.")
    try:
        return from_json(given)
    except ValueError as error:
        raise ExchangeError(f"Set {index} of the file: {error}.") from error

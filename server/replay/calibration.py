"""`--calibration`: files of navdeck's own, put together to what is in force from the first sample on."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from server.calibration.errors import ExchangeError
from server.nav.calibration.applied import Calibration, merged
from server.nav.calibration.types import SENSOR_OF, CalKind, Sensor, Value
from server.nav.preprocess.chain_calibration import check_calibration
from server.replay.contract_preprocessing import CalibrationOut
from server.replay.errors import ReplayError

_REMEDY: Final = "Give what a board exports as JSON, or what navdeck calibrate writes with --out."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Given:
    """What the files amount to: the calibration, None when there is no file; and each part by itself."""

    calibration: Calibration | None
    parts: tuple[CalibrationOut, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Part:
    sensor: Sensor
    kind: str
    set_id: str
    parameters: Mapping[str, Value]


def read_calibrations(files: Iterable[Path]) -> Given:
    """Return the calibration of the files in their order, the later one of a sensor winning.

    A file is navdeck's native JSON, or the result of `navdeck calibrate`; a result that finds only part of a sensor's
    parameters keeps what the files before it say of the others.

    Raises:
        ReplayError: a file is neither, is a refused calibration, or holds numbers that cannot be applied.
    """
    present, parts = Calibration(), []
    for path in files:
        for part in _parts(path, present):
            present = _having(present, part, path)
            parts.append(_part_out(path, part))
    return Given(calibration=present if parts else None, parts=tuple(parts))


def _parts(path: Path, present: Calibration) -> Iterator[_Part]:
    """Yield what one file holds."""
    from server.calibration.exchange.native import from_native  # loads kernels

    try:
        text = path.read_text(encoding="utf-8-sig")
        body = json.loads(text)
    except OSError as error:
        raise ReplayError(f"--calibration {path} cannot be read: {error.strerror}. Check the path.") from error
    except ValueError as error:
        raise ReplayError(f"--calibration {path} is not JSON: {error}. {_REMEDY}") from error
    if isinstance(body, dict) and "ok" in body and "format" not in body:
        yield _result(path, body, present)
        return
    try:
        found = from_native(text)
    except ExchangeError as error:
        raise ReplayError(f"--calibration {path}: {error} {_REMEDY}") from error
    if not found:
        raise ReplayError(f"--calibration {path} holds no set. Export a board that has a calibration in force.")
    for kept in found:
        yield _Part(sensor=kept.sensor, kind=str(kept.kind), set_id=kept.id, parameters=kept.parameters)


def _result(path: Path, body: Mapping[str, Any], present: Calibration) -> _Part:
    """Return the result of `navdeck calibrate`."""
    if not body["ok"]:
        raise ReplayError(f"--calibration {path} is a refused calibration. Give one that was fitted.")
    try:
        kind = CalKind(body["kind"])
        values, sigma = _arrays(body["parameters"]), _arrays(body["sigma"])
        whole = merged(kind, values, sigma, present)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ReplayError(f"--calibration {path} is not a result of navdeck calibrate ({error}). {_REMEDY}") from error
    return _Part(sensor=SENSOR_OF[kind], kind=str(kind), set_id="", parameters=whole)


def _arrays(values: Mapping[str, Any]) -> dict[str, Value]:
    """Return JSON's numbers as arrays; null is NaN."""
    return {name: np.asarray(value, dtype=np.float64) for name, value in values.items()}


def _having(present: Calibration, part: _Part, path: Path) -> Calibration:
    """Return the calibration with one part replaced, if that can be applied."""
    try:
        found = present.having(part.sensor, part.parameters)
        check_calibration(found)
    except (TypeError, ValueError) as error:
        raise ReplayError(f"--calibration {path}, {part.sensor}: {error}. Calibrate again.") from error
    return found


def _part_out(path: Path, part: _Part) -> CalibrationOut:
    numbers = {name: np.asarray(value, dtype=np.float64).tolist() for name, value in part.parameters.items()}
    return CalibrationOut(
        file=path.name, sensor=str(part.sensor), kind=part.kind, set_id=part.set_id, parameters=numbers
    )

"""A calibration set exactly to JSON and back: every float bit for bit, NaN as null."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, Literal, cast

import numpy as np

from server.calibration.records import CalibrationSet
from server.nav.calibration.types import NAN, CalKind, Check, Failure, Grade, Residual, Sensor, Value

SHAPES: Final = ((), (3,), (3, 3))
_INFINITE: Final = {"Infinity": math.inf, "-Infinity": -math.inf}


def to_json(kept: CalibrationSet) -> dict[str, Any]:
    """Return plain JSON values; NaN is null, infinities are the words "Infinity" and "-Infinity"."""
    return {
        "id": kept.id,
        "board_id": kept.board_id,
        "sensor": str(kept.sensor),
        "kind": str(kept.kind),
        "parameters": _values_out(kept.parameters),
        "sigma": _values_out(kept.sigma),
        "grade": kept.grade,
        "coverage": _number_out(kept.coverage),
        "residual_before": _residual_out(kept.residual_before),
        "residual_after": _residual_out(kept.residual_after),
        "samples": kept.samples,
        "temperature_degc": _number_out(kept.temperature_degc),
        "created_utc": kept.created_utc,
        "created_by": kept.created_by,
        "software_version": kept.software_version,
        "source": kept.source,
        "samples_file": kept.samples_file,
        "note": kept.note,
        "verified": _check_out(kept.verified),
        "details": {name: _number_out(value) for name, value in kept.details.items()},
    }


def from_json(given: Mapping[str, Any]) -> CalibrationSet:
    """Return the set of `to_json`, every float bit for bit (NaN apart, of which there is one).

    Raises:
        ValueError: a field is missing or is not what it should be; the text names it.
    """
    try:
        return _from_json(given)
    except KeyError as error:
        raise ValueError(f"the calibration set has no field {error.args[0]!r}") from error
    except (TypeError, AttributeError) as error:
        raise ValueError(f"the calibration set is not well formed: {error}") from error


def _from_json(given: Mapping[str, Any]) -> CalibrationSet:
    kind = given["kind"]
    texts = ("id", "board_id", "created_utc", "created_by", "software_version", "source", "samples_file", "note")
    return CalibrationSet(
        **{name: _text_in(given, name) for name in texts},
        sensor=Sensor(given["sensor"]),
        kind=kind if kind in {"import", "default"} else CalKind(kind),
        parameters=_values_in(given["parameters"]),
        sigma=_values_in(given["sigma"]),
        grade=_grade_in(given["grade"]),
        coverage=_number_in(given["coverage"]),
        residual_before=_residual_in(given["residual_before"]),
        residual_after=_residual_in(given["residual_after"]),
        samples=int(given["samples"]),
        temperature_degc=_number_in(given["temperature_degc"]),
        verified=_check_in(given["verified"]),
        details={str(name): _number_in(value) for name, value in given["details"].items()},
    )


def _text_in(given: Mapping[str, Any], name: str) -> str:
    if not isinstance(given[name], str):
        raise ValueError(f"the field {name!r} of a calibration set must be text")
    return str(given[name])


def _grade_in(value: object) -> Grade | Literal[""]:
    if value == "good":
        return "good"
    if value == "fair":
        return "fair"
    if value == "poor":
        return "poor"
    if value == "":
        return ""
    raise ValueError(f"{value!r} is not a grade; known are good, fair, poor")


def _number_out(value: float) -> float | str | None:
    number = float(value)
    if math.isnan(number):
        return None
    return number if math.isfinite(number) else ("Infinity" if number > 0 else "-Infinity")


def _number_in(value: object) -> float:
    if value is None:
        return NAN
    if isinstance(value, str) and value in _INFINITE:
        return _INFINITE[value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{value!r} is not a number")
    return float(value)


def _values_out(values: Mapping[str, Value]) -> dict[str, Any]:
    return {name: _value_out(np.asarray(value, dtype=np.float64).tolist()) for name, value in values.items()}


def _value_out(value: object) -> object:
    return [_value_out(part) for part in value] if isinstance(value, list) else _number_out(cast("float", value))


def _values_in(values: Mapping[str, Any]) -> dict[str, Value]:
    return {str(name): _value_in(str(name), value) for name, value in values.items()}


def _value_in(name: str, value: object) -> Value:
    if not isinstance(value, list):
        return _number_in(value)
    rows = [[_number_in(part) for part in row] if isinstance(row, list) else _number_in(row) for row in value]
    array = np.array(rows, dtype=np.float64)
    if array.shape not in SHAPES:
        raise ValueError(f"{name!r} has the shape {array.shape}; it must be a number, (3,) or (3, 3)")
    array.flags.writeable = False
    return array


def _residual_out(residual: Residual | None) -> dict[str, Any] | None:
    return None if residual is None else {"value": _number_out(residual.value), "unit": residual.unit}


def _residual_in(given: Mapping[str, Any] | None) -> Residual | None:
    return None if given is None else Residual(value=_number_in(given["value"]), unit=str(given["unit"]))


def _check_out(check: Check | None) -> dict[str, Any] | None:
    if check is None:
        return None
    return {
        "ok": check.ok,
        "residual": _residual_out(check.residual),
        "limit": _number_out(check.limit),
        "samples": check.samples,
        "failure": None if check.failure is None else _failure_out(check.failure),
    }


def _failure_out(why: Failure) -> dict[str, Any]:
    numbers = {"measured": _number_out(why.measured), "limit": _number_out(why.limit)}
    return {"code": why.code, **numbers, "unit": why.unit, "advice": why.advice}


def _check_in(given: Mapping[str, Any] | None) -> Check | None:
    if given is None:
        return None
    residual, why = given["residual"], given["failure"]
    return Check(
        ok=bool(given["ok"]),
        residual=Residual(value=_number_in(residual["value"]), unit=str(residual["unit"])),
        limit=_number_in(given["limit"]),
        samples=int(given["samples"]),
        failure=None if why is None else _failure_in(why),
    )


def _failure_in(why: Mapping[str, Any]) -> Failure:
    return Failure(
        code=str(why["code"]),
        measured=_number_in(why["measured"]),
        limit=_number_in(why["limit"]),
        unit=str(why["unit"]),
        advice=str(why["advice"]),
    )

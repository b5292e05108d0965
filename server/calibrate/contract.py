"""The JSON result as typed models; the JSON Schema that is shipped is generated from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from server.calibrate.run import Result
from server.nav.calibration.codes import FAILURES
from server.nav.calibration.types import CalKind, Check, Failure, Fit, Residual, Value

Number = float | None
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Field(min_length=3, max_length=3)]
NAMES: Final = ("offset", "matrix", "scale", "bias")


class _Out(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FailureOut(_Out):
    """Why nothing was fitted."""

    code: str = Field(description="one of the documented list", json_schema_extra={"enum": [*sorted(FAILURES)]})
    measured: Number = Field(description="the number that was too bad; null when it is not about one")
    limit: Number = Field(description="what it had to reach, or stay below")
    unit: str = Field(description='of both, "" for a pure number')
    advice: str = Field(description="what happened and what to do")


class ResidualOut(_Out):
    """RMS of what the model leaves unexplained."""

    value: Number
    unit: str


class CheckOut(_Out):
    """The parameters on fresh data."""

    ok: bool
    residual: ResidualOut
    limit: Number = Field(description="of the residual, in its unit")
    samples: int
    failure: FailureOut | None = Field(description="why it could not be judged")


class ParametersOut(_Out):
    """As the kind has them: calibrated = matrix · (raw − offset), or scale * (raw − bias); {} when refused."""

    offset: Vector | None = None
    matrix: Matrix | None = None
    scale: Vector | Number = None
    bias: Vector | Number = None


class ResultOut(_Out):
    """What `navdeck calibrate --json` prints."""

    ok: bool = Field(description="fitted; false = refused, and failure says why")
    kind: CalKind
    failure: FailureOut | None
    parameters: ParametersOut
    sigma: ParametersOut = Field(
        description="one standard deviation of each, same names and shapes; null = not measured"
    )
    residual_before: ResidualOut | None
    residual_after: ResidualOut | None
    coverage: Number = Field(description="share of what the kind needs that the data held, 0 to 1")
    grade: Literal["good", "fair", "poor"] | None
    samples: int
    temperature_degc: Number
    details: dict[str, Number] = Field(description="further numbers, unit in the name")
    notes: list[str] = Field(description="sentences a person should read")
    software_version: str
    check: CheckOut | None = Field(description="with --verify; null without, or when refused")


def number(value: float) -> Number:
    """Return the value, None when it is not finite."""
    return float(value) if math.isfinite(value) else None


def result_out(result: Result) -> ResultOut:
    """Return the result as it is printed."""
    fit = result.fit
    return ResultOut(
        ok=fit.ok,
        kind=fit.kind,
        failure=_failure(fit.failure),
        parameters=_values(fit.parameters if fit.ok else {}),
        sigma=_sigma(fit),
        residual_before=_residual(fit.residual_before),
        residual_after=_residual(fit.residual_after),
        coverage=number(fit.coverage),
        grade=fit.grade or None,
        samples=fit.samples,
        temperature_degc=number(fit.temperature_degc),
        details={name: number(value) for name, value in fit.details.items()},
        notes=list(result.notes),
        software_version=version("navdeck"),
        check=_check(result.check),
    )


def result_json(out: ResultOut) -> str:
    """Return the text of it: parameters that a kind does not have are left out, everything unknown is null."""
    whole = out.model_dump(mode="json")
    for part in ("parameters", "sigma"):
        whole[part] = {
            name: value for name, value in whole[part].items() if name in getattr(out, part).model_fields_set
        }
    return _dumps(whole)


def _dumps(whole: Mapping[str, object]) -> str:
    import json

    return json.dumps(whole, indent=2, ensure_ascii=False, allow_nan=False)


def _values(values: Mapping[str, Value]) -> ParametersOut:
    """Return the four named values; anything further that a kind finds is not part of the contract."""
    return ParametersOut(**{name: _plain(values[name]) for name in NAMES if name in values})


def _sigma(fit: Fit) -> ParametersOut:
    """Return σ in the shape of the parameters, null where the kind gives none."""
    if not fit.ok:
        return _values({})
    blank = {name: np.full(np.shape(value), np.nan) for name, value in fit.parameters.items()}
    return _values({**blank, **{name: value for name, value in fit.sigma.items() if name in blank}})


def _plain(value: Value) -> list[object] | Number:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        return number(float(array))
    return [_plain(part) for part in array]


def _residual(residual: Residual | None) -> ResidualOut | None:
    return None if residual is None else ResidualOut(value=number(residual.value), unit=residual.unit)


def _failure(failure: Failure | None) -> FailureOut | None:
    if failure is None:
        return None
    measured, limit = number(failure.measured), number(failure.limit)
    return FailureOut(code=failure.code, measured=measured, limit=limit, unit=failure.unit, advice=failure.advice)


def _check(check: Check | None) -> CheckOut | None:
    if check is None:
        return None
    return CheckOut(
        ok=check.ok,
        residual=ResidualOut(value=number(check.residual.value), unit=check.residual.unit),
        limit=number(check.limit),
        samples=check.samples,
        failure=_failure(check.failure),
    )


@cache
def schema_text() -> str:
    """Return the JSON Schema of the result as it stands in its file."""
    whole = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **ResultOut.model_json_schema(mode="serialization"),
    }
    whole["$defs"]["ParametersOut"].pop("required", None)
    return _dumps(whole) + "\n"

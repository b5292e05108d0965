"""One calibration of one sensor as it is kept: parameters with their provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from server.nav.calibration.applied import Calibration, merged
from server.nav.calibration.types import (
    NAN,
    SENSOR_OF,
    CalKind,
    Check,
    Fit,
    Grade,
    Residual,
    Sensor,
    Value,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationSet:
    """The whole parameters of one sensor of one board, and where they come from.

    Attributes:
        id: unique within the board, sorts by time; "" = the store gives one when it is added.
        parameters: as `applied.Calibration.having` takes them: rad/s, m/s², gauss, Pa, m; numbers, (3,) or (3, 3).
        sigma: one standard deviation, same names and shapes, as far as known; NaN = not measured.
        grade: "" = nobody judged it (an import, a default).
        coverage: share of what the kind needs that the data held, 0 to 1; NaN unknown.
        temperature_degc: mean while collecting; NaN unknown.
        created_utc: ISO 8601 with "Z"; "" = the store fills it in.
        created_by: role or name as the caller gave it.
        source: job id, file name, or "import:ardupilot" and the like.
        samples_file: name of the folder of raw samples under the store's `samples`, "" when none was kept.
        verified: the check on fresh data; None when it was not made.
    """

    board_id: str
    sensor: Sensor
    kind: CalKind | Literal["import", "default"]
    parameters: Mapping[str, Value]
    id: str = ""
    sigma: Mapping[str, Value] = field(default_factory=dict)
    grade: Grade | Literal[""] = ""
    coverage: float = NAN
    residual_before: Residual | None = None
    residual_after: Residual | None = None
    samples: int = 0
    temperature_degc: float = NAN
    created_utc: str = ""
    created_by: str = ""
    software_version: str = ""
    source: str = ""
    samples_file: str = ""
    note: str = ""
    verified: Check | None = None
    details: Mapping[str, float] = field(default_factory=dict)


def set_from_fit(fit: Fit, *, board_id: str, present: Calibration, **provenance: str) -> CalibrationSet:
    """Return the set a successful fit amounts to, with what the kind does not find taken from the present parameters.

    Args:
        fit: what was found.
        board_id: whose it is.
        present: what is in force on the board.
        **provenance: further fields of `CalibrationSet`: created_by, software_version, source, samples_file, …

    Raises:
        ValueError: the fit was refused.
    """
    if not fit.ok:
        raise ValueError("a refused fit has no parameters to keep")
    parameters = merged(fit.kind, fit.parameters, fit.sigma, present)
    fields: dict[str, Any] = {
        "board_id": board_id,
        "sensor": SENSOR_OF[fit.kind],
        "kind": fit.kind,
        "parameters": parameters,
        "sigma": {name: value for name, value in fit.sigma.items() if name in parameters},
        "grade": fit.grade,
        "coverage": fit.coverage,
        "residual_before": fit.residual_before,
        "residual_after": fit.residual_after,
        "samples": fit.samples,
        "temperature_degc": fit.temperature_degc,
        "details": dict(fit.details),
    }
    return CalibrationSet(**{**fields, **provenance})


def composed(in_force: Mapping[Sensor, CalibrationSet]) -> Calibration:
    """Return the sets as preprocessing takes them; sensors without a set are left as they are."""
    whole = Calibration()
    for sensor, kept in in_force.items():
        whole = whole.having(sensor, kept.parameters)
    return whole

"""The result for a person: a short table, or the refusal with what to do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from server.calibrate.contract import CheckOut, FailureOut, ResidualOut, ResultOut
from server.nav.calibration.types import SENSOR_OF, Sensor

GRADES: Final = {
    "good": "use it",
    "fair": "usable; better data would make it good",
    "poor": "better than nothing; calibrate again when you can",
}
UNITS: Final = {
    Sensor.GYRO: "rad/s",
    Sensor.ACCEL: "m/s²",
    Sensor.MAG: "gauss",
    Sensor.AIRSPEED: "Pa",
    Sensor.BARO: "m",
}
_AXES: Final = "xyz"


def report(out: ResultOut, *, raw: bool = False) -> str:
    """Return the result in a few lines.

    Args:
        out: the result.
        raw: the data were in units of their own, so offset and bias are.
    """
    lines = [f"{out.kind.value}: {'fitted' if out.ok else 'REFUSED'} from {out.samples:,} samples"]
    if out.failure is not None:
        lines += _refusal(out.failure)
    lines += _parameters(out, "raw" if raw else UNITS.get(SENSOR_OF[out.kind], ""))
    if out.residual_before or out.residual_after:
        lines.append(f"  residual   {_residual(out.residual_before)} before, {_residual(out.residual_after)} after")
    if out.coverage is not None:
        lines.append(f"  coverage   {out.coverage:.0%}")
    if out.grade is not None:
        lines.append(f"  grade      {out.grade}: {GRADES[out.grade]}")
    if out.check is not None:
        lines += _check(out.check)
    width = max((len(name) for name in out.details), default=0)
    lines += [
        f"  {name:<{width}}  {'unknown' if value is None else f'{value:.6g}'}" for name, value in out.details.items()
    ]
    return "\n".join([*lines, *(f"  note: {note}" for note in out.notes)])


def _refusal(failure: FailureOut) -> list[str]:
    numbers = [
        f"{name} {value:.4g} {failure.unit}".rstrip()
        for name, value in (("measured", failure.measured), ("limit", failure.limit))
        if value is not None
    ]
    return [f"  {failure.code}{': ' if numbers else ''}{', '.join(numbers)}", f"  → {failure.advice}"]


def _parameters(out: ResultOut, unit: str) -> list[str]:
    lines = []
    for name in ("offset", "bias", "scale", "matrix"):
        value, sigma = getattr(out.parameters, name), getattr(out.sigma, name)
        if value is None:
            continue
        shown = unit if name in {"offset", "bias"} else ""
        rows = [value] if not isinstance(value, list) else value if name == "matrix" else [[each] for each in value]
        errors = [sigma] if not isinstance(value, list) else sigma if name == "matrix" else [[s] for s in sigma or ()]
        for at, row in enumerate(rows):
            label = (name if at == 0 else "").ljust(8) + (_AXES[at] if len(rows) == 3 else " ")
            lines.append(f"  {label}  {_cells(row, errors[at] if errors else None)} {shown}".rstrip())
    return lines


def _cells(row: Sequence[float | None] | float, errors: Sequence[float | None] | float | None) -> str:
    """Return numbers with their standard deviations."""
    values = np.atleast_1d(np.asarray(row, dtype=np.float64))
    sigmas = np.broadcast_to(np.asarray(np.nan if errors is None else errors, dtype=np.float64), values.shape)
    return "  ".join(
        f"{value: .6g}".ljust(10) + ("" if np.isnan(sigma) else f" ± {sigma:.2g}".ljust(11))
        for value, sigma in zip(values, sigmas, strict=True)
    ).rstrip()


def _residual(residual: ResidualOut | None) -> str:
    return "unknown" if residual is None or residual.value is None else f"{residual.value:.4g} {residual.unit}".rstrip()


def _check(check: CheckOut) -> list[str]:
    if check.failure is not None:
        return [f"  check      could not be judged, {check.failure.code}: {check.failure.advice}"]
    verdict = "holds on fresh data" if check.ok else "DOES NOT HOLD on fresh data: calibrate again"
    limit = "unknown" if check.limit is None else f"{check.limit:.4g}"
    return [f"  check      {verdict} (residual {_residual(check.residual)}, limit {limit}, {check.samples:,} samples)"]

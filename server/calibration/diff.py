"""What changed between two calibrations of one sensor, number by number and in standard deviations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from server.calibration.records import CalibrationSet
from server.nav.calibration.applied import Calibration
from server.nav.calibration.types import NAN, Sensor, Value

UNITS: Final[Mapping[Sensor, str]] = {
    Sensor.GYRO: "rad/s",
    Sensor.ACCEL: "m/s²",
    Sensor.MAG: "gauss",
    Sensor.BOARD: "",
    Sensor.AIRSPEED: "Pa",
    Sensor.BARO: "m",
}
_PURE: Final = frozenset({"matrix", "scale"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One number of a calibration, before and after.

    Attributes:
        name: "offset[0]", "matrix[2][1]", "bias".
        change: new − old.
        sigma: of the change, from both sides as far as known; NaN when neither is.
        change_in_sigma: change / sigma; NaN where sigma is unknown or 0.
        unit: "" for a pure number.
    """

    name: str
    old: float
    new: float
    change: float
    sigma: float
    change_in_sigma: float
    unit: str


def diff(old: CalibrationSet | None, new: CalibrationSet | None) -> tuple[Change, ...]:
    """Return every number of both sets side by side; None stands for "nothing in force".

    Raises:
        ValueError: they belong to different sensors, or both are None.
    """
    one = new if new is not None else old
    if one is None:
        raise ValueError("there is nothing to compare: both sides are empty")
    if old is not None and old.sensor is not one.sensor:
        raise ValueError(f"a calibration of {old.sensor} cannot be compared with one of {one.sensor}")
    names = _names(old, new)
    before, after = _flat(one.sensor, old, names), _flat(one.sensor, new, names)
    sigma_old, sigma_new = _sigmas(old, before), _sigmas(new, before)
    return tuple(
        _change(one.sensor, name, before[name], after[name], sigma_old[name], sigma_new[name]) for name in before
    )


def _names(old: CalibrationSet | None, new: CalibrationSet | None) -> tuple[str, ...]:
    """Return the parameters to show; a gyroscope with cross-axis terms is shown as a matrix on both sides."""
    sides = [side for side in (old, new) if side is not None]
    names = list(Calibration().of(sides[0].sensor))
    if sides[0].sensor is Sensor.GYRO and any("matrix" in side.parameters for side in sides):
        names = ["matrix", "bias"]
    return tuple(names)


def _flat(sensor: Sensor, side: CalibrationSet | None, names: tuple[str, ...]) -> dict[str, float]:
    whole = Calibration().having(sensor, {} if side is None else side.parameters)
    values = {**whole.of(sensor), **({"matrix": whole.gyro_matrix} if sensor is Sensor.GYRO else {})}
    return _numbers({name: values[name] for name in names})


def _numbers(values: Mapping[str, Value]) -> dict[str, float]:
    out: dict[str, float] = {}
    for name, value in values.items():
        array = np.asarray(value, dtype=np.float64)
        for index in np.ndindex(array.shape):
            out[name + "".join(f"[{i}]" for i in index)] = float(array[index])
    return out


def _sigmas(side: CalibrationSet | None, names: Mapping[str, float]) -> dict[str, float]:
    known = {} if side is None else _numbers(side.sigma)
    return {name: known.get(name, NAN) for name in names}


def _change(sensor: Sensor, name: str, old: float, new: float, sigma_old: float, sigma_new: float) -> Change:
    known = [sigma for sigma in (sigma_old, sigma_new) if math.isfinite(sigma)]
    sigma = math.hypot(*known) if known else NAN
    return Change(
        name=name,
        old=old,
        new=new,
        change=new - old,
        sigma=sigma,
        change_in_sigma=(new - old) / sigma if sigma > 0 else NAN,
        unit="" if name.partition("[")[0] in _PURE else UNITS[sensor],
    )

"""What a person may set of each sensor's preprocessing: names, units, limits, meaning."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from server.nav.lanes.base import Parameter
from server.nav.preprocess.chain_layout import SENSORS

AXES: Final = ("x", "y", "z")
_UNITS: Final = {
    "gyro": ("rad/s", "rad_s", 100.0),
    "accel": ("m/s²", "m_s2", 1000.0),
    "mag": ("gauss", "gauss", 100.0),
    "baro": ("m", "m", 10_000.0),
    "airspeed": ("Pa", "pa", 100_000.0),
}
"""Sensor → unit, its name in names, the most a limit may be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainInfo:
    """One sensor's chain as a person sets it.

    Attributes:
        name: of `SENSORS`.
        active: its samples go through the chain: something of it is switched on, or a calibration is in force.
        delay_s: what its filters delay at the measured rate; 0 before that is known.
        parameters: what may be set. values: of each of them.
    """

    name: str
    active: bool
    delay_s: float
    parameters: tuple[Parameter, ...]
    values: Mapping[str, float]


def _one(name: str, unit: str, default: float, most: float, meaning: str, least: float = 0.0) -> Parameter:
    return Parameter(name=name, unit=unit, default=default, minimum=least, maximum=most, meaning=meaning)


def _filters(unit: str, word: str, most: float) -> tuple[Parameter, ...]:
    return (
        _one(f"limit_{word}", unit, 0.0, most, "A sample further from the last is replaced by it; 0 = off."),
        _one("limit_count", "", 5.0, 1000.0, "So many replaced in a row, and the new level is accepted.", 1.0),
        _one("butterworth_hz", "Hz", 0.0, 4000.0, "Cut-off of the Butterworth low-pass; 0 = off; lower is smoother."),
        _one("butterworth_order", "", 2.0, 4.0, "Its order; higher cuts more sharply and delays more.", 1.0),
        _one("lowpass_hz", "Hz", 0.0, 4000.0, "Cut-off of the first-order low-pass; 0 = off; lower is smoother."),
        _one("window_samples", "", 1.0, 64.0, "Moving mean over so many samples; 1 = off.", 1.0),
    )


def _vector(sensor: str) -> tuple[Parameter, ...]:
    unit, word, most = _UNITS[sensor]
    full = "End of the range; samples there count as clipped; 0 = found out where it can be."
    return (
        *(_one(f"zero_{axis}_counts", "", 0.0, 1e7, f"Raw counts of zero on {axis}.", -1e7) for axis in AXES),
        _one(f"{word}_per_count", unit, 1.0, 1e6, "Size of one raw count; 1 = the board sends the unit itself.", 1e-12),
        *(
            _one(f"{angle}_deg", "°", 0.0, 360.0, f"How the sensor is turned about {about} against the body.", -360.0)
            for angle, about in (("roll", "forward"), ("pitch", "right"), ("yaw", "down"))
        ),
        *_filters(unit, word, most),
        _one(f"full_scale_{word}", unit, 0.0, most, full),
    )


def _number(sensor: str) -> tuple[Parameter, ...]:
    unit, word, most = _UNITS[sensor]
    full = "End of the pressure sensor's range; samples there count as clipped; 0 = not known."
    return (
        _one("zero_counts", "", 0.0, 1e7, "Raw counts of zero pressure.", -1e7),
        _one("pa_per_count", "Pa", 1.0, 1e6, "Size of one raw count; 1 = the board sends pascal itself.", 1e-12),
        *_filters(unit, word, most),
        _one("full_scale_pa", "Pa", 0.0, 200_000.0, full),
    )


CONVERT: Final = _one(
    "convert", "", 0.0, 1.0, "1: true airspeed from the differential pressure and the air's density; 0: as sent."
)
CHAIN_PARAMETERS: Final[dict[str, tuple[Parameter, ...]]] = {
    **{sensor: _vector(sensor) for sensor in ("gyro", "accel", "mag")},
    "baro": _number("baro"),
    "airspeed": (*_number("airspeed"), CONVERT),
}
WHOLE: Final = frozenset({"limit_count", "butterworth_order", "window_samples", "convert"})


def chain_defaults(sensor: str) -> dict[str, float]:
    """Return every parameter of a sensor at its default."""
    return {parameter.name: parameter.default for parameter in CHAIN_PARAMETERS[sensor]}


def check_chain(sensor: str, values: Mapping[str, float]) -> None:
    """Raise ValueError, naming value, limits and remedy, for what a sensor's chain does not take."""
    if sensor not in CHAIN_PARAMETERS:
        raise ValueError(f"no chain of {sensor}; there are: {', '.join(SENSORS)}")
    known = {parameter.name: parameter for parameter in CHAIN_PARAMETERS[sensor]}
    for name, value in values.items():
        if name not in known:
            raise ValueError(f"the chain of {sensor} has no parameter {name}; there are: {', '.join(known)}")
        one = known[name]
        unit = f" {one.unit}" if one.unit else ""
        if not one.minimum <= value <= one.maximum:
            raise ValueError(
                f"{sensor}.{name} = {value:g}{unit} is outside {one.minimum:g} … {one.maximum:g}{unit};"
                f" the default is {one.default:g}"
            )
        if name in WHOLE and not math.isclose(value, round(value)):
            raise ValueError(f"{sensor}.{name} = {value:g} is not a whole number")

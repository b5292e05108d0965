"""The closed list of column names that a CSV may have, and what becomes of each."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final

from server.nav.calibration.types import GRAVITY_M_S2, CalKind
from server.nav.types import SAMPLE_COLUMNS, Kind

AXES: Final = "xyz"
_DEG: Final = math.pi / 180.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """Where a column goes: value in the row = factor · cell + shift; raw data keep the cell.

    Attributes:
        sensor: "gyro", "accel", "mag", "pressure", "altitude", "diff_pressure", "tas", "temperature".
        place: column of `SAMPLE_COLUMNS[kind]`; of temperature, that of the IMU.
        unit: as written in the name, "" when it names none.
    """

    sensor: str
    kind: Kind
    place: int
    unit: str
    factor: float = 1.0
    shift: float = 0.0


_VECTORS: Final = {
    "gyro": (Kind.IMU, 0, ("gyro", "gyr"), "g", {"rad_s": 1.0, "mrad_s": 1e-3, "deg_s": _DEG, "dps": _DEG}),
    "accel": (
        Kind.IMU,
        3,
        ("accel", "acc"),
        "a",
        {"m_s2": 1.0, "g": GRAVITY_M_S2, "mg": 1e-3 * GRAVITY_M_S2},
    ),
    "mag": (
        Kind.MAG,
        0,
        ("mag",),
        "m",
        {"gauss": 1.0, "mgauss": 1e-3, "milligauss": 1e-3, "ut": 1e-2, "nt": 1e-5},
    ),
}
_SCALARS: Final = {
    "pressure": (Kind.BARO, 0, {"pa": (1.0, 0.0), "hpa": (1e2, 0.0), "mbar": (1e2, 0.0), "kpa": (1e3, 0.0)}),
    "altitude": (Kind.BARO, 1, {"m": (1.0, 0.0)}),
    "diff_pressure": (Kind.AIRSPEED, 0, {"pa": (1.0, 0.0), "hpa": (1e2, 0.0), "mbar": (1e2, 0.0), "kpa": (1e3, 0.0)}),
    "tas": (Kind.AIRSPEED, 1, {"m_s": (1.0, 0.0)}),
    "temperature": (Kind.IMU, 6, {"degc": (1.0, 0.0), "k": (1.0, -273.15)}),
}


def _names() -> dict[str, Target]:
    """Return every accepted name."""
    found = {}
    for sensor, (kind, first, stems, letter, units) in _VECTORS.items():
        for at, axis in enumerate(AXES):
            for stem in stems:
                for unit, factor in {"": 1.0, **units}.items():
                    name = f"{stem}_{axis}_{unit}".rstrip("_")
                    found[name] = Target(sensor=sensor, kind=kind, place=first + at, unit=unit, factor=factor)
            found[letter + axis] = Target(sensor=sensor, kind=kind, place=first + at, unit="")
    for sensor, (kind, place, scales) in _SCALARS.items():
        for unit, (factor, shift) in {"": (1.0, 0.0), **scales}.items():
            name = f"{sensor}_{unit}".rstrip("_")
            found[name] = Target(sensor=sensor, kind=kind, place=place, unit=unit, factor=factor, shift=shift)
    return found


NAMES: Final = _names()
TIMES: Final = {
    f"{stem}_{unit}": scale
    for unit, scale in (("ns", 1.0), ("us", 1e3), ("ms", 1e6), ("s", 1e9))
    for stem in ("t", "time", "timestamp")
}
"""Names of time columns → nanoseconds a unit, the finest first."""
BARE_TIMES: Final = ("t", "time", "timestamp")
"""Seconds, when their steps are those of seconds."""

TEMPERATURE_PLACE: Final = {
    kind: SAMPLE_COLUMNS[kind].index("temperature_degc") for kind in (Kind.IMU, Kind.BARO, Kind.AIRSPEED)
}
SI_UNITS: Final = {"gyro": "rad/s", "accel": "m/s²", "mag": "gauss", "pressure": "Pa", "diff_pressure": "Pa"}

SENSOR_OF_XYZ: Final = {
    CalKind.GYRO_BIAS: "gyro",
    CalKind.GYRO_SCALE: "gyro",
    CalKind.ACCEL_SIX_POSITION: "accel",
    CalKind.ACCEL_MULTI_POSE: "accel",
    CalKind.LEVEL: "accel",
    CalKind.MAG_ELLIPSOID: "mag",
    CalKind.MAG_FIXED_HEADING: "mag",
    CalKind.MAG_IN_FLIGHT: "mag",
}
"""Which sensor x, y, z are."""

NEEDED: Final[dict[CalKind, tuple[tuple[str, ...], ...]]] = {
    **{kind: ((sensor,),) for kind, sensor in SENSOR_OF_XYZ.items()},
    CalKind.MAG_FIXED_HEADING: (("mag",), ("accel",), ("gyro",)),
    CalKind.MAG_IN_FLIGHT: (("mag",), ("accel",), ("gyro",)),
    CalKind.AIRSPEED_ZERO: (("diff_pressure",),),
    CalKind.BARO_REFERENCE: (("pressure", "altitude"),),
}
"""Groups of sensors, the calibrated one first; each group needs one of its sensors."""
MAIN_KIND: Final = {
    kind: next(target.kind for target in NAMES.values() if target.sensor == groups[0][0])
    for kind, groups in NEEDED.items()
}
"""Samples of the calibrated sensor: what may be raw, and what ranges count."""

_SENSOR_LIKE: Final = re.compile(r"(?:(gyro|gyr)|(accel|acc)|(mag))_?[xyz](?:_|$)")
_TIME_LIKE: Final = re.compile(r"(?:t|time|timestamp)(?:_|$)")


def plain(name: str) -> str:
    """Return a name as the list has it: lower case, blanks and hyphens as underscores, quotes off."""
    return re.sub(r"[\s-]+", "_", name.strip().strip("\"'").strip().lower())


def looks_like(name: str) -> str:
    """Return the sensor ("time" too) that a name not in the list seems to mean, or ""."""
    if _TIME_LIKE.match(name):
        return "time"
    found = _SENSOR_LIKE.match(name)
    return next(sensor for sensor, part in zip(_VECTORS, found.groups(), strict=True) if part) if found else ""


def accepted(sensor: str) -> str:
    """Return the names a sensor's first column may have, for a message."""
    if sensor == "time":
        return ", ".join(("t_ns", "t_us", "t_ms", "t_s"))
    if sensor in _VECTORS:
        stem, units = _VECTORS[sensor][2][0], _VECTORS[sensor][4]
        return ", ".join(f"{stem}_x_{unit}" for unit in units) + f" (and y, z), or {stem}_x or x with --unit"
    return ", ".join(f"{sensor}_{unit}" for unit in _SCALARS[sensor][2])

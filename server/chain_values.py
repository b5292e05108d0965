"""SENSOR.PARAMETER=VALUE of the preprocessing, as a person writes it in a setting or on the command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from server.lane_values import LaneValues, lane_values

TOGETHER: Final = {"imu": ("gyro", "accel"), "board": ("gyro", "accel", "mag")}
"""Names that stand for several sensors: "imu.butterworth_hz=40", "board.mounting=roll180"."""
MOUNTING: Final = "mounting"


def chain_values(texts: Iterable[str]) -> LaneValues:
    """Return sensor → parameter → value; the last one of the same parameter wins.

    `SENSOR.mounting=NAME` stands for the three angles of a mounting by name, as in "board.mounting=roll180yaw90".

    Raises:
        ValueError: a text is not SENSOR.PARAMETER=VALUE with a finite number, or names a mounting that there is not.
            Whether there is such a sensor and parameter, and its limits, is the engine's to say.
    """
    found: LaneValues = {}
    for text in texts:
        for plain in _plain(text):
            for sensor, values in lane_values((plain,)).items():
                found.setdefault(sensor, {}).update(values)
    return found


def _plain(text: str) -> list[str]:
    """Return the text as one or several of a single sensor and a number."""
    place, _, value = text.partition("=")
    sensor, _, name = (part.strip() for part in place.partition("."))
    sensors = TOGETHER.get(sensor, (sensor,))
    if name != MOUNTING:
        return [f"{one}.{name}={value}" for one in sensors] if sensor in TOGETHER else [text]
    from server.nav.preprocess.units import mounting_deg  # loads kernels

    angles = zip(("roll", "pitch", "yaw"), mounting_deg(value), strict=True)
    return [f"{one}.{axis}_deg={angle:g}" for axis, angle in angles for one in sensors]


def changed_chain(values: Mapping[str, Mapping[str, float]]) -> LaneValues:
    """Return those that differ from the default."""
    from server.nav.preprocess.chain_parameters import chain_defaults  # loads kernels

    changed = {
        sensor: {name: value for name, value in own.items() if value != chain_defaults(sensor).get(name)}
        for sensor, own in values.items()
    }
    return {sensor: own for sensor, own in changed.items() if own}

"""What a format cannot hold, said with its size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from server.calibration.exchange.parameters import Found
from server.nav.calibration.types import GRAVITY_M_S2, Sensor
from server.nav.types import Float

FLOAT32_LIMIT: Final = 1e-6  # relative; a float32 parameter rounds to 6e-8, what is below is not a loss


def warn_cross_axis(found: Found, sensor: Sensor, matrix: Float) -> None:
    """Say how much an accelerometer's terms off the diagonal are, which the format does not have."""
    size = float(np.abs(matrix - np.diag(np.diag(matrix))).max())
    if size > FLOAT32_LIMIT:
        text = (
            f"Cross-axis terms of the {sensor} up to {size:.2g} are lost, {size * GRAVITY_M_S2:.2g} m/s² at 1 g: the "
            "format has a scale of each axis only."
        )
        found.warn("cross-axis-lost", text, sensor, size * GRAVITY_M_S2, "m/s²")


def warn_lost_scale(found: Found, matrix: Float) -> None:
    """Say how much a gyroscope's scale is, which neither format has."""
    size = float(np.abs(matrix - np.eye(3)).max())
    if size > FLOAT32_LIMIT:
        text = f"The gyro's scale is lost: the format has an offset only. A rate is wrong by up to {size:.2%}."
        found.warn("scale-lost", text, Sensor.GYRO, size)


def warn_skew(found: Found, matrix: Float) -> None:
    """Say how far a magnetometer's matrix is from the symmetric one the format has."""
    size = float(np.abs(matrix - matrix.T).max() / 2)
    if size > FLOAT32_LIMIT:
        text = f"The magnetometer's matrix is not symmetric: {size:.2g} of the field is lost, about {size:.2g} rad."
        found.warn("cross-axis-lost", text, Sensor.MAG, size)


def warn_rotation(found: Found, yaw_rad: float) -> None:
    """Say what heading part of the mounting the format does not have."""
    if abs(yaw_rad) > FLOAT32_LIMIT:
        text = f"The mounting's turn about the vertical, {np.degrees(yaw_rad):.3f}°, is lost: there is roll and pitch."
        found.warn("yaw-lost", text, Sensor.BOARD, yaw_rad, "rad")


def warn_outside(found: Found, limits: Mapping[tuple[str, str, str], tuple[float, float]]) -> None:
    """Say which values the autopilot will not take."""
    for names, (lowest, highest) in limits.items():
        for name in names:
            value = found.parameters.get(name)
            if value is not None and not lowest <= value <= highest:
                text = f"{name} {value:.6g} is outside {lowest:g} to {highest:g}: the autopilot may refuse to arm."
                found.warn("out-of-range", text, _sensor_of(name), value)


def _sensor_of(name: str) -> Sensor:
    if name.startswith("COMPASS"):
        return Sensor.MAG
    return Sensor.BOARD if "TRIM" in name else Sensor.ACCEL

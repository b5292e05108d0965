"""What the engine says when somebody changes a calibration or the preprocessing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from server.nav.calibration.applied import Calibration
from server.nav.types import Event, Float

ANEW: Final = "The vehicle is not under way: the estimators start anew. Hold it still for a few seconds."
GOES_ON: Final = "The estimators go on with their biases carried over; nothing to do."
PARTS: Final = (("gyro", "rad_s"), ("accel", "m_s2"), ("mag", "gauss"))


def calibration_event(calibration: Calibration, t_ns: int, *, anew: bool) -> Event:
    """Return the event of a calibration that has just come into force: its offsets, and how much it stretches."""
    if calibration.is_identity:
        text = "Every calibration was taken off: the sensors are used as the board sends them."
    else:
        text = "Another calibration is in force."
    text += f" {ANEW if anew else GOES_ON}"
    return Event(t_ns=t_ns, code="calibration-applied", severity="info", text=text, values=_numbers(calibration))


def _numbers(calibration: Calibration) -> tuple[tuple[str, float], ...]:
    found: list[tuple[str, float]] = []
    for name, unit in PARTS:
        matrix: Float = getattr(calibration, f"{name}_matrix")
        offset: Float = getattr(calibration, f"{name}_offset")
        found += [(f"{name}_offset_{axis}_{unit}", float(value)) for axis, value in zip("xyz", offset, strict=True)]
        found.append((f"{name}_stretch", float(np.abs(matrix - np.eye(3)).max())))
    level_rad = float(np.arccos(np.clip(0.5 * (np.trace(calibration.level) - 1.0), -1.0, 1.0)))
    found += [
        ("level_rad", level_rad),
        ("diff_pressure_bias_pa", calibration.diff_pressure_bias_pa),
        ("baro_bias_m", calibration.baro_bias_m),
    ]
    return tuple(found)


def level_event(t_ns: int) -> Event:
    """Return the event of a board that sits differently in its vehicle from now on."""
    text = (
        "The level was changed, and with it the body's axes: every estimator starts anew."
        " Hold the vehicle still for a few seconds."
    )
    return Event(t_ns=t_ns, code="calibration-level-changed", severity="caution", text=text)


def chain_event(sensor: str, values: Mapping[str, float], t_ns: int) -> Event:
    """Return the event of filters, units or a mounting that were changed."""
    text = f"The preprocessing of {sensor} was changed; its filters start anew. Nothing to do."
    return Event(
        t_ns=t_ns,
        code="chain-changed",
        severity="info",
        text=text,
        values=tuple((f"{sensor}_{name}", float(value)) for name, value in values.items()),
    )

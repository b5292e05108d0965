"""Made logs and rows whose truth is known."""

import math
from pathlib import Path

import numpy as np

from server.compare.signals import Rows
from server.nav.types import ROW_WIDTH

SPACING_S = 0.02


def swinging(t_s, roll_amplitude_rad=0.4):
    """Attitude, place and velocity of something that rolls, climbs and travels smoothly; columns of a reference."""
    roll = roll_amplitude_rad * (np.sin(1.7 * t_s) + 0.5 * np.sin(4.1 * t_s))
    data = np.full((len(t_s), ROW_WIDTH), np.nan)
    data[:, 0], data[:, 1], data[:, 2], data[:, 3] = np.cos(roll / 2), np.sin(roll / 2), 0.0, 0.0
    data[:, 4], data[:, 5] = 47.0, 8.0
    data[:, 6] = 500.0 - np.cos(1.3 * t_s) / 1.3 - np.cos(2.9 * t_s) / 2.9
    data[:, 7], data[:, 8] = 2.0 * np.sin(0.9 * t_s), np.cos(0.7 * t_s)
    data[:, 9] = -np.sin(1.3 * t_s) - np.sin(2.9 * t_s)
    return data


def rows_at(t_s, late_s=0.0, **kwargs):
    """Rows stamped t that say what was true `late_s` before."""
    return Rows(t_ns=np.round(t_s * 1e9).astype(np.int64), data=swinging(t_s - late_s, **kwargs))


def cut_log(source: Path, target: Path, megabytes: float) -> Path:
    """Copy the beginning of a log."""
    with source.open("rb") as file:
        target.write_bytes(file.read(math.floor(megabytes * 1e6)))
    return target

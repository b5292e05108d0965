"""A calibration on its way into the chain: is it one, and what the filters remember under the new one."""

from __future__ import annotations

from typing import Final

import numpy as np

from server.nav.calibration.applied import Calibration
from server.nav.preprocess import chain_layout as at
from server.nav.types import Float

LEAST_STRETCH: Final = 1e-3
MOST_STRETCH: Final = 1e3


def check_calibration(calibration: Calibration) -> None:
    """Raise ValueError for a calibration that would make numbers no numbers."""
    flat = calibration.flat()
    if not np.isfinite(flat).all():
        raise ValueError("the calibration holds a number that is not finite; make it anew")
    for sensor, name in enumerate(at.SENSORS[: at.MAG + 1]):
        stretch = np.linalg.svd(flat[12 * sensor : 12 * sensor + 9].reshape(3, 3), compute_uv=False)
        if not LEAST_STRETCH < stretch[-1] <= stretch[0] < MOST_STRETCH:
            raise ValueError(
                f"the {name} matrix stretches by {stretch[-1]:g} to {stretch[0]:g}; it must stay between"
                f" {LEAST_STRETCH:g} and {MOST_STRETCH:g}. Give raw counts their unit first (per_count)"
            )


def move_states(c: Float, sensor: int, A: Float, d: Float) -> None:
    """Apply x → A x + d to what one sensor's filters remember of x."""
    b, n = at.block_at(sensor), at.CHANNELS[sensor]
    z = c[b + at.B_STATES : b + at.B_STATES + n * at.Z_SIZE].reshape(n, at.Z_SIZE)
    steady = np.ones(at.Z_SIZE)  # of each state for a constant input of 1; the filters are linear
    k = c[b + at.B_COEFFICIENTS : b + at.B_COEFFICIENTS + 5 * at.SECTIONS].reshape(at.SECTIONS, 5)
    steady[at.Z_SECTIONS : at.Z_LOWPASS] = np.stack((1.0 - k[:, 0], k[:, 2] - k[:, 4]), axis=1).ravel()
    rejected = z[:, at.Z_REJECTED].copy()
    z[:] = A @ z + np.outer(d, steady)
    z[:, at.Z_REJECTED] = rejected

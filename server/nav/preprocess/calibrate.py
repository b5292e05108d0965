"""The calibration in force on one sample: matrix · (raw − offset − per kelvin · warming)."""

from __future__ import annotations

import math

from server.nav.calibration.applied import C_ACCEL, C_ACCEL_PER_K, C_GYRO, C_GYRO_PER_K, C_MAG, C_REFERENCE_DEGC
from server.nav.kernel import kernel
from server.nav.preprocess.chain_layout import K_CAL, K_LEARNED
from server.nav.types import Float


@kernel("void(float64[::1], int64, float64, float64, float64, float64[::1], int64)")
def _affine(c: Float, at: int, ox: float, oy: float, oz: float, row: Float, first: int) -> None:
    """Set three numbers of the row to M (raw − offset − o); M and the offset stand at c[at:]."""
    x, y, z = row[first] - c[at + 9] - ox, row[first + 1] - c[at + 10] - oy, row[first + 2] - c[at + 11] - oz
    for i in range(3):
        row[first + i] = c[at + 3 * i] * x + c[at + 3 * i + 1] * y + c[at + 3 * i + 2] * z


@kernel("void(float64[::1], float64[::1])")
def calibrate_imu(c: Float, row: Float) -> None:
    """Calibrate rate (row[:3], rad/s) and specific force (row[3:6], m/s²) in place; row[6] is °C or NaN."""
    warm = row[6] - c[K_CAL + C_REFERENCE_DEGC]
    if not math.isfinite(warm):
        warm = 0.0
    k = K_CAL + C_GYRO_PER_K
    _affine(c, K_CAL + C_GYRO, warm * c[k], warm * c[k + 1], warm * c[k + 2], row, 0)
    k = K_CAL + C_ACCEL_PER_K
    _affine(c, K_CAL + C_ACCEL, warm * c[k], warm * c[k + 1], warm * c[k + 2], row, 3)


@kernel("void(float64[::1], float64[::1])")
def calibrate_mag(c: Float, row: Float) -> None:
    """Calibrate the field (row[:3], gauss) in place and take off what was learned in flight."""
    _affine(c, K_CAL + C_MAG, 0.0, 0.0, 0.0, row, 0)
    for i in range(3):
        row[i] -= c[K_LEARNED + i]

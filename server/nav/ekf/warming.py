"""Biases that run with the board's temperature: they walk faster while it changes than when it has settled."""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf.layout import (
    A_TEMPERATURE,
    A_WARMING,
    PAR_ACCEL_PER_K,
    PAR_GYRO_PER_K,
    U_DT,
    U_TEMPERATURE,
)
from server.nav.ekf.states import ACCEL_BIAS, GYRO_BIAS, packed
from server.nav.kernel import kernel
from server.nav.types import Float

SMOOTH_S: Final = 10.0  # thermometers on the chip have hundredths of a kelvin; boards warm up over minutes
GYRO_DRIFT_RAD_S2: Final = 2e-6
GYRO_LEARNED_S: Final = 50.0
ACCEL_DRIFT_M_S3: Final = 4e-5
ACCEL_LEARNED_S: Final = 25.0
"""At such a drift a bias is learned over such a time: the gyro's from the heading, the slower one, the accelerometer's
from the velocity. Round numbers with which campaigns on the demo board are consistent."""
SLOWER: Final = 0.4


@kernel("float64(float64, float64, float64)")
def walk(drift: float, usual: float, learned_s: float) -> float:
    """Return the random walk density squared that goes as far as a ramp while the filter learns it.

    A bias of walk q that is measured through an integral is learned over T = (R/q)^(1/4), and q = drift² T: a slower
    drift is learned over a longer time, T = learned_s (usual/drift)^0.4.

    Args:
        drift: of the bias, its unit per second, ≥ 0.
        usual: the drift at which it is learned over learned_s.
        learned_s: s.
    """
    if not drift > 0.0:
        return 0.0
    return float(drift * drift * learned_s * (usual / drift) ** SLOWER)


@kernel("void(float64[::1], float64[::1])")
def note_temperature(u: Float, aux: Float) -> None:
    """Follow how fast the board warms up: the smoothed temperature lags a ramp by its slope times `SMOOTH_S`.

    Args:
        u: shape (U_SIZE,), the step; its temperature in °C may be NaN.
        aux: shape (A_SIZE,), memory: A_TEMPERATURE °C and A_WARMING K/s are written.
    """
    t = u[U_TEMPERATURE]
    if not math.isfinite(t):
        return
    if math.isnan(aux[A_TEMPERATURE]):
        aux[A_TEMPERATURE] = t
    share = min(1.0, u[U_DT] / SMOOTH_S)
    aux[A_TEMPERATURE] += share * (t - aux[A_TEMPERATURE])
    aux[A_WARMING] += share * ((t - aux[A_TEMPERATURE]) / SMOOTH_S - aux[A_WARMING])


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def walk_with_temperature(P: Float, u: Float, par: Float, aux: Float) -> None:
    """Add to the biases' variances what the present warming moves them by.

    Args:
        P: shape (PACKED,), covariance, changed in place.
        u, par, aux: step, parameters and memory, `layout`.
    """
    rate = abs(aux[A_WARMING])
    gyro = walk(par[PAR_GYRO_PER_K] * rate, GYRO_DRIFT_RAD_S2, GYRO_LEARNED_S) * u[U_DT]
    accel = walk(par[PAR_ACCEL_PER_K] * rate, ACCEL_DRIFT_M_S3, ACCEL_LEARNED_S) * u[U_DT]
    for i in range(3):
        P[packed(GYRO_BIAS + i, GYRO_BIAS + i)] += gyro
        P[packed(ACCEL_BIAS + i, ACCEL_BIAS + i)] += accel

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
GYRO_LEARNED_S: Final = 30.0
ACCEL_LEARNED_S: Final = 12.0
"""A ramp is told as the random walk that goes as far in the time over which the filter learns a bias: the gyro's from
the heading, the slower one, the accelerometer's from the velocity."""


@kernel("void(float64[::1], float64[::1])")
def note_temperature(u: Float, aux: Float) -> None:
    """Follow how fast the board warms up: the smoothed temperature lags a ramp by its slope times `SMOOTH_S`."""
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
    """Add to the biases' variances what the present warming moves them by."""
    rate2 = aux[A_WARMING] * aux[A_WARMING] * u[U_DT]
    gyro = par[PAR_GYRO_PER_K] * par[PAR_GYRO_PER_K] * GYRO_LEARNED_S * rate2
    accel = par[PAR_ACCEL_PER_K] * par[PAR_ACCEL_PER_K] * ACCEL_LEARNED_S * rate2
    for i in range(3):
        P[packed(GYRO_BIAS + i, GYRO_BIAS + i)] += gyro
        P[packed(ACCEL_BIAS + i, ACCEL_BIAS + i)] += accel

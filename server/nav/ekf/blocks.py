"""Switching the magnetic and wind blocks of the filter on, with what is known of them before any measurement."""

from __future__ import annotations

import math

from server.nav.ekf.layout import (
    A_DECLINATION,
    A_FIELD_D,
    A_FIELD_H,
    C_HAS_FIELD,
    PAR_DECLINATION_SIGMA,
    PAR_FIELD_SIGMA,
    PAR_MAG_BIAS_SIGMA,
    PAR_WIND_SIGMA,
    W_DIM,
)
from server.nav.ekf.states import FIELD, MAG_BIAS, WIND, WITH_MAG, X_FIELD, X_MAG_BIAS, X_WIND, N, packed
from server.nav.ekf.update import reset_axis
from server.nav.kernel import kernel
from server.nav.types import Float, Int


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], int64[::1])")
def start_field(x: Float, P: Float, par: Float, aux: Float, ctl: Int) -> None:
    """Set the Earth field to the model's, or to the one found at alignment, with the error of either.

    Across magnetic north the model errs by the declination's σ; in the vertical plane, along the field and in dip, by a
    share of the strength that also covers scale and soft iron of the sensor, so that a dip which does not fit is not
    taken for tilt. Without a model east is zero by definition: the heading then counts from magnetic north.
    """
    h, d, D = aux[A_FIELD_H], aux[A_FIELD_D], aux[A_DECLINATION]
    c, s = math.cos(D), math.sin(D)
    x[X_FIELD], x[X_FIELD + 1], x[X_FIELD + 2] = h * c, h * s, d
    share = par[PAR_FIELD_SIGMA] ** 2 * (h * h + d * d)
    across = (par[PAR_DECLINATION_SIGMA] * h) ** 2 if ctl[C_HAS_FIELD] else 0.0
    for i in range(3):
        reset_axis(P, FIELD + i, share)
    P[packed(FIELD, FIELD)] = share * c * c + across * s * s
    P[packed(FIELD + 1, FIELD + 1)] = share * s * s + across * c * c
    P[packed(FIELD + 1, FIELD)] = (share - across) * s * c


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])")
def switch_mag_on(x: Float, P: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Activate Earth field and magnetic bias, the latter zero with the σ that a calibration leaves."""
    work[W_DIM] = max(work[W_DIM], float(WITH_MAG))
    start_field(x, P, par, aux, ctl)
    for i in range(3):
        x[X_MAG_BIAS + i] = 0.0
        reset_axis(P, MAG_BIAS + i, par[PAR_MAG_BIAS_SIGMA] ** 2)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def switch_wind_on(x: Float, P: Float, par: Float, work: Float) -> None:
    """Activate the wind, calm with the σ of ordinary weather; a magnetic block that is absent stays at zero."""
    work[W_DIM] = float(N)
    for i in range(2):
        x[X_WIND + i] = 0.0
        reset_axis(P, WIND + i, par[PAR_WIND_SIGMA] ** 2)

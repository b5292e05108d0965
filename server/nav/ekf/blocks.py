"""Switching the optional blocks of the filter on, with what is known of them before any measurement."""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf.layout import (
    A_DECLINATION,
    A_FIELD_D,
    A_FIELD_H,
    C_HAS_FIELD,
    PAR_DECLINATION_SIGMA,
    PAR_DRAG_K,
    PAR_DRAG_K_SIGMA,
    PAR_FIELD_SIGMA,
    PAR_MAG_BIAS_SIGMA,
    PAR_WIND_SIGMA,
    W_DIM,
    W_DX,
    W_H,
)
from server.nav.ekf.states import (
    ATT,
    BARO,
    DRAG,
    FIELD,
    JITTER,
    MAG_BIAS,
    MIX,
    POS,
    WANDER,
    WIND,
    WITH_BARO,
    WITH_DRAG,
    WITH_JITTER,
    WITH_MAG,
    WITH_WANDER,
    WITH_WIND,
    X_BARO,
    X_DRAG,
    X_FIELD,
    X_JITTER,
    X_MAG_BIAS,
    X_WANDER,
    X_WIND,
    N,
    packed,
)
from server.nav.ekf.update import clear_row, correction_seen, fuse, inject, project, reset_axis
from server.nav.kernel import kernel
from server.nav.types import Float, Int

UNKNOWN_SHARE: Final = 0.05  # error of a field that is only measured, before a model says what it should be


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
    known = par[PAR_FIELD_SIGMA] if ctl[C_HAS_FIELD] else max(UNKNOWN_SHARE, par[PAR_FIELD_SIGMA])
    share = known**2 * (h * h + d * d)
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


@kernel("void(float64[::1], float64[::1], float64, float64)")
def turn_field(x: Float, P: Float, angle_rad: float, variance: float) -> None:
    """Turn the Earth field about down by the declination just learned; the heading has been turned by it already.

    The declination's error is one error of both, so it changes nothing that the magnetometer sees.

    Args:
        x, P: shape (X_SIZE,) and (PACKED,), changed in place.
        angle_rad: declination, east of north.
        variance: of it, rad².
    """
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    n, e = x[X_FIELD], x[X_FIELD + 1]
    x[X_FIELD], x[X_FIELD + 1] = c * n - s * e, s * n + c * e
    nn, ne, ee = P[packed(FIELD, FIELD)], P[packed(FIELD, FIELD + 1)], P[packed(FIELD + 1, FIELD + 1)]
    for j in range(N):
        if j != FIELD and j != FIELD + 1:
            a, b = P[packed(FIELD, j)], P[packed(FIELD + 1, j)]
            P[packed(FIELD, j)], P[packed(FIELD + 1, j)] = c * a - s * b, s * a + c * b
    P[packed(FIELD, FIELD)] = c * c * nn - 2.0 * c * s * ne + s * s * ee
    P[packed(FIELD, FIELD + 1)] = c * s * (nn - ee) + (c * c - s * s) * ne
    P[packed(FIELD + 1, FIELD + 1)] = s * s * nn + 2.0 * c * s * ne + c * c * ee
    gn, ge = -x[X_FIELD + 1], x[X_FIELD]
    P[packed(ATT + 2, ATT + 2)] += variance
    P[packed(FIELD, ATT + 2)] += gn * variance
    P[packed(FIELD + 1, ATT + 2)] += ge * variance
    P[packed(FIELD, FIELD)] += gn * gn * variance
    P[packed(FIELD + 1, FIELD)] += gn * ge * variance
    P[packed(FIELD + 1, FIELD + 1)] += ge * ge * variance


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])")
def fuse_field_model(x: Float, P: Float, par: Float, aux: Float, work: Float) -> None:
    """Correct the field towards the model's strength, horizontal and down, as far as the model's σ allows.

    Args:
        x, P: shape (X_SIZE,) and (PACKED,), changed in place.
        par, aux, work: parameters, memory (A_FIELD_H and A_FIELD_D in gauss) and scratch, `layout`.
    """
    c, s = math.cos(aux[A_DECLINATION]), math.sin(aux[A_DECLINATION])
    h, d = aux[A_FIELD_H], aux[A_FIELD_D]
    variance = par[PAR_FIELD_SIGMA] ** 2 * (h * h + d * d) + 1e-12
    for i in range(N):
        work[W_DX + i] = 0.0
    clear_row(work)
    work[W_H + FIELD], work[W_H + FIELD + 1] = c, s
    total = project(P, work) + variance
    fuse(P, work, h - c * x[X_FIELD] - s * x[X_FIELD + 1], total)
    clear_row(work)
    work[W_H + FIELD + 2] = 1.0
    total = project(P, work) + variance
    fuse(P, work, d - x[X_FIELD + 2] - correction_seen(work), total)
    inject(x, P, work)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def switch_wind_on(x: Float, P: Float, par: Float, work: Float) -> None:
    """Activate the wind, calm with the σ of ordinary weather; a magnetic block that is absent stays at zero."""
    work[W_DIM] = max(work[W_DIM], float(WITH_WIND))
    for i in range(2):
        x[X_WIND + i] = 0.0
        reset_axis(P, WIND + i, par[PAR_WIND_SIGMA] ** 2)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def switch_drag_on(x: Float, P: Float, par: Float, work: Float) -> None:
    """Activate a multirotor's drag, with what airframes have, and the wind that it is felt against."""
    if not P[packed(WIND, WIND)] > 0.0:
        switch_wind_on(x, P, par, work)
    work[W_DIM] = max(work[W_DIM], float(WITH_DRAG))
    x[X_DRAG] = par[PAR_DRAG_K]
    reset_axis(P, DRAG, par[PAR_DRAG_K_SIGMA] ** 2)


@kernel("void(float64[::1], float64[::1], float64[::1], float64, float64)")
def start_datum(x: Float, P: Float, work: Float, offset_m: float, variance: float) -> None:
    """Set the baro's datum from the height: what is known of the height becomes what is known of the datum.

    Args:
        offset_m: height less baro height.
        variance: of one baro height, m².
    """
    work[W_DIM] = max(work[W_DIM], float(WITH_BARO))
    x[X_BARO] = offset_m
    for j in range(N):
        if j != BARO:
            P[packed(BARO, j)] = -P[packed(POS + 2, j)]
    P[packed(BARO, BARO)] = P[packed(POS + 2, POS + 2)] + variance


@kernel("void(float64[::1], float64[::1], float64[::1], float64, float64)")
def start_wander(x: Float, P: Float, work: Float, sigma_m: float, sigma_d_m: float) -> None:
    """Activate the slow error of the receiver's position, zero with its long-term σ, horizontal and down."""
    work[W_DIM] = max(work[W_DIM], float(WITH_WANDER))
    for i in range(3):
        x[X_WANDER + i] = 0.0
        reset_axis(P, WANDER + i, sigma_m**2 if i < 2 else sigma_d_m**2)


@kernel("void(float64[::1], float64[::1], float64[::1], float64, float64)")
def start_jitter(x: Float, P: Float, work: Float, sigma_m: float, sigma_d_m: float) -> None:
    """Activate the quick error of the receiver's position likewise."""
    work[W_DIM] = max(work[W_DIM], float(WITH_JITTER))
    for i in range(3):
        x[X_JITTER + i] = 0.0
        reset_axis(P, JITTER + i, sigma_m**2 if i < 2 else sigma_d_m**2)


@kernel("void(float64[::1], float64[::1], float64, float64)")
def start_mix(P: Float, work: Float, scale: float, cross: float) -> None:
    """Activate the errors of the gyro's scale and axes with the σ told; what was learned of them before is kept."""
    work[W_DIM] = float(N)
    for i in range(9):
        reset_axis(P, MIX + i, scale**2 if i % 4 == 0 else cross**2)

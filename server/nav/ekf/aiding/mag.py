"""Magnetic field: its horizontal part across magnetic north corrects the heading.

The measured field is turned into NED with the present attitude; what lies across the model's horizontal direction is
the innovation. Strength and the component along north are not fused: iron and a wrong scale show there first.
"""

from __future__ import annotations

import math
from typing import Final

from numba import njit

from server.nav.codes import FUSED, REFUSED_DISTURBED, REFUSED_GATE
from server.nav.ekf.layout import (
    A_DECLINATION,
    A_FIELD_D,
    A_FIELD_H,
    C_HAS_FIELD,
    H_DATA,
    H_STATUS,
    H_T,
    H_VAR,
    HANDLER,
    PAR_GATE,
    PAR_MAG_NOISE,
    U_GYRO,
    U_T,
    UNDECIDED,
    W_H,
    W_INNOV,
    W_OBS,
    W_PRED,
    W_RATIO,
    W_VAR,
)
from server.nav.ekf.states import ATT, DECLINATION, X_DECLINATION, X_GYRO_BIAS, X_Q
from server.nav.ekf.update import clear_row, correction_seen, fuse, project
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int

STRENGTH_TOLERANCE: Final = 0.25
"""Share of the model's strength; crustal anomalies stay under 10 %, uncalibrated soft iron under 20 %."""


@njit("UniTuple(float64, 3)(float64[::1], float64[::1], float64[::1])", cache=True)
def field_in_ned(h: Float, x: Float, u: Float) -> tuple[float, float, float]:
    """Return the measured field in NED, gauss, turned with the attitude at the measurement's own time."""
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    tau = (h[H_T] - u[U_T]) * 1e-9
    wx = tau * (u[U_GYRO] - x[X_GYRO_BIAS])
    wy = tau * (u[U_GYRO + 1] - x[X_GYRO_BIAS + 1])
    wz = tau * (u[U_GYRO + 2] - x[X_GYRO_BIAS + 2])
    bx, by, bz = h[H_DATA], h[H_DATA + 1], h[H_DATA + 2]
    mx, my, mz = bx + wy * bz - wz * by, by + wz * bx - wx * bz, bz + wx * by - wy * bx
    return (
        R[0] * mx + R[1] * my + R[2] * mz,
        R[3] * mx + R[4] * my + R[5] * mz,
        R[6] * mx + R[7] * my + R[8] * mz,
    )


@njit(HANDLER, cache=True)
def heading(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Handle a magnetic field in the body, gauss; decide at first use, then correct.

    With z = R_nb m_b, the model m_n = (Bh cos D, Bh sin D, Bz) and e across magnetic north, z·e = δθ·(e × m_n) + Bh δD.
    """
    z = field_in_ned(h, x, u)
    declination = aux[A_DECLINATION] + x[X_DECLINATION]
    cd, sd = math.cos(declination), math.sin(declination)
    Bh, Bz = aux[A_FIELD_H], aux[A_FIELD_D]
    work[W_PRED], work[W_PRED + 1], work[W_PRED + 2] = Bh * cd, Bh * sd, Bz
    for i in range(3):
        work[W_OBS + i] = z[i]
        work[W_INNOV + i] = z[i] - work[W_PRED + i]
    across = -sd * z[0] + cd * z[1]
    clear_row(work)
    work[W_H + ATT], work[W_H + ATT + 1], work[W_H + ATT + 2] = cd * Bz, sd * Bz, -Bh
    work[W_H + DECLINATION] = Bh
    if h[H_STATUS] == UNDECIDED:
        h[H_VAR] = par[PAR_MAG_NOISE] ** 2
        total = project(P, work) + h[H_VAR]
        work[W_VAR] = work[W_VAR + 1] = work[W_VAR + 2] = total
        work[W_RATIO] = across**2 / (par[PAR_GATE] ** 2 * total)
        h[H_STATUS] = FUSED if work[W_RATIO] <= 1.0 else REFUSED_GATE
        strength = math.sqrt(Bh * Bh + Bz * Bz)
        off = abs(math.sqrt(z[0] ** 2 + z[1] ** 2 + z[2] ** 2) - strength)
        if ctl[C_HAS_FIELD] and off > STRENGTH_TOLERANCE * strength:
            h[H_STATUS] = REFUSED_DISTURBED
    if h[H_STATUS] == FUSED:
        total = project(P, work) + h[H_VAR]
        fuse(P, work, across - correction_seen(work), total)

"""Magnetic field: three axes against the Earth field and the bias fixed to the body, both states of the filter.

The measurement is compared in NED, where its noise is as round as in the body: with z = R_nb (m_b − b) and the
field state E, z − E = [E]× δθ + δE + R_nb δb. The model's direction and strength are the field's prior, so the
declination is learned within what the model leaves open, and a magnet carried along shows once the vehicle turns.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import FUSED, REFUSED_DISTURBED, REFUSED_GATE
from server.nav.ekf.aiding.gnss import REFUSED_K, tracked_ratio
from server.nav.ekf.delays import MAG as MAG_DELAY
from server.nav.ekf.layout import (
    A_DECLINATION,
    A_FIELD_D,
    A_FIELD_H,
    A_K_MAG,
    C_HAS_FIELD,
    C_POSITIONED,
    H_DATA,
    H_STATUS,
    H_T,
    H_VAR,
    HANDLER,
    PAR_GATE,
    PAR_MAG_NOISE,
    PAR_MAG_TIMING,
    U_GYRO,
    U_T,
    UNDECIDED,
    W_D,
    W_H,
    W_INNOV,
    W_OBS,
    W_PRED,
    W_RATIO,
    W_VAR,
)
from server.nav.ekf.states import ATT, FIELD, MAG_BIAS, X_FIELD, X_GYRO_BIAS, X_MAG_BIAS, X_Q, packed
from server.nav.ekf.update import clear_row, correction_seen, fuse, project
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int

LEARN: Final = 0.01  # weight of one sample in the tracked noise: 5 to 10 s of samples
K_MIN: Final = 0.36  # what soft iron, currents and timing leave is not white: 6 mG at least, at 25 samples a second
K_MAX: Final = 25.0
ANGLE_TOLERANCE_RAD: Final = math.radians(20.0)  # uncalibrated soft iron turns the field by 11° at most
ANGLE_SIGMAS: Final = 5.0
STRENGTH_TOLERANCE: Final = 0.25
"""Share of the model's strength; crustal anomalies stay under 10 %, uncalibrated soft iron under 20 %."""


@kernel("UniTuple(float64, 3)(float64[::1], float64[::1], float64[::1])")
def field_in_ned(h: Float, x: Float, u: Float) -> tuple[float, float, float]:
    """Return the measured field less the body's bias in NED, gauss, turned with the attitude at its own time."""
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    tau = (h[H_T] - u[U_T]) * 1e-9
    wx = tau * (u[U_GYRO] - x[X_GYRO_BIAS])
    wy = tau * (u[U_GYRO + 1] - x[X_GYRO_BIAS + 1])
    wz = tau * (u[U_GYRO + 2] - x[X_GYRO_BIAS + 2])
    bx, by, bz = h[H_DATA] - x[X_MAG_BIAS], h[H_DATA + 1] - x[X_MAG_BIAS + 1], h[H_DATA + 2] - x[X_MAG_BIAS + 2]
    mx, my, mz = bx + wy * bz - wz * by, by + wz * bx - wx * bz, bz + wx * by - wy * bx
    return (
        R[0] * mx + R[1] * my + R[2] * mz,
        R[3] * mx + R[4] * my + R[5] * mz,
        R[6] * mx + R[7] * my + R[8] * mz,
    )


@kernel("void(float64[::1], float64[::1], float64[::1], int64)")
def observe(x: Float, u: Float, work: Float, i: int) -> None:
    """Set the row of H of the NED component i: [E]× δθ + δE + R_nb δb; and what a delay does to it, ω × E."""
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    j, k = (i + 1) % 3, (i + 2) % 3
    clear_row(work)
    work[W_H + ATT + j], work[W_H + ATT + k] = -x[X_FIELD + k], x[X_FIELD + j]
    work[W_H + FIELD + i] = 1.0
    for c in range(3):
        work[W_H + MAG_BIAS + c] = R[3 * i + c]
    wx, wy, wz = u[U_GYRO] - x[X_GYRO_BIAS], u[U_GYRO + 1] - x[X_GYRO_BIAS + 1], u[U_GYRO + 2] - x[X_GYRO_BIAS + 2]
    wj = R[3 * j] * wx + R[3 * j + 1] * wy + R[3 * j + 2] * wz
    wk = R[3 * k] * wx + R[3 * k + 1] * wy + R[3 * k + 2] * wz
    work[W_D + MAG_DELAY] = wj * x[X_FIELD + k] - wk * x[X_FIELD + j]


@kernel("boolean(UniTuple(float64, 3), float64[::1], float64[::1], int64[::1])")
def _points_elsewhere(z: tuple[float, float, float], P: Float, aux: Float, ctl: Int) -> bool:
    """Return whether the field, as the attitude turns it, points far from the model's: to be asked with GNSS only.

    Motion holds the heading then. As its σ grows without a magnetometer the tolerance does, so a heading that is
    wrong after all finds back.
    """
    if not ctl[C_POSITIONED]:
        return False
    off = math.atan2(z[1], z[0]) - aux[A_DECLINATION]
    off = abs((off + math.pi) % (2.0 * math.pi) - math.pi)
    return bool(off > max(ANGLE_TOLERANCE_RAD, ANGLE_SIGMAS * math.sqrt(P[packed(ATT + 2, ATT + 2)])))


@kernel(HANDLER)
def field(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Handle a magnetic field in the body, gauss; decide at first use, then correct."""
    z = field_in_ned(h, x, u)
    undecided = h[H_STATUS] == UNDECIDED
    worst, excess = 0.0, 0.0
    if undecided:
        turn = (u[U_GYRO] - x[X_GYRO_BIAS]) ** 2 + (u[U_GYRO + 1] - x[X_GYRO_BIAS + 1]) ** 2
        turn += (u[U_GYRO + 2] - x[X_GYRO_BIAS + 2]) ** 2
        strength2 = h[H_DATA] ** 2 + h[H_DATA + 1] ** 2 + h[H_DATA + 2] ** 2
        h[H_VAR] = aux[A_K_MAG] * par[PAR_MAG_NOISE] ** 2 + par[PAR_MAG_TIMING] ** 2 * turn * strength2
    for i in range(3):
        work[W_PRED + i], work[W_OBS + i] = x[X_FIELD + i], z[i]
        work[W_INNOV + i] = z[i] - x[X_FIELD + i]
        if undecided:
            observe(x, u, work, i)
            own = project(P, work)
            excess += (work[W_INNOV + i] ** 2 - own) / (3.0 * par[PAR_MAG_NOISE] ** 2)
            work[W_VAR + i] = own + h[H_VAR]
            worst = max(worst, work[W_INNOV + i] ** 2 / (par[PAR_GATE] ** 2 * work[W_VAR + i]))
    if undecided:
        work[W_RATIO] = worst
        h[H_STATUS] = FUSED if worst <= 1.0 else REFUSED_GATE
        strength = math.sqrt(aux[A_FIELD_H] ** 2 + aux[A_FIELD_D] ** 2)
        off = abs(math.sqrt(z[0] ** 2 + z[1] ** 2 + z[2] ** 2) - strength)
        if ctl[C_HAS_FIELD] and (off > STRENGTH_TOLERANCE * strength or _points_elsewhere(z, P, aux, ctl)):
            h[H_STATUS] = REFUSED_DISTURBED
        most = K_MAX if h[H_STATUS] == FUSED else max(aux[A_K_MAG], REFUSED_K)  # what is refused must not open its gate
        aux[A_K_MAG] = min(most, max(K_MIN, tracked_ratio(aux[A_K_MAG], excess, LEARN)))
    if h[H_STATUS] == FUSED:
        for i in range(3):
            observe(x, u, work, i)
            total = project(P, work) + h[H_VAR]
            fuse(P, work, work[W_INNOV + i] - correction_seen(work), total)

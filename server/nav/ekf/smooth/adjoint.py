"""λ and Λ, what later measurements tell, carried back over one thing that the filter did; equations in `back`."""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf.layout import W_DX
from server.nav.ekf.smooth.layout import (
    F_DT,
    F_DTHETA,
    F_JITTER,
    F_WANDER,
    L_H,
    L_INNOVATION,
    L_PH,
    L_VARIANCE,
)
from server.nav.ekf.states import ACCEL_BIAS, ATT, BARO, GYRO_BIAS, JITTER, MIX, POS, VEL, WANDER, N, packed
from server.nav.ekf.update import inject
from server.nav.kernel import kernel
from server.nav.types import Float

LEAST_SHARE: Final = 1e-8
"""Of the filter's variance that the smoothed one keeps at least, whatever rounding says."""


@kernel("void(float64[::1], float64[:, ::1], int64)")
def forget(lam: Float, Lam: Float, i: int) -> None:
    """State i was set: nothing later tells about what it was before."""
    lam[i] = 0.0
    for j in range(N):
        Lam[i, j] = Lam[j, i] = 0.0


@kernel("void(float64[::1], float64[:, ::1], float64)")
def turn_back(lam: Float, Lam: Float, angle_rad: float) -> None:
    """Undo a turn of the tilt error: λ ← Tᵀ λ, Λ ← Tᵀ Λ T with T from `update.rotate_tilt`."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    a, b = lam[ATT], lam[ATT + 1]
    lam[ATT], lam[ATT + 1] = c * a + s * b, c * b - s * a
    for j in range(N):
        a, b = Lam[ATT, j], Lam[ATT + 1, j]
        Lam[ATT, j], Lam[ATT + 1, j] = c * a + s * b, c * b - s * a
    for j in range(N):
        a, b = Lam[j, ATT], Lam[j, ATT + 1]
        Lam[j, ATT], Lam[j, ATT + 1] = c * a + s * b, c * b - s * a


@kernel("void(float64[::1], float64[:, ::1], float64[::1], float64[::1], int64)", contract=True)
def back_over_scalar(lam: Float, Lam: Float, entry: Float, g: Float, n: int) -> None:
    """Carry λ, Λ back over one scalar measurement.

    Args:
        lam, Lam: shapes (N,), (N, N), changed in place.
        entry: shape (L_SIZE,), of the log.
        g: shape (N,), scratch.
        n: active states.
    """
    inverse = 1.0 / entry[L_VARIANCE]
    along = curvature = 0.0
    for i in range(n):
        g[i] = 0.0
    for i in range(n):
        gain = entry[L_PH + i] * inverse
        along += gain * lam[i]
        for j in range(n):
            g[j] += gain * Lam[i, j]
    for i in range(n):
        curvature += entry[L_PH + i] * inverse * g[i]
    along = entry[L_INNOVATION] * inverse - along
    curvature += inverse
    for i in range(n):
        h = entry[L_H + i]
        if h != 0.0:
            lam[i] += h * along
            for j in range(n):
                Lam[i, j] -= h * g[j]
                Lam[j, i] -= h * g[j]
    for i in range(n):
        h = entry[L_H + i]
        if h != 0.0:
            for j in range(n):
                Lam[i, j] += h * curvature * entry[L_H + j]


@kernel("void(float64[::1], float64[::1], int64)", contract=True)
def _back_slow(lam: Float, f: Float, n: int) -> None:
    """λ ← Fᵀ λ with F of `predict.predict_slow`; n active states."""
    if n > WANDER:
        for i in range(3):
            lam[WANDER + i] *= f[F_WANDER]
            lam[JITTER + i] *= f[F_JITTER]
    if n > MIX:
        for r in range(3):
            turned = (f[3 + r] * lam[ATT] + f[6 + r] * lam[ATT + 1] + f[9 + r] * lam[ATT + 2]) / f[F_DT]
            for c in range(3):
                lam[MIX + 3 * r + c] -= turned * f[F_DTHETA + c]


@kernel("void(float64[:, ::1], float64[::1], int64)", contract=True)
def _back_slow_rows(Lam: Float, f: Float, n: int) -> None:
    """Λ ← Fᵀ Λ likewise, row by row."""
    for i in range(3 if n > WANDER else 0):
        for j in range(n):
            Lam[WANDER + i, j] *= f[F_WANDER]
            Lam[JITTER + i, j] *= f[F_JITTER]
    for r in range(3 if n > MIX else 0):
        a, b, c = f[3 + r] / f[F_DT], f[6 + r] / f[F_DT], f[9 + r] / f[F_DT]
        for j in range(n):
            turned = a * Lam[ATT, j] + b * Lam[ATT + 1, j] + c * Lam[ATT + 2, j]
            for m in range(3):
                Lam[MIX + 3 * r + m, j] -= turned * f[F_DTHETA + m]


@kernel("void(float64[:, ::1], float64[::1], int64)", contract=True)
def _back_rows(Lam: Float, f: Float, n: int) -> None:
    """Λ ← Fᵀ Λ, row by row, F as `derivation` has it."""
    dt = f[F_DT]
    for j in range(n):
        for i in range(3):
            a0, a1, a2 = f[3 + i], f[6 + i], f[9 + i]
            Lam[ACCEL_BIAS + i, j] -= a0 * Lam[VEL, j] + a1 * Lam[VEL + 1, j] + a2 * Lam[VEL + 2, j]
            Lam[GYRO_BIAS + i, j] -= a0 * Lam[ATT, j] + a1 * Lam[ATT + 1, j] + a2 * Lam[ATT + 2, j]
        v0, v1, v2 = Lam[VEL, j], Lam[VEL + 1, j], Lam[VEL + 2, j]
        Lam[ATT, j] += f[1] * v2 - f[2] * v1
        Lam[ATT + 1, j] += f[2] * v0 - f[0] * v2
        Lam[ATT + 2, j] += f[0] * v1 - f[1] * v0
        for i in range(3):
            Lam[VEL + i, j] += dt * Lam[POS + i, j]


@kernel("void(float64[::1], float64[:, ::1], float64[::1], int64)")
def back_over_prediction(lam: Float, Lam: Float, f: Float, n: int) -> None:
    """Carry λ, Λ back over one prediction.

    Args:
        lam, Lam: shapes (N,), (N, N), changed in place.
        f: shape (F_SIZE,), of `layout`.
        n: active states.
    """
    _back_slow(lam, f, n)
    for i in range(3):
        for r in range(3):
            lam[ACCEL_BIAS + i] -= f[3 + 3 * r + i] * lam[VEL + r]
            lam[GYRO_BIAS + i] -= f[3 + 3 * r + i] * lam[ATT + r]
    lam[ATT] += f[1] * lam[VEL + 2] - f[2] * lam[VEL + 1]
    lam[ATT + 1] += f[2] * lam[VEL] - f[0] * lam[VEL + 2]
    lam[ATT + 2] += f[0] * lam[VEL + 1] - f[1] * lam[VEL]
    for i in range(3):
        lam[VEL + i] += f[F_DT] * lam[POS + i]
    for _ in range(2):  # Fᵀ Λ F is the same row operation twice, with a transposition after each
        _back_slow_rows(Lam, f, n)
        _back_rows(Lam, f, n)
        for i in range(n):
            for j in range(i):
                Lam[i, j], Lam[j, i] = Lam[j, i], Lam[i, j]


@kernel("void(float64[::1], float64[:, ::1])")
def back_over_datum(lam: Float, Lam: Float) -> None:
    """Carry λ, Λ back over the start of the baro's datum (`blocks.start_datum`): δb = −δd + noise, whatever it was."""
    lam[POS + 2] -= lam[BARO]
    for j in range(N):
        Lam[POS + 2, j] -= Lam[BARO, j]
    for j in range(N):
        Lam[j, POS + 2] -= Lam[j, BARO]
    forget(lam, Lam, BARO)


@kernel(
    "void(float64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1],"
    " int64)",
    contract=True,
)
def correct(x: Float, full: Float, P: Float, product: Float, lam: Float, work: Float, Lam: Float, n: int) -> None:
    """Set x ← x ⊞ P λ and the leading nine states of P ← P − P Λ P; the rest of P is not kept.

    Args:
        x: shape (X_SIZE,), changed in place.
        full, product: shapes (N, N), (9, N), scratch.
        P: packed lower triangle, changed in place.
        lam, Lam: shapes (N,), (N, N).
        work: the filter's scratch.
        n: active states.
    """
    for i in range(n):
        for j in range(i + 1):
            full[i, j] = full[j, i] = P[packed(i, j)]
    for i in range(N):
        work[W_DX + i] = 0.0
    for i in range(n):
        for j in range(n):
            work[W_DX + i] += full[i, j] * lam[j]
    for i in range(POS + 3):
        for j in range(n):
            product[i, j] = 0.0
        for k in range(n):
            p = full[i, k]
            for j in range(n):
                product[i, j] += p * Lam[k, j]
        for j in range(i + 1):
            less = 0.0
            for k in range(n):
                less += product[i, k] * full[k, j]
            P[packed(i, j)] -= less
        P[packed(i, i)] = max(P[packed(i, i)], LEAST_SHARE * full[i, i])
    inject(x, P, work)

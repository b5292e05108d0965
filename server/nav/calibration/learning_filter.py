"""One filter of the magnetometer's learning: prediction over a block of steps, correction by its mean sample."""

from __future__ import annotations

import math

from server.nav.calibration.learning_layout import (
    C_B_DT,
    C_B_N,
    C_B_PATH,
    C_B_R,
    C_B_RM,
    C_B_TURN,
    C_B_W,
    C_B_Z,
    C_PATCH2,
    DELAY,
    F_H,
    F_K,
    F_P,
    F_PH,
    F_X,
    FIELD,
    GYRO,
    K_FIELD_WALK,
    K_GYRO_NOISE,
    K_GYRO_WALK,
    K_OFFSET_WALK,
    K_TURN,
    OFFSET,
    N,
)
from server.nav.kernel import kernel
from server.nav.types import Float


@kernel("void(float64[::1], float64[::1])")
def _move(s: Float, c: Float) -> None:
    """Turn the field by the gyro bias over the block, and its errors with it: P = Φ P Φᵀ, δf' = δf − f × (W δw)."""
    p, f, w = F_P, F_X + FIELD, F_X + GYRO
    for i in range(3):  # f' = f + (W w) × f, small: at most some tenths of a degree
        s[F_K + i] = 0.0
        for j in range(3):
            s[F_K + i] += c[C_B_R + 3 * i + j] * s[w + j]
    for col in range(N):  # rows of the field: Φ P
        d0, d1, d2 = s[p + N * FIELD + col], s[p + N * (FIELD + 1) + col], s[p + N * (FIELD + 2) + col]
        g0 = g1 = g2 = 0.0
        for j in range(3):
            pw = s[p + N * (GYRO + j) + col]
            g0 += c[C_B_R + j] * pw
            g1 += c[C_B_R + 3 + j] * pw
            g2 += c[C_B_R + 6 + j] * pw
        s[p + N * FIELD + col] += s[F_K + 1] * d2 - s[F_K + 2] * d1 + g1 * s[f + 2] - g2 * s[f + 1]
        s[p + N * (FIELD + 1) + col] += s[F_K + 2] * d0 - s[F_K] * d2 + g2 * s[f] - g0 * s[f + 2]
        s[p + N * (FIELD + 2) + col] += s[F_K] * d1 - s[F_K + 1] * d0 + g0 * s[f + 1] - g1 * s[f]
    for row in range(N):  # columns of the field: (Φ P) Φᵀ
        at = p + N * row
        d0, d1, d2 = s[at + FIELD], s[at + FIELD + 1], s[at + FIELD + 2]
        g0 = g1 = g2 = 0.0
        for j in range(3):
            pw = s[at + GYRO + j]
            g0 += c[C_B_R + j] * pw
            g1 += c[C_B_R + 3 + j] * pw
            g2 += c[C_B_R + 6 + j] * pw
        s[at + FIELD] += s[F_K + 1] * d2 - s[F_K + 2] * d1 + g1 * s[f + 2] - g2 * s[f + 1]
        s[at + FIELD + 1] += s[F_K + 2] * d0 - s[F_K] * d2 + g2 * s[f] - g0 * s[f + 2]
        s[at + FIELD + 2] += s[F_K] * d1 - s[F_K + 1] * d0 + g0 * s[f + 1] - g1 * s[f]
    f0, f1, f2 = s[f], s[f + 1], s[f + 2]
    s[f] += s[F_K + 1] * f2 - s[F_K + 2] * f1
    s[f + 1] += s[F_K + 2] * f0 - s[F_K] * f2
    s[f + 2] += s[F_K] * f1 - s[F_K + 1] * f0
    size = math.sqrt((f0 * f0 + f1 * f1 + f2 * f2) / max(s[f] ** 2 + s[f + 1] ** 2 + s[f + 2] ** 2, 1e-12))
    for i in range(3):
        s[f + i] *= size


@kernel("void(float64[::1], float64[::1], float64[::1], boolean)")
def predict(s: Float, c: Float, par: Float, moving: bool) -> None:
    """Carry one filter over the block: gyro bias, turning errors across the field, the place's own unevenness.

    Args:
        s: shape (F_SIZE,), written. c: shape (C_SIZE,). par: shape (K_SIZE,).
        moving: at rest neither the field nor the offset changes of itself.
    """
    _move(s, c)
    dt, f = c[C_B_DT], F_X + FIELD
    across2 = par[K_GYRO_NOISE] ** 2 * dt
    walk2 = 0.0
    if moving:
        across2 += par[K_TURN] ** 2 * c[C_B_PATH]
        walk2 = par[K_FIELD_WALK] ** 2 * dt
    f2 = s[f] ** 2 + s[f + 1] ** 2 + s[f + 2] ** 2
    for i in range(3):
        s[F_P + (N + 1) * (FIELD + i)] += walk2 + across2 * f2
        for j in range(3):  # a turning error moves the field across itself, never along: its size stays
            s[F_P + N * (FIELD + i) + FIELD + j] -= across2 * s[f + i] * s[f + j]
        s[F_P + (N + 1) * (GYRO + i)] += par[K_GYRO_WALK] ** 2 * dt
        if moving:
            s[F_P + (N + 1) * (OFFSET + i)] += par[K_OFFSET_WALK] ** 2 * c[C_PATCH2] * dt


@kernel("void(float64[::1], float64[::1], int64)")
def _row(s: Float, c: Float, i: int) -> None:
    """Set H for component i of the block's mean sample."""
    n, f, w = c[C_B_N], F_X + FIELD, C_B_W
    j, k = (i + 1) % 3, (i + 2) % 3
    for m in range(N):
        s[F_H + m] = 0.0
    s[F_H + FIELD + i] = 1.0
    for m in range(3):
        s[F_H + OFFSET + m] = c[C_B_RM + 3 * i + m] / n
    s[F_H + DELAY] = (c[w + j] * s[f + k] - c[w + k] * s[f + j]) / n


@kernel("float64(float64[::1], float64[::1], int64)")
def innovation(s: Float, c: Float, i: int) -> float:
    """Return component i, frame i, of the block's mean sample minus the expected one, gauss."""
    n, f, w = c[C_B_N], F_X + FIELD, C_B_W
    j, k = (i + 1) % 3, (i + 2) % 3
    y = c[C_B_Z + i] / n - s[f + i] - s[F_X + DELAY] * (c[w + j] * s[f + k] - c[w + k] * s[f + j]) / n
    for m in range(3):
        y -= c[C_B_RM + 3 * i + m] / n * s[F_X + OFFSET + m]
    return float(y)


@kernel("float64(float64[::1])")
def _project(s: Float) -> float:
    """Set PH = P Hᵀ; return H P Hᵀ."""
    total = 0.0
    for i in range(N):
        row = 0.0
        for j in range(N):
            row += s[F_P + N * i + j] * s[F_H + j]
        s[F_PH + i] = row
        total += row * s[F_H + i]
    return total


@kernel("UniTuple(float64, 2)(float64[::1], float64[::1])")
def judge(s: Float, c: Float) -> tuple[float, float]:
    """Return |innovation|² and the trace of H P Hᵀ, gauss²."""
    y2 = known2 = 0.0
    for i in range(3):
        _row(s, c, i)
        known2 += _project(s)
        y2 += innovation(s, c, i) ** 2
    return y2, known2


@kernel("void(float64[::1], float64, float64, int64, int64)")
def fuse(s: Float, y: float, variance: float, first: int, end: int) -> None:
    """Correct states [first, end) by the measurement whose row is in H; the covariance is right for any gain [Joseph].

    Args:
        s: shape (F_SIZE,), written. y: innovation. variance: of the measurement.
        first, end: the others keep their values, and their covariance with what is corrected stays right (Schmidt).
    """
    total = _project(s) + variance
    for i in range(N):
        s[F_K + i] = s[F_PH + i] / total if first <= i < end else 0.0
        s[F_X + i] += s[F_K + i] * y
    for i in range(N):
        for j in range(i, N):
            less = s[F_K + i] * s[F_PH + j] + s[F_PH + i] * s[F_K + j] - s[F_K + i] * s[F_K + j] * total
            s[F_P + N * i + j] -= less
            s[F_P + N * j + i] = s[F_P + N * i + j]


@kernel("void(float64[::1], float64[::1], float64, int64, int64)")
def correct(s: Float, c: Float, variance: float, first: int, end: int) -> None:
    """Correct by the block's mean sample, each axis of it with this variance."""
    for i in range(3):
        y = innovation(s, c, i)
        _row(s, c, i)
        fuse(s, y, variance, first, end)


@kernel("void(float64[::1], float64[::1], float64)")
def hold_still(s: Float, c: Float, sigma_rad_s: float) -> None:
    """Correct the gyro bias: at rest it is all that the gyro reads."""
    for i in range(3):
        for m in range(N):
            s[F_H + m] = 0.0
        s[F_H + GYRO + i] = 1.0
        fuse(s, c[C_B_TURN + i] / c[C_B_DT] - s[F_X + GYRO + i], sigma_rad_s**2, FIELD, N)


@kernel("void(float64[::1], int64, float64)")
def widen(s: Float, first: int, variance: float) -> None:
    """Add this variance to three states from `first`: they may have changed by so much."""
    for i in range(first, first + 3):
        s[F_P + (N + 1) * i] += variance

"""Scalar measurement updates on the packed covariance, and what the corrections do to the nominal state."""

from __future__ import annotations

import math

from server.nav.ekf.delays import update_sensitivities
from server.nav.ekf.layout import DELAYS, W_D, W_DELAYS, W_DIM, W_DX, W_H, W_LOG, W_PH, W_SIZE
from server.nav.ekf.predict import move_position
from server.nav.ekf.states import (
    ACCEL_BIAS,
    ATT,
    FIELD,
    GYRO_BIAS,
    MAG_BIAS,
    POS,
    VEL,
    WIND,
    X_ACCEL_BIAS,
    X_DRAG,
    X_FIELD,
    X_GYRO_BIAS,
    X_MAG_BIAS,
    X_Q,
    X_VEL,
    X_WIND,
    N,
    packed,
)
from server.nav.kernel import kernel
from server.nav.rotation import quat_from_rotvec, quat_mul
from server.nav.types import Float

MIN_VARIANCE = 1e-18
"""Floor of a diagonal entry after an update; rounding must not take it to zero or below."""


@kernel("float64(float64[::1], float64[::1])", contract=True)
def project(P: Float, work: Float) -> float:
    """Set work[W_PH] = P Hᵀ for the row H in work[W_H]; return H P Hᵀ."""
    n = int(work[W_DIM])
    for i in range(n):
        work[W_PH + i] = 0.0
    for j in range(n):
        h = work[W_H + j]
        if h != 0.0:
            k = j * (j + 1) // 2
            for i in range(j + 1):
                work[W_PH + i] += h * P[k + i]
            k += 2 * j + 1
            for i in range(j + 1, n):
                work[W_PH + i] += h * P[k]
                k += i + 1
    total = 0.0
    for j in range(n):
        total += work[W_H + j] * work[W_PH + j]
    return total


@kernel("float64(float64[::1])")
def correction_seen(work: Float) -> float:
    """Return H δx of what was collected so far: the next scalar's innovation must not count it twice."""
    total = 0.0
    for j in range(int(work[W_DIM])):
        total += work[W_H + j] * work[W_DX + j]
    return total


LOGGED = 2 * N + 2
"""Numbers of one logged scalar: innovation, its variance, H, P Hᵀ."""


@kernel("void(float64[::1], float64, float64)")
def log_scalar(work: Float, innovation: float, variance: float) -> None:
    """Append what one scalar update did behind the scratch: all that a smoother needs to know of a measurement."""
    k = W_SIZE + int(work[W_LOG] - 1.0) * LOGGED
    if k + LOGGED > work.shape[0]:
        return
    work[k], work[k + 1] = innovation, variance
    n = int(work[W_DIM])
    for i in range(N):
        work[k + 2 + i] = work[W_H + i] if i < n else 0.0
        work[k + 2 + N + i] = work[W_PH + i] if i < n else 0.0
    work[W_LOG] += 1.0


@kernel("void(float64[::1], float64[::1], float64, float64)", contract=True)
def fuse(P: Float, work: Float, innovation: float, variance: float) -> None:
    """Kalman update with one scalar; `project` has been called [Solà 2017, eq. 274-276].

    Args:
        P: shape (PACKED,), updated in place.
        work: scratch with P Hᵀ; the correction is added to work[W_DX].
        innovation: of this scalar, corrections collected so far already taken off.
        variance: innovation variance H P Hᵀ + R, > 0.
    """
    if work[W_LOG] > 0.0:
        log_scalar(work, innovation, variance)
    if work[W_DELAYS] > 0.0:
        update_sensitivities(work, innovation, variance)
    k = 0
    for i in range(int(work[W_DIM])):
        gain = work[W_PH + i] / variance
        work[W_DX + i] += gain * innovation
        for j in range(i + 1):
            P[k] -= gain * work[W_PH + j]
            k += 1
        if gain != 0.0:  # a block that is not in use stays at zero
            P[k - 1] = max(P[k - 1], MIN_VARIANCE)


@kernel("void(float64[::1], float64)")
def rotate_tilt(P: Float, angle_rad: float) -> None:
    """Turn the covariance of the tilt error about down, together with the nominal heading.

    At rest tilt and accelerometer bias are one unknown, and the bias is fixed to the body. A heading correction that
    left the tilt error in its old direction would break that tie and invent knowledge of both. Turning it with the
    heading holds the tilt error in the frame of the heading, which is equal to first order.
    """
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    xx, xy, yy = P[packed(ATT, ATT)], P[packed(ATT, ATT + 1)], P[packed(ATT + 1, ATT + 1)]
    for j in range(ATT + 2, N):
        x, y = P[packed(ATT, j)], P[packed(ATT + 1, j)]
        P[packed(ATT, j)], P[packed(ATT + 1, j)] = c * x - s * y, s * x + c * y
    P[packed(ATT, ATT)] = c * c * xx - 2.0 * c * s * xy + s * s * yy
    P[packed(ATT, ATT + 1)] = c * s * (xx - yy) + (c * c - s * s) * xy
    P[packed(ATT + 1, ATT + 1)] = s * s * xx + 2.0 * c * s * xy + c * c * yy


@kernel("void(float64[::1], float64[::1], float64[::1])")
def inject(x: Float, P: Float, work: Float) -> None:
    """Move the correction collected in work[W_DX] into the nominal state and clear it [Solà 2017, eq. 283]."""
    d = work[W_DX : W_DX + N]
    rotate_tilt(P, d[ATT + 2])
    turn = quat_from_rotvec(d[ATT], d[ATT + 1], d[ATT + 2])
    q = quat_mul(turn[0], turn[1], turn[2], turn[3], x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    scale = 1.0 / math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for i in range(4):
        x[X_Q + i] = q[i] * scale
    for i in range(3):
        x[X_VEL + i] += d[VEL + i]
        x[X_GYRO_BIAS + i] += d[GYRO_BIAS + i]
        x[X_ACCEL_BIAS + i] += d[ACCEL_BIAS + i]
        x[X_FIELD + i] += d[FIELD + i]
        x[X_MAG_BIAS + i] += d[MAG_BIAS + i]
    n = int(work[W_DIM])
    for i in range(WIND, n):  # from the wind on both tables have the same order
        x[X_WIND + i - WIND] += d[i]
    x[X_DRAG] = max(0.0, x[X_DRAG])  # drag brakes
    move_position(x, d[POS], d[POS + 1], d[POS + 2])
    for i in range(n):
        d[i] = 0.0


@kernel("void(float64[::1], int64, float64)")
def reset_axis(P: Float, axis: int, variance: float) -> None:
    """Forget what is known of one error state: no correlation, the given variance."""
    for j in range(N):
        P[packed(axis, j)] = 0.0
    P[packed(axis, axis)] = variance


@kernel("void(float64[::1])")
def clear_row(work: Float) -> None:
    """Set H = 0."""
    for j in range(int(work[W_DIM])):
        work[W_H + j] = 0.0
    for i in range(DELAYS):
        work[W_D + i] = 0.0

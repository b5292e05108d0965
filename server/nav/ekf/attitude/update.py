"""Scalar measurement updates of the attitude mode, and what they do to the nominal state."""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf.attitude.layout import ATT, FIELD, MAG_DELAY, S_DX, S_H, S_P, S_PH, S_Q, S_X, VEL, N
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float

MIN_VARIANCE: Final = 1e-18
LONGEST_DELAY_S: Final = 0.1


@kernel("void(float64[::1])")
def clear_row(s: Float) -> None:
    """Set H = 0."""
    for i in range(N):
        s[S_H + i] = 0.0


@kernel("float64(float64[::1])", contract=True)
def project(s: Float) -> float:
    """Set s[S_PH] = P Hᵀ; return H P Hᵀ."""
    for i in range(N):
        s[S_PH + i] = 0.0
    for j in range(N):
        h = s[S_H + j]
        if h != 0.0:
            row = S_P + N * j
            for i in range(N):
                s[S_PH + i] += h * s[row + i]
    total = 0.0
    for j in range(N):
        total += s[S_H + j] * s[S_PH + j]
    return total


@kernel("void(float64[::1], float64, float64)", contract=True)
def fuse(s: Float, innovation: float, variance: float) -> None:
    """Kalman update with the row in s[S_H]; what was collected before is taken off first [Solà 2017, eq. 274-276].

    Args:
        s: memory; the correction is added to s[S_DX].
        innovation: against the nominal state.
        variance: of the measurement alone, > 0.
    """
    total = project(s) + variance
    for j in range(N):
        innovation -= s[S_H + j] * s[S_DX + j]
    for i in range(N):
        gain = s[S_PH + i] / total
        s[S_DX + i] += gain * innovation
        row = S_P + N * i
        for j in range(N):
            s[row + j] -= gain * s[S_PH + j]
    for i in range(N):
        d = S_P + (N + 1) * i
        s[d] = max(s[d], MIN_VARIANCE)


@kernel("void(float64[::1], int64, float64)")
def _turn_pair(s: Float, first: int, angle_rad: float) -> None:
    """Turn the covariance of a vector's horizontal part about down."""
    c, n = math.cos(angle_rad), math.sin(angle_rad)
    a, b = S_P + N * first, S_P + N * (first + 1)
    for j in range(N):
        x, y = s[a + j], s[b + j]
        s[a + j], s[b + j] = c * x - n * y, n * x + c * y
    for j in range(N):
        k = S_P + N * j + first
        x, y = s[k], s[k + 1]
        s[k], s[k + 1] = c * x - n * y, n * x + c * y


@kernel("void(float64[::1], float64, float64, float64)")
def turn_nominal(s: Float, x_rad: float, y_rad: float, z_rad: float) -> None:
    """Rotate attitude, velocity and field by a rotation vector in NED; their errors turn with the heading."""
    for first in (ATT, VEL, FIELD):
        _turn_pair(s, first, z_rad)
    t = quat_from_rotvec(x_rad, y_rad, z_rad)
    q = quat_mul(t[0], t[1], t[2], t[3], s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3])
    scale = 1.0 / math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for i in range(4):
        s[S_Q + i] = q[i] * scale
    R = matrix_entries(t[0], t[1], t[2], t[3])
    for k in (S_X + VEL, S_X + FIELD):
        a, b, c = s[k], s[k + 1], s[k + 2]
        for i in range(3):
            s[k + i] = R[3 * i] * a + R[3 * i + 1] * b + R[3 * i + 2] * c


@kernel("void(float64[::1])")
def inject(s: Float) -> None:
    """Move the correction collected in s[S_DX] into the nominal state and clear it [Solà 2017, eq. 283]."""
    turn_nominal(s, s[S_DX], s[S_DX + 1], s[S_DX + 2])
    for i in range(VEL, N):
        s[S_X + i] += s[S_DX + i]
    for i in range(N):
        s[S_DX + i] = 0.0
    s[S_X + MAG_DELAY] = min(max(s[S_X + MAG_DELAY], -LONGEST_DELAY_S), LONGEST_DELAY_S)


@kernel("void(float64[::1], int64, float64)")
def forget(s: Float, axis: int, variance: float) -> None:
    """Forget what is known of one error state: no correlation, the given variance."""
    for j in range(N):
        s[S_P + N * axis + j] = 0.0
        s[S_P + N * j + axis] = 0.0
    s[S_P + (N + 1) * axis] = variance

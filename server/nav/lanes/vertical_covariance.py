"""Covariance of [down, speed, acceleration, acceleration bias]: prediction, and what a measurement takes off."""

from __future__ import annotations

from typing import Final

from server.nav.kernel import kernel
from server.nav.types import Float

N: Final = 4


@kernel("void(float64[:, ::1], float64, float64, float64)")
def propagate(P: Float, dt: float, q: float, walk: float) -> None:
    """Set P = F P Fᵀ + Q for a step of dt seconds; Q of white jerk of density² q, exactly discretised, and a walk."""
    half = 0.5 * dt * dt
    for j in range(N):
        P[0, j] += dt * P[1, j] + half * P[2, j]
        P[1, j] += dt * P[2, j]
    for i in range(N):
        P[i, 0] += dt * P[i, 1] + half * P[i, 2]
        P[i, 1] += dt * P[i, 2]
    P[0, 0] += q * dt**5 / 20.0
    P[0, 1] += q * dt**4 / 8.0
    P[1, 0] += q * dt**4 / 8.0
    P[0, 2] += q * dt**3 / 6.0
    P[2, 0] += q * dt**3 / 6.0
    P[1, 1] += q * dt**3 / 3.0
    P[1, 2] += q * dt**2 / 2.0
    P[2, 1] += q * dt**2 / 2.0
    P[2, 2] += q * dt
    P[3, 3] += walk * walk * dt


@kernel("void(float64[:, ::1], float64, float64, float64, float64, float64)")
def take_off(P: Float, c0: float, c1: float, c2: float, c3: float, total: float) -> None:
    """Set P = P − c cᵀ / total, kept symmetric."""
    c = (c0, c1, c2, c3)
    for i in range(N):
        for j in range(i, N):
            P[i, j] -= c[i] * c[j] / total
            P[j, i] = P[i, j]

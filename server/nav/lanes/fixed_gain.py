"""Steady-state Kalman weights of one angle with its gyro bias, from the discrete algebraic Riccati equation."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import solve_discrete_are


def steady_gains(dt_s: float, gyro: float, walk: float, angle: float) -> tuple[float, float]:
    """Return the weights (angle, of 1; bias, 1/s, positive) that a Kalman filter of [angle, bias] settles at.

    P = A P Aᵀ − A P Hᵀ (H P Hᵀ + R)⁻¹ H P Aᵀ + Q with A = [[1, −dt], [0, 1]] (S1 eq. 3.17), H = [1, 0] and noises given
    as densities, R = angle²/dt. The bias weight of the textbook is negative; here it is what `feed_bias` subtracts.

    Args:
        dt_s: step.
        gyro: noise density of the rate, rad/s/√Hz.
        walk: of the bias, rad/s²/√Hz.
        angle: of the measured angle, rad/√Hz.
    """
    tau = math.sqrt(angle / walk)  # in units of tau and angle/√tau every coefficient is near h or 1/h
    h, q = dt_s / tau, (gyro * tau / angle) ** 2
    A = np.array([[1.0, -h], [0.0, 1.0]])
    Q = np.array([[q * h + h**3 / 3.0, -(h**2) / 2.0], [-(h**2) / 2.0, h]])
    P = solve_discrete_are(A.T, np.array([[1.0], [0.0]]), Q, np.array([[1.0 / h]]))
    K = P[:, 0] / (P[0, 0] + 1.0 / h)
    return float(K[0]), float(-K[1] / tau)

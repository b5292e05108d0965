"""Delays that nobody told: found on line from the innovations, beside the filter and not inside it.

A measurement assumed valid at t but valid δ earlier is wrong by −ḣ δ. The filter follows that error, so innovations
alone do not show it: what counts is how much of δ the state has already swallowed. Friedland's separated bias filter
keeps exactly that, the sensitivity V = ∂(state error)/∂δ, at the cost of one more column per delay in prediction and
update [Friedland 1969, IEEE Transactions on Automatic Control 14(4), eq. 22-36]:

    V ← F V;   S = H V + D;   V ← V − K S;   δ̂ ← δ̂ + M Sᵀ (ν − S δ̂) / s;   M ← M − M Sᵀ S M / s

with D = −∂h/∂t and s the innovation variance plus S M Sᵀ. The estimate is moved step by step into the delay that
is used, so that what is left of it stays small. Three delays: GNSS position, GNSS velocity (receivers smooth it
longer), magnetometer.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.ekf.layout import (
    DELAYS,
    SENS,
    W_D,
    W_DELAYS,
    W_DELTA,
    W_DIM,
    W_H,
    W_LEARN,
    W_M,
    W_PH,
    W_SENS,
    W_USED,
)
from server.nav.kernel import kernel
from server.nav.types import Float

POSITION: Final = 0
VELOCITY: Final = 1
MAG: Final = 2
SHARED_SIGMA_S: Final = 0.15  # of a receiver's position and velocity together: its cycle and the link
OWN_SIGMA_S: Final = 0.1  # of either: smoothing
MAG_SIGMA_S: Final = 0.03
MOVE_SHARE: Final = 0.05  # per fix, of the estimate into the delay that is used
LEAST_S: Final = -0.1
MOST_S: Final = 0.8  # the history holds a second
MOST_MAG_S: Final = 0.15  # slower sensors there are none
SURE_S2: Final = 2.5e-3  # 50 ms: before that an estimate is not used
FLOOR_S2: Final = 4e-6  # 2 ms: a receiver's delay is not a constant


def start_delays(work: Float, unknown: tuple[bool, bool]) -> None:
    """Estimate the delays that are unknown, from zero; forget those that are known now.

    Args:
        work: shape (W_SIZE,), the filter's scratch and switches.
        unknown: of GNSS, of the magnetometer.
    """
    gnss, mag = unknown
    covariance = np.zeros((DELAYS, DELAYS))
    if gnss:
        covariance[:2, :2] = SHARED_SIGMA_S**2 + OWN_SIGMA_S**2 * np.eye(2)
    if mag:
        covariance[MAG, MAG] = MAG_SIGMA_S**2
    work[W_M : W_M + DELAYS * DELAYS] = covariance.ravel()
    work[W_SENS : W_SENS + DELAYS * SENS] = work[W_DELTA : W_DELTA + DELAYS] = work[W_USED : W_USED + DELAYS] = 0.0
    work[W_DELAYS] = float(gnss or mag)


@kernel("void(float64[::1])")
def predict_sensitivities(work: Float) -> None:
    """Set V ← F V; f, A and dt of the step are in work[:13] (`covariance.predict_covariance`)."""
    f0, f1, f2, dt = work[0], work[1], work[2], work[12]
    for p in range(DELAYS):
        k = W_SENS + p * SENS
        t0, t1, t2, v0, v1, v2 = work[k], work[k + 1], work[k + 2], work[k + 3], work[k + 4], work[k + 5]
        g0, g1, g2, b0, b1, b2 = work[k + 9], work[k + 10], work[k + 11], work[k + 12], work[k + 13], work[k + 14]
        for i in range(3):
            work[k + 6 + i] += dt * work[k + 3 + i]
            work[k + i] -= work[3 + 3 * i] * g0 + work[4 + 3 * i] * g1 + work[5 + 3 * i] * g2
        work[k + 3] = v0 + f2 * t1 - f1 * t2 - work[3] * b0 - work[4] * b1 - work[5] * b2
        work[k + 4] = v1 - f2 * t0 + f0 * t2 - work[6] * b0 - work[7] * b1 - work[8] * b2
        work[k + 5] = v2 + f1 * t0 - f0 * t1 - work[9] * b0 - work[10] * b1 - work[11] * b2


@kernel("void(float64[::1], float64, float64)")
def update_sensitivities(work: Float, innovation: float, variance: float) -> None:
    """Take one scalar: H in work[W_H], D in work[W_D], P Hᵀ in work[W_PH]; learn when work[W_LEARN] says so.

    Args:
        work: scratch, sensitivities, estimate and its covariance.
        innovation: of this scalar, corrections of the same measurement already taken off.
        variance: H P Hᵀ + R.
    """
    n = int(work[W_DIM])
    s0 = s1 = s2 = 0.0
    for j in range(n):
        h = work[W_H + j]
        if h != 0.0:
            s0 += h * work[W_SENS + j]
            s1 += h * work[W_SENS + SENS + j]
            s2 += h * work[W_SENS + 2 * SENS + j]
    s0, s1, s2 = s0 + work[W_D], s1 + work[W_D + 1], s2 + work[W_D + 2]
    for j in range(n):
        gain = work[W_PH + j] / variance
        work[W_SENS + j] -= gain * s0
        work[W_SENS + SENS + j] -= gain * s1
        work[W_SENS + 2 * SENS + j] -= gain * s2
    if work[W_LEARN] == 0.0:
        return
    m0 = work[W_M] * s0 + work[W_M + 1] * s1 + work[W_M + 2] * s2
    m1 = work[W_M + 3] * s0 + work[W_M + 4] * s1 + work[W_M + 5] * s2
    m2 = work[W_M + 6] * s0 + work[W_M + 7] * s1 + work[W_M + 8] * s2
    total = variance + s0 * m0 + s1 * m1 + s2 * m2
    left = innovation - s0 * work[W_DELTA] - s1 * work[W_DELTA + 1] - s2 * work[W_DELTA + 2]
    m = (m0, m1, m2)
    for i in range(DELAYS):
        work[W_DELTA + i] += m[i] * left / total
        for j in range(DELAYS):
            work[W_M + 3 * i + j] -= m[i] * m[j] / total
        if m[i] != 0.0:
            work[W_M + 4 * i] = max(work[W_M + 4 * i], FLOOR_S2)


@kernel("void(float64[::1], int64)")
def use_estimate(work: Float, p: int) -> None:
    """Move a share of one estimate into the delay that is used from the next measurement on."""
    if work[W_M + p * (DELAYS + 1)] > SURE_S2:  # noise, at rest above all
        return
    step = MOVE_SHARE * work[W_DELTA + p]
    used = min(MOST_MAG_S if p == MAG else MOST_S, max(LEAST_S, work[W_USED + p] + step))
    work[W_DELTA + p] -= used - work[W_USED + p]
    work[W_USED + p] = used


@kernel("void(float64[::1], float64[::1])")
def widen(work: Float, out: Float) -> None:
    """Add to the published σ of attitude, velocity and position what the uncertain delays leave: V M Vᵀ.

    Args:
        work: sensitivities and covariance.
        out: shape (len(LANE_COLUMNS),), changed in place.
    """
    for state in range(9):
        total = out[10 + state] * out[10 + state]
        for i in range(DELAYS):
            for j in range(DELAYS):
                total += work[W_SENS + i * SENS + state] * work[W_M + 3 * i + j] * work[W_SENS + j * SENS + state]
        out[10 + state] = math.sqrt(max(0.0, total))

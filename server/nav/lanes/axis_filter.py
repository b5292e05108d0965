"""One axis of `nav_position`: [position, speed, acceleration error, baro offset], given the acceleration in NED.

With the attitude given, the three axes do not share an unknown. The acceleration error takes what a wrong tilt leaves
of gravity and the accelerometer's bias: a first-order Gauss-Markov process in NED. The offset is the vertical axis's
alone: baro height = offset − down.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.kernel import kernel
from server.nav.types import Float

N: Final = 4
POS: Final = 0
VEL: Final = 1
ERR: Final = 2
OFF: Final = 3


@kernel("void(float64[::1], float64[:, ::1], float64, float64, float64, float64, float64, float64)")
def predict_axis(
    x: Float, P: Float, accel_m_s2: float, dt: float, noise: float, sigma: float, tau_s: float, drift: float
) -> None:
    """Carry state and covariance over a step of dt seconds.

    Args:
        x: shape (4,). P: shape (4, 4).
        accel_m_s2: mean acceleration over the step, gravity removed.
        dt: s.
        noise: density of the acceleration, m/s²/√Hz.
        sigma: standard deviation of the acceleration error, m/s². tau_s: its correlation time.
        drift: of the baro offset, m/√s.
    """
    a = accel_m_s2 - x[ERR]
    keep = math.exp(-dt / tau_s)
    x[POS] += x[VEL] * dt + 0.5 * a * dt * dt
    x[VEL] += a * dt
    x[ERR] *= keep
    half = 0.5 * dt * dt
    for j in range(N):
        P[POS, j] += dt * P[VEL, j] - half * P[ERR, j]
        P[VEL, j] -= dt * P[ERR, j]
        P[ERR, j] *= keep
    for i in range(N):
        P[i, POS] += dt * P[i, VEL] - half * P[i, ERR]
        P[i, VEL] -= dt * P[i, ERR]
        P[i, ERR] *= keep
    q = noise * noise * dt
    P[POS, POS] += q * dt * dt / 3.0
    P[POS, VEL] += q * dt / 2.0
    P[VEL, POS] += q * dt / 2.0
    P[VEL, VEL] += q
    P[ERR, ERR] += sigma * sigma * (1.0 - keep * keep)
    P[OFF, OFF] += drift * drift * dt


@kernel("void(float64[:, ::1], float64[:, :, ::1], float64)")
def turn_error(x: Float, P: Float, angle_rad: float) -> None:
    """Turn the horizontal acceleration error with the vehicle's heading: its causes are fixed to the body.

    The axes' covariances stay apart: what the turn makes of one axis's correlation with the other's is dropped.
    """
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    north, east = x[0, ERR], x[1, ERR]
    x[0, ERR], x[1, ERR] = c * north - s * east, s * north + c * east
    for i in range(2):
        for j in range(N):
            if j != ERR:
                P[i, ERR, j] *= c
                P[i, j, ERR] *= c


@kernel("float64(float64[:, ::1], float64, float64, float64, float64)")
def innovation_variance(P: Float, on_pos: float, on_vel: float, on_off: float, variance: float) -> float:
    """Return H P Hᵀ + R for H = [on_pos, on_vel, 0, on_off]."""
    h = (on_pos, on_vel, 0.0, on_off)
    total = variance
    for i in range(N):
        for j in range(N):
            total += h[i] * P[i, j] * h[j]
    return total


@kernel("UniTuple(float64, 2)(float64[::1], float64[:, ::1], float64, float64, float64, float64, float64, float64)")
def update_axis(
    x: Float, P: Float, e: float, on_pos: float, on_vel: float, on_off: float, variance: float, age_s: float
) -> tuple[float, float]:
    """Correct the present by an innovation of `age_s` seconds ago; return what it made of position and speed then.

    The gain is the present's; the correction it makes of the past is carried to the present by the speed.
    """
    h = (on_pos, on_vel, 0.0, on_off)
    p0 = p1 = p2 = p3 = 0.0
    for j in range(N):
        p0, p1, p2, p3 = p0 + P[0, j] * h[j], p1 + P[1, j] * h[j], p2 + P[2, j] * h[j], p3 + P[3, j] * h[j]
    ph = (p0, p1, p2, p3)
    total = on_pos * p0 + on_vel * p1 + on_off * p3 + variance
    for i in range(N):
        for j in range(i, N):
            P[i, j] -= ph[i] * ph[j] / total
            P[j, i] = P[i, j]
    gain = e / total
    x[POS] += gain * (p0 + p1 * age_s)
    x[VEL] += gain * p1
    x[ERR] += gain * p2
    x[OFF] += gain * p3
    return gain * p0, gain * p1


@kernel("void(float64[:, ::1], float64, float64, float64, float64)")
def start_axis(P: Float, pos2: float, vel2: float, err2: float, off2: float) -> None:
    """Set the covariance to the given variances, uncorrelated."""
    for i in range(N):
        for j in range(N):
            P[i, j] = 0.0
    P[POS, POS], P[VEL, VEL], P[ERR, ERR], P[OFF, OFF] = pos2, vel2, err2, off2

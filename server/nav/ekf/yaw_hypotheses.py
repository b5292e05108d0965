"""The hypotheses of the yaw bank: one small filter each, their weights, and what they say together.

A hypothesis has five states: velocity north, east of the antenna m/s; ψ rad, the heading of the frame L (`yaw_bank`);
b (2), horizontal acceleration error of L, m/s². Between fixes v += R(ψ)(ΔV_L + b Δt).
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.constants import STANDARD_GRAVITY_M_S2
from server.nav.kernel import kernel
from server.nav.types import Float

HYPOTHESES: Final = 12
RING: Final = 1024
"""Steps held: one second at 1 kHz. A fix that was valid before the oldest is not used."""

# Memory.
B_FIXES: Final = 0  # velocities used since the start
B_HEAD: Final = 1  # steps since the start
B_T_FIX: Final = 2  # validity of the last velocity, ns
B_Q: Final = 4  # (4) body to L
B_SUM: Final = 8  # (2) ∫ specific force in L, m/s
B_AT_FIX: Final = 10  # (2) ring's value at the last fix, m/s
B_TURNED: Final = 12  # rad turned through since the last fix
B_SHAKEN: Final = 13  # velocity variance from vibration since the last fix, m²/s²
B_GAP2: Final = 14  # s², holes bridged since the last fix
B_ANGLE: Final = 15  # result: ψ of the bank, rad, and its standard deviation
B_SIGMA: Final = 16
B_NIS: Final = 17  # of the heaviest hypothesis at the last fix, two degrees of freedom
B_MOVED: Final = 18  # (2) velocity gained in L since the last fix, before b, m/s
B_SURPRISE: Final = 20  # running mean of B_NIS
B_BANK: Final = 24
"""Hypotheses, one after the other: five states, 25 of the covariance row by row, weight, −2 log likelihood."""
K_P: Final = 5
K_WEIGHT: Final = 30
K_NIS: Final = 31
K_SIZE: Final = 32
B_RING: Final = B_BANK + HYPOTHESES * K_SIZE  # (RING, 3) time ns, velocity in L of the antenna
B_SIZE: Final = B_RING + 3 * RING

LEVEL_SIGMA_M_S2: Final = 1.0  # 6° of tilt: what an alignment in motion leaves
LEVEL_WALK: Final = 0.03  # m/s²/√s: a gyro bias of 0.1 °/s over a manoeuvre; an accel bias turning with the body
FORCE_NOISE: Final = 0.1  # m/s/√s
TURN_NOISE: Final = 0.01  # rad/√s: a vertical gyro bias unknown by 0.1 °/s makes 6° in a minute, this 4°
TURN_SCALE_RAD: Final = 4e-4  # rad² per rad turned through: 1 % of scale error makes 3.6° in a full turn, this 2.9°
WEAK_M_S2: Final = 0.3  # an acceleration below it is sway, tilt and noise: counting its direction invents headings
GATE_NIS: Final = 9.2  # 99 % of two degrees of freedom; past it the fix counts less
SURPRISE_NIS: Final = 30.0  # one fix counts as this at most: four wild ones in a row, or many poor ones, start anew
SURPRISE_LEARN: Final = 0.1
LEAST_WEIGHT: Final = 1e-6  # a hypothesis can come back


@kernel("void(float64[::1], float64, float64, float64)")
def spread_hypotheses(s: Float, vn: float, ve: float, variance: float) -> None:
    """Put the hypotheses around the circle at the first velocity, all equally likely."""
    step = 2.0 * math.pi / HYPOTHESES
    for k in range(HYPOTHESES):
        at = B_BANK + k * K_SIZE
        for i in range(K_SIZE):
            s[at + i] = 0.0
        s[at], s[at + 1], s[at + 2] = vn, ve, -math.pi + (k + 0.5) * step
        s[at + K_P] = s[at + K_P + 6] = variance
        s[at + K_P + 12] = (0.5 * step) ** 2
        s[at + K_P + 18] = s[at + K_P + 24] = LEVEL_SIGMA_M_S2**2
        s[at + K_WEIGHT] = 1.0 / HYPOTHESES


@kernel("void(float64[::1], int64, float64)")
def advance(s: Float, at: int, dt: float) -> None:
    """Advance one hypothesis over the time between two fixes, s."""
    P = at + K_P
    c, n = math.cos(s[at + 2]), math.sin(s[at + 2])
    gx, gy = s[B_MOVED] + s[at + 3] * dt, s[B_MOVED + 1] + s[at + 4] * dt
    north, east = c * gx - n * gy, n * gx + c * gy
    s[at] += north
    s[at + 1] += east
    c, n = c * dt, n * dt
    a2 = (gx * gx + gy * gy) / (dt * dt)
    told = a2 / (a2 + WEAK_M_S2**2)
    north, east = told * north, told * east
    for j in range(5):
        p2, p3, p4 = s[P + 10 + j], s[P + 15 + j], s[P + 20 + j]
        s[P + j] += -east * p2 + c * p3 - n * p4
        s[P + 5 + j] += north * p2 + n * p3 + c * p4
    for i in range(5):
        row = P + 5 * i
        p2, p3, p4 = s[row + 2], s[row + 3], s[row + 4]
        s[row] += -east * p2 + c * p3 - n * p4
        s[row + 1] += north * p2 + n * p3 + c * p4
    force = FORCE_NOISE**2 * dt + s[B_SHAKEN] + 9.0 * s[B_GAP2]
    s[P] += force
    s[P + 6] += force
    s[P + 12] += TURN_NOISE**2 * dt + TURN_SCALE_RAD * s[B_TURNED] + 0.25 * s[B_GAP2]
    level = LEVEL_WALK**2 * dt + 0.25 * STANDARD_GRAVITY_M_S2**2 * s[B_GAP2]
    s[P + 18] += level
    s[P + 24] += level


@kernel("float64(float64[::1], int64, float64, float64, float64)")
def _nis(s: Float, at: int, vn: float, ve: float, variance: float) -> float:
    """Return the normalised innovation squared of a velocity for one hypothesis."""
    a, b, o = s[at + K_P] + variance, s[at + K_P + 6] + variance, s[at + K_P + 1]
    x, y = vn - s[at], ve - s[at + 1]
    return float((b * x * x - 2.0 * o * x * y + a * y * y) / (a * b - o * o))


@kernel("void(float64[::1], int64, int64, float64, float64)")
def _correct(s: Float, at: int, axis: int, innovation: float, variance: float) -> None:
    """Correct one hypothesis by one component of the velocity."""
    P = at + K_P
    a = (s[P + axis], s[P + axis + 5], s[P + axis + 10], s[P + axis + 15], s[P + axis + 20])
    inverse = 1.0 / (a[axis] + variance)
    for i in range(5):
        K = a[i] * inverse
        s[at + i] += K * innovation
        for j in range(5):
            s[P + 5 * i + j] -= K * a[j]


@kernel("void(float64[::1], float64, float64, float64)")
def weigh(s: Float, vn: float, ve: float, variance: float) -> None:
    """Multiply every weight by the likelihood of the velocity; then correct every hypothesis by it."""
    best = heaviest = spread = 0.0
    for k in range(HYPOTHESES):
        at = B_BANK + k * K_SIZE
        nis = _nis(s, at, vn, ve, variance)
        if s[at + K_WEIGHT] > heaviest:
            heaviest, best = s[at + K_WEIGHT], nis
            spread = 0.5 * (s[at + K_P] + s[at + K_P + 6]) + variance
    s[B_NIS] = best
    s[B_SURPRISE] += SURPRISE_LEARN * (min(SURPRISE_NIS, best) - s[B_SURPRISE])
    if best > GATE_NIS:  # the leading hypothesis is surprised: glitch or its end, in any case slowly
        variance += (best / GATE_NIS - 1.0) * spread
    least = math.inf
    for k in range(HYPOTHESES):
        at = B_BANK + k * K_SIZE
        a, b, o = s[at + K_P] + variance, s[at + K_P + 6] + variance, s[at + K_P + 1]
        s[at + K_NIS] = _nis(s, at, vn, ve, variance) + math.log(a * b - o * o)
        least = min(least, s[at + K_NIS])
        _correct(s, at, 0, vn - s[at], variance)
        _correct(s, at, 1, ve - s[at + 1], variance)
    total = 0.0
    for k in range(HYPOTHESES):
        at = B_BANK + k * K_SIZE
        s[at + K_WEIGHT] = max(LEAST_WEIGHT, s[at + K_WEIGHT]) * math.exp(0.5 * (least - s[at + K_NIS]))
        total += s[at + K_WEIGHT]
    for k in range(HYPOTHESES):
        s[B_BANK + k * K_SIZE + K_WEIGHT] /= total


@kernel("void(float64[::1])")
def summarise(s: Float) -> None:
    """Set angle and standard deviation: mean direction of the weighted hypotheses, spread about it."""
    c = n = 0.0
    for k in range(HYPOTHESES):
        at = B_BANK + k * K_SIZE
        c += s[at + K_WEIGHT] * math.cos(s[at + 2])
        n += s[at + K_WEIGHT] * math.sin(s[at + 2])
    s[B_ANGLE] = math.atan2(n, c)
    variance = 0.0
    for k in range(HYPOTHESES):
        at = B_BANK + k * K_SIZE
        off = (s[at + 2] - s[B_ANGLE] + math.pi) % (2.0 * math.pi) - math.pi
        variance += s[at + K_WEIGHT] * (s[at + K_P + 12] + off * off)
    s[B_SIGMA] = min(math.pi, math.sqrt(variance * max(1.0, 0.5 * s[B_SURPRISE])))

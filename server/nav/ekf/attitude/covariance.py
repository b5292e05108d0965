"""The covariance over one block of steps, about 20 ms."""

from __future__ import annotations

import math

from server.nav.ekf.attitude.layout import (
    ACCEL_BIAS,
    ATT,
    FIELD,
    GYRO_BIAS,
    GYRO_SCALE,
    MAG_OFFSET,
    S_B_DT,
    S_B_GAP,
    S_B_R,
    S_B_RW,
    S_B_TURN,
    S_B_VIBRATION,
    S_GRAVITY,
    S_P,
    S_REF,
    S_REST,
    S_X,
    VEL,
    N,
)
from server.nav.ekf.attitude.parameters import (
    K_ACCEL_BIAS_WALK,
    K_ACCEL_NOISE,
    K_FIELD_SIGMA,
    K_FIELD_TIME,
    K_GYRO_NOISE,
    K_GYRO_WALK_MOVING,
    K_GYRO_WALK_REST,
    K_OFFSET_WALK,
    K_TURN_NOISE,
)
from server.nav.ekf.defaults import VIBRATION_BANDWIDTH_HZ
from server.nav.kernel import kernel
from server.nav.types import Float


@kernel("void(float64[::1])", contract=True)
def _carry_rows(s: Float) -> None:
    """P ← F P: only the rows of velocity, field and attitude change.

    Velocity and field errors are held as ξ = δx − δθ × x [Barrau and Bonnabel 2017, "The invariant extended Kalman
    filter as a stable observer", §IV]: specific force drops out of F, so shaking cannot feign a heading.
    """
    v0, v1, v2 = s[S_X + VEL], s[S_X + VEL + 1], s[S_X + VEL + 2]
    f0, f1, f2 = s[S_X + FIELD], s[S_X + FIELD + 1], s[S_X + FIELD + 2]
    fall = s[S_GRAVITY] * s[S_B_DT]
    v, f, t = S_P + N * VEL, S_P + N * FIELD, S_P + N * ATT
    for j in range(N):
        s[v + j] -= fall * s[t + N + j]  # g × δθ
        s[v + N + j] += fall * s[t + j]
    for j in range(N):
        d0 = d1 = d2 = 0.0
        for k in range(3):
            b, a = s[S_P + N * (GYRO_BIAS + k) + j], s[S_P + N * (ACCEL_BIAS + k) + j]
            d0 -= s[S_B_R + k] * b
            d1 -= s[S_B_R + 3 + k] * b
            d2 -= s[S_B_R + 6 + k] * b
            s[v + j] -= s[S_B_R + k] * a
            s[v + N + j] -= s[S_B_R + 3 + k] * a
            s[v + 2 * N + j] -= s[S_B_R + 6 + k] * a
        for k in range(9):
            m = s[S_P + N * (GYRO_SCALE + k) + j]
            d0 -= s[S_B_RW + k] * m
            d1 -= s[S_B_RW + 9 + k] * m
            d2 -= s[S_B_RW + 18 + k] * m
        s[t + j] += d0
        s[t + N + j] += d1
        s[t + 2 * N + j] += d2
        s[v + j] += v1 * d2 - v2 * d1  # the frame that ξ is held in has turned by d
        s[v + N + j] += v2 * d0 - v0 * d2
        s[v + 2 * N + j] += v0 * d1 - v1 * d0
        s[f + j] += f1 * d2 - f2 * d1
        s[f + N + j] += f2 * d0 - f0 * d2
        s[f + 2 * N + j] += f0 * d1 - f1 * d0


@kernel("void(float64[::1])")
def _transpose(s: Float) -> None:
    for i in range(N):
        for j in range(i):
            a, b = S_P + N * i + j, S_P + N * j + i
            s[a], s[b] = s[b], s[a]


@kernel("void(float64[::1])")
def _symmetrize(s: Float) -> None:
    for i in range(N):
        for j in range(i):
            a, b = S_P + N * i + j, S_P + N * j + i
            s[a] = s[b] = 0.5 * (s[a] + s[b])


@kernel("void(float64[::1], float64)")
def _return_rows(s: Float, share: float) -> None:
    """P ← F P for a field that goes back to the usual one by `share`: ξ loses that share of δf = ξ + δθ × f."""
    f, t = S_P + N * FIELD, S_P + N * ATT
    north, down = s[S_REF], s[S_REF + 1]
    for j in range(N):
        x, y, z = s[t + j], s[t + N + j], s[t + 2 * N + j]
        s[f + j] -= share * (s[f + j] + y * down)
        s[f + N + j] -= share * (s[f + N + j] + z * north - x * down)
        s[f + 2 * N + j] -= share * (s[f + 2 * N + j] - y * north)


@kernel("void(float64[::1], float64[::1], float64)")
def _return_field(s: Float, par: Float, dt: float) -> None:
    """Let the field tend to the usual one: another place has another disturbance. This tells the heading."""
    keep = math.exp(-dt / par[K_FIELD_TIME])
    _return_rows(s, 1.0 - keep)
    _transpose(s)
    _return_rows(s, 1.0 - keep)
    for i in range(3):
        usual = s[S_REF] if i == 0 else (s[S_REF + 1] if i == 2 else 0.0)
        s[S_X + FIELD + i] = usual + keep * (s[S_X + FIELD + i] - usual)
        s[S_P + (N + 1) * (FIELD + i)] += (1.0 - keep * keep) * par[K_FIELD_SIGMA] ** 2


@kernel("void(float64[::1], float64[::1])")
def close_block(s: Float, par: Float) -> None:
    """Advance the covariance over the block that is open.

    Args:
        s: shape (S_SIZE,), memory.
        par: shape (K_SIZE,), parameters.
    """
    dt, gap, moving = s[S_B_DT], s[S_B_GAP], s[S_REST] == 0.0
    _carry_rows(s)
    _transpose(s)
    _carry_rows(s)
    if moving:
        _return_field(s, par, dt)
    _symmetrize(s)
    shaking = s[S_B_VIBRATION] ** 2 / (3.0 * VIBRATION_BANDWIDTH_HZ)
    att = par[K_GYRO_NOISE] ** 2 * dt + par[K_TURN_NOISE] ** 2 * s[S_B_TURN] + (0.5 * gap) ** 2
    vel = (par[K_ACCEL_NOISE] ** 2 + shaking) * dt + (3.0 * gap) ** 2
    walk = par[K_GYRO_WALK_MOVING] if moving else par[K_GYRO_WALK_REST]
    for i in range(3):
        s[S_P + (N + 1) * (ATT + i)] += att
        s[S_P + (N + 1) * (VEL + i)] += vel
        s[S_P + (N + 1) * (GYRO_BIAS + i)] += walk**2 * dt
        s[S_P + (N + 1) * (ACCEL_BIAS + i)] += par[K_ACCEL_BIAS_WALK] ** 2 * dt
        if moving:
            s[S_P + (N + 1) * (MAG_OFFSET + i)] += par[K_OFFSET_WALK] ** 2 * dt

"""Heading without a magnetometer: a bank of small filters whose accelerations must explain the receiver's velocities.

The gyros carry an attitude of their own whose heading starts anywhere: the frame L, level, turned about the vertical
by an unknown angle ψ against north. Specific force is integrated in L, once for all hypotheses; that is all a
navigation step costs. At a fix each hypothesis, an extended Kalman filter with the states

    velocity north, east of the antenna m/s;  ψ rad;  b (2) horizontal acceleration error of L, m/s²

advances by v += R(ψ)(ΔV_L + b Δt) and is corrected by the velocity; its weight is multiplied by the likelihood of the
innovation (a Gaussian sum [Alspach and Sorenson 1972]). b is the tilt error of L times gravity, so levelling needs no
assumption on the motion: what the bank learns of b is fed back into L. Nothing here depends on the main filter's
heading, tilt, velocity or accelerometer bias, which a wrong heading spoils; its gyro bias is used.

The sums since the start are kept for a second, so a fix is used at its own time of validity, whatever its delay.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.constants import STANDARD_GRAVITY_M_S2
from server.nav.ekf.layout import PAR_LEVER, U_DT, U_DTHETA, U_DVEL, U_GAP_S, U_GYRO, U_T, U_VIBRATION
from server.nav.ekf.states import X_GYRO_BIAS, X_Q
from server.nav.ekf.yaw_hypotheses import (
    B_ANGLE,
    B_AT_FIX,
    B_BANK,
    B_FIXES,
    B_GAP2,
    B_HEAD,
    B_MOVED,
    B_Q,
    B_RING,
    B_SHAKEN,
    B_SIGMA,
    B_SIZE,
    B_SUM,
    B_SURPRISE,
    B_T_FIX,
    B_TURNED,
    GATE_NIS,
    HYPOTHESES,
    K_SIZE,
    K_WEIGHT,
    RING,
    advance,
    spread_hypotheses,
    summarise,
    weigh,
)
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float

PAUSE_S: Final = 10.0  # without velocity for longer, the tilt of L has drifted: start again
SHAKING_HZ: Final = 100.0  # bandwidth over which vibration is white, as in `predict`
VELOCITY_FLOOR_M_S: Final = 0.05
UNKNOWN_M_S: Final = 0.5  # older receivers hold the course of a slow vehicle: the recorded quadrotors at take-off
CORRELATION_S: Final = 1.0  # of receivers' velocity errors: taken as white noise of the same slow power
TIMING_S: Final = 0.04  # what is left of the delays that are known


def new_bank() -> Float:
    """Return the memory of a bank, shape (B_SIZE,), not started."""
    s = np.zeros(B_SIZE)
    bank_start(s)
    return s


@kernel("void(float64[::1])")
def bank_start(s: Float) -> None:
    """Forget everything; the following steps take the tilt of the state they are given until a fix comes."""
    for i in range(B_BANK):
        s[i] = 0.0
    s[B_Q] = 1.0
    s[B_SIGMA] = math.pi


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def bank_predict(u: Float, x: Float, par: Float, s: Float) -> None:
    """Advance the frame L and its sums by one navigation step; the hypotheses wait for a fix.

    Args:
        u: shape (U_SIZE,), the step.
        x: shape (X_SIZE,), state of the aligned main filter: its gyro bias is used; until the first fix its attitude.
        par: shape (PAR_SIZE,), for the lever arm.
        s: shape (B_SIZE,), memory of the bank.
    """
    dt = u[U_DT]
    q = (s[B_Q], s[B_Q + 1], s[B_Q + 2], s[B_Q + 3])
    R = matrix_entries(q[0], q[1], q[2], q[3])
    dx, dy, dz = u[U_DVEL], u[U_DVEL + 1], u[U_DVEL + 2]
    s[B_SUM] += R[0] * dx + R[1] * dy + R[2] * dz
    s[B_SUM + 1] += R[3] * dx + R[4] * dy + R[5] * dz
    rx = u[U_DTHETA] - x[X_GYRO_BIAS] * dt
    ry = u[U_DTHETA + 1] - x[X_GYRO_BIAS + 1] * dt
    rz = u[U_DTHETA + 2] - x[X_GYRO_BIAS + 2] * dt
    turn = quat_from_rotvec(rx, ry, rz)
    new = quat_mul(q[0], q[1], q[2], q[3], turn[0], turn[1], turn[2], turn[3])
    # One Newton step to unit length: a step leaves it within rounding.
    scale = 1.5 - 0.5 * (new[0] ** 2 + new[1] ** 2 + new[2] ** 2 + new[3] ** 2)
    for i in range(4):
        s[B_Q + i] = new[i] * scale if s[B_FIXES] > 0.0 else x[X_Q + i]
    s[B_TURNED] += math.sqrt(rx * rx + ry * ry + rz * rz)
    s[B_SHAKEN] += u[U_VIBRATION] ** 2 / (3.0 * SHAKING_HZ) * dt
    s[B_GAP2] += u[U_GAP_S] ** 2
    at = B_RING + 3 * (int(s[B_HEAD]) % RING)
    s[B_HEAD] += 1.0
    s[at], s[at + 1], s[at + 2] = u[U_T], s[B_SUM], s[B_SUM + 1]
    lx, ly, lz = par[PAR_LEVER], par[PAR_LEVER + 1], par[PAR_LEVER + 2]
    if lx != 0.0 or ly != 0.0 or lz != 0.0:
        wx, wy, wz = u[U_GYRO] - x[X_GYRO_BIAS], u[U_GYRO + 1] - x[X_GYRO_BIAS + 1], u[U_GYRO + 2] - x[X_GYRO_BIAS + 2]
        E = matrix_entries(s[B_Q], s[B_Q + 1], s[B_Q + 2], s[B_Q + 3])
        sx, sy, sz = wy * lz - wz * ly, wz * lx - wx * lz, wx * ly - wy * lx
        s[at + 1] += E[0] * sx + E[1] * sy + E[2] * sz
        s[at + 2] += E[3] * sx + E[4] * sy + E[5] * sz


@kernel("UniTuple(float64, 3)(float64[::1], float64)")
def _velocity_then(s: Float, t_ns: float) -> tuple[float, float, float]:
    """Return (1, antenna velocity in L at t_ns), between two steps; (0, …) where the ring does not reach."""
    head = int(s[B_HEAD])
    oldest = max(0, head - RING)
    k = head - 2
    while k > oldest and s[B_RING + 3 * (k % RING)] > t_ns:
        k -= 1
    if k < oldest:
        return 0.0, 0.0, 0.0
    a, b = B_RING + 3 * (k % RING), B_RING + 3 * ((k + 1) % RING)
    share = (t_ns - s[a]) / max(1.0, s[b] - s[a])
    if not -0.5 <= share <= 20.0:
        return 0.0, 0.0, 0.0
    return 1.0, s[a + 1] + share * (s[b + 1] - s[a + 1]), s[a + 2] + share * (s[b + 2] - s[a + 2])


@kernel("void(float64[::1], float64)")
def _feed_back(s: Float, t_ns: float) -> None:
    """Tilt L by what the bank has learned of b; every hypothesis and the sums after t_ns know of it."""
    bx = by = 0.0
    for k in range(HYPOTHESES):
        at = B_BANK + k * K_SIZE
        bx += s[at + K_WEIGHT] * s[at + 3]
        by += s[at + K_WEIGHT] * s[at + 4]
    for k in range(HYPOTHESES):
        s[B_BANK + k * K_SIZE + 3] -= bx
        s[B_BANK + k * K_SIZE + 4] -= by
    turn = quat_from_rotvec(by / STANDARD_GRAVITY_M_S2, -bx / STANDARD_GRAVITY_M_S2, 0.0)
    new = quat_mul(turn[0], turn[1], turn[2], turn[3], s[B_Q], s[B_Q + 1], s[B_Q + 2], s[B_Q + 3])
    for i in range(4):
        s[B_Q + i] = new[i]
    head = int(s[B_HEAD])
    k = head - 1
    while k >= max(0, head - RING) and s[B_RING + 3 * (k % RING)] > t_ns:
        at = B_RING + 3 * (k % RING)
        after = (s[at] - t_ns) * 1e-9
        s[at + 1] += bx * after
        s[at + 2] += by * after
        if k == head - 1:
            s[B_SUM] += bx * after
            s[B_SUM + 1] += by * after
        k -= 1


@kernel("boolean(float64, float64, float64, float64, float64[::1])")
def bank_velocity(t_ns: float, vn: float, ve: float, sigma: float, s: Float) -> bool:
    """Weigh and correct the hypotheses by a receiver's velocity; return whether it was used.

    Args:
        t_ns: time of validity on the steps' clock, at most a ring behind the newest step.
        vn, ve: velocity of the antenna north, east, m/s.
        sigma: its standard deviation per axis, m/s; NaN where the receiver does not say.
        s: shape (B_SIZE,), memory of the bank.
    """
    dt = (t_ns - s[B_T_FIX]) * 1e-9
    if s[B_FIXES] > 0.0 and (dt > PAUSE_S or s[B_SURPRISE] > GATE_NIS):
        bank_start(s)
    found, x, y = _velocity_then(s, t_ns)
    if found == 0.0 or not math.isfinite(vn + ve) or (s[B_FIXES] > 0.0 and dt <= 0.0):
        return False
    variance = max(VELOCITY_FLOOR_M_S, sigma) ** 2 if math.isfinite(sigma) else UNKNOWN_M_S**2
    if s[B_FIXES] == 0.0:
        spread_hypotheses(s, vn, ve, variance)
    else:
        s[B_MOVED], s[B_MOVED + 1] = x - s[B_AT_FIX], y - s[B_AT_FIX + 1]
        for k in range(HYPOTHESES):
            advance(s, B_BANK + k * K_SIZE, dt)
        variance *= 1.0 + 2.0 * CORRELATION_S / dt
        variance += TIMING_S**2 * (s[B_MOVED] ** 2 + s[B_MOVED + 1] ** 2) / (dt * dt)
        weigh(s, vn, ve, variance)
        _feed_back(s, t_ns)
    s[B_FIXES] += 1.0
    s[B_T_FIX], s[B_AT_FIX], s[B_AT_FIX + 1] = t_ns, x, y
    s[B_TURNED] = s[B_SHAKEN] = s[B_GAP2] = 0.0
    summarise(s)
    return True


@kernel("UniTuple(float64, 2)(float64[::1])")
def bank_result(s: Float) -> tuple[float, float]:
    """Return the heading of the body at the newest step and its standard deviation, rad; σ is π before the first."""
    R = matrix_entries(s[B_Q], s[B_Q + 1], s[B_Q + 2], s[B_Q + 3])
    yaw = s[B_ANGLE] + math.atan2(R[3], R[0])
    return (yaw + math.pi) % (2.0 * math.pi) - math.pi, s[B_SIGMA]


@kernel("UniTuple(float64, 2)(float64[::1], float64[::1])")
def bank_turn(x: Float, s: Float) -> tuple[float, float]:
    """Return the angle in [−π, π) by which a state at the newest step must turn about down, and its deviation, rad.

    It is the vertical part of the rotation between two attitudes, so a body that points straight up has one as well.
    """
    q = quat_mul(s[B_Q], s[B_Q + 1], s[B_Q + 2], s[B_Q + 3], x[X_Q], -x[X_Q + 1], -x[X_Q + 2], -x[X_Q + 3])
    angle = s[B_ANGLE] + 2.0 * math.atan2(q[3], q[0])
    return (angle + math.pi) % (2.0 * math.pi) - math.pi, s[B_SIGMA]

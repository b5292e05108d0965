"""GNSS position and velocity: predicted at the antenna, at the receiver's time of validity.

A receiver's own accuracies are believed only as far as the innovations bear them out: for each group the ratio of
the observed innovation variance (less the filter's own share) to the reported one is tracked and scales it.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import FUSED, REFUSED_GATE
from server.nav.earth import curvature_radii, ned_from_lla
from server.nav.ekf.delays import POSITION, VELOCITY
from server.nav.ekf.layout import (
    A_BARO_OFFSET,
    A_BARO_OFFSET_VAR,
    A_GNSS_INTERVAL,
    A_K_POS,
    A_K_VEL,
    A_SITE,
    A_T_BARO,
    A_T_RESET,
    C_BARO_SEEN,
    C_POSITIONED,
    H_ACC,
    H_DATA,
    H_FLOOR,
    H_SHIFT,
    H_STATUS,
    H_T,
    H_VAR,
    HANDLER,
    PAR_GATE,
    PAR_GNSS_CORRELATION,
    PAR_LEVER,
    U_ACCEL_MEAN,
    U_GYRO,
    U_T,
    UNDECIDED,
    W_D,
    W_H,
    W_INNOV,
    W_OBS,
    W_PRED,
    W_RATIO,
    W_VAR,
)
from server.nav.ekf.predict import gravity_here, move_position
from server.nav.ekf.states import POS, VEL, X_ACCEL_BIAS, X_GYRO_BIAS, X_POS, X_Q, X_VEL, packed
from server.nav.ekf.update import clear_row, correction_seen, fuse, project, reset_axis
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int

LEARN: Final = 0.05
"""Weight of one fix in the tracked ratio: a memory of 20 fixes, 4 s at 5 Hz."""
K_MIN: Final = 0.0004  # a fiftieth of the reported standard deviation
K_MAX: Final = 400.0
JUDGED_K: Final = 0.1  # a run of repeated digits must not make the first movement an outlier
REFUSED_K: Final = 4.0  # a receiver twice as bad as it says is possible, ten times is a glitch
POSITION_FLOOR_M: Final = 0.005  # rounding to 1e-7 degrees, 11 mm, is 3 mm RMS
VELOCITY_FLOOR_M_S: Final = 0.01  # resolution of centimetres a second
BARO_FRESH_NS: Final = 2e9
RESET_SPEED_M_S: Final = 10.0
POSITION_CORRELATION: Final = 4.0
"""Variance factor: (1 + ρ)/(1 − ρ) with ρ = 0.6 from fix to fix. A receiver's slow error is not averaged here but
published on top (`intake.WANDER_SHARE`)."""
ALTITUDE_CORRELATION_S: Final = 10.0  # GNSS height errors stay the same over about this long (data INDEX)


@kernel("UniTuple(float64, 9)(float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64)")
def antenna(
    x: Float, u: Float, par: Float, aux: Float, ctl: Int, t_ns: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return antenna offset from the state's position NED m, its velocity NED m/s and acceleration, at t_ns."""
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    tau = (t_ns - u[U_T]) * 1e-9
    lx, ly, lz = par[PAR_LEVER], par[PAR_LEVER + 1], par[PAR_LEVER + 2]
    wx, wy, wz = u[U_GYRO] - x[X_GYRO_BIAS], u[U_GYRO + 1] - x[X_GYRO_BIAS + 1], u[U_GYRO + 2] - x[X_GYRO_BIAS + 2]
    fx = u[U_ACCEL_MEAN] - x[X_ACCEL_BIAS]
    fy = u[U_ACCEL_MEAN + 1] - x[X_ACCEL_BIAS + 1]
    fz = u[U_ACCEL_MEAN + 2] - x[X_ACCEL_BIAS + 2]
    sx, sy, sz = wy * lz - wz * ly, wz * lx - wx * lz, wx * ly - wy * lx
    an = R[0] * fx + R[1] * fy + R[2] * fz
    ae = R[3] * fx + R[4] * fy + R[5] * fz
    ad = R[6] * fx + R[7] * fy + R[8] * fz + gravity_here(x, aux, ctl)
    half = 0.5 * tau * tau
    return (
        R[0] * lx + R[1] * ly + R[2] * lz + tau * x[X_VEL] + half * an,
        R[3] * lx + R[4] * ly + R[5] * lz + tau * x[X_VEL + 1] + half * ae,
        R[6] * lx + R[7] * ly + R[8] * lz + tau * x[X_VEL + 2] + half * ad,
        x[X_VEL] + R[0] * sx + R[1] * sy + R[2] * sz + tau * an,
        x[X_VEL + 1] + R[3] * sx + R[4] * sy + R[5] * sz + tau * ae,
        x[X_VEL + 2] + R[6] * sx + R[7] * sy + R[8] * sz + tau * ad,
        an,
        ae,
        ad,
    )


@kernel("float64(float64, float64, float64)")
def tracked_ratio(k: float, excess: float, learn: float) -> float:
    """Return the new ratio of observed to reported variance after one observation of it."""
    return min(K_MAX, max(K_MIN, k + learn * (min(excess, 10.0 * k + 1.0) - k)))


@kernel("void(float64[::1], float64[::1], int64, int64, float64, int64)")
def _scale(h: Float, aux: Float, axes: int, k_index: int, floor: float, first: int) -> None:
    """Set the variances of `axes` components from the reported accuracies and the tracked ratio."""
    for i in range(first, first + axes):
        h[H_VAR + i] = max(floor * floor, h[H_FLOOR] ** 2, aux[k_index] * h[H_ACC + i] ** 2)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], int64, int64, int64)")
def _learn(h: Float, P: Float, aux: Float, work: Float, state: int, n: int, k_index: int) -> None:
    """Track the ratio of the innovations' variance, less the filter's own share, to the reported variance."""
    excess = 0.0
    for i in range(n):
        excess += (work[W_INNOV + i] ** 2 - P[packed(state + i, state + i)]) / (n * h[H_ACC + i] ** 2)
    aux[k_index] = tracked_ratio(aux[k_index], excess, LEARN)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], int64, int64)")
def _judge(h: Float, P: Float, par: Float, work: Float, state: int, n: int) -> None:
    """Decide once whether a measurement is believed: worst component against its gate."""
    worst = 0.0
    for i in range(n):
        variance = P[packed(state + i, state + i)] + h[H_VAR + i]
        work[W_VAR + i] = variance
        ratio = work[W_INNOV + i] ** 2 / (par[PAR_GATE] ** 2 * variance)
        worst = ratio if not ratio <= worst else worst  # a NaN stays and refuses
    work[W_RATIO] = worst
    h[H_STATUS] = FUSED if worst <= 1.0 else REFUSED_GATE


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64, int64, int64, float64, float64)"
)
def _believe(
    h: Float,
    P: Float,
    par: Float,
    aux: Float,
    work: Float,
    state: int,
    n: int,
    k_index: int,
    floor: float,
    alike: float,
) -> None:
    """Judge by what was known before this fix, then learn from it; a refused one teaches only so much.

    Otherwise a receiver that jumps would talk the filter into believing the jump: its own contradiction, taken for
    noise, would open the gate within seconds.
    """
    before = aux[k_index]
    aux[k_index] = max(before, JUDGED_K)
    _scale(h, aux, n, k_index, floor, 0)
    for i in range(n):
        h[H_VAR + i] *= alike
    _judge(h, P, par, work, state, n)
    aux[k_index] = before
    _learn(h, P, aux, work, state, 2, k_index)
    if h[H_STATUS] != FUSED:
        aux[k_index] = min(aux[k_index], max(before, REFUSED_K))
    _scale(h, aux, n, k_index, floor, 0)
    for i in range(n):
        h[H_VAR + i] *= alike


@kernel("void(float64[::1], float64[::1], int64, float64, float64, int64, float64)")
def _fuse_axis(
    P: Float, work: Float, state: int, innovation: float, variance: float, delay: int, change: float
) -> None:
    """Fuse one directly observed state, which changes by so much a second and is late by delay number `delay`."""
    clear_row(work)
    work[W_H + state] = 1.0
    work[W_D + delay] = -change
    total = project(P, work) + variance
    fuse(P, work, innovation - correction_seen(work), total)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])")
def _decide_position(h: Float, P: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Set status, variances and, while the baro carries the height, how far its datum moves."""
    _believe(h, P, par, aux, work, POS, 2, A_K_POS, POSITION_FLOOR_M, POSITION_CORRELATION)
    h[H_SHIFT] = h[H_VAR + 2] = 0.0
    has_height = not math.isnan(h[H_DATA + 2])
    slow = max(1.0, 2.0 * ALTITUDE_CORRELATION_S / max(0.05, aux[A_GNSS_INTERVAL]))
    if has_height and ctl[C_BARO_SEEN] and h[H_T] - aux[A_T_BARO] < BARO_FRESH_NS:
        variance = h[H_ACC + 2] ** 2 * slow
        total = aux[A_BARO_OFFSET_VAR] + P[packed(POS + 2, POS + 2)] + variance
        work[W_VAR + 2] = total
        if h[H_STATUS] == FUSED and work[W_INNOV + 2] ** 2 < par[PAR_GATE] ** 2 * total:
            gain = aux[A_BARO_OFFSET_VAR] / total
            h[H_SHIFT] = -gain * work[W_INNOV + 2]
            aux[A_BARO_OFFSET] += h[H_SHIFT]
            aux[A_BARO_OFFSET_VAR] *= 1.0 - gain
    elif has_height:
        h[H_VAR + 2] = h[H_ACC + 2] ** 2 * math.sqrt(slow)
        work[W_VAR + 2] = P[packed(POS + 2, POS + 2)] + h[H_VAR + 2]


@kernel(HANDLER)
def position(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Handle a GNSS position: data = latitude rad, longitude rad, height m; decide at first use, then correct."""
    ant = antenna(x, u, par, aux, ctl, h[H_T])
    meridian, prime = curvature_radii(x[X_POS])
    here = ned_from_lla(x[X_POS], x[X_POS + 1], x[X_POS + 2], aux[A_SITE], aux[A_SITE + 1], aux[A_SITE + 2])
    dlon = (h[H_DATA + 1] - x[X_POS + 1] + math.pi) % (2.0 * math.pi) - math.pi
    work[W_INNOV] = (h[H_DATA] - x[X_POS]) * (meridian + x[X_POS + 2]) - ant[0]
    work[W_INNOV + 1] = dlon * (prime + x[X_POS + 2]) * math.cos(x[X_POS]) - ant[1]
    work[W_INNOV + 2] = x[X_POS + 2] - h[H_DATA + 2] - ant[2]
    for i in range(3):
        work[W_PRED + i] = here[i] + ant[i]
        work[W_OBS + i] = work[W_PRED + i] + work[W_INNOV + i]
    if h[H_STATUS] == UNDECIDED:
        _decide_position(h, P, par, aux, ctl, work)
    if h[H_STATUS] != FUSED:
        return
    _fuse_axis(P, work, POS, work[W_INNOV], h[H_VAR], POSITION, ant[3])
    _fuse_axis(P, work, POS + 1, work[W_INNOV + 1], h[H_VAR + 1], POSITION, ant[4])
    if h[H_VAR + 2] > 0.0:
        _fuse_axis(P, work, POS + 2, work[W_INNOV + 2], h[H_VAR + 2], POSITION, ant[5])
    x[X_POS + 2] += h[H_SHIFT]


@kernel(HANDLER)
def reset_position(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Put the state at the receiver's position, with its accuracy and an unknown velocity; the size stays in work."""
    for i in range(3):
        reset_axis(P, POS + i, h[H_ACC + i] ** 2)
        reset_axis(P, VEL + i, RESET_SPEED_M_S**2)
        if not ctl[C_POSITIONED]:
            x[X_VEL + i] = 0.0
    meridian, prime = curvature_radii(x[X_POS])
    dlon = (h[H_DATA + 1] - x[X_POS + 1] + math.pi) % (2.0 * math.pi) - math.pi
    work[W_INNOV] = (h[H_DATA] - x[X_POS]) * (meridian + x[X_POS + 2])
    work[W_INNOV + 1] = dlon * (prime + x[X_POS + 2]) * math.cos(x[X_POS])
    height = x[X_POS + 2] if math.isnan(h[H_DATA + 2]) else h[H_DATA + 2]
    work[W_INNOV + 2] = x[X_POS + 2] - height
    x[X_POS], x[X_POS + 1], x[X_POS + 2] = h[H_DATA], h[H_DATA + 1], height
    ctl[C_POSITIONED] = 1
    ant = antenna(x, u, par, aux, ctl, h[H_T])
    move_position(x, -ant[0], -ant[1], -ant[2])
    if h[H_STATUS] == UNDECIDED:
        aux[A_K_POS] = aux[A_K_VEL] = 1.0
        aux[A_T_RESET] = h[H_T]


@kernel(HANDLER)
def velocity(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Handle a GNSS velocity: data = NED m/s, down may be NaN; decide at first use, then correct."""
    ant = antenna(x, u, par, aux, ctl, h[H_T])
    n = 2 if math.isnan(h[H_DATA + 2]) else 3
    for i in range(3):
        work[W_PRED + i] = ant[3 + i]
        work[W_OBS + i] = h[H_DATA + i]
        work[W_INNOV + i] = h[H_DATA + i] - ant[3 + i]
    if h[H_STATUS] == UNDECIDED:
        _believe(h, P, par, aux, work, VEL, n, A_K_VEL, VELOCITY_FLOOR_M_S, par[PAR_GNSS_CORRELATION])
    if h[H_STATUS] == FUSED:
        for i in range(n):
            _fuse_axis(P, work, VEL + i, work[W_INNOV + i], h[H_VAR + i], VELOCITY, ant[6 + i])

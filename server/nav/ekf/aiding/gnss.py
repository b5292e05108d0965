"""GNSS position and velocity: predicted at the antenna, at the receiver's time of validity.

A receiver's own accuracies are believed only as far as the innovations bear them out: for each group the ratio of
the observed innovation variance (less the filter's own share) to the reported one is tracked and scales it.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import FUSED, REFUSED_GATE
from server.nav.earth import curvature_radii, ned_from_lla
from server.nav.ekf.blocks import start_jitter, start_wander
from server.nav.ekf.delays import POSITION, VELOCITY
from server.nav.ekf.layout import (
    A_GNSS_INTERVAL,
    A_K_ALT,
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
    H_STATUS,
    H_T,
    H_VAR,
    H_WANDER,
    H_WANDER_D,
    HANDLER,
    PAR_GATE,
    PAR_GNSS_CORRELATION,
    PAR_GNSS_JITTER,
    PAR_GNSS_JITTER_TAU,
    PAR_GNSS_SPEED,
    PAR_GNSS_SPEED_TAU,
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
from server.nav.ekf.states import (
    JITTER,
    POS,
    VEL,
    WANDER,
    WITH_JITTER,
    X_ACCEL_BIAS,
    X_GYRO_BIAS,
    X_JITTER,
    X_POS,
    X_Q,
    X_VEL,
    X_WANDER,
    packed,
)
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
ROUNDING_M: Final = 0.003  # 1e-7 degrees, 11 mm, over √12
POSITION_FLOOR_M: Final = 0.005
VELOCITY_FLOOR_M_S: Final = 0.01  # resolution of centimetres a second
BARO_FRESH_NS: Final = 2e9
RESET_SPEED_M_S: Final = 10.0
POSITION_CORRELATION: Final = 4.0
"""Variance factor: (1 + ρ)/(1 − ρ) with ρ = 0.6 from fix to fix, of an error whose memory is not told. A receiver's
slow error is not averaged here but a state of the filter (`states`)."""
ALTITUDE_CORRELATION_S: Final = 10.0  # heights of a carrier-phase fix keep their error about this long (data INDEX)


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


@kernel("float64(float64[::1], float64[::1], float64[::1], float64[::1], int64, int64, int64)")
def _learn(h: Float, own: Float, aux: Float, work: Float, first: int, n: int, k_index: int) -> float:
    """Track the ratio of the innovations' variance, less the filter's own share, to the reported variance."""
    excess = 0.0
    for i in range(first, first + n):
        excess += (work[W_INNOV + i] ** 2 - own[i]) / (n * h[H_ACC + i] ** 2)
    aux[k_index] = tracked_ratio(aux[k_index], excess, LEARN)
    k: float = aux[k_index]
    return k


@kernel("void(float64[::1], float64[::1], float64[::1], int64)")
def _judge(h: Float, par: Float, work: Float, n: int) -> None:
    """Decide once whether a measurement is believed: worst component against its gate.

    work[W_VAR:] holds the filter's own share. Its noise as it is weighted, repetition included, widens the gate.
    """
    worst = 0.0
    for i in range(n):
        variance = work[W_VAR + i] + h[H_VAR + i]
        ratio = work[W_INNOV + i] ** 2 / (par[PAR_GATE] ** 2 * variance)
        worst = ratio if not ratio <= worst else worst  # a NaN stays and refuses
    work[W_RATIO] = worst
    h[H_STATUS] = FUSED if worst <= 1.0 else REFUSED_GATE


@kernel("float64(float64[::1], float64, int64, float64)")
def _variance(h: Float, k: float, axis: int, floor: float) -> float:
    """Return the variance of one component: the reported one as far as the innovations bear it out."""
    return float(max(floor * floor, h[H_FLOOR] ** 2, k * h[H_ACC + axis] ** 2))


@kernel("float64(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64, int64, float64, float64)")
def _believe(
    h: Float, own: Float, par: Float, aux: Float, work: Float, n: int, k_index: int, floor: float, alike: float
) -> float:
    """Judge by what was known before this fix, then learn from it; a refused one teaches only so much.

    Otherwise a receiver that jumps would talk the filter into believing the jump: its own contradiction, taken for
    noise, would open the gate within seconds. Returns the tracked ratio as it is now.
    """
    before = aux[k_index]
    for i in range(n):
        h[H_VAR + i] = alike * _variance(h, max(before, JUDGED_K), i, floor)
    _judge(h, par, work, n)
    k = _learn(h, own, aux, work, 0, 2, k_index)
    if h[H_STATUS] != FUSED:
        k = aux[k_index] = min(k, max(before, REFUSED_K))
    for i in range(n):
        h[H_VAR + i] = alike * _variance(h, k, i, floor)
    return float(k)


@kernel("void(float64[::1], float64[::1], float64[::1], int64)")
def observe(h: Float, P: Float, work: Float, axis: int) -> None:
    """Set the row of H of one axis of a fix: the position and the receiver's own slow and quick error."""
    clear_row(work)
    work[W_H + POS + axis] = 1.0
    if h[H_WANDER] > 0.0:
        work[W_H + WANDER + axis] = 1.0
    if P[packed(JITTER, JITTER)] > 0.0:
        work[W_H + JITTER + axis] = 1.0


@kernel("float64(float64[::1])")
def _down_ratio(h: Float) -> float:
    """Return the receiver's own ratio of its error down to that of one horizontal axis."""
    return float(math.sqrt(2.0) * h[H_ACC + 2] / h[H_ACC])


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])")
def _start_slow(h: Float, x: Float, P: Float, par: Float, work: Float) -> None:
    """Activate the receiver's slow and quick errors when a fix first needs them."""
    if h[H_WANDER] > 0.0 and not P[packed(WANDER, WANDER)] > 0.0:
        start_wander(x, P, work, h[H_WANDER], h[H_WANDER_D])
    told = math.isfinite(par[PAR_GNSS_JITTER]) and par[PAR_GNSS_JITTER_TAU] > 0.0
    if told and not P[packed(JITTER, JITTER)] > 0.0:
        start_jitter(x, P, work, par[PAR_GNSS_JITTER], par[PAR_GNSS_JITTER] * _down_ratio(h))


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])")
def _decide_position(h: Float, P: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Set status and variances: what is recorded is the fix's own, what is weighted also counts its repetition."""
    n = 2 if math.isnan(h[H_DATA + 2]) else 3
    own = work[W_VAR : W_VAR + 3]
    for i in range(n):
        observe(h, P, work, i)
        own[i] = project(P, work)
    if math.isfinite(par[PAR_GNSS_JITTER]):
        white = 0.0 if par[PAR_GNSS_JITTER_TAU] > 0.0 else par[PAR_GNSS_JITTER] ** 2
        steady = 1.0
        h[H_VAR] = h[H_VAR + 1] = ROUNDING_M**2 + white
        v2 = ROUNDING_M**2 + white * _down_ratio(h) ** 2
        _judge(h, par, work, 2)
    else:
        steady = POSITION_CORRELATION
        _believe(h, own, par, aux, work, 2, A_K_POS, POSITION_FLOOR_M, steady)
        v2 = h[H_ACC + 2] ** 2
        if n == 3 and h[H_WANDER] > 0.0:
            v2 = _variance(h, _learn(h, own, aux, work, 2, 1, A_K_ALT), 2, POSITION_FLOOR_M)
    own[0] += h[H_VAR] / steady
    own[1] += h[H_VAR + 1] / steady
    if n == 2:
        h[H_VAR + 2] = 0.0
        return
    h[H_VAR + 2] = v2 * steady
    by_baro = ctl[C_BARO_SEEN] == 1 and h[H_T] - aux[A_T_BARO] < BARO_FRESH_NS
    if not h[H_WANDER] > 0.0:
        slow = max(1.0, 2.0 * ALTITUDE_CORRELATION_S / max(0.05, aux[A_GNSS_INTERVAL]))
        h[H_VAR + 2] = v2 * (slow if by_baro else math.sqrt(slow))
    if by_baro and not work[W_INNOV + 2] ** 2 < par[PAR_GATE] ** 2 * (own[2] + h[H_VAR + 2]):
        h[H_VAR + 2] = 0.0
    own[2] += v2


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
    _start_slow(h, x, P, par, work)
    for i in range(3):
        slow = x[X_JITTER + i] + (x[X_WANDER + i] if h[H_WANDER] > 0.0 else 0.0)
        work[W_INNOV + i] -= slow
        work[W_PRED + i] = here[i] + ant[i] + slow
        work[W_OBS + i] = work[W_PRED + i] + work[W_INNOV + i]
    if h[H_STATUS] == UNDECIDED:
        _decide_position(h, P, par, aux, ctl, work)
    if h[H_STATUS] != FUSED:
        return
    for i in range(3 if h[H_VAR + 2] > 0.0 else 2):
        observe(h, P, work, i)
        work[W_D + POSITION] = -ant[3 + i]
        total = project(P, work) + h[H_VAR + i]
        fuse(P, work, work[W_INNOV + i] - correction_seen(work), total)


@kernel(HANDLER)
def reset_position(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Put the state at the receiver's position, with its accuracy and an unknown velocity; the size stays in work.

    The receiver's own slow and quick errors, unknown again, are then errors of the position too, reversed.
    """
    for i in range(WANDER, WITH_JITTER):
        reset_axis(P, i, 0.0)
    _start_slow(h, x, P, par, work)
    for i in range(3):
        slow = P[packed(WANDER + i, WANDER + i)]
        quick = P[packed(JITTER + i, JITTER + i)]
        least = slow + quick + POSITION_FLOOR_M**2
        reset_axis(P, POS + i, least if math.isfinite(par[PAR_GNSS_JITTER]) else max(least, h[H_ACC + i] ** 2))
        P[packed(POS + i, WANDER + i)], P[packed(POS + i, JITTER + i)] = -slow, -quick
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
        aux[A_K_POS] = aux[A_K_VEL] = aux[A_K_ALT] = 1.0
        aux[A_T_RESET] = h[H_T]


@kernel("float64(float64, float64, float64)")
def repeats(own: float, variance: float, alike: float) -> float:
    """Return how many times its variance a fix weighs when errors are alike by ρ from fix to fix.

    A filter with gain g keeps (1 − g)^j of the fix j before: with a = (1 − g) ρ the errors it holds add up to
    (1 + a)/(1 − a) times those of independent fixes. The first fix of all, g = 1, counts once.

    Args:
        own: variance of what the filter holds, in the unit of `variance`.
        variance: of one fix.
        alike: ρ, 0 ≤ ρ < 1.
    """
    gain = own / (own + variance * (1.0 + alike) / (1.0 - alike))
    kept = (1.0 - gain) * alike
    return float((1.0 + kept) / (1.0 - kept))


@kernel("float64(float64, float64, float64, float64)")
def _followed(own: float, variance: float, alike: float, weight: float) -> float:
    """Return the covariance of the filter's error with that of a new fix, because it followed those before.

    With gain g and errors alike by ρ from fix to fix, Σ g (1 − g)^(j − 1) ρ^j v over the fixes j before.
    """
    gain = own / (own + weight * variance)
    return float(gain * alike * variance / (1.0 - (1.0 - gain) * alike))


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64)")
def _decide_velocity(h: Float, P: Float, par: Float, aux: Float, work: Float, n: int) -> None:
    """Set status and variances; successive errors are alike, so fewer of them count than there are."""
    own = work[W_VAR : W_VAR + 3]
    for i in range(3):
        own[i] = P[packed(VEL + i, VEL + i)]
    told = math.isfinite(par[PAR_GNSS_SPEED])
    steady = par[PAR_GNSS_CORRELATION]
    alike = (steady - 1.0) / (steady + 1.0)
    if told:
        alike = math.exp(-aux[A_GNSS_INTERVAL] / par[PAR_GNSS_SPEED_TAU]) if par[PAR_GNSS_SPEED_TAU] > 0.0 else 0.0
        steady = (1.0 + alike) / (1.0 - alike)
        for i in range(3):
            h[H_VAR + i] = steady * max(VELOCITY_FLOOR_M_S**2, par[PAR_GNSS_SPEED] ** 2)
        _judge(h, par, work, n)
    else:
        _believe(h, own, par, aux, work, n, A_K_VEL, VELOCITY_FLOOR_M_S, steady)
    for i in range(n):
        v = h[H_VAR + i] / steady
        weight = repeats(own[i], v, alike) if told else steady  # what is not told may be a delay as well as noise
        h[H_VAR + i] = weight * v
        own[i] += v if not told else v - 2.0 * _followed(own[i], v, alike, weight)
    if n == 2:
        own[2] = math.nan


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
        _decide_velocity(h, P, par, aux, work, n)
    if h[H_STATUS] == FUSED:
        for i in range(n):
            clear_row(work)
            work[W_H + VEL + i] = 1.0
            work[W_D + VELOCITY] = -ant[6 + i]
            total = project(P, work) + h[H_VAR + i]
            fuse(P, work, work[W_INNOV + i] - correction_seen(work), total)

"""One navigation step of the nominal state and of the covariance."""

from __future__ import annotations

import math

from server.nav.constants import EARTH_RATE_RAD_S
from server.nav.earth import curvature_radii, gravity_and_radii, normal_gravity
from server.nav.ekf.covariance import predict_covariance
from server.nav.ekf.delays import predict_sensitivities
from server.nav.ekf.layout import (
    A_GNSS_JITTER_VAR,
    A_GNSS_JITTER_VAR_D,
    A_GNSS_WANDER_VAR,
    A_GNSS_WANDER_VAR_D,
    A_GRAVITY,
    C_HAS_SITE,
    C_POSITIONED,
    PAR_ACCEL_NOISE,
    PAR_ACCEL_PER_K,
    PAR_ACCEL_WALK,
    PAR_BARO_DRIFT,
    PAR_DRAG_WALK,
    PAR_FIELD_WALK,
    PAR_GNSS_JITTER_TAU,
    PAR_GNSS_WANDER_TAU,
    PAR_GYRO_NOISE,
    PAR_GYRO_PER_K,
    PAR_GYRO_WALK,
    PAR_MAG_BIAS_WALK,
    PAR_VIBRATION_BANDWIDTH,
    PAR_WIND_WALK,
    U_DT,
    U_DTHETA,
    U_DVEL,
    U_GAP_S,
    U_VIBRATION,
    W_DELAYS,
    W_DIM,
)
from server.nav.ekf.states import (
    ATT,
    BARO,
    DRAG,
    FIELD,
    JITTER,
    MAG_BIAS,
    MIX,
    WANDER,
    WIND,
    X_ACCEL_BIAS,
    X_GYRO_BIAS,
    X_JITTER,
    X_MIX,
    X_POS,
    X_Q,
    X_VEL,
    X_WANDER,
    packed,
)
from server.nav.ekf.warming import walk_with_temperature
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float, Int


@kernel("UniTuple(float64, 3)(float64[::1], int64[::1])")
def frame_rate(x: Float, ctl: Int) -> tuple[float, float, float]:
    """Return ω_in in NED, rad/s: Earth rate plus transport rate; zero where the place is unknown."""
    if ctl[C_HAS_SITE] == 0:
        return 0.0, 0.0, 0.0
    lat = x[X_POS]
    meridian, prime = curvature_radii(lat)
    ve = x[X_VEL + 1] / (prime + x[X_POS + 2])
    vn = x[X_VEL] / (meridian + x[X_POS + 2])
    return EARTH_RATE_RAD_S * math.cos(lat) + ve, -vn, -EARTH_RATE_RAD_S * math.sin(lat) - ve * math.tan(lat)


@kernel("float64(float64[::1], float64[::1], int64[::1])")
def gravity_here(x: Float, aux: Float, ctl: Int) -> float:
    """Return gravity in m/s²: normal gravity at the position, the standard value where the place is unknown."""
    return normal_gravity(x[X_POS], x[X_POS + 2]) if ctl[C_HAS_SITE] else aux[A_GRAVITY]


@kernel("void(float64[::1], float64, float64, float64)")
def move_position(x: Float, north_m: float, east_m: float, down_m: float) -> None:
    """Shift latitude, longitude and height by metres in NED."""
    meridian, prime = curvature_radii(x[X_POS])
    x[X_POS + 1] += east_m / ((prime + x[X_POS + 2]) * math.cos(x[X_POS]))
    x[X_POS] += north_m / (meridian + x[X_POS + 2])
    x[X_POS + 2] -= down_m


@kernel("void(float64[::1], float64[::1], int64, int64)", contract=True)
def predict_columns(P: Float, u: Float, first: int, last: int) -> None:
    """Advance the covariances of states [first, last), which do not move themselves, with the inertial ones.

    Args:
        P: packed lower triangle.
        u: as `covariance.predict_covariance` takes it.
    """
    f0, f1, f2, dt = u[0], u[1], u[2], u[12]
    a00, a01, a02, a10, a11, a12, a20, a21, a22 = u[3], u[4], u[5], u[6], u[7], u[8], u[9], u[10], u[11]
    k = first * (first + 1) // 2
    for c in range(first, last):
        t0, t1, t2, v0, v1, v2 = P[k], P[k + 1], P[k + 2], P[k + 3], P[k + 4], P[k + 5]
        g0, g1, g2, b0, b1, b2 = P[k + 9], P[k + 10], P[k + 11], P[k + 12], P[k + 13], P[k + 14]
        P[k + 6] += dt * v0
        P[k + 7] += dt * v1
        P[k + 8] += dt * v2
        P[k + 3] = v0 + f2 * t1 - f1 * t2 - a00 * b0 - a01 * b1 - a02 * b2
        P[k + 4] = v1 - f2 * t0 + f0 * t2 - a10 * b0 - a11 * b1 - a12 * b2
        P[k + 5] = v2 + f1 * t0 - f0 * t1 - a20 * b0 - a21 * b1 - a22 * b2
        P[k] = t0 - a00 * g0 - a01 * g1 - a02 * g2
        P[k + 1] = t1 - a10 * g0 - a11 * g1 - a12 * g2
        P[k + 2] = t2 - a20 * g0 - a21 * g1 - a22 * g2
        k += c + 1


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def _predict_errors(P: Float, u: Float, par: Float, work: Float) -> None:
    """Advance the covariance; work[:13] holds f, A and dt. A bridged gap adds what may have happened in it."""
    dt, gap = u[U_DT], u[U_GAP_S]
    shaking = u[U_VIBRATION] * u[U_VIBRATION] / (3.0 * par[PAR_VIBRATION_BANDWIDTH])
    work[13] = par[PAR_GYRO_NOISE] * par[PAR_GYRO_NOISE] * dt + 0.25 * gap * gap
    work[14] = (par[PAR_ACCEL_NOISE] * par[PAR_ACCEL_NOISE] + shaking) * dt + 9.0 * gap * gap
    work[15] = 0.0
    work[16] = par[PAR_GYRO_WALK] * par[PAR_GYRO_WALK] * dt
    work[17] = par[PAR_ACCEL_WALK] * par[PAR_ACCEL_WALK] * dt
    predict_covariance(P, work)
    n = int(work[W_DIM])
    if n > FIELD:
        predict_columns(P, work, FIELD, n)
        if P[packed(MAG_BIAS, MAG_BIAS)] > 0.0:
            field = par[PAR_FIELD_WALK] * par[PAR_FIELD_WALK] * dt
            bias = par[PAR_MAG_BIAS_WALK] * par[PAR_MAG_BIAS_WALK] * dt
            for i in range(3):
                P[packed(FIELD + i, FIELD + i)] += field
                P[packed(MAG_BIAS + i, MAG_BIAS + i)] += bias
    if n > WIND and P[packed(WIND, WIND)] > 0.0:
        wind = par[PAR_WIND_WALK] * par[PAR_WIND_WALK] * dt
        P[packed(WIND, WIND)] += wind
        P[packed(WIND + 1, WIND + 1)] += wind
    if n > DRAG and P[packed(DRAG, DRAG)] > 0.0:
        P[packed(DRAG, DRAG)] += par[PAR_DRAG_WALK] * par[PAR_DRAG_WALK] * dt


@kernel("void(float64[::1], int64, int64, float64, float64, float64)", contract=True)
def fade(P: Float, first: int, n: int, keep: float, drive: float, drive_d: float) -> None:
    """Advance the covariances of three Gauss-Markov states; a block that was never started stays at zero.

    Args:
        P: packed lower triangle.
        first: of the three states.
        n: active states.
        keep: share of the error that is left after the step.
        drive, drive_d: variance added to the two horizontal ones and to the one down, m².
    """
    if not P[packed(first, first)] > 0.0:
        return
    last = first + 3
    k = first * (first + 1) // 2
    for i in range(first, last):
        for j in range(i + 1):
            P[k + j] *= keep
        k += i + 1
    k = first * (first + 1) // 2
    for i in range(first, n):
        for j in range(first, min(i + 1, last)):
            P[k + j] *= keep
        k += i + 1
    P[packed(first, first)] += drive
    P[packed(first + 1, first + 1)] += drive
    P[packed(first + 2, first + 2)] += drive_d


@kernel("float64(float64[::1], float64[::1], float64[::1], int64, int64)", contract=True)
def _turned(P: Float, u: Float, dtheta: Float, i: int, j: int) -> float:
    """Return how far the errors of the gyro's scale and axes turn the attitude about axis i, times state j."""
    total: float = 0.0
    for r in range(3):
        felt = 0.0
        for c in range(3):
            felt += dtheta[c] * P[packed(MIX + 3 * r + c, j)]
        total += u[3 + 3 * i + r] * felt
    return float(total / u[12])


@kernel("void(float64[::1], float64[::1], float64[::1], int64)", contract=True)
def turn_mix(P: Float, u: Float, dtheta: Float, n: int) -> None:
    """Advance the attitude's covariances by the errors δM of the gyro's scale and axes: δθ ← δθ − (A/dt) δM Δθ.

    Args:
        P: packed lower triangle.
        u: as `covariance.predict_covariance` takes it; A and dt are read.
        dtheta: shape (3,), rotation over the step, rad.
        n: active states.
    """
    for i in range(3):
        for j in range(ATT + 3, n):
            P[packed(ATT + i, j)] -= _turned(P, u, dtheta, i, j)
    # The covariances of δM with the attitude are new already: the part quadratic in δM would count once too often.
    for i in range(3):
        for k in range(i + 1):
            P[packed(ATT + i, ATT + k)] -= _turned(P, u, dtheta, i, ATT + k) + _turned(P, u, dtheta, k, ATT + i)
            for r in range(3):
                for c in range(3):
                    g = u[3 + 3 * k + r] * dtheta[c] / u[12]
                    P[packed(ATT + i, ATT + k)] -= g * _turned(P, u, dtheta, i, MIX + 3 * r + c)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])")
def predict_slow(x: Float, P: Float, u: Float, par: Float, aux: Float, work: Float) -> None:
    """Advance the sensors' slow errors and delays, if there are any; to be called after `predict`, with the same step.

    The baro's datum walks, the receiver's errors fade and come anew. Inside `predict` this would cost a filter without
    such states 50 ns a step for the compiler's sake.
    """
    if work[W_DELAYS] > 0.0:
        predict_sensitivities(work)
    if par[PAR_GYRO_PER_K] + par[PAR_ACCEL_PER_K] > 0.0:
        walk_with_temperature(P, u, par, aux)
    if work[W_DIM] <= BARO:
        return
    n, dt = int(work[W_DIM]), u[U_DT]
    if P[packed(BARO, BARO)] > 0.0:
        P[packed(BARO, BARO)] += par[PAR_BARO_DRIFT] * par[PAR_BARO_DRIFT] * dt
    if n > WANDER:
        keep = math.exp(-dt / par[PAR_GNSS_WANDER_TAU])
        fresh = 1.0 - keep * keep
        fade(P, WANDER, n, keep, fresh * aux[A_GNSS_WANDER_VAR], fresh * aux[A_GNSS_WANDER_VAR_D])
        for i in range(3):
            x[X_WANDER + i] *= keep
    if n > JITTER and par[PAR_GNSS_JITTER_TAU] > 0.0:
        keep = math.exp(-dt / par[PAR_GNSS_JITTER_TAU])
        fresh = 1.0 - keep * keep
        fade(P, JITTER, n, keep, fresh * aux[A_GNSS_JITTER_VAR], fresh * aux[A_GNSS_JITTER_VAR_D])
        for i in range(3):
            x[X_JITTER + i] *= keep
    if n > MIX:
        turn_mix(P, work, u[U_DTHETA : U_DTHETA + 3], n)


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], int64[::1])")
def _move(x: Float, u: Float, work: Float, aux: Float, ctl: Int) -> None:
    """Advance the nominal state; f, A and dt for the covariance go to work[:13]."""
    dt = u[U_DT]
    qw, qx, qy, qz = x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3]
    R = matrix_entries(qw, qx, qy, qz)
    dx, dy = u[U_DVEL] - x[X_ACCEL_BIAS] * dt, u[U_DVEL + 1] - x[X_ACCEL_BIAS + 1] * dt
    dz = u[U_DVEL + 2] - x[X_ACCEL_BIAS + 2] * dt
    fn, fe, fd = R[0] * dx + R[1] * dy + R[2] * dz, R[3] * dx + R[4] * dy + R[5] * dz, R[6] * dx + R[7] * dy + R[8] * dz
    work[0], work[1], work[2], work[12] = fn, fe, fd, dt
    for i in range(9):
        work[3 + i] = R[i] * dt
    wn = we = wd = 0.0
    if ctl[C_HAS_SITE]:  # one sine and one cosine of the latitude serve radii, gravity and Earth rate
        height, vn, ve, vd = x[X_POS + 2], x[X_VEL], x[X_VEL + 1], x[X_VEL + 2]
        sl, cl = math.sin(x[X_POS]), math.cos(x[X_POS])
        g, meridian, prime = gravity_and_radii(sl * sl, height)
        east = ve / (prime + height)
        wn, we, wd = EARTH_RATE_RAD_S * cl + east, -vn / (meridian + height), -EARTH_RATE_RAD_S * sl - east * sl / cl
        if ctl[C_POSITIONED]:
            cn, cd = wn + EARTH_RATE_RAD_S * cl, wd - EARTH_RATE_RAD_S * sl  # 2 ω_ie + ω_en
            x[X_VEL] += fn - (we * vd - cd * ve) * dt
            x[X_VEL + 1] += fe - (cd * vn - cn * vd) * dt
            x[X_VEL + 2] += fd + (g - (cn * ve - we * vn)) * dt
            half = 0.5 * dt
            x[X_POS + 1] += half * (ve + x[X_VEL + 1]) / ((prime + height) * cl)
            x[X_POS] += half * (vn + x[X_VEL]) / (meridian + height)
            x[X_POS + 2] -= half * (vd + x[X_VEL + 2])
    # Attitude: body rotation on the right, rotation of the local frame (under 1e-5 rad) on the left.
    rx, ry, rz = u[U_DTHETA], u[U_DTHETA + 1], u[U_DTHETA + 2]
    bx, by, bz = x[X_GYRO_BIAS] * dt, x[X_GYRO_BIAS + 1] * dt, x[X_GYRO_BIAS + 2] * dt
    if work[W_DIM] > MIX:
        bx += x[X_MIX] * rx + x[X_MIX + 1] * ry + x[X_MIX + 2] * rz
        by += x[X_MIX + 3] * rx + x[X_MIX + 4] * ry + x[X_MIX + 5] * rz
        bz += x[X_MIX + 6] * rx + x[X_MIX + 7] * ry + x[X_MIX + 8] * rz
    t = quat_from_rotvec(rx - bx, ry - by, rz - bz)
    new = quat_mul(qw, qx, qy, qz, t[0], t[1], t[2], t[3])
    new = quat_mul(1.0, -0.5 * wn * dt, -0.5 * we * dt, -0.5 * wd * dt, new[0], new[1], new[2], new[3])
    norm2 = new[0] * new[0] + new[1] * new[1] + new[2] * new[2] + new[3] * new[3]
    scale = 1.5 - 0.5 * norm2  # one Newton step of 1/√ from 1: the norm is off by rounding and 1e-11 only
    for i in range(4):
        x[X_Q + i] = new[i] * scale


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])")
def predict(x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Advance state and covariance in place by one step [Solà 2017, eq. 260 and 268, attitude error in NED].

    Args:
        x: shape (X_SIZE,), nominal state.
        P: shape (PACKED,), covariance.
        u: shape (U_SIZE,), the step.
        par, aux, ctl, work: parameters, memory and scratch, `layout`.
    """
    _move(x, u, work, aux, ctl)
    _predict_errors(P, u, par, work)

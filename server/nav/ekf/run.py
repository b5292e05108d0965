"""The filter over a block of navigation steps: predict, take what arrived, re-run, publish one row per step."""

from __future__ import annotations

import math
from typing import Final

from numba import njit

from server.nav.codes import ALIGNING, ATTITUDE, DEAD_RECKONING, FAILED, GRAVITY, NAVIGATING, ZERO_RATE, ZERO_VELOCITY
from server.nav.earth import ned_from_lla
from server.nav.ekf.align import align, rest
from server.nav.ekf.handle import add_event
from server.nav.ekf.history import attach, push, rerun
from server.nav.ekf.intake import take
from server.nav.ekf.layout import (
    A_BARO_OFFSET_VAR,
    A_GNSS_INTERVAL,
    A_SITE,
    A_SPEED_GNSS,
    A_T_GNSS,
    A_T_GNSS_SEEN,
    A_T_GRAVITY,
    A_T_RATE,
    A_T_STILL,
    C_BARO_SEEN,
    C_HAS_HEADING,
    C_MODE,
    C_POSITIONED,
    C_STEPS,
    C_STILL_STEPS,
    C_VALID,
    E_ALIGNED,
    E_FAILED,
    E_GAP,
    E_GNSS_LOST,
    H_AID,
    H_SIZE,
    H_STATUS,
    H_T,
    M_STEP,
    PAR_IMU_DELAY,
    U_ACCEL,
    U_DT,
    U_GAP_S,
    U_GYRO,
    U_T,
    UNDECIDED,
)
from server.nav.ekf.predict import gravity_here, predict
from server.nav.ekf.states import ATT, POS, VEL, X_ACCEL_BIAS, X_GYRO_BIAS, X_POS, X_Q, X_SIZE, X_VEL, packed
from server.nav.ekf.update import reset_axis
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float, Int

PSEUDO_INTERVAL_NS: Final = 1e8  # ten a second: the board's sway is correlated for about that long
REST_BEFORE_ZERO_S: Final = 1.0
STILL_SPEED_M_S: Final = 0.15
GAP_RESTART_S: Final = 1.0
"""Past this hole in the IMU data nothing is left of the attitude of a moving vehicle: align again."""
OUTAGE_S: Final = 1.0
OUTAGE_INTERVALS: Final = 2.5


@njit("void(float64[::1], float64[::1], float64)", cache=True)
def _pseudo(h: Float, u: Float, aid: float) -> None:
    for i in range(H_SIZE):
        h[i] = 0.0
    h[H_AID], h[H_T], h[H_STATUS] = aid, u[U_T], UNDECIDED


@njit(
    "int64(float64[::1], int64, float64[::1], float64[::1], int64[::1], float64[::1], float64[:, ::1],"
    " float64[:, :, ::1], int64[::1], float64[:, ::1], float64[::1], float64[::1], float64[::1])",
    cache=True,
)
def pseudo_measurements(
    u: Float,
    dirty: int,
    x: Float,
    aux: Float,
    ctl: Int,
    work: Float,
    r_u: Float,
    r_m: Float,
    r_n: Int,
    aids: Float,
    aid_t: Float,
    h: Float,
    par: Float,
) -> int:
    """Attach zero velocity and zero rate at rest, gravity without GNSS; return the earliest dirty slot.

    A vehicle that flies or drives smoothly looks still to its IMU, so rest needs a second witness while one is there:
    the receiver's speed, or without receiver a velocity that the filter itself holds for zero.
    """
    t = u[U_T]
    rest(u, aux, ctl, gravity_here(x, aux, ctl))
    if not ctl[C_POSITIONED] and t - aux[A_T_GRAVITY] >= PSEUDO_INTERVAL_NS:
        aux[A_T_GRAVITY] = t
        _pseudo(h, u, GRAVITY)
        dirty = attach(h, dirty, t, ctl, work, r_u, r_m, r_n, aids, aid_t)
    if ctl[C_STILL_STEPS] * u[U_DT] < REST_BEFORE_ZERO_S or t - aux[A_T_RATE] < PSEUDO_INTERVAL_NS:
        return dirty
    fresh = aux[A_T_GNSS_SEEN] >= 0.0 and t - aux[A_T_GNSS_SEEN] < 2e9
    if ctl[C_POSITIONED]:
        speed = math.sqrt(x[X_VEL] ** 2 + x[X_VEL + 1] ** 2 + x[X_VEL + 2] ** 2)
        if speed > STILL_SPEED_M_S or (fresh and aux[A_SPEED_GNSS] > STILL_SPEED_M_S):
            return dirty
        aux[A_T_STILL] = t
        _pseudo(h, u, ZERO_VELOCITY)
        dirty = attach(h, dirty, t, ctl, work, r_u, r_m, r_n, aids, aid_t)
    aux[A_T_RATE] = t
    _pseudo(h, u, ZERO_RATE)
    return attach(h, dirty, t, ctl, work, r_u, r_m, r_n, aids, aid_t)


@njit("void(float64[::1], float64[::1], float64, float64[:, ::1], int64[::1])", cache=True)
def _mode(x: Float, aux: Float, t: float, events: Float, ctl: Int) -> None:
    """Set the lane's status from what it has; losing GNSS is an event."""
    if not ctl[C_POSITIONED]:
        ctl[C_MODE] = ATTITUDE
        return
    limit = max(OUTAGE_S, OUTAGE_INTERVALS * aux[A_GNSS_INTERVAL])
    mode = DEAD_RECKONING if (t - aux[A_T_GNSS]) * 1e-9 > limit else NAVIGATING
    if mode == DEAD_RECKONING and ctl[C_MODE] == NAVIGATING:
        add_event(events, ctl, E_GNSS_LOST, t, limit, 0.0)
    ctl[C_MODE] = mode


@njit("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1])", cache=True)
def publish(x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, out: Float) -> None:
    """Write one row of LANE_COLUMNS: the state carried on from the IMU's own delay to the step's stamp."""
    d = par[PAR_IMU_DELAY]
    w = (u[U_GYRO] - x[X_GYRO_BIAS], u[U_GYRO + 1] - x[X_GYRO_BIAS + 1], u[U_GYRO + 2] - x[X_GYRO_BIAS + 2])
    f = (u[U_ACCEL] - x[X_ACCEL_BIAS], u[U_ACCEL + 1] - x[X_ACCEL_BIAS + 1], u[U_ACCEL + 2] - x[X_ACCEL_BIAS + 2])
    turn = quat_from_rotvec(w[0] * d, w[1] * d, w[2] * d)
    q = quat_mul(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3], turn[0], turn[1], turn[2], turn[3])
    sign = -1.0 if q[0] < 0.0 else 1.0
    for i in range(out.shape[0]):
        out[i] = math.nan
    for i in range(4):
        out[i] = sign * q[i]
    for i in range(3):
        out[10 + i] = math.sqrt(P[packed(ATT + i, ATT + i)])
        out[19 + i], out[22 + i] = x[X_GYRO_BIAS + i], x[X_ACCEL_BIAS + i]
    out[25], out[29] = ctl[C_MODE], 0.0
    if not ctl[C_POSITIONED]:
        return
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    g = gravity_here(x, aux, ctl)
    a = (
        R[0] * f[0] + R[1] * f[1] + R[2] * f[2],
        R[3] * f[0] + R[4] * f[1] + R[5] * f[2],
        R[6] * f[0] + R[7] * f[1] + R[8] * f[2] + g,
    )
    ned = ned_from_lla(x[X_POS], x[X_POS + 1], x[X_POS + 2], aux[A_SITE], aux[A_SITE + 1], aux[A_SITE + 2])
    per_rad = (ned_from_lla(x[X_POS] + 1e-6, x[X_POS + 1] + 1e-6, 0.0, x[X_POS], x[X_POS + 1], 0.0))
    for i in range(3):
        step = d * x[X_VEL + i] + 0.5 * d * d * a[i]
        out[4 + i] = x[X_VEL + i] + d * a[i]
        out[26 + i] = ned[i] + step
        out[7 + i] = math.degrees(x[X_POS + i] + step / per_rad[i] * 1e-6) if i < 2 else x[X_POS + 2] - step
        out[13 + i] = math.sqrt(P[packed(VEL + i, VEL + i)])
        out[16 + i] = math.sqrt(P[packed(POS + i, POS + i)])
    if ctl[C_BARO_SEEN]:
        out[18] = math.sqrt(P[packed(POS + 2, POS + 2)] + aux[A_BARO_OFFSET_VAR])
    out[29] = max(0.0, (u[U_T] - aux[A_T_GNSS]) * 1e-9) if ctl[C_MODE] == DEAD_RECKONING else 0.0


@njit("boolean(float64[::1], float64[::1])", cache=True)
def _sane(x: Float, P: Float) -> bool:
    for i in range(X_SIZE):
        if not math.isfinite(x[i]):
            return False
    return bool(P[packed(ATT, ATT)] >= 0.0 and math.isfinite(P[packed(POS, POS)]))


@njit(
    "void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1],"
    " float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1], int64[::1],"
    " float64[:, ::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[::1])",
    cache=True,
)
def run(
    steps: Float,
    meas: Float,
    x: Float,
    P: Float,
    par: Float,
    aux: Float,
    ctl: Int,
    work: Float,
    withheld: Float,
    r_u: Float,
    r_x: Float,
    r_P: Float,
    r_m: Float,
    r_n: Int,
    rows: Float,
    aids: Float,
    aid_t: Float,
    events: Float,
    h: Float,
) -> None:
    """Run the filter over navigation steps and the measurements that arrived with them, in order of arrival.

    Args:
        steps: shape (n, U_SIZE). meas: shape (k, M_SIZE), M_STEP ascending in [0, n).
        x, P, par, aux, ctl, work, r_*: state, parameters, memory, scratch and history, `layout`.
        withheld: shape (j, 2), intervals of validity ns whose GNSS is held back.
        rows: shape (n, len(LANE_COLUMNS)), written.
        aids, aid_t, events: records, counted in ctl[C_AIDS] and ctl[C_EVENTS].
        h: shape (H_SIZE,), scratch.
    """
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        dirty = -1
        if u[U_GAP_S] > GAP_RESTART_S and ctl[C_MODE] != ALIGNING:
            add_event(events, ctl, E_GAP, u[U_T], u[U_GAP_S], 0.0)
            ctl[C_MODE] = ALIGNING
            ctl[C_POSITIONED] = ctl[C_VALID] = 0
        if ctl[C_MODE] == ALIGNING:
            aligned = align(x, P, u, par, aux, ctl)
            if aligned:
                tilt = math.sqrt(max(P[packed(ATT, ATT)], P[packed(ATT + 1, ATT + 1)]))
                heading = math.sqrt(P[packed(ATT + 2, ATT + 2)]) if ctl[C_HAS_HEADING] else math.nan
                add_event(events, ctl, E_ALIGNED, u[U_T], heading, tilt)
                push(u, x, P, ctl, r_u, r_x, r_P, r_n)
        else:
            predict(x, P, u, par, aux, ctl, work)
            if not ctl[C_POSITIONED]:
                for i in range(3):
                    x[X_VEL + i] = 0.0
                    reset_axis(P, VEL + i, 1.0)
                    reset_axis(P, POS + i, 1.0)
            push(u, x, P, ctl, r_u, r_x, r_P, r_n)
            dirty = pseudo_measurements(u, dirty, x, aux, ctl, work, r_u, r_m, r_n, aids, aid_t, h, par)
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            dirty = take(meas[k], dirty, u[U_T], par, aux, ctl, work, withheld, r_u, r_m, r_n, aids, aid_t, h)
            k += 1
        if dirty >= 0:
            rerun(dirty, u[U_T], x, P, par, aux, ctl, work, r_u, r_x, r_P, r_m, r_n, aids, aid_t, events)
        ctl[C_STEPS] += 1
        if ctl[C_MODE] == ALIGNING:
            for i in range(rows.shape[1]):
                rows[n, i] = math.nan
            rows[n, 25], rows[n, 29] = ALIGNING, 0.0
            continue
        _mode(x, aux, u[U_T], events, ctl)
        if not _sane(x, P):
            add_event(events, ctl, E_FAILED, u[U_T], 0.0, 0.0)
            ctl[C_MODE] = FAILED
            for i in range(rows.shape[1]):
                rows[n, i] = math.nan
            rows[n, 25] = FAILED
            ctl[C_MODE] = ALIGNING  # start again from nothing, after saying so
            ctl[C_POSITIONED] = ctl[C_VALID] = 0
            continue
        publish(x, P, u, par, aux, ctl, rows[n])



"""The filter over a block of navigation steps: predict, take what arrived, re-run, publish one row per step."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import ALIGNING, ATTITUDE, DEAD_RECKONING, FAILED, NAVIGATING
from server.nav.ekf.align import align, restart
from server.nav.ekf.delays import widen
from server.nav.ekf.events import add_event
from server.nav.ekf.history import push, rerun
from server.nav.ekf.intake import take
from server.nav.ekf.layout import (
    A_ACCEL_MEAN,
    A_ACCEL_VAR,
    A_GNSS_INTERVAL,
    A_GYRO_MEAN,
    A_GYRO_VAR,
    A_K_ALT,
    A_K_BARO,
    A_K_DRAG,
    A_K_MAG,
    A_K_POS,
    A_K_VEL,
    A_MAG_WEIGHT,
    A_REST_HEIGHT,
    A_SITE,
    A_T_GNSS,
    A_T_START,
    C_ALIGNED_BEFORE,
    C_BARO_SEEN,
    C_DELAYS_TOLD,
    C_HAS_HEADING,
    C_MODE,
    C_POSITIONED,
    C_REFUSED_RUN,
    C_STEPS,
    C_STILL_STEPS,
    C_VALID,
    E_ALIGNED,
    E_DELAYS,
    E_FAILED,
    E_GAP,
    E_GNSS_LOST,
    M_STEP,
    NEVER_NS,
    PAR_GNSS_DELAY,
    U_GAP_S,
    U_T,
    W_DELAYS,
    W_M,
    W_USED,
)
from server.nav.ekf.predict import predict, predict_slow
from server.nav.ekf.pseudo import pseudo_measurements
from server.nav.ekf.publish import publish
from server.nav.ekf.states import ATT, POS, VEL, X_POS, X_Q, X_SIZE, X_VEL, packed
from server.nav.ekf.update import reset_axis
from server.nav.ekf.warming import note_temperature
from server.nav.ekf.yaw_bank import bank_predict, bank_start
from server.nav.kernel import kernel
from server.nav.types import Float, Int

GAP_RESTART_S: Final = 1.0
"""Past this hole in the IMU data nothing is left of the attitude of a moving vehicle: align again."""
DELAY_TOLD_S2: Final = 4e-4  # 20 ms
OUTAGE_S: Final = 1.0
OUTAGE_INTERVALS: Final = 2.5


@kernel("void(float64[::1], float64[::1], float64[::1], int64[::1])")
def _forget(x: Float, P: Float, aux: Float, ctl: Int) -> None:
    """Start again from nothing: no number of the failed state may reach the next one."""
    x[:] = 0.0
    P[:] = 0.0
    x[X_Q] = 1.0
    for i in range(3):
        x[X_POS + i] = aux[A_SITE + i]
        aux[A_GYRO_MEAN + i] = aux[A_GYRO_VAR + i] = aux[A_ACCEL_MEAN + i] = aux[A_ACCEL_VAR + i] = 0.0
    aux[A_K_POS] = aux[A_K_VEL] = aux[A_K_ALT] = aux[A_K_BARO] = aux[A_K_MAG] = aux[A_K_DRAG] = 1.0
    aux[A_MAG_WEIGHT] = 0.0
    aux[A_T_START] = NEVER_NS
    aux[A_REST_HEIGHT] = math.nan
    ctl[C_POSITIONED] = ctl[C_VALID] = ctl[C_ALIGNED_BEFORE] = 0
    ctl[C_BARO_SEEN] = ctl[C_REFUSED_RUN] = ctl[C_STILL_STEPS] = ctl[C_HAS_HEADING] = 0
    restart(aux, ctl)


@kernel("void(float64[::1], float64[::1], float64, float64[:, ::1], int64[::1])")
def _mode(par: Float, aux: Float, t: float, events: Float, ctl: Int) -> None:
    """Set the lane's status from what it has; losing GNSS is an event."""
    if not ctl[C_POSITIONED]:
        ctl[C_MODE] = ATTITUDE
        return
    limit = max(OUTAGE_S, OUTAGE_INTERVALS * aux[A_GNSS_INTERVAL]) + par[PAR_GNSS_DELAY]
    mode = DEAD_RECKONING if (t - aux[A_T_GNSS]) * 1e-9 > limit else NAVIGATING
    if mode == DEAD_RECKONING and ctl[C_MODE] == NAVIGATING:
        add_event(events, ctl, E_GNSS_LOST, t, limit, 0.0)
    ctl[C_MODE] = mode


@kernel("boolean(float64[::1], float64[::1])")
def _sane(x: Float, P: Float) -> bool:
    for i in range(X_SIZE):
        if not math.isfinite(x[i]):
            return False
    return bool(P[packed(ATT, ATT)] >= 0.0 and math.isfinite(P[packed(POS, POS)]))


@kernel(
    "void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1],"
    " float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1], int64[::1],"
    " float64[:, ::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[::1], float64[::1])"
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
    bank: Float,
) -> None:
    """Run the filter over navigation steps and the measurements that arrived with them, in order of arrival.

    Args:
        steps: shape (n, U_SIZE). meas: shape (k, M_SIZE), M_STEP ascending in [0, n).
        x, P, par, aux, ctl, work, r_*: state, parameters, memory, scratch and history, `layout`.
        rows: shape (n, len(LANE_COLUMNS)), written.
        aids, aid_t, events: records, counted in ctl[C_AIDS] and ctl[C_EVENTS].
        h: shape (H_SIZE,), scratch.
        bank: shape (B_SIZE,), memory of the yaw bank, which is not rolled back.
    """
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        dirty = -1
        if u[U_GAP_S] > GAP_RESTART_S and ctl[C_MODE] != ALIGNING:
            add_event(events, ctl, E_GAP, u[U_T], u[U_GAP_S], 0.0)
            ctl[C_MODE] = ALIGNING
            ctl[C_POSITIONED] = ctl[C_VALID] = 0
            restart(aux, ctl)
            bank_start(bank)
            aux[A_MAG_WEIGHT] = 0.0
            aux[A_T_START] = NEVER_NS
        if ctl[C_MODE] == ALIGNING:
            aligned = u[U_GAP_S] <= GAP_RESTART_S and align(x, P, u, par, aux, ctl, work)
            if aligned:
                tilt = math.sqrt(max(P[packed(ATT, ATT)], P[packed(ATT + 1, ATT + 1)]))
                heading = math.sqrt(P[packed(ATT + 2, ATT + 2)]) if ctl[C_HAS_HEADING] else math.nan
                add_event(events, ctl, E_ALIGNED, u[U_T], heading, tilt)
                push(u, x, P, ctl, work, r_u, r_x, r_P, r_n)
        else:
            predict(x, P, u, par, aux, ctl, work)
            note_temperature(u, aux)
            predict_slow(x, P, u, par, aux, work)
            bank_predict(u, x, par, bank)
            if not ctl[C_POSITIONED]:
                for i in range(3):
                    x[X_VEL + i] = 0.0
                    reset_axis(P, VEL + i, 1.0)
                    reset_axis(P, POS + i, 1.0)
            push(u, x, P, ctl, work, r_u, r_x, r_P, r_n)
            dirty = pseudo_measurements(u, dirty, x, aux, ctl, work, r_u, r_m, r_n, aids, aid_t, h, par)
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            dirty = take(meas[k], dirty, u[U_T], x, P, bank, par, aux, ctl, work, r_u, r_m, r_n, aids, aid_t, h)
            k += 1
        if dirty >= 0:
            rerun(dirty, u[U_T], x, P, par, aux, ctl, work, r_u, r_x, r_P, r_m, r_n, aids, aid_t, events)
        if not ctl[C_DELAYS_TOLD] and 0.0 < work[W_M] < DELAY_TOLD_S2 and work[W_M + 4] < DELAY_TOLD_S2:
            ctl[C_DELAYS_TOLD] = 1
            add_event(events, ctl, E_DELAYS, u[U_T], work[W_USED], work[W_USED + 1])
        ctl[C_STEPS] += 1
        if ctl[C_MODE] == ALIGNING:
            for i in range(rows.shape[1]):
                rows[n, i] = math.nan
            rows[n, 25], rows[n, 29] = ALIGNING, 0.0
            continue
        _mode(par, aux, u[U_T], events, ctl)
        if not _sane(x, P):
            add_event(events, ctl, E_FAILED, u[U_T], 0.0, 0.0)
            ctl[C_MODE] = FAILED
            for i in range(rows.shape[1]):
                rows[n, i] = math.nan
            rows[n, 25] = FAILED
            ctl[C_MODE] = ALIGNING  # start again from nothing, after saying so
            _forget(x, P, aux, ctl)
            bank_start(bank)
            continue
        publish(x, P, u, par, aux, ctl, rows[n])
        if work[W_DELAYS] > 0.0:
            widen(work, rows[n])

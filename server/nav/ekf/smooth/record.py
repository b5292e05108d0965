"""What the smoother needs of the filter's way: each history slot as it ends, and what its measurements did to it.

A slot that leaves the history is final: its measurements have been decided on and every late one is in. A second state
follows the filter at that distance: predicted by the same steps, corrected by the same measurements with the variances
decided on, in order of validity. What each scalar did is logged, so the pass back needs no model of any measurement.
Resets are logged as what they are: states that nothing later tells anything about.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import FUSED
from server.nav.earth import ned_from_lla
from server.nav.ekf.history import copy
from server.nav.ekf.layout import (
    C_BARO_SEEN,
    C_HAS_HEADING,
    C_POSITIONED,
    H_SIZE,
    H_STATUS,
    NEVER_NS,
    PAR_GNSS_JITTER_TAU,
    PAR_GNSS_WANDER_TAU,
    RESET,
    U_DT,
    U_DTHETA,
    U_T,
    W_LOG,
)
from server.nav.ekf.predict import predict, predict_slow
from server.nav.ekf.smooth.layout import (
    F_DT,
    F_DTHETA,
    F_JITTER,
    F_WANDER,
    T_BOUNDARIES,
    T_END,
    T_GNSS,
    T_LINKED,
    T_NEXT,
    T_POSITIONED,
    Z_GNSS,
    Z_LINKED,
    Z_LOG_END,
    Z_POSITIONED,
    Z_SIZE,
    Z_WAS_POSITIONED,
)
from server.nav.ekf.smooth.log import correct_logged
from server.nav.ekf.states import ATT, POS, VEL, X_POS, X_Q, X_VEL, packed
from server.nav.ekf.update import reset_axis
from server.nav.kernel import kernel
from server.nav.rotation import quat_mul, rotvec_from_quat
from server.nav.types import Float, Int

APART_RATIO: Final = 3.0
APART_FLOORS: Final = (1e-3, 0.02, 0.05)  # attitude rad, velocity m/s, position m


@kernel("float64(float64[::1], float64[::1], int64)")
def _apart(x: Float, y: Float, i: int) -> float:
    """Return component i of the attitude, velocity and position error of y against x."""
    if i < VEL:
        r = quat_mul(y[X_Q], y[X_Q + 1], y[X_Q + 2], y[X_Q + 3], x[X_Q], -x[X_Q + 1], -x[X_Q + 2], -x[X_Q + 3])
        v = rotvec_from_quat(r[0], r[1], r[2], r[3])
        return v[0] if i == ATT else (v[1] if i == ATT + 1 else v[2])
    if i < POS:
        return float(y[X_VEL + i - VEL] - x[X_VEL + i - VEL])
    d = ned_from_lla(y[X_POS], y[X_POS + 1], y[X_POS + 2], x[X_POS], x[X_POS + 1], x[X_POS + 2])
    return d[0] if i == POS else (d[1] if i == POS + 1 else d[2])


@kernel("boolean(float64[::1], float64[::1], float64[::1], float64[::1], boolean)")
def _follows(x: Float, P: Float, y: Float, Q: Float, positioned: bool) -> bool:
    """Return whether the filter's prediction y, Q agrees with x, P; if not, something else happened to the filter."""
    for i in range(ATT, POS + 3 if positioned else VEL):
        k = packed(i, i)
        floor = APART_FLOORS[i // 3]
        if not (Q[k] < APART_RATIO * P[k] + floor**2 and P[k] < APART_RATIO * Q[k] + floor**2):
            return False
        if not _apart(x, y, i) ** 2 < P[k] + floor**2:
            return False
    return True


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " int64[::1], float64[::1], float64[::1], float64[::1])"
)
def follow(
    t: Float,
    x: Float,
    P: Float,
    y: Float,
    Q: Float,
    u: Float,
    par: Float,
    ctl: Int,
    aux: Float,
    work: Float,
    z: Float,
) -> None:
    """Predict x, P over the step u, work[:13] says how; where that is not what the filter did, take its y, Q."""
    linked = t[T_LINKED] > 0.0 and abs(u[U_T] - u[U_DT] * 1e9 - t[T_END]) < 0.5e9 * u[U_DT]
    positioned = t[T_POSITIONED] > 0.0
    if linked:
        ctl[C_POSITIONED] = int(t[T_POSITIONED])
        predict(x, P, u, par, aux, ctl, work)
        predict_slow(x, P, u, par, aux, work)
        for i in range(0 if positioned else 3):  # as `run` holds them
            x[X_VEL + i] = 0.0
            reset_axis(P, VEL + i, 1.0)
            reset_axis(P, POS + i, 1.0)
        linked = _follows(x, P, y, Q, positioned)
    z[Z_LINKED] = 1.0 if linked else 0.0
    if not linked:
        copy(y, x, x.shape[0])
        copy(Q, P, P.shape[0])
        t[T_BOUNDARIES] += t[T_LINKED]
        t[T_POSITIONED], t[T_GNSS] = 0.0, NEVER_NS
    z[Z_WAS_POSITIONED] = t[T_POSITIONED]


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def _keep_prediction(u: Float, par: Float, work: Float, f: Float) -> None:
    """Write down the prediction just made over the step u."""
    for i in range(F_DT + 1):
        f[i] = work[i]
    for i in range(3):
        f[F_DTHETA + i] = u[U_DTHETA + i]
    tau = par[PAR_GNSS_JITTER_TAU]
    f[F_WANDER] = math.exp(-u[U_DT] / par[PAR_GNSS_WANDER_TAU])
    f[F_JITTER] = math.exp(-u[U_DT] / tau) if tau > 0.0 else 1.0


@kernel(
    "void(int64, int64, float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], int64[::1], float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1],"
    " float64[:, :, ::1], int64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[:, ::1],"
    " float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], int64[::1])"
)
def record_slots(
    end: int,
    valid: int,
    t: Float,
    x: Float,
    P: Float,
    before: Float,
    h: Float,
    par: Float,
    aux: Float,
    ctl: Int,
    work: Float,
    r_u: Float,
    r_x: Float,
    r_P: Float,
    r_m: Float,
    r_n: Int,
    aids: Float,
    aid_t: Float,
    events: Float,
    z_u: Float,
    z_x: Float,
    z_P: Float,
    z_f: Float,
    z_s: Float,
    z_log: Float,
    count: Int,
) -> None:
    """Record the slots from t[T_NEXT] up to `end`.

    Args:
        valid: number of the oldest slot whose measurements can be repeated.
        t, x, P: where the recording stands, and its state at the slot before.
        before, h: shapes (N,), (H_SIZE,), scratch.
        par, aux, ctl, work: the filter's parameters, and copies of its memory; the scratch has room for the log.
        r_u, r_x, r_P, r_m, r_n: the history.
        aids, aid_t, events: scratch.
        z_u, z_x, z_P, z_f, z_s, z_log: the record, appended to; `count` has slots and log entries.
    """
    size = r_u.shape[0]
    ctl[C_HAS_HEADING] = ctl[C_BARO_SEEN] = 1
    for k in range(int(t[T_NEXT]), end):
        slot, n = k % size, count[0]
        u, z = r_u[slot], z_s[n]
        for i in range(Z_SIZE):
            z[i] = 0.0
        follow(t, x, P, r_x[slot], r_P[slot], u, par, ctl, aux, work, z)
        _keep_prediction(u, par, work, z_f[n])
        ctl[C_POSITIONED] = 1
        log = int(count[1])
        for i in range(r_n[slot] if k >= valid else 0):
            copy(r_m[slot, i], h, H_SIZE)
            if h[H_STATUS] == FUSED or h[H_STATUS] == RESET:
                log = correct_logged(h, t, x, P, before, u, par, aux, ctl, work, aids, aid_t, events, z, z_log, log)
        copy(u, z_u[n], u.shape[0])
        copy(x, z_x[n], x.shape[0])
        copy(P, z_P[n], P.shape[0])
        z[Z_POSITIONED], z[Z_GNSS], z[Z_LOG_END] = t[T_POSITIONED], t[T_GNSS], log
        t[T_LINKED], t[T_END], t[T_NEXT] = 1.0, u[U_T], k + 1
        count[0], count[1] = n + 1, log
    work[W_LOG] = 0.0

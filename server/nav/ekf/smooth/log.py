"""What a measurement did, written down: scalars with H, P Hᵀ and innovation, or states that were set."""

from __future__ import annotations

import math

from server.nav.codes import BARO_HEIGHT, GNSS_POSITION
from server.nav.ekf.aiding.baro import DATUM_LOST_NS
from server.nav.ekf.aiding.gnss import ALTITUDE_CORRELATION_S
from server.nav.ekf.handle import handle
from server.nav.ekf.layout import (
    A_BARO_OFFSET,
    A_GNSS_INTERVAL,
    A_T_RESET,
    C_EVENTS,
    H_ACC,
    H_AID,
    H_SHIFT,
    H_STATUS,
    H_T,
    PAR_BARO_DRIFT,
    PAR_BARO_NOISE,
    RESET,
    U_T,
    W_LOG,
    W_SIZE,
)
from server.nav.ekf.smooth.layout import (
    DATUM,
    FORGET,
    L_H,
    L_INNOVATION,
    L_KIND,
    L_PH,
    L_SIZE,
    L_TURN,
    L_VARIANCE,
    SCALAR,
    T_BARO,
    T_BARO_SEEN,
    T_DATUM_VAR,
    T_GNSS,
    T_POSITIONED,
    T_RESETS,
    Z_GNSS_HERE,
    Z_SHIFT,
)
from server.nav.ekf.states import ATT, POS, X_Q, N, packed
from server.nav.ekf.update import LOGGED, reset_axis
from server.nav.kernel import kernel
from server.nav.rotation import quat_mul, rotvec_from_quat
from server.nav.types import Float, Int


@kernel("int64(float64[:, ::1], int64, float64)")
def _entry(z_log: Float, k: int, kind: float) -> int:
    """Start log entry k; return the number after it."""
    for i in range(L_SIZE):
        z_log[k, i] = 0.0
    z_log[k, L_KIND] = kind
    return k + 1


@kernel("int64(float64[::1], float64[:, ::1], int64)")
def _keep_scalars(work: Float, z_log: Float, k: int) -> int:
    """Move the scalars of one measurement to the log; the last of them turns the tilt with the heading."""
    turn = 0.0
    n = int(work[W_LOG] - 1.0)
    for s in range(n):
        at = W_SIZE + s * LOGGED
        k = _entry(z_log, k, SCALAR)
        for i in range(LOGGED):
            z_log[k - 1, L_INNOVATION + i] = work[at + i]
        turn += work[at] * z_log[k - 1, L_PH + ATT + 2] / work[at + 1]
    if n > 0:
        z_log[k - 1, L_TURN] = turn
    return k


@kernel("int64(float64[::1], float64[::1], float64[::1], float64[:, ::1], int64)")
def _keep_reset(before: Float, P: Float, angle: Float, z_log: Float, k: int) -> int:
    """Log states that were set and not corrected; a heading nobody had known counts as measured.

    Args:
        before: shape (N,), covariance of the heading error with every state before the reset.
        P: after it.
        angle: shape (1,), by which the heading turned.
    """
    turned = False
    mask = k + 1
    k = _entry(z_log, k, SCALAR)
    k = _entry(z_log, k, FORGET)
    for i in range(N):
        alone = P[packed(i, i)] > 0.0
        for j in range(N):
            alone = alone and (j == i or P[packed(i, j)] == 0.0)
        if alone:
            z_log[mask, L_H + i] = 1.0
    own = P[packed(ATT + 2, ATT + 2)]
    if z_log[mask, L_H + ATT + 2] > 0.0:
        total = before[ATT + 2] + own
        if angle[0] ** 2 < 9.0 * total:
            turned = True
            z_log[mask, L_H + ATT + 2] = 0.0
            z_log[mask - 1, L_INNOVATION], z_log[mask - 1, L_VARIANCE] = angle[0], total
            z_log[mask - 1, L_H + ATT + 2] = 1.0
            for i in range(N):
                z_log[mask - 1, L_PH + i] = before[i]
        z_log[mask - 1, L_TURN] = angle[0]
    if not turned:
        z_log[mask - 1, L_VARIANCE] = math.inf
    return k


@kernel("int64(float64[::1], float64[::1], float64[::1], float64[::1], float64[:, ::1], int64)")
def _start_datum(t: Float, h: Float, P: Float, par: Float, z_log: Float, k: int) -> int:
    """Do and log what the first baro height after a pause does to the height (`aiding.baro.height`)."""
    if h[H_T] - t[T_BARO] > DATUM_LOST_NS:
        t[T_BARO_SEEN] = 0.0
    if t[T_BARO_SEEN] == 0.0:
        k = _entry(z_log, k, DATUM)
        t[T_DATUM_VAR] = z_log[k - 1, L_VARIANCE] = P[packed(POS + 2, POS + 2)]
        t[T_BARO_SEEN] = 1.0
        t[T_BARO] = h[H_T]
        reset_axis(P, POS + 2, par[PAR_BARO_NOISE] ** 2)
    t[T_DATUM_VAR] += par[PAR_BARO_DRIFT] ** 2 * max(0.0, h[H_T] - t[T_BARO]) * 1e-9
    t[T_BARO] = h[H_T]
    return k


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])")
def _note_fix(t: Float, h: Float, P: Float, aux: Float, z: Float) -> None:
    """Keep the account of GNSS positions: when, and how far they moved the baro's datum (`aiding.gnss`)."""
    t[T_GNSS], z[Z_GNSS_HERE] = h[H_T], 1.0
    if h[H_SHIFT] != 0.0:
        slow = max(1.0, 2.0 * ALTITUDE_CORRELATION_S / max(0.05, aux[A_GNSS_INTERVAL]))
        total = t[T_DATUM_VAR] + P[packed(POS + 2, POS + 2)] + h[H_ACC + 2] ** 2 * slow
        t[T_DATUM_VAR] *= 1.0 - t[T_DATUM_VAR] / total
        z[Z_SHIFT] += h[H_SHIFT]
        aux[A_BARO_OFFSET] += h[H_SHIFT]


@kernel(
    "int64(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], int64[::1], float64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[::1],"
    " float64[:, ::1], int64)"
)
def correct_logged(
    h: Float,
    t: Float,
    x: Float,
    P: Float,
    before: Float,
    u: Float,
    par: Float,
    aux: Float,
    ctl: Int,
    work: Float,
    aids: Float,
    aid_t: Float,
    events: Float,
    z: Float,
    z_log: Float,
    k: int,
) -> int:
    """Repeat one decided measurement and log it; return the number of log entries."""
    reset = h[H_STATUS] == RESET
    baro, fix = h[H_AID] == BARO_HEIGHT, h[H_AID] == GNSS_POSITION
    qw, qx, qy, qz = x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3]
    if reset:
        for i in range(N):
            before[i] = P[packed(ATT + 2, i)]
    elif fix:
        _note_fix(t, h, P, aux, z)
    elif baro and h[H_T] >= aux[A_T_RESET]:
        k = _start_datum(t, h, P, par, z_log, k)
    work[W_LOG], ctl[C_EVENTS] = 1.0, 0
    handle(h, x, P, u, par, aux, ctl, work, aids, aid_t, events, u[U_T])
    if not reset:
        return _keep_scalars(work, z_log, k)
    r = quat_mul(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3], qw, -qx, -qy, -qz)
    work[W_SIZE] = rotvec_from_quat(r[0], r[1], r[2], r[3])[2]
    t[T_RESETS] += 1.0
    if fix:
        t[T_POSITIONED], t[T_BARO_SEEN], t[T_GNSS] = 1.0, 0.0, h[H_T]
        z[Z_GNSS_HERE], z[Z_SHIFT] = 1.0, 0.0
    return _keep_reset(before, P, work[W_SIZE : W_SIZE + 1], z_log, k)

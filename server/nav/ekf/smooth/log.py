"""What a measurement did, written down: scalars with H, P Hᵀ and innovation, or states that were set."""

from __future__ import annotations

import math

from server.nav.codes import BARO_HEIGHT, GNSS_POSITION
from server.nav.ekf.handle import handle
from server.nav.ekf.layout import C_EVENTS, H_AID, H_STATUS, H_T, RESET, U_T, W_LOG, W_SIZE
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
    T_GNSS,
    T_POSITIONED,
    T_RESETS,
    Z_GNSS_HERE,
)
from server.nav.ekf.states import ATT, POS, VEL, WANDER, WITH_JITTER, WITH_MAG, X_Q, N, packed
from server.nav.ekf.update import LOGGED
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


@kernel("boolean(int64, float64[::1], int64)")
def _is_set(aid: int, P: Float, i: int) -> bool:
    """Return whether state i was set by a measurement that did not correct: nothing else knows of it."""
    if aid == GNSS_POSITION:  # the receiver's own errors and the position then know of each other
        return bool(VEL <= i < POS + 3 or WANDER <= i < WITH_JITTER)
    if i >= WITH_MAG or not P[packed(i, i)] > 0.0:
        return False
    for j in range(N):
        if j != i and P[packed(i, j)] != 0.0:
            return False
    return True


@kernel("int64(int64, float64[::1], float64[::1], float64, float64[:, ::1], int64)")
def _keep_reset(aid: int, before: Float, P: Float, angle: float, z_log: Float, k: int) -> int:
    """Log states that were set and not corrected; a heading nobody had known counts as measured.

    Args:
        aid: what set them.
        before: shape (N,), covariance of the heading error with every state before the reset.
        P: after it.
        angle: by which the heading turned.
        z_log, k: the log and its entries so far.
    """
    turned = False
    mask = k + 1
    k = _entry(z_log, k, SCALAR)
    k = _entry(z_log, k, FORGET)
    for i in range(N):
        z_log[mask, L_H + i] = 1.0 if _is_set(aid, P, i) else 0.0
    if z_log[mask, L_H + ATT + 2] > 0.0:
        total = before[ATT + 2] + P[packed(ATT + 2, ATT + 2)]
        if angle * angle < 9.0 * total:
            turned = True
            z_log[mask, L_H + ATT + 2] = 0.0
            z_log[mask - 1, L_INNOVATION], z_log[mask - 1, L_VARIANCE] = angle, total
            z_log[mask - 1, L_H + ATT + 2] = 1.0
            for i in range(N):
                z_log[mask - 1, L_PH + i] = before[i]
        z_log[mask - 1, L_TURN] = angle
    if not turned:
        z_log[mask - 1, L_VARIANCE] = math.inf
    return k


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
    aid = int(h[H_AID])
    qw, qx, qy, qz = x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3]
    for i in range(N):
        before[i] = P[packed(ATT + 2, i)]
    work[W_LOG], ctl[C_EVENTS] = 1.0, 0
    handle(h, x, P, u, par, aux, ctl, work, aids, aid_t, events, u[U_T])
    if aid == GNSS_POSITION:
        t[T_GNSS], z[Z_GNSS_HERE] = h[H_T], 1.0
    if h[H_STATUS] != RESET:
        return _keep_scalars(work, z_log, k)
    if aid == BARO_HEIGHT:
        return _entry(z_log, k, DATUM)
    r = quat_mul(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3], qw, -qx, -qy, -qz)
    t[T_RESETS] += 1.0
    if aid == GNSS_POSITION:
        t[T_POSITIONED] = 1.0
    return _keep_reset(aid, before, P, rotvec_from_quat(r[0], r[1], r[2], r[3])[2], z_log, k)

"""What the smoother needs of the filter's way: each history slot as it ends, and what its measurements did to it.

A slot that leaves the history is final: its measurements have been decided on and every late one is in. A second state
follows the filter at that distance: predicted by the same steps, corrected by the same measurements with the variances
decided on, in order of validity. What each scalar did is logged, so the pass back needs no model of any measurement.
Resets are logged as what they are: states that nothing later tells anything about.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import BARO_HEIGHT, FUSED, GNSS_POSITION
from server.nav.earth import ned_from_lla
from server.nav.ekf.aiding.baro import DATUM_LOST_NS
from server.nav.ekf.aiding.gnss import ALTITUDE_CORRELATION_S
from server.nav.ekf.handle import handle
from server.nav.ekf.history import copy
from server.nav.ekf.layout import (
    A_BARO_OFFSET,
    A_GNSS_INTERVAL,
    A_GNSS_WANDER_VAR,
    A_T_RESET,
    C_BARO_SEEN,
    C_EVENTS,
    C_HAS_HEADING,
    C_POSITIONED,
    H_ACC,
    H_AID,
    H_SHIFT,
    H_SIZE,
    H_STATUS,
    H_T,
    NEVER_NS,
    PAR_BARO_DRIFT,
    PAR_BARO_NOISE,
    RESET,
    U_DT,
    U_T,
    W_LOG,
    W_SIZE,
)
from server.nav.ekf.predict import predict
from server.nav.ekf.states import ATT, POS, VEL, X_POS, X_Q, X_VEL, N, packed
from server.nav.ekf.update import LOGGED, reset_axis
from server.nav.kernel import kernel
from server.nav.rotation import quat_mul, rotvec_from_quat
from server.nav.types import Float, Int

# Where the recording stands.
T_NEXT: Final = 0  # number of the next slot to record
T_LINKED: Final = 1  # the slot before is there to go on from
T_POSITIONED: Final = 2
T_BARO_SEEN: Final = 3
T_BARO: Final = 4  # last baro height used, ns
T_DATUM_VAR: Final = 5  # of the baro's datum, m²
T_GNSS: Final = 6  # last GNSS position used, ns
T_END: Final = 7  # end of the slot before, ns
T_BOUNDARIES: Final = 8  # places, after the first alignment, that nothing later tells anything across
T_RESETS: Final = 9  # positions or headings set instead of corrected
T_SIZE: Final = 10

# One recorded slot.
Z_LINKED: Final = 0  # follows the slot before it by the prediction in z_f
Z_POSITIONED: Final = 1
Z_BARO_SEEN: Final = 2
Z_DATUM_VAR: Final = 3
Z_SHIFT: Final = 4  # of height and datum together at this slot, m up
Z_WANDER_VAR: Final = 5
Z_GNSS: Final = 6  # last GNSS position used, ns
Z_GNSS_HERE: Final = 7
Z_LOG_END: Final = 8  # entries of the log up to and with this slot's
Z_WAS_POSITIONED: Final = 9  # before this slot's measurements
Z_SIZE: Final = 10
F_SIZE: Final = 13
"""f·dt NED, A = R_nb·dt row by row, dt of the prediction that leads to the slot (`derivation`)."""

# One entry of the log.
L_KIND: Final = 0
L_TURN: Final = 1  # rad by which the tilt error turned after it (`update.rotate_tilt`)
L_INNOVATION: Final = 2
L_VARIANCE: Final = 3
L_H: Final = 4  # (N); of a forgetting entry: 1 for the states that are forgotten
L_PH: Final = 4 + N  # (N)
L_SIZE: Final = 4 + 2 * N
SCALAR: Final = 0.0
FORGET: Final = 1.0
DATUM: Final = 2.0
"""What was known of the height became what is known of the baro's datum; the variance is that of both."""

LOG_ROOM: Final = 96
"""Scalars one slot can log: sixteen measurements of six."""
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
def _correct(
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


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " int64[::1], float64[::1], float64[::1], float64[::1])"
)
def _predict(
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
        t[T_POSITIONED] = t[T_BARO_SEEN] = t[T_DATUM_VAR] = 0.0
        t[T_GNSS] = t[T_BARO] = NEVER_NS
    z[Z_WAS_POSITIONED] = t[T_POSITIONED]


@kernel("float64(int64, int64, float64[:, :, ::1], int64[::1])")
def _shifts(first: int, end: int, r_m: Float, r_n: Int) -> float:
    """Return how far the measurements of slots [first, end) have moved the baro's datum, m."""
    total = 0.0
    for k in range(first, end):
        slot = k % r_n.shape[0]
        for i in range(r_n[slot]):
            if r_m[slot, i, H_STATUS] == FUSED:
                total += r_m[slot, i, H_SHIFT]
    return total


@kernel(
    "void(int64, int64, int64, float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], int64[::1], float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1],"
    " float64[:, :, ::1], int64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[:, ::1],"
    " float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], int64[::1])"
)
def record_slots(
    end: int,
    head: int,
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
        head: number of the slot that comes next.
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
    aux[A_BARO_OFFSET] -= _shifts(int(t[T_NEXT]), head, r_m, r_n)
    for k in range(int(t[T_NEXT]), end):
        slot, n = k % size, count[0]
        u, z = r_u[slot], z_s[n]
        for i in range(Z_SIZE):
            z[i] = 0.0
        _predict(t, x, P, r_x[slot], r_P[slot], u, par, ctl, aux, work, z)
        copy(work, z_f[n], F_SIZE)
        ctl[C_POSITIONED] = 1
        log = int(count[1])
        for i in range(r_n[slot] if k >= valid else 0):
            copy(r_m[slot, i], h, H_SIZE)
            if h[H_STATUS] == FUSED or h[H_STATUS] == RESET:
                log = _correct(h, t, x, P, before, u, par, aux, ctl, work, aids, aid_t, events, z, z_log, log)
        copy(u, z_u[n], u.shape[0])
        copy(x, z_x[n], x.shape[0])
        copy(P, z_P[n], P.shape[0])
        z[Z_POSITIONED], z[Z_BARO_SEEN], z[Z_DATUM_VAR] = t[T_POSITIONED], t[T_BARO_SEEN], t[T_DATUM_VAR]
        z[Z_WANDER_VAR], z[Z_GNSS], z[Z_LOG_END] = aux[A_GNSS_WANDER_VAR], t[T_GNSS], log
        t[T_LINKED], t[T_END], t[T_NEXT] = 1.0, u[U_T], k + 1
        count[0], count[1] = n + 1, log
    work[W_LOG] = 0.0

"""The short past: a measurement is put where it was valid, and the filter is re-run from there.

Each slot keeps one navigation step, the state and covariance predicted to its end, and the measurements valid there.
A late one makes its slot dirty; from the earliest dirty slot on, corrections and predictions are repeated in order, so
the present is what it would have been had everything arrived at once. Decisions (believed or not, with which variance)
are taken once, at first use.
"""

from __future__ import annotations

from server.nav.codes import REFUSED_STALE
from server.nav.ekf.handle import clear_record, handle, record
from server.nav.ekf.layout import (
    C_HEAD,
    C_OVERFLOW,
    C_VALID,
    DELAYS,
    H_AID,
    H_SIZE,
    H_T,
    SENS,
    SLOT_MEASUREMENTS,
    U_T,
    W_DELAYS,
    W_DIM,
    W_SENS,
)
from server.nav.ekf.predict import predict, predict_slow
from server.nav.kernel import kernel
from server.nav.types import Float, Int


@kernel("void(float64[::1], float64[::1], int64)")
def copy(source: Float, target: Float, n: int) -> None:
    """Copy the first n numbers; a slice assignment would look for overlap first."""
    for i in range(n):
        target[i] = source[i]


@kernel("void(float64[::1], float64[::1], float64[::1])")
def save(x: Float, work: Float, slot: Float) -> None:
    """Keep the nominal state and, while delays are estimated, its sensitivities."""
    n = x.shape[0]
    copy(x, slot, n)
    if work[W_DELAYS] > 0.0:
        for i in range(DELAYS * SENS):
            slot[n + i] = work[W_SENS + i]


@kernel("void(float64[::1], float64[::1], float64[::1])")
def restore(slot: Float, x: Float, work: Float) -> None:
    """Take back what `save` kept."""
    n = x.shape[0]
    copy(slot, x, n)
    if work[W_DELAYS] > 0.0:
        for i in range(DELAYS * SENS):
            work[W_SENS + i] = slot[n + i]


@kernel("int64(float64[::1])", inline=True)
def active(work: Float) -> int:
    """Return how many entries of the packed covariance are in use."""
    n = int(work[W_DIM])
    return n * (n + 1) // 2


@kernel(
    "void(float64[::1], float64[::1], float64[::1], int64[::1], float64[::1], float64[:, ::1], float64[:, ::1],"
    " float64[:, ::1], int64[::1])"
)
def push(u: Float, x: Float, P: Float, ctl: Int, work: Float, r_u: Float, r_x: Float, r_P: Float, r_n: Int) -> None:
    """Open a slot for the step whose end the state has just been predicted to."""
    slot = ctl[C_HEAD] % r_u.shape[0]
    copy(u, r_u[slot], r_u.shape[1])
    save(x, work, r_x[slot])
    copy(P, r_P[slot], active(work))
    r_n[slot] = 0
    ctl[C_HEAD] += 1
    ctl[C_VALID] = min(ctl[C_VALID] + 1, r_u.shape[0])


@kernel("int64(float64, int64[::1], float64[:, ::1])")
def find(t_ns: float, ctl: Int, r_u: Float) -> int:
    """Return the number of the slot whose end is nearest to t_ns, −1 when it lies before the history."""
    size = r_u.shape[0]
    newest = int(ctl[C_HEAD] - 1)
    oldest = int(ctl[C_HEAD] - ctl[C_VALID])
    k = newest
    while k > oldest and r_u[k % size, U_T] > t_ns:
        k -= 1
    t = r_u[k % size, U_T]
    if t > t_ns:
        return k if t - t_ns < 0.5 * r_u[k % size, 1] * 1e9 else -1
    if k < newest and r_u[(k + 1) % size, U_T] - t_ns < t_ns - t:
        return k + 1
    return k


@kernel(
    "int64(float64[::1], int64, float64, int64[::1], float64[::1], float64[:, ::1], float64[:, :, ::1], int64[::1],"
    " float64[:, ::1], float64[::1])"
)
def attach(
    h: Float,
    dirty: int,
    t_ns: float,
    ctl: Int,
    work: Float,
    r_u: Float,
    r_m: Float,
    r_n: Int,
    aids: Float,
    aid_t: Float,
) -> int:
    """Put a measurement into its slot; return the earliest dirty slot, now that this one is there."""
    k = find(h[H_T], ctl, r_u)
    slot = k % r_u.shape[0]
    if k < 0 or r_n[slot] >= SLOT_MEASUREMENTS:
        ctl[C_OVERFLOW] += k >= 0
        clear_record(work)
        record(h[H_AID], REFUSED_STALE, h[H_T], t_ns, work, ctl, aids, aid_t)
        return dirty
    for i in range(H_SIZE):
        r_m[slot, r_n[slot], i] = h[i]
    r_n[slot] += 1
    return k if dirty < 0 or k < dirty else dirty


@kernel(
    "void(int64, float64, float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1],"
    " float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1], int64[::1],"
    " float64[:, ::1], float64[::1], float64[:, ::1])"
)
def rerun(
    dirty: int,
    t_ns: float,
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
    aids: Float,
    aid_t: Float,
    events: Float,
) -> None:
    """Repeat the filter from slot number `dirty` to the newest; x and P end as the present."""
    size = r_u.shape[0]
    slot = dirty % size
    restore(r_x[slot], x, work)
    copy(r_P[slot], P, active(work))
    for k in range(dirty, ctl[C_HEAD]):
        slot = k % size
        if k > dirty:
            predict(x, P, r_u[slot], par, aux, ctl, work)
            predict_slow(x, P, r_u[slot], par, aux, work)
            save(x, work, r_x[slot])
            copy(P, r_P[slot], active(work))  # a measurement may have switched a block on
        for i in range(r_n[slot]):
            handle(r_m[slot, i], x, P, r_u[slot], par, aux, ctl, work, aids, aid_t, events, t_ns)

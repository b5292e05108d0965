"""The best trajectory after the fact: one pass back over the recorded way of the filter.

The modified Bryson-Frazier form of the fixed-interval smoother [Bierman 1977, "Factorization Methods for Discrete
Sequential Estimation", ch. X]: instead of a smoothed state it carries back an adjoint λ with its covariance Λ, which
say what the later measurements tell. With the filter's corrected state x, P at a step

    x_smoothed = x ⊞ P λ,    P_smoothed = P − P Λ P

and going back over a scalar measurement (H, K = P Hᵀ/S, innovation ν) and over a prediction F

    λ ← Hᵀν/S + (I − K H)ᵀ λ,    Λ ← HᵀH/S + (I − K H)ᵀ Λ (I − K H);    λ ← Fᵀ λ,    Λ ← Fᵀ Λ F.

It equals Rauch, Tung and Striebel's smoother, but inverts nothing: a state without variance (a block not switched on, a
declination held) simply takes no part, and a step costs a few hundred multiplications for each scalar.
The datum of the baro height, which the filter keeps beside its states, is smoothed as the random walk it is.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import ATTITUDE, DEAD_RECKONING, NAVIGATING
from server.nav.ekf.history import copy
from server.nav.ekf.layout import (
    A_BARO_OFFSET_VAR,
    A_GNSS_INTERVAL,
    A_GNSS_WANDER_VAR,
    A_T_GNSS,
    C_BARO_SEEN,
    C_MODE,
    C_POSITIONED,
    PAR_BARO_DRIFT,
    PAR_GNSS_DELAY,
    U_T,
    W_DX,
)
from server.nav.ekf.publish import publish
from server.nav.ekf.record import (
    DATUM,
    FORGET,
    L_H,
    L_INNOVATION,
    L_KIND,
    L_PH,
    L_TURN,
    L_VARIANCE,
    SCALAR,
    Z_BARO_SEEN,
    Z_DATUM_VAR,
    Z_GNSS,
    Z_GNSS_HERE,
    Z_LINKED,
    Z_LOG_END,
    Z_POSITIONED,
    Z_SHIFT,
    Z_WANDER_VAR,
    Z_WAS_POSITIONED,
)
from server.nav.ekf.run import OUTAGE_INTERVALS, OUTAGE_S
from server.nav.ekf.states import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL, X_POS, N, packed
from server.nav.ekf.update import inject
from server.nav.kernel import kernel
from server.nav.types import Float, Int

# What the pass carries from a step to the one before it, beside λ and Λ.
B_LINKED: Final = 0  # the step after this one follows from it
B_SEEN: Final = 1  # … and used the baro
B_DATUM: Final = 2  # smoothed less filtered datum at the step after, m up
B_DATUM_VAR: Final = 3  # smoothed, there
B_SHIFT: Final = 4  # of the datum at the step after, m up
B_DT: Final = 5  # to the step after, s
B_FUTURE: Final = 6  # a later GNSS position holds this step
B_SIZE: Final = 7

LEAST_SHARE: Final = 1e-8
"""Of the filter's variance that the smoothed one keeps at least, whatever rounding says."""
ROUNDING: Final = (0.003, 0.005)
"""Of a receiver's velocities (cm/s) and positions (1e-7 degrees): for one that moves little it is the same in every fix,
so averaging over the future and the past does not remove it. m/s, m."""


@kernel("void(float64[::1], float64[:, ::1], int64)")
def _forget(lam: Float, Lam: Float, i: int) -> None:
    """State i was set: nothing later tells about what it was before."""
    lam[i] = 0.0
    for j in range(N):
        Lam[i, j] = Lam[j, i] = 0.0


@kernel("void(float64[::1], float64[:, ::1], float64)")
def _turn_back(lam: Float, Lam: Float, angle_rad: float) -> None:
    """Undo a turn of the tilt error: λ ← Tᵀ λ, Λ ← Tᵀ Λ T with T from `update.rotate_tilt`."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    a, b = lam[ATT], lam[ATT + 1]
    lam[ATT], lam[ATT + 1] = c * a + s * b, c * b - s * a
    for j in range(N):
        a, b = Lam[ATT, j], Lam[ATT + 1, j]
        Lam[ATT, j], Lam[ATT + 1, j] = c * a + s * b, c * b - s * a
    for j in range(N):
        a, b = Lam[j, ATT], Lam[j, ATT + 1]
        Lam[j, ATT], Lam[j, ATT + 1] = c * a + s * b, c * b - s * a


@kernel("void(float64[::1], float64[:, ::1], float64[::1], float64[::1], int64)", contract=True)
def back_over_scalar(lam: Float, Lam: Float, entry: Float, g: Float, n: int) -> None:
    """Carry λ, Λ back over one scalar measurement.

    Args:
        lam, Lam: shapes (N,), (N, N), changed in place.
        entry: shape (L_SIZE,), of the log.
        g: shape (N,), scratch.
        n: active states.
    """
    inverse = 1.0 / entry[L_VARIANCE]
    along = curvature = 0.0
    for i in range(n):
        g[i] = 0.0
    for i in range(n):
        gain = entry[L_PH + i] * inverse
        along += gain * lam[i]
        for j in range(n):
            g[j] += gain * Lam[i, j]
    for i in range(n):
        curvature += entry[L_PH + i] * inverse * g[i]
    along = entry[L_INNOVATION] * inverse - along
    curvature += inverse
    for i in range(n):
        h = entry[L_H + i]
        if h != 0.0:
            lam[i] += h * along
            for j in range(n):
                Lam[i, j] -= h * g[j]
                Lam[j, i] -= h * g[j]
    for i in range(n):
        h = entry[L_H + i]
        if h != 0.0:
            for j in range(n):
                Lam[i, j] += h * curvature * entry[L_H + j]


@kernel("void(float64[:, ::1], float64[::1], int64)", contract=True)
def _back_rows(Lam: Float, f: Float, n: int) -> None:
    """Λ ← Fᵀ Λ, row by row, F as `derivation` has it."""
    dt = f[12]
    for j in range(n):
        for i in range(3):
            a0, a1, a2 = f[3 + i], f[6 + i], f[9 + i]
            Lam[ACCEL_BIAS + i, j] -= a0 * Lam[VEL, j] + a1 * Lam[VEL + 1, j] + a2 * Lam[VEL + 2, j]
            Lam[GYRO_BIAS + i, j] -= a0 * Lam[ATT, j] + a1 * Lam[ATT + 1, j] + a2 * Lam[ATT + 2, j]
        v0, v1, v2 = Lam[VEL, j], Lam[VEL + 1, j], Lam[VEL + 2, j]
        Lam[ATT, j] += f[1] * v2 - f[2] * v1
        Lam[ATT + 1, j] += f[2] * v0 - f[0] * v2
        Lam[ATT + 2, j] += f[0] * v1 - f[1] * v0
        for i in range(3):
            Lam[VEL + i, j] += dt * Lam[POS + i, j]


@kernel("void(float64[::1], float64[:, ::1], float64[::1], int64)")
def back_over_prediction(lam: Float, Lam: Float, f: Float, n: int) -> None:
    """Carry λ, Λ back over one prediction.

    Args:
        lam, Lam: shapes (N,), (N, N), changed in place.
        f: shape (13,): f·dt NED, A = R_nb·dt row by row, dt.
        n: active states.
    """
    for i in range(3):
        for r in range(3):
            lam[ACCEL_BIAS + i] -= f[3 + 3 * r + i] * lam[VEL + r]
            lam[GYRO_BIAS + i] -= f[3 + 3 * r + i] * lam[ATT + r]
    lam[ATT] += f[1] * lam[VEL + 2] - f[2] * lam[VEL + 1]
    lam[ATT + 1] += f[2] * lam[VEL] - f[0] * lam[VEL + 2]
    lam[ATT + 2] += f[0] * lam[VEL + 1] - f[1] * lam[VEL]
    for i in range(3):
        lam[VEL + i] += f[12] * lam[POS + i]
    for _ in range(2):  # Fᵀ Λ F is the same row operation twice, with a transposition after each
        _back_rows(Lam, f, n)
        for i in range(n):
            for j in range(i):
                Lam[i, j], Lam[j, i] = Lam[j, i], Lam[i, j]


@kernel("void(float64[::1], float64[:, ::1], float64[::1], float64)")
def _back_over_datum(lam: Float, Lam: Float, b: Float, variance: float) -> None:
    """Before the first baro height the datum's error was the height's own: what is known of it goes over."""
    _forget(lam, Lam, POS + 2)
    lam[POS + 2] = -(b[B_DATUM] + b[B_SHIFT]) / variance
    Lam[POS + 2, POS + 2] = max(0.0, variance - b[B_DATUM_VAR]) / (variance * variance)
    b[B_SEEN] = 0.0


@kernel(
    "void(float64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1],"
    " int64)",
    contract=True,
)
def correct(x: Float, full: Float, P: Float, product: Float, lam: Float, work: Float, Lam: Float, n: int) -> None:
    """Set x ← x ⊞ P λ and the leading nine states of P ← P − P Λ P; the rest of P is not kept.

    Args:
        x: shape (X_SIZE,), changed in place.
        full, product: shapes (N, N), (9, N), scratch.
        P: packed lower triangle, changed in place.
        lam, Lam: shapes (N,), (N, N).
        work: the filter's scratch.
        n: active states.
    """
    for i in range(n):
        for j in range(i + 1):
            full[i, j] = full[j, i] = P[packed(i, j)]
    for i in range(N):
        work[W_DX + i] = 0.0
    for i in range(n):
        for j in range(n):
            work[W_DX + i] += full[i, j] * lam[j]
    for i in range(POS + 3):
        for j in range(n):
            product[i, j] = 0.0
        for k in range(n):
            p = full[i, k]
            for j in range(n):
                product[i, j] += p * Lam[k, j]
        for j in range(i + 1):
            less = 0.0
            for k in range(n):
                less += product[i, k] * full[k, j]
            P[packed(i, j)] -= less
        P[packed(i, i)] = max(P[packed(i, i)], LEAST_SHARE * full[i, i])
    inject(x, P, work)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def _smooth_datum(z: Float, b: Float, par: Float) -> None:
    """Carry the datum back by one step: a random walk, smoothed by itself [Rauch, Tung, Striebel 1965]."""
    here = z[Z_DATUM_VAR]
    if b[B_LINKED] == 0.0 or b[B_SEEN] == 0.0 or z[Z_BARO_SEEN] == 0.0 or here <= 0.0:
        b[B_DATUM], b[B_DATUM_VAR] = 0.0, here
        return
    ahead = here + par[PAR_BARO_DRIFT] ** 2 * b[B_DT]
    c = here / ahead
    b[B_DATUM] = c * (b[B_DATUM] + b[B_SHIFT])
    b[B_DATUM_VAR] = max(0.0, here + c * c * (b[B_DATUM_VAR] - ahead))


@kernel("void(float64, float64[::1], float64[::1], float64[::1], float64[::1], int64[::1])")
def _state(t: float, z: Float, b: Float, par: Float, aux: Float, ctl: Int) -> None:
    """Set what `publish` asks of the memory: the mode above all. Held at both ends, a gap in GNSS is no reckoning."""
    ctl[C_POSITIONED], ctl[C_BARO_SEEN] = int(z[Z_POSITIONED]), int(z[Z_BARO_SEEN])
    aux[A_BARO_OFFSET_VAR], aux[A_GNSS_WANDER_VAR] = b[B_DATUM_VAR], z[Z_WANDER_VAR]
    aux[A_T_GNSS] = z[Z_GNSS]
    limit = max(OUTAGE_S, OUTAGE_INTERVALS * aux[A_GNSS_INTERVAL]) + par[PAR_GNSS_DELAY]
    lost = b[B_FUTURE] == 0.0 and (t - z[Z_GNSS]) * 1e-9 > limit
    ctl[C_MODE] = (DEAD_RECKONING if lost else NAVIGATING) if ctl[C_POSITIONED] else ATTITUDE


@kernel("void(float64[:, ::1], int64, int64, float64[::1], float64[:, ::1], float64[::1], float64[::1], int64)")
def _back_over_log(z_log: Float, first: int, last: int, lam: Float, Lam: Float, b: Float, g: Float, n: int) -> None:
    """Carry λ, Λ back over the log entries of one slot, the last one first."""
    for k in range(last - 1, first - 1, -1):
        entry = z_log[k]
        if entry[L_TURN] != 0.0:
            _turn_back(lam, Lam, entry[L_TURN])
        if entry[L_KIND] == FORGET:
            for i in range(N):
                if entry[L_H + i] != 0.0:
                    _forget(lam, Lam, i)
            if entry[L_H + POS] != 0.0:
                b[B_FUTURE] = b[B_SEEN] = 0.0
        elif entry[L_KIND] == DATUM:
            _back_over_datum(lam, Lam, b, entry[L_VARIANCE])
        elif entry[L_KIND] == SCALAR and math.isfinite(entry[L_VARIANCE]):
            back_over_scalar(lam, Lam, entry, g, n)


@kernel(
    "void(int64, int64, float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1],"
    " float64[:, ::1], int64[::1], float64[::1], float64[:, ::1], float64[::1], float64[::1], float64[::1],"
    " float64[::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], int64[::1], float64[::1],"
    " float64[:, ::1])"
)
def smooth(
    slots: int,
    n: int,
    z_u: Float,
    z_x: Float,
    z_P: Float,
    z_f: Float,
    z_s: Float,
    z_log: Float,
    step_of: Int,
    lam: Float,
    Lam: Float,
    b: Float,
    x: Float,
    P: Float,
    g: Float,
    full: Float,
    product: Float,
    par: Float,
    aux: Float,
    ctl: Int,
    work: Float,
    rows: Float,
) -> None:
    """Go back over recorded slots and write the smoothed rows.

    Args:
        slots: recorded in z_u … z_s. n: active states.
        z_u, z_x, z_P, z_f, z_s, z_log: the record, `record`.
        step_of: shape (slots,), row of each slot.
        lam, Lam, b: shapes (N,), (N, N), (B_SIZE,), carried on from the part of the recording that follows.
        x, P, g, full, product: shapes (X_SIZE,), (PACKED,), (N,), (N, N), (9, N), scratch.
        par, aux, ctl, work: the filter's parameters, and copies of its memory and scratch.
        rows: shape (steps, len(LANE_COLUMNS)), written where there is a slot.
    """
    for k in range(slots - 1, -1, -1):
        z = z_s[k]
        if b[B_LINKED] == 0.0:
            for i in range(N):
                _forget(lam, Lam, i)
            b[B_FUTURE] = 0.0
        _smooth_datum(z, b, par)
        b[B_SHIFT] = z[Z_SHIFT]
        if z[Z_GNSS_HERE] > 0.0:
            b[B_FUTURE] = 1.0
        copy(z_x[k], x, x.shape[0])
        copy(z_P[k], P, P.shape[0])
        correct(x, full, P, product, lam, work, Lam, n)
        x[X_POS + 2] += b[B_DATUM]
        for i in range(VEL, POS + 3):
            P[packed(i, i)] += ROUNDING[0 if i < POS else 1] ** 2
        _state(z_u[k, U_T], z, b, par, aux, ctl)
        publish(x, P, z_u[k], par, aux, ctl, rows[step_of[k]])
        b[B_LINKED], b[B_SEEN], b[B_DT] = z[Z_LINKED], z[Z_BARO_SEEN], z_f[k, 12]
        first = int(z_s[k - 1, Z_LOG_END]) if k > 0 else 0
        _back_over_log(z_log, first, int(z[Z_LOG_END]), lam, Lam, b, g, n)
        if z[Z_LINKED] > 0.0:
            if z[Z_WAS_POSITIONED] == 0.0:
                for i in range(VEL, POS + 3):
                    _forget(lam, Lam, i)
            back_over_prediction(lam, Lam, z_f[k], n)

"""The best trajectory after the fact: one pass back over the recorded way of the filter.

The modified Bryson-Frazier form of the fixed-interval smoother [Bierman 1977, "Factorization Methods for Discrete
Sequential Estimation", ch. X]: instead of a smoothed state it carries back an adjoint λ with its covariance Λ, which
say what the later measurements tell. With the filter's corrected state x, P at a step

    x_smoothed = x ⊞ P λ,    P_smoothed = P − P Λ P

and going back over a scalar measurement (H, K = P Hᵀ/S, innovation ν) and over a prediction F

    λ ← Hᵀν/S + (I − K H)ᵀ λ,    Λ ← HᵀH/S + (I − K H)ᵀ Λ (I − K H);    λ ← Fᵀ λ,    Λ ← Fᵀ Λ F.

It equals Rauch, Tung and Striebel's smoother, but inverts nothing: a state without variance (a block not switched on, a
declination held) simply takes no part, and a step costs a few hundred multiplications for each scalar.
The sensors' slow errors are states like the others. One that starts on the way had no variance before, so nothing is
to be done; only the baro's datum starts as the height's own error, δb = −δd + noise, and λ goes over to the height.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import ATTITUDE, DEAD_RECKONING, NAVIGATING
from server.nav.ekf.history import copy
from server.nav.ekf.layout import (
    A_GNSS_INTERVAL,
    A_T_GNSS,
    C_MODE,
    C_POSITIONED,
    DELAYS,
    PAR_GNSS_DELAY,
    U_GYRO_MEAN,
    U_T,
    W_DELAYS,
    W_M,
)
from server.nav.ekf.publish import publish
from server.nav.ekf.run import OUTAGE_INTERVALS, OUTAGE_S
from server.nav.ekf.smooth.adjoint import (
    back_over_datum,
    back_over_prediction,
    back_over_scalar,
    correct,
    forget,
    turn_back,
)
from server.nav.ekf.smooth.layout import (
    B_FUTURE,
    B_LATER,
    B_LINKED,
    DATUM,
    FORGET,
    L_H,
    L_KIND,
    L_TURN,
    L_VARIANCE,
    SCALAR,
    Z_GNSS,
    Z_GNSS_HERE,
    Z_LINKED,
    Z_LOG_END,
    Z_POSITIONED,
    Z_WAS_POSITIONED,
)
from server.nav.ekf.states import POS, VEL, X_VEL, N, packed
from server.nav.kernel import kernel
from server.nav.types import Float, Int

ROUNDING: Final = (0.003, 0.005)
"""Of a receiver's velocities (cm/s) and positions (1e-7 degrees), m/s and m: for one that moves little it is the same
in every fix, so averaging over the future and the past does not remove it."""


@kernel("void(float64, float64[::1], float64[::1], float64[::1], float64[::1], int64[::1])")
def _state(t: float, z: Float, b: Float, par: Float, aux: Float, ctl: Int) -> None:
    """Set what `publish` asks of the memory: the mode above all. Held at both ends, a gap in GNSS is no reckoning."""
    ctl[C_POSITIONED], aux[A_T_GNSS] = int(z[Z_POSITIONED]), z[Z_GNSS]
    limit = max(OUTAGE_S, OUTAGE_INTERVALS * aux[A_GNSS_INTERVAL]) + par[PAR_GNSS_DELAY]
    lost = b[B_FUTURE] == 0.0 and (t - z[Z_GNSS]) * 1e-9 > limit
    ctl[C_MODE] = (DEAD_RECKONING if lost else NAVIGATING) if ctl[C_POSITIONED] else ATTITUDE


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def _widen(x: Float, u: Float, work: Float, out: Float) -> None:
    """Add to σ what delays that were found and not told leave: along the motion, and about the turn."""
    for i in range(3):
        out[16 + i] = math.sqrt(out[16 + i] ** 2 + x[X_VEL + i] ** 2 * work[W_M])
    turn2 = u[U_GYRO_MEAN] ** 2 + u[U_GYRO_MEAN + 1] ** 2 + u[U_GYRO_MEAN + 2] ** 2
    out[12] = math.sqrt(out[12] ** 2 + turn2 * work[W_M + DELAYS * DELAYS - 1])


@kernel("void(float64[:, ::1], int64, int64, float64[::1], float64[:, ::1], float64[::1], float64[::1], int64)")
def _back_over_log(z_log: Float, first: int, last: int, lam: Float, Lam: Float, b: Float, g: Float, n: int) -> None:
    """Carry λ, Λ back over the log entries of one slot, the last one first."""
    for k in range(last - 1, first - 1, -1):
        entry = z_log[k]
        if entry[L_TURN] != 0.0:
            turn_back(lam, Lam, entry[L_TURN])
        if entry[L_KIND] == FORGET:
            for i in range(N):
                if entry[L_H + i] != 0.0:
                    forget(lam, Lam, i)
            if entry[L_H + POS] != 0.0:
                b[B_FUTURE] = 0.0
        elif entry[L_KIND] == DATUM:
            back_over_datum(lam, Lam)
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
    """Go back over recorded slots and write the smoothed rows; a stretch without any position keeps the filter's own.

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
                forget(lam, Lam, i)
            b[B_FUTURE] = b[B_LATER] = 0.0
        if z[Z_GNSS_HERE] > 0.0:
            b[B_FUTURE] = b[B_LATER] = 1.0
        copy(z_x[k], x, x.shape[0])
        copy(z_P[k], P, P.shape[0])
        correct(x, full, P, product, lam, work, Lam, n)
        for i in range(VEL, POS + 3):
            P[packed(i, i)] += ROUNDING[0 if i < POS else 1] ** 2
        _state(z_u[k, U_T], z, b, par, aux, ctl)
        if b[B_LATER] > 0.0 or ctl[C_POSITIONED] > 0:
            publish(x, P, z_u[k], par, aux, ctl, rows[step_of[k]])
            if work[W_DELAYS] > 0.0:
                _widen(x, z_u[k], work, rows[step_of[k]])
        b[B_LINKED] = z[Z_LINKED]
        first = int(z_s[k - 1, Z_LOG_END]) if k > 0 else 0
        _back_over_log(z_log, first, int(z[Z_LOG_END]), lam, Lam, b, g, n)
        if z[Z_LINKED] > 0.0:
            if z[Z_WAS_POSITIONED] == 0.0:
                for i in range(VEL, POS + 3):
                    forget(lam, Lam, i)
            back_over_prediction(lam, Lam, z_f[k], n)

"""GNSS and baro in `nav_position`: each compared with the state of its own time, the states since corrected."""

from __future__ import annotations

import math
from typing import Final

from server.nav.earth import ned_from_lla
from server.nav.ekf.layout import M_DATA, M_T, NEVER_NS, U_GYRO, U_T
from server.nav.kernel import kernel
from server.nav.lanes.axis_filter import ERR, OFF, POS, VEL, N, innovation_variance, start_axis, update_axis
from server.nav.lanes.nav_position_layout import (
    F_ACCEL,
    F_BARO,
    F_BARO_REFUSED,
    F_GNSS_REFUSED,
    F_INTERVAL,
    F_RUN,
    F_SITE,
    F_T_GNSS,
    G_BARO,
    G_BARO_DELAY,
    G_CORRELATION,
    G_ERROR,
    G_ERROR_DOWN,
    G_GATE,
    G_GNSS_DELAY,
    G_HEIGHT,
    G_IMU_DELAY,
    G_LEVER,
    G_POSITION,
    G_REACCEPT,
    G_VELOCITY,
    H_ARM,
    H_ARM_VEL,
    H_POS,
    H_T,
    H_VEL,
)
from server.nav.lanes.vertical import attitude_at_end
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int

HEIGHT_CORRELATION: Final = 25.0
"""Variance factor for GNSS heights: their error stays alike for seconds (10 s on the recorded autopilot), 2 τ/T."""
WORST_START_M: Final = 50.0  # a first fix less accurate than this does not start the navigation
UNKNOWN_POSITION_M: Final = 3.0  # receivers that tell no accuracy: an open-sky single-frequency fix
UNKNOWN_HEIGHT_M: Final = 5.0
UNKNOWN_VELOCITY_M_S: Final = 0.3
LEAST_VELOCITY_M_S: Final = 0.03  # Doppler velocities of 5 to 10 Hz receivers are no better, whatever they report
LEAST_POSITION_M: Final = 0.01
REACCEPT_COUNT: Final = 3.0
START_ERROR_M_S2: Final = 1.0  # an attitude that has just started may lean by 6°


@kernel("void(float64[::1], float64[::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1], int64[::1])")
def remember(u: Float, att: Float, x: Float, f: Float, par: Float, r: Float, c: Int) -> None:
    """Append the state at the end of the step, and where the antenna is from it, to the past."""
    row = r[c[0] % r.shape[0]]
    d = par[G_IMU_DELAY]
    q = attitude_at_end(u, att, d)
    R = matrix_entries(q[0], q[1], q[2], q[3])
    l0, l1, l2 = par[G_LEVER], par[G_LEVER + 1], par[G_LEVER + 2]
    w0, w1, w2 = u[U_GYRO], u[U_GYRO + 1], u[U_GYRO + 2]
    v0, v1, v2 = w1 * l2 - w2 * l1, w2 * l0 - w0 * l2, w0 * l1 - w1 * l0
    row[H_T] = u[U_T] - d * 1e9
    for i in range(3):
        row[H_POS + i], row[H_VEL + i] = x[i, POS], x[i, VEL]
        row[H_ARM + i] = R[3 * i] * l0 + R[3 * i + 1] * l1 + R[3 * i + 2] * l2
        row[H_ARM_VEL + i] = R[3 * i] * v0 + R[3 * i + 1] * v1 + R[3 * i + 2] * v2
    c[0] += 1
    c[1] = min(c[1] + 1, r.shape[0])


@kernel("int64(float64, float64[:, ::1], int64[::1])")
def _slot_at(t: float, r: Float, c: Int) -> int:
    """Return how many rows back the newest one not after t lies; 0 when t is older than all."""
    for back in range(1, c[1] + 1):
        if r[(c[0] - back) % r.shape[0], H_T] <= t:
            return back
    return 0


@kernel("void(int64, float64, int64, float64, float64, float64[:, ::1], int64[::1])")
def _correct_past(axis: int, t: float, back: int, pos: float, vel: float, r: Float, c: Int) -> None:
    """Add what a correction at t makes of every remembered position and velocity since."""
    for i in range(1, back + 1):
        row = r[(c[0] - i) % r.shape[0]]
        row[H_POS + axis] += pos + vel * (row[H_T] - t) * 1e-9
        row[H_VEL + axis] += vel


@kernel("float64(int64, int64, float64[::1], float64[:, ::1], int64[::1])")
def _acceleration_after(back: int, axis: int, f: Float, r: Float, c: Int) -> float:
    """Return the acceleration in the step that follows a remembered row; the newest one's goes on."""
    if back < 2:
        return float(f[F_ACCEL + axis])
    row, following = r[(c[0] - back) % r.shape[0]], r[(c[0] - back + 1) % r.shape[0]]
    return float((following[H_VEL + axis] - row[H_VEL + axis]) / ((following[H_T] - row[H_T]) * 1e-9))


@kernel("float64(float64, float64, float64, float64)")
def _accuracy(chosen: float, reported: float, unknown: float, least: float) -> float:
    """Return the standard deviation to use: the one chosen, else the receiver's own, else that of ordinary ones."""
    if math.isfinite(chosen):
        return chosen
    return max(least, reported) if math.isfinite(reported) and reported > 0.0 else unknown


@kernel("boolean(float64[::1], float64[::1], float64[::1])")
def _place(m: Float, f: Float, out: Float) -> bool:
    """Write a fix's NED position from the site; return whether it has one."""
    if not math.isfinite(m[M_DATA] + m[M_DATA + 1] + f[F_SITE] + f[F_SITE + 1] + f[F_SITE + 2]):
        return False
    height = m[M_DATA + 2] if math.isfinite(m[M_DATA + 2]) else f[F_SITE + 2]
    ned = ned_from_lla(
        math.radians(m[M_DATA]), math.radians(m[M_DATA + 1]), height, f[F_SITE], f[F_SITE + 1], f[F_SITE + 2]
    )
    out[0], out[1] = ned[0], ned[1]
    out[2] = ned[2] if math.isfinite(m[M_DATA + 2]) else math.nan
    return True


@kernel(
    "void(float64[::1], float64, float64, float64[:, ::1], float64[:, :, ::1], float64[::1], float64[::1],"
    " float64[::1], float64[:, ::1], int64[::1])"
)
def _start(
    m: Float, t: float, t_now: float, x: Float, P: Float, f: Float, par: Float, ned: Float, r: Float, c: Int
) -> None:
    """Set position and velocity from a fix, carried to the present by its own velocity; forget the past."""
    h = _accuracy(par[G_POSITION], m[M_DATA + 6], UNKNOWN_POSITION_M, LEAST_POSITION_M)
    v = _accuracy(par[G_HEIGHT], m[M_DATA + 7], UNKNOWN_HEIGHT_M, LEAST_POSITION_M)
    s = _accuracy(par[G_VELOCITY], m[M_DATA + 8], UNKNOWN_VELOCITY_M_S, LEAST_VELOCITY_M_S)
    newest = r[(c[0] - 1) % r.shape[0]]
    for i in range(3):
        speed = m[M_DATA + 3 + i]
        known = math.isfinite(speed)
        x[i, VEL] = speed - newest[H_ARM_VEL + i] if known else 0.0
        base = ned[i] if math.isfinite(ned[i]) else 0.0
        x[i, POS] = base - newest[H_ARM + i] + x[i, VEL] * (t_now - t) * 1e-9
        x[i, ERR] = x[i, OFF] = 0.0
        error = par[G_ERROR_DOWN] if i == 2 else max(par[G_ERROR], START_ERROR_M_S2)
        start_axis(P[i], (v if i == 2 else h) ** 2, s * s if known else 4.0, error * error, 0.0)
    f[F_RUN], f[F_T_GNSS], f[F_GNSS_REFUSED], f[F_BARO], f[F_BARO_REFUSED] = 1.0, t, 0.0, NEVER_NS, 0.0
    c[1] = 1  # what is older belongs to another course
    for i in range(3):
        newest[H_POS + i], newest[H_VEL + i] = x[i, POS], x[i, VEL]


@kernel("boolean(boolean, float64, int64, float64[::1], float64)")
def _lasting(passed: bool, since_s: float, index: int, f: Float, patience_s: float) -> bool:
    """Count refusals in a row at f[index]; return True when they have lasted, after an outage soon."""
    f[index] = 0.0 if passed else f[index] + 1.0
    return bool(f[index] >= REACCEPT_COUNT and since_s >= patience_s)


@kernel(
    "void(float64[::1], float64, float64[:, ::1], float64[:, :, ::1], float64[::1], float64[::1], float64[::1],"
    " float64[:, ::1], int64[::1])"
)
def fuse_gnss(m: Float, t_now: float, x: Float, P: Float, f: Float, par: Float, ned: Float, r: Float, c: Int) -> None:
    """Start from a fix, or compare it with the state of its own time and correct all since; refuse an outlier."""
    t = m[M_T] - par[G_GNSS_DELAY] * 1e9
    placed = _place(m, f, ned)
    if f[F_RUN] == 0.0:
        h = _accuracy(par[G_POSITION], m[M_DATA + 6], UNKNOWN_POSITION_M, LEAST_POSITION_M)
        if placed and h <= WORST_START_M and c[1] > 0:
            _start(m, t, t_now, x, P, f, par, ned, r, c)
        return
    back = _slot_at(t, r, c)
    if back == 0 or t <= f[F_T_GNSS]:
        return
    slot = r[(c[0] - back) % r.shape[0]]
    ahead = (t - slot[H_T]) * 1e-9
    age = (r[(c[0] - 1) % r.shape[0], H_T] - t) * 1e-9
    accuracy = (
        _accuracy(par[G_POSITION], m[M_DATA + 6], UNKNOWN_POSITION_M, LEAST_POSITION_M),
        _accuracy(par[G_HEIGHT], m[M_DATA + 7], UNKNOWN_HEIGHT_M, LEAST_POSITION_M),
        _accuracy(par[G_VELOCITY], m[M_DATA + 8], UNKNOWN_VELOCITY_M_S, LEAST_VELOCITY_M_S),
    )
    factors = (par[G_CORRELATION], HEIGHT_CORRELATION, par[G_CORRELATION])
    worst = 0.0
    for i in range(3):  # the innovations are of one moment: all are found before the first one corrects
        a = _acceleration_after(back, i, f, r, c)
        if placed and math.isfinite(ned[i]):
            ned[3 + i] = ned[i] - (slot[H_POS + i] + (slot[H_VEL + i] + 0.5 * ahead * a) * ahead + slot[H_ARM + i])
            j = 1 if i == 2 else 0
            variance = factors[j] * accuracy[j] ** 2
            worst = max(worst, ned[3 + i] ** 2 / innovation_variance(P[i], 1.0, 0.0, 0.0, variance))
        else:
            ned[3 + i] = math.nan
        ned[6 + i] = m[M_DATA + 3 + i] - (slot[H_VEL + i] + ahead * a + slot[H_ARM_VEL + i])
        if math.isfinite(ned[6 + i]):
            variance = factors[2] * accuracy[2] ** 2
            worst = max(worst, ned[6 + i] ** 2 / innovation_variance(P[i], 0.0, 1.0, 0.0, variance))
    passed = worst <= par[G_GATE] ** 2
    if _lasting(passed, (t - f[F_T_GNSS]) * 1e-9, F_GNSS_REFUSED, f, par[G_REACCEPT]) and placed:
        _start(m, t, t_now, x, P, f, par, ned, r, c)
        return
    if not passed:
        return
    for i in range(3):
        pos = vel = 0.0
        if math.isfinite(ned[3 + i]):
            j = 1 if i == 2 else 0
            variance = factors[j] * accuracy[j] ** 2
            pos, vel = update_axis(x[i], P[i], ned[3 + i], 1.0, 0.0, 0.0, variance, age)
        if math.isfinite(ned[6 + i]):
            more = update_axis(x[i], P[i], ned[6 + i] - vel, 0.0, 1.0, 0.0, factors[2] * accuracy[2] ** 2, age)
            pos, vel = pos + more[0], vel + more[1]
        _correct_past(i, t, back, pos, vel, r, c)
    f[F_INTERVAL] += 0.2 * (min(5.0, (t - f[F_T_GNSS]) * 1e-9) - f[F_INTERVAL])
    f[F_T_GNSS] = t


@kernel(
    "void(float64[::1], float64[:, ::1], float64[:, :, ::1], float64[::1], float64[::1], float64[:, ::1], int64[::1])"
)
def fuse_baro(m: Float, x: Float, P: Float, f: Float, par: Float, r: Float, c: Int) -> None:
    """Compare a baro height with the one of its own time; the first one, or one that stays outside, sets the offset."""
    t = m[M_T] - par[G_BARO_DELAY] * 1e9
    back = _slot_at(t, r, c)
    if back == 0 or t <= f[F_BARO] or f[F_RUN] == 0.0:
        return
    slot = r[(c[0] - back) % r.shape[0]]
    height = -(slot[H_POS + 2] + slot[H_VEL + 2] * (t - slot[H_T]) * 1e-9)
    variance = par[G_BARO] ** 2
    e = m[M_DATA + 1] - height - x[2, OFF]
    first = f[F_BARO] == NEVER_NS
    passed = first or e * e <= par[G_GATE] ** 2 * innovation_variance(P[2], -1.0, 0.0, 1.0, variance)
    if first or _lasting(passed, (t - f[F_BARO]) * 1e-9, F_BARO_REFUSED, f, par[G_REACCEPT]):
        x[2, OFF] += e
        for j in range(N):  # offset = baro height + down: it errs as the height does, and as the barometer
            P[2, OFF, j] = P[2, j, OFF] = P[2, POS, j]
        P[2, OFF, OFF] = P[2, POS, POS] + variance
        f[F_BARO_REFUSED] = 0.0
    elif passed:
        age = (r[(c[0] - 1) % r.shape[0], H_T] - t) * 1e-9
        done = update_axis(x[2], P[2], e, -1.0, 0.0, 1.0, variance, age)
        _correct_past(2, t, back, done[0], done[1], r, c)
    else:
        return
    f[F_BARO] = t

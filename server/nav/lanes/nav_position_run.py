"""The kernels of `nav_position` over a block of steps: predict, take what arrived, publish one row per step."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import BARO, DEAD_RECKONING, FAILED, FUSED, GNSS, NAVIGATING
from server.nav.earth import curvature_radii
from server.nav.ekf.layout import M_DATA, M_KIND, M_STATUS, M_STEP, NEVER_NS, U_DT, U_DTHETA, U_DVEL, U_GAP_S, U_T
from server.nav.kernel import kernel
from server.nav.lanes.axis_filter import ERR, POS, VEL, N, predict_axis, turn_error
from server.nav.lanes.nav_position_fuse import fuse_baro, fuse_gnss, remember
from server.nav.lanes.nav_position_layout import (
    F_ACCEL,
    F_BARO,
    F_BARO_REFUSED,
    F_GNSS_REFUSED,
    F_GRAVITY,
    F_INTERVAL,
    F_RUN,
    F_SITE,
    F_T_GNSS,
    G_ACCEL,
    G_DRIFT,
    G_ERROR,
    G_ERROR_DOWN,
    G_ERROR_TAU,
    G_GNSS_DELAY,
    G_IMU_DELAY,
)
from server.nav.lanes.vertical import GAP_RESTART_S, attitude_at_start
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int

DOWN_TAU_S: Final = 100.0  # the vertical acceleration error is a bias, not a tilt
OUTAGE_S: Final = 1.0  # as `ekf.run`
OUTAGE_INTERVALS: Final = 2.5


@kernel("void(float64[::1], float64[::1], float64[:, ::1], float64[:, :, ::1], float64[::1], float64[::1])")
def _predict(u: Float, att: Float, x: Float, P: Float, f: Float, par: Float) -> None:
    """Turn the step's velocity increment into NED and carry the three axes over it."""
    q = attitude_at_start(u, att, par[G_IMU_DELAY])
    R = matrix_entries(q[0], q[1], q[2], q[3])
    dt = u[U_DT]
    turn = 0.0
    for j in range(3):
        turn += R[6 + j] * (u[U_DTHETA + j] - att[19 + j] * dt)
    turn_error(x, P, turn)
    for i in range(3):
        a = (R[3 * i] * u[U_DVEL] + R[3 * i + 1] * u[U_DVEL + 1] + R[3 * i + 2] * u[U_DVEL + 2]) / dt
        if i == 2:
            predict_axis(x[i], P[i], a + f[F_GRAVITY], dt, par[G_ACCEL], par[G_ERROR_DOWN], DOWN_TAU_S, par[G_DRIFT])
            f[F_ACCEL + i] = a + f[F_GRAVITY] - x[i, ERR]
        else:
            predict_axis(x[i], P[i], a, dt, par[G_ACCEL], par[G_ERROR], par[G_ERROR_TAU], 0.0)
            f[F_ACCEL + i] = a - x[i, ERR]


@kernel("boolean(float64[:, ::1], float64[:, :, ::1])")
def _sane(x: Float, P: Float) -> bool:
    ok = True
    for i in range(3):
        for j in range(N):
            ok = ok and math.isfinite(x[i, j]) and P[i, j, j] >= 0.0 and math.isfinite(P[i, j, j])
    return ok


@kernel(
    "void(float64[::1], float64[::1], float64[:, ::1], float64[:, :, ::1], float64[::1], float64[::1], float64[::1])"
)
def _publish(u: Float, att: Float, x: Float, P: Float, f: Float, par: Float, out: Float) -> None:
    """Write one row: attitude as given, position and velocity carried on from the IMU's delay to the step's stamp."""
    for i in range(out.shape[0]):
        out[i] = math.nan
    for i in range(4):
        out[i] = att[i]
    for i in range(3):
        out[10 + i], out[19 + i] = att[10 + i], att[19 + i]
    out[25], out[29] = att[25], 0.0
    if f[F_RUN] == 0.0:
        return
    age = (u[U_T] - f[F_T_GNSS]) * 1e-9
    lost = age > max(OUTAGE_S, OUTAGE_INTERVALS * f[F_INTERVAL]) + par[G_GNSS_DELAY]
    out[25], out[29] = DEAD_RECKONING if lost else NAVIGATING, max(0.0, age) if lost else 0.0
    d = par[G_IMU_DELAY]
    for i in range(3):
        out[4 + i] = x[i, VEL] + d * f[F_ACCEL + i]
        out[26 + i] = x[i, POS] + d * x[i, VEL] + 0.5 * d * d * f[F_ACCEL + i]
        out[13 + i], out[16 + i] = math.sqrt(P[i, VEL, VEL]), math.sqrt(P[i, POS, POS])
    lat0, height = f[F_SITE], f[F_SITE + 2] - out[28]
    lat = lat0
    for _ in range(3):  # inverse of `earth.ned_from_lla`, whose radii belong to the mean latitude
        radii = curvature_radii(0.5 * (lat + lat0))
        lat = lat0 + out[26] / (radii[0] + 0.5 * (height + f[F_SITE + 2]))
    east = (radii[1] + 0.5 * (height + f[F_SITE + 2])) * math.cos(0.5 * (lat + lat0))
    out[7], out[8], out[9] = math.degrees(lat), math.degrees(f[F_SITE + 1] + out[27] / east), height
    out[8] = (out[8] + 180.0) % 360.0 - 180.0


@kernel("void(float64[:, ::1], float64[:, :, ::1], float64[::1], int64[::1])")
def _forget(x: Float, P: Float, f: Float, c: Int) -> None:
    """Start again from nothing, the site apart."""
    x[:] = 0.0
    P[:] = 0.0
    f[F_RUN] = f[F_ACCEL] = f[F_ACCEL + 1] = f[F_ACCEL + 2] = 0.0
    f[F_GNSS_REFUSED] = f[F_BARO_REFUSED] = 0.0
    f[F_T_GNSS] = f[F_BARO] = NEVER_NS
    f[F_INTERVAL] = 1.0
    c[0] = c[1] = 0


@kernel(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, :, ::1], float64[::1],"
    " float64[::1], float64[:, ::1], int64[::1], float64[::1], float64[:, ::1])"
)
def run_position(
    steps: Float,
    meas: Float,
    att: Float,
    x: Float,
    P: Float,
    f: Float,
    par: Float,
    r: Float,
    c: Int,
    w: Float,
    out: Float,
) -> None:
    """Advance over a block of steps.

    Args:
        steps: shape (n, U_SIZE). meas: shape (k, M_SIZE), M_STEP ascending.
        att: shape (n, len(LANE_COLUMNS)), the attitude lane's rows.
        x, P, f, par, r, c: state, covariance, memory, parameters and past.
        w: shape (9,), scratch.
        out: shape (n, len(LANE_COLUMNS)), written.
    """
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        broken = att[n, 25] == FAILED or not math.isfinite(u[U_T] + u[U_DT] + u[U_DVEL] + u[U_DVEL + 1] + u[U_DVEL + 2])
        level = not broken and u[U_DT] > 0.0 and math.isfinite(att[n, 0] + att[n, 1] + att[n, 2] + att[n, 3])
        if not level or u[U_GAP_S] > GAP_RESTART_S:
            _forget(x, P, f, c)
        if level:
            if f[F_RUN] == 1.0:
                _predict(u, att[n], x, P, f, par)
            remember(u, att[n], x, f, par, r, c)
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            m = meas[k]
            k += 1
            if not level or m[M_STATUS] != FUSED:
                continue
            if m[M_KIND] == GNSS:
                fuse_gnss(m, u[U_T] - par[G_IMU_DELAY] * 1e9, x, P, f, par, w, r, c)
            elif m[M_KIND] == BARO and math.isfinite(m[M_DATA + 1]):
                fuse_baro(m, x, P, f, par, r, c)
        if broken or not _sane(x, P):
            _forget(x, P, f, c)
            for i in range(out.shape[1]):
                out[n, i] = math.nan
            out[n, 25], out[n, 29] = FAILED, 0.0
            continue
        _publish(u, att[n], x, P, f, par, out[n])

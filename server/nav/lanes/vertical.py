"""What the lanes that only know the height share: their memory, the baro zero, a short past, the row that leaves them.

Everything is down-positive (NED). Heights are relative to the zero, the mean baro height at the start [S3 summary 1:
the barometer tells an absolute height, so the one at the start is recorded].
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import ALIGNING, BARO, DEAD_RECKONING, FAILED, FUSED, NAVIGATING
from server.nav.ekf.layout import (
    M_DATA,
    M_KIND,
    M_STATUS,
    M_T,
    NEVER_NS,
    U_DT,
    U_DTHETA,
    U_DVEL,
    U_GAP_S,
    U_GYRO,
    U_T,
)
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float, Int

# Memory of one lane.
V_RUN: Final = 0  # 1 = height and speed are valid
V_D: Final = 1  # m down from the zero
V_V: Final = 2  # m/s down
V_A: Final = 3  # m/s² down, gravity and bias removed, over the last step
V_T_BARO: Final = 4  # validity of the last baro height used, ns
V_ZERO: Final = 5  # baro height of the zero, m
V_ZERO_SUM: Final = 6
V_ZERO_N: Final = 7
V_T_ZERO: Final = 8  # first sample of the zero, ns
V_HAS_ZERO: Final = 9
V_SITE: Final = 10  # height of the site, m; NaN unknown
V_G: Final = 11  # gravity, m/s²
V_OWN: Final = 12  # the lane's own numbers from here on
V_SIZE: Final = 40

# Parameters.
P_IMU_DELAY: Final = 0  # s
P_BARO_DELAY: Final = 1  # s
P_ZERO_SAMPLES: Final = 2
P_ZERO_S: Final = 3
P_OWN: Final = 4  # the lane's own from here on
P_SIZE: Final = 16

# The past: one row a step, and [rows pushed, rows valid].
R_T: Final = 0  # validity, ns
R_D: Final = 1
R_V: Final = 2
R_SIZE: Final = 3

GAP_RESTART_S: Final = 1.0
"""Past this hole in the IMU data speed is unknown: start again from the next baro height."""
BARO_LOST_S: Final = 2.0
"""Without baro for this long the height is dead reckoning."""
BACK_S: Final = 0.25
"""A baro height this much older than all that is remembered is still compared, by the speed then."""

COMPUTING: Final = 1
WAITING: Final = 0
BROKEN: Final = -1


@kernel("UniTuple(float64, 4)(float64[::1], float64[::1], float64)")
def attitude_at_end(u: Float, att: Float, delay_s: float) -> tuple[float, float, float, float]:
    """Return q_nb at the end of the step as the IMU saw it, from the attitude published at its stamp.

    Args:
        u: the navigation step.
        att: attitude lane's row, carried on by the IMU's delay to the step's stamp; with its gyro bias.
        delay_s: that delay.
    """
    d = delay_s
    back = quat_from_rotvec(
        d * (att[19] - u[U_GYRO]), d * (att[20] - u[U_GYRO + 1]), d * (att[21] - u[U_GYRO + 2])
    )  # fmt: skip
    return quat_mul(att[0], att[1], att[2], att[3], back[0], back[1], back[2], back[3])


@kernel("UniTuple(float64, 4)(float64[::1], float64[::1], float64)")
def attitude_at_start(u: Float, att: Float, delay_s: float) -> tuple[float, float, float, float]:
    """Return q_nb at the start of the step as the IMU saw it; arguments as `attitude_at_end`."""
    q = attitude_at_end(u, att, delay_s)
    dt = u[U_DT]
    turn = quat_from_rotvec(
        att[19] * dt - u[U_DTHETA], att[20] * dt - u[U_DTHETA + 1], att[21] * dt - u[U_DTHETA + 2]
    )  # fmt: skip
    return quat_mul(q[0], q[1], q[2], q[3], turn[0], turn[1], turn[2], turn[3])


@kernel("UniTuple(float64, 3)(float64[::1], float64[::1], float64)")
def down_axis(u: Float, att: Float, delay_s: float) -> tuple[float, float, float]:
    """Return the body components of NED down at the start of the step: the last row of R_nb."""
    q = attitude_at_start(u, att, delay_s)
    R = matrix_entries(q[0], q[1], q[2], q[3])
    return R[6], R[7], R[8]


@kernel("int64(float64[::1], float64[::1], float64[::1], int64[::1])")
def begin_step(u: Float, att: Float, s: Float, c: Int) -> int:
    """Return COMPUTING, WAITING (no attitude, zero or baro height yet) or BROKEN (numbers that are none).

    A hole in the IMU data or a lost attitude ends the computing; the zero and what was learned of the sensors stay.
    """
    if att[25] == FAILED or not math.isfinite(u[U_T] + u[U_DT] + u[U_DVEL] + u[U_DVEL + 1] + u[U_DVEL + 2]):
        return BROKEN
    known = math.isfinite(att[0] + att[1] + att[2] + att[3])
    if u[U_GAP_S] > GAP_RESTART_S or u[U_DT] <= 0.0 or not known:
        s[V_RUN] = 0.0
        c[1] = 0
        return WAITING
    return COMPUTING if s[V_RUN] == 1.0 else WAITING


@kernel("void(float64[::1], int64[::1])")
def forget(s: Float, c: Int) -> None:
    """Start again from nothing, the site apart: no number of the failed state may reach the next one."""
    for i in range(V_SIZE):
        if i != V_SITE and i != V_G:
            s[i] = 0.0
    s[V_T_BARO] = s[V_T_ZERO] = NEVER_NS
    c[0] = c[1] = 0


@kernel("boolean(float64[::1])")
def is_baro(m: Float) -> bool:
    """Return whether a measurement is a baro height to be used."""
    return bool(m[M_KIND] == BARO and m[M_STATUS] == FUSED and math.isfinite(m[M_DATA + 1]))


@kernel("boolean(float64, float64, boolean, float64[::1], float64[::1])")
def starts(height_m: float, t_ns: float, level: bool, s: Float, par: Float) -> bool:
    """Take a baro height while the lane does not compute; return whether it does from here on.

    The zero is the mean of the first samples, by count or by time, whichever is reached first; S3's 200 samples would
    take 20 s at the 10 Hz of many boards.
    """
    if not s[V_HAS_ZERO]:
        if s[V_ZERO_N] == 0.0:
            s[V_T_ZERO] = t_ns
        s[V_ZERO_SUM] += height_m
        s[V_ZERO_N] += 1.0
        if s[V_ZERO_N] < par[P_ZERO_SAMPLES] and (t_ns - s[V_T_ZERO]) * 1e-9 < par[P_ZERO_S]:
            return False
        s[V_ZERO], s[V_HAS_ZERO] = s[V_ZERO_SUM] / s[V_ZERO_N], 1.0
        height_m = s[V_ZERO]
    if not level:
        return False
    s[V_RUN], s[V_D], s[V_V], s[V_A], s[V_T_BARO] = 1.0, s[V_ZERO] - height_m, 0.0, 0.0, t_ns
    return True


@kernel("void(float64, float64[::1], float64[:, ::1], int64[::1])")
def remember(t_ns: float, s: Float, r: Float, c: Int) -> None:
    """Append the present height and speed to the past."""
    row = r[c[0] % r.shape[0]]
    row[R_T], row[R_D], row[R_V] = t_ns, s[V_D], s[V_V]
    c[0] += 1
    c[1] = min(c[1] + 1, r.shape[0])


@kernel("int64(float64, float64[:, ::1], int64[::1])")
def slot_at(t_ns: float, r: Float, c: Int) -> int:
    """Return how many rows back the newest one not after t_ns lies (1 = the newest); 0 when it is out of memory."""
    for back in range(1, c[1] + 1):
        if r[(c[0] - back) % r.shape[0], R_T] <= t_ns:
            return back
    if c[1] > 0 and r[(c[0] - c[1]) % r.shape[0], R_T] - t_ns < BACK_S * 1e9:
        return int(c[1])
    return 0


@kernel("float64(float64, int64, float64[:, ::1], int64[::1])")
def down_at(t_ns: float, back: int, r: Float, c: Int) -> float:
    """Return the height at t_ns, m down, from the row `back` rows ago."""
    row = r[(c[0] - back) % r.shape[0]]
    return float(row[R_D] + row[R_V] * (t_ns - row[R_T]) * 1e-9)


@kernel("void(float64, int64, float64, float64, float64[:, ::1], int64[::1])")
def correct_past(t_ns: float, back: int, d_m: float, v_m_s: float, r: Float, c: Int) -> None:
    """Add what a correction at t_ns makes of every remembered height and speed since."""
    for i in range(1, back + 1):
        row = r[(c[0] - i) % r.shape[0]]
        row[R_D] += d_m + v_m_s * (row[R_T] - t_ns) * 1e-9
        row[R_V] += v_m_s


@kernel("boolean(float64[::1], int64)")
def sane(s: Float, n: int) -> bool:
    """Return whether the first n numbers of the memory, the site's apart, are finite."""
    for i in range(n):
        if i != V_SITE and not math.isfinite(s[i]):
            return False
    return True


@kernel("void(int64, float64[::1])")
def empty_row(status: int, out: Float) -> None:
    """Write a row that knows nothing but its status."""
    for i in range(out.shape[0]):
        out[i] = math.nan
    out[25], out[29] = status, 0.0


@kernel("void(float64, float64[::1], float64[::1], float64[::1])")
def altitude_row(t_ns: float, s: Float, par: Float, out: Float) -> None:
    """Write one row of LANE_COLUMNS: height and speed carried on from the IMU's own delay to the step's stamp."""
    if s[V_RUN] == 0.0:
        empty_row(ALIGNING, out)
        return
    age_s = max(0.0, (t_ns - s[V_T_BARO]) * 1e-9)
    lost = age_s > BARO_LOST_S + par[P_BARO_DELAY]
    empty_row(DEAD_RECKONING if lost else NAVIGATING, out)
    d = par[P_IMU_DELAY]
    out[6] = s[V_V] + d * s[V_A]
    out[28] = s[V_D] + d * s[V_V] + 0.5 * d * d * s[V_A]
    out[9] = s[V_SITE] - out[28]
    out[29] = age_s if lost else 0.0


@kernel("float64(float64[::1], float64[::1])")
def baro_time(m: Float, par: Float) -> float:
    """Return a baro height's time of validity, ns."""
    return float(m[M_T] - par[P_BARO_DELAY] * 1e9)

"""Navigation steps as the VQF library takes them, and its answers as rows: body FRD and NED here, FLU and ENU there."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import ATTITUDE, FAILED
from server.nav.ekf.layout import U_DT, U_DTHETA, U_GAP_S, U_GYRO
from server.nav.kernel import kernel
from server.nav.lanes.attitude import (
    GAP_RESTART_S,
    S_FIELD,
    S_SINCE_FIELD,
    blank,
    force_at_end,
    rotate,
    take_field,
    usable,
)
from server.nav.rotation import quat_from_rotvec, quat_mul
from server.nav.types import Float

NO_FIELD: Final = 0.0  # flags of a step: six-axis …
FIELD: Final = 1.0  # … nine-axis …
HOLE: Final = 2.0  # … a hole ended here, the attitude is lost …
BAD: Final = 3.0  # … its numbers are not usable
OLDEST_HELD_S: Final = 1.0  # a field older than this is no longer held
ROOT: Final = math.sqrt(0.5)


@kernel(
    "void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], float64[:, ::1], float64[:, ::1],"
    " float64[:, ::1], float64[::1])"
)
def prepare(
    steps: Float, meas: Float, par: Float, s: Float, turn: Float, force: Float, field: Float, flag: Float
) -> None:
    """Write what the library takes of each step, body forward, left, up, and what the step is good for (`flag`).

    Args:
        steps: shape (n, U_SIZE). meas: shape (k, M_SIZE).
        par: the delays. s: shape (S_OWN,), memory.
        turn: shape (n, 3), rotation vector over the step, rad.
        force: shape (n, 3), mean specific force at the step's end, m/s².
        field: shape (n, 3), held magnetic field at the step's end, gauss.
        flag: shape (n,).
    """
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        if not usable(u) or u[U_GAP_S] > GAP_RESTART_S:
            flag[n] = HOLE if usable(u) else BAD
            s[S_SINCE_FIELD] = 2.0 * OLDEST_HELD_S
            for i in range(3):
                turn[n, i] = force[n, i] = field[n, i] = 0.0
            continue
        f = force_at_end(u)
        back = quat_from_rotvec(-u[U_DTHETA], -u[U_DTHETA + 1], -u[U_DTHETA + 2])
        held = rotate(back[0], back[1], back[2], back[3], s[S_FIELD], s[S_FIELD + 1], s[S_FIELD + 2])
        s[S_FIELD], s[S_FIELD + 1], s[S_FIELD + 2] = held
        k, count = take_field(meas, k, n, u, par, s)
        s[S_SINCE_FIELD] = 0.0 if count else s[S_SINCE_FIELD] + u[U_DT]
        flag[n] = FIELD if s[S_SINCE_FIELD] <= OLDEST_HELD_S else NO_FIELD
        for i in range(3):
            sign = 1.0 if i == 0 else -1.0
            turn[n, i], force[n, i], field[n, i] = sign * u[U_DTHETA + i], sign * f[i], sign * s[S_FIELD + i]


@kernel("void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64, float64, float64[:, ::1])")
def publish_all(steps: Float, q: Float, bias: Float, delay_s: float, turn_rad: float, rows: Float) -> None:
    """Write rows from the library's quaternions (FLU to ENU) and biases, carried on over the IMU's delay.

    Args:
        steps: shape (n, U_SIZE).
        q: shape (n, 4). bias: shape (n, 3), body forward, left, up, rad/s.
        delay_s: the IMU's.
        turn_rad: added to the heading.
        rows: shape (n, len(LANE_COLUMNS)), written.
    """
    z = quat_from_rotvec(0.0, 0.0, turn_rad)
    ned = quat_mul(z[0], z[1], z[2], z[3], 0.0, ROOT, ROOT, 0.0)
    for n in range(steps.shape[0]):
        u, out = steps[n], rows[n]
        blank(out, ATTITUDE)
        out[19], out[20], out[21] = bias[n, 0], -bias[n, 1], -bias[n, 2]
        e = quat_mul(ned[0], ned[1], ned[2], ned[3], q[n, 0], q[n, 1], q[n, 2], q[n, 3])
        b = quat_mul(e[0], e[1], e[2], e[3], 0.0, 1.0, 0.0, 0.0)
        t = quat_from_rotvec(
            delay_s * (u[U_GYRO] - out[19]), delay_s * (u[U_GYRO + 1] - out[20]), delay_s * (u[U_GYRO + 2] - out[21])
        )
        v = quat_mul(b[0], b[1], b[2], b[3], t[0], t[1], t[2], t[3])
        sign = -1.0 if v[0] < 0.0 else 1.0
        for i in range(4):
            out[i] = sign * v[i]
        if not math.isfinite(v[0] + v[1] + v[2] + v[3]):
            blank(out, FAILED)

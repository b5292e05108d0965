"""The magnetometer's learning over navigation steps and samples: rotation, blocks, holes; compiled, cut anywhere."""

from __future__ import annotations

import math
from typing import Final

from server.nav.calibration.learning_block import TURN_RAD, close_block, turned_since
from server.nav.calibration.learning_filter import widen
from server.nav.calibration.learning_layout import (
    C_A_Q,
    C_B_DT,
    C_B_N,
    C_B_PATH,
    C_B_R,
    C_B_RM,
    C_B_SIZE,
    C_B_TURN,
    C_B_W,
    C_B_Z,
    C_B_Z2,
    C_HEAD,
    C_P,
    C_P_N,
    C_PATCH2,
    C_Q,
    C_RING,
    C_STARTED,
    C_T,
    C_W,
    C_WHITE2,
    DELAY,
    F_P,
    F_X,
    FIELD,
    GYRO,
    K_DELAY,
    K_DELAY_SIGMA,
    K_GYRO_SIGMA,
    K_NOISE,
    NEVER_NS,
    OFFSET,
    RING,
    RING_COLUMNS,
    N,
)
from server.nav.calibration.learning_strength import reading
from server.nav.codes import FUSED, MAG, REFUSED_DISTURBED
from server.nav.ekf.layout import M_DATA, M_KIND, M_STATUS, M_STEP, M_T, U_DT, U_DTHETA, U_GAP_S, U_T
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float

BLOCK_S: Final = 0.05  # least length of a block: what a step costs stays small in a fast roll
LONGEST_S: Final = 0.5
GAP_S: Final = 0.2  # a hole through which the rotation is lost
LARGEST_GAUSS: Final = 16.0  # full scale of common magnetometers
SAME: Final = 2.5  # standard deviations
STILL_RAD_S: Final = 0.02  # 1.1 °/s: below it a turn is not told from a drift of the gyro bias


@kernel("void(float64[::1], float64[::1])")
def _turn(u: Float, c: Float) -> None:
    """Advance the rotation by one step and add it to the open block."""
    dt, path2 = u[U_DT], 0.0
    v = (u[U_DTHETA], u[U_DTHETA + 1], u[U_DTHETA + 2])
    half = quat_from_rotvec(0.5 * v[0], 0.5 * v[1], 0.5 * v[2])
    mid = quat_mul(c[C_Q], c[C_Q + 1], c[C_Q + 2], c[C_Q + 3], half[0], half[1], half[2], half[3])
    end = quat_mul(mid[0], mid[1], mid[2], mid[3], half[0], half[1], half[2], half[3])
    R = matrix_entries(mid[0], mid[1], mid[2], mid[3])
    for i in range(9):
        c[C_B_R + i] += R[i] * dt
    for i in range(3):
        c[C_B_TURN + i] += v[i]
        c[C_W + i] = v[i] / dt
        path2 += v[i] * v[i]
    c[C_B_PATH] += math.sqrt(path2)
    c[C_B_DT] += dt
    shrink = 1.5 - 0.5 * (end[0] ** 2 + end[1] ** 2 + end[2] ** 2 + end[3] ** 2)
    for i in range(4):
        c[C_Q + i] = end[i] * shrink
    c[C_T] = u[U_T]


@kernel("void(float64[::1])")
def _remember(c: Float) -> None:
    """Keep when the board was turned how, for samples that are older than the step they came with."""
    c[C_HEAD] = (c[C_HEAD] + 1.0) % RING
    slot = C_RING + RING_COLUMNS * int(c[C_HEAD])
    c[slot] = c[C_T]
    for i in range(4):
        c[slot + 1 + i] = c[C_Q + i]


@kernel("boolean(float64[::1], float64[::1], float64)")
def _take(m: Float, c: Float, t_ns: float) -> bool:
    """Add a sample, valid at t, to the open block with the rotation of its own time; False: too old for that."""
    head = int(c[C_HEAD])
    slot = C_RING + RING_COLUMNS * head
    for back in range(RING):
        slot = C_RING + RING_COLUMNS * ((head - back) % RING)
        if c[slot] <= t_ns or c[slot] == NEVER_NS:
            break
    if not c[slot] <= t_ns or c[slot] == NEVER_NS:
        return False
    after = C_RING + RING_COLUMNS * (((slot - C_RING) // RING_COLUMNS + 1) % RING)
    q = (c[slot + 1], c[slot + 2], c[slot + 3], c[slot + 4])
    ahead = min((t_ns - c[slot]) * 1e-9, 0.02)
    w = (c[C_W], c[C_W + 1], c[C_W + 2])
    if slot != C_RING + RING_COLUMNS * head:  # between two steps: the mean of both, weighted, is exact for small turns
        share = (t_ns - c[slot]) / (c[after] - c[slot])
        p0, p1 = q[0] + share * (c[after + 1] - q[0]), q[1] + share * (c[after + 2] - q[1])
        p2, p3 = q[2] + share * (c[after + 3] - q[2]), q[3] + share * (c[after + 4] - q[3])
        size = 1.0 / math.sqrt(p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
        q = (p0 * size, p1 * size, p2 * size, p3 * size)
    elif ahead > 0.0:
        turn = quat_from_rotvec(w[0] * ahead, w[1] * ahead, w[2] * ahead)
        q = quat_mul(q[0], q[1], q[2], q[3], turn[0], turn[1], turn[2], turn[3])
    R = matrix_entries(q[0], q[1], q[2], q[3])
    for i in range(3):
        c[C_B_Z + i] += R[3 * i] * m[0] + R[3 * i + 1] * m[1] + R[3 * i + 2] * m[2]
        c[C_B_W + i] += R[3 * i] * w[0] + R[3 * i + 1] * w[1] + R[3 * i + 2] * w[2]
    for i in range(9):
        c[C_B_RM + i] += R[i]
    c[C_B_Z2] += m[0] * m[0] + m[1] * m[1] + m[2] * m[2]
    c[C_B_N] += 1.0
    return True


@kernel("void(float64[:, ::1], float64[::1], float64[::1])")
def _start(s: Float, c: Float, par: Float) -> None:
    """Take the field from the first samples and the offset that is held; the frame is the body's of now."""
    n = c[C_B_N]
    for i in range(3):
        s[0, F_X + FIELD + i] = c[C_B_Z + i] / n
        s[0, F_P + (N + 1) * (GYRO + i)] = par[K_GYRO_SIGMA] ** 2
        for j in range(3):
            r = c[C_B_RM + 3 * i + j] / n
            s[0, F_X + FIELD + i] -= r * s[0, F_X + OFFSET + j]
            at = F_P + N * (FIELD + i) + OFFSET + j
            s[0, at] = -r * s[0, F_P + (N + 1) * (OFFSET + j)]
            s[0, F_P + N * (OFFSET + j) + FIELD + i] = s[0, at]
    for i in range(3):
        for j in range(3):
            cov = (par[K_NOISE] ** 2 / n + c[C_PATCH2]) if i == j else 0.0
            for k in range(3):
                r = c[C_B_RM + 3 * i + k] / n * c[C_B_RM + 3 * j + k] / n
                cov += r * s[0, F_P + (N + 1) * (OFFSET + k)]
            s[0, F_P + N * (FIELD + i) + FIELD + j] = cov
    s[0, F_P + (N + 1) * DELAY] = par[K_DELAY_SIGMA] ** 2
    c[C_STARTED] = 1.0
    for i in range(4):
        c[C_A_Q + i] = c[C_Q + i]
    for i in range(C_B_SIZE):
        c[C_B_DT + i] = 0.0


@kernel("void(float64[:, ::1], float64[::1])")
def _lost(s: Float, c: Float) -> None:
    """A hole ended: how the board turned in it is not known, so the field lies anywhere; its offset stays."""
    for h in range(2):
        f2 = s[h, F_X + FIELD] ** 2 + s[h, F_X + FIELD + 1] ** 2 + s[h, F_X + FIELD + 2] ** 2
        widen(s[h], FIELD, 4.0 * f2)
    for i in range(C_B_SIZE):
        c[C_B_DT + i] = 0.0
    for i in range(RING):
        c[C_RING + RING_COLUMNS * i] = NEVER_NS


@kernel("boolean(float64[::1])")
def _same_field(c: Float) -> bool:
    """True when the field in the body is as in the block before; keep it for the next."""
    n, p = c[C_B_N], reading(c)
    before = c[C_P_N]
    limit = SAME * math.sqrt(3.0 * c[C_WHITE2] * (1.0 / n + 1.0 / max(before, 1.0)))
    limit += STILL_RAD_S * c[C_B_DT] * math.sqrt(p[3])
    change2 = (p[0] - c[C_P]) ** 2 + (p[1] - c[C_P + 1]) ** 2 + (p[2] - c[C_P + 2]) ** 2
    c[C_P], c[C_P + 1], c[C_P + 2], c[C_P_N] = p[0], p[1], p[2], n
    return bool(before == 0.0 or change2 < limit * limit)


@kernel("boolean(float64[::1], float64[:, ::1])")
def _still(c: Float, s: Float) -> bool:
    """True when the block did not turn.

    By less than a slow drift once the gyro bias is taken off; by as much as the bias may still be, when the field says
    so too.
    """
    same = _same_field(c) if c[C_B_N] > 0.0 else True
    rate2 = doubt2 = 0.0
    for i in range(3):
        rate2 += (c[C_B_TURN + i] / c[C_B_DT] - s[0, F_X + GYRO + i]) ** 2
        doubt2 = max(doubt2, s[0, F_P + (N + 1) * (GYRO + i)])
    rate = math.sqrt(rate2)
    return bool(rate < STILL_RAD_S or (same and rate < STILL_RAD_S + 2.0 * math.sqrt(doubt2)))


@kernel("void(float64[:, ::1], float64[:, ::1], float64[::1], float64[:, ::1], float64[::1])")
def run(steps: Float, meas: Float, par: Float, s: Float, c: Float) -> None:
    """Advance over navigation steps and the measurements that arrived with them.

    Args:
        steps: shape (n, U_SIZE), columns of `ekf.layout`. meas: shape (k, M_SIZE), M_STEP ascending in [0, n).
        par: shape (K_SIZE,). s: shape (2, F_SIZE). c: shape (C_SIZE,). All of `learning_layout`.
    """
    k = 0
    for n in range(steps.shape[0]):
        u = steps[n]
        if not (u[U_DT] > 0.0 and math.isfinite(u[U_DTHETA] + u[U_DTHETA + 1] + u[U_DTHETA + 2])):
            continue
        if u[U_GAP_S] > GAP_S:
            _lost(s, c)
        _turn(u, c)
        _remember(c)
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            m, status = meas[k, M_DATA:], meas[k, M_STATUS]
            size = abs(m[0]) + abs(m[1]) + abs(m[2])
            used = meas[k, M_KIND] == MAG and status in (FUSED, REFUSED_DISTURBED)
            if used and 0.0 < size < LARGEST_GAUSS:
                _take(m, c, meas[k, M_T] - par[K_DELAY] * 1e9)
            k += 1
        if c[C_B_DT] < BLOCK_S - 1e-9:
            continue
        if c[C_STARTED] == 0.0:
            if c[C_B_N] > 0.0:
                _start(s, c, par)
        elif c[C_B_DT] >= LONGEST_S - 1e-9 or (c[C_B_N] > 0.0 and turned_since(c)[0] >= TURN_RAD):
            close_block(s, c, par, _still(c, s))

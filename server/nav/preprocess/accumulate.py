"""Samples in order of arrival → navigation steps and checked measurements, compiled, cut anywhere.

The IMU is averaged into steps by time, not by count (S0 eq. 3.2 does it by count): between two samples rate and
specific force are taken as linear (trapezoid), the rotation is composed sample by sample, and each velocity
increment is rotated into the frame at the start of the step, which keeps coning and sculling [Savage 1998, part 1 §3
and part 2 §3, evaluated directly instead of by correction terms].
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.codes import AIRSPEED, DMP, IMU, MAG
from server.nav.ekf.layout import (
    M_DATA,
    M_STEP,
    U_ACCEL,
    U_ACCEL_MEAN,
    U_COUNT,
    U_DT,
    U_DTHETA,
    U_DVEL,
    U_GAP_S,
    U_GYRO,
    U_GYRO_MEAN,
    U_T,
    U_TEMPERATURE,
    U_VIBRATION,
)
from server.nav.kernel import kernel
from server.nav.preprocess.chain_layout import (
    ACCEL,
    B_FULL_SCALE,
    G_USED,
    GYRO,
    K_CHANGED,
    K_CLIP_ACCEL,
    K_CLIP_GYRO,
    K_ON,
    K_ROW,
    K_SIZE,
    block_at,
)
from server.nav.preprocess.chain_run import chain_imu, own_copy
from server.nav.preprocess.check import check_imu, count_clipped
from server.nav.preprocess.memory import (
    N_GAPS,
    NEVER_NS,
    S_ACCEL,
    S_ACCEL_SUM,
    S_CELL,
    S_COUNT,
    S_DVEL,
    S_GAP,
    S_GYRO,
    S_GYRO_SUM,
    S_Q,
    S_RATE,
    S_RAW,
    S_SLOW,
    S_T_GAP,
    S_T_KIND,
    S_T_LAST,
    S_T_START,
    S_TEMPERATURE,
    S_VIBRATION2,
)
from server.nav.preprocess.take_aid import take_aid
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul, rotvec_from_quat
from server.nav.types import ROW_WIDTH, Byte, Float, Int

GYRO_BLOCK: Final = block_at(GYRO)
ACCEL_BLOCK: Final = block_at(ACCEL)
BRIDGE_S: Final = 0.1
"""A hole between IMU samples longer than this is reported; the step that holds it carries its length."""
VIBRATION_CUTOFF_RAD_S: Final = 2.0 * math.pi * 5.0  # autopilots high-pass the vibration measure at 5 Hz


@kernel("void(float64[::1], float64, float64[::1])")
def _integrate(row: Float, dt: float, s: Float) -> None:
    """Add one sample interval of dt seconds to the open step."""
    gx, gy, gz = 0.5 * (s[S_GYRO] + row[0]), 0.5 * (s[S_GYRO + 1] + row[1]), 0.5 * (s[S_GYRO + 2] + row[2])
    ax, ay, az = 0.5 * (s[S_ACCEL] + row[3]), 0.5 * (s[S_ACCEL + 1] + row[4]), 0.5 * (s[S_ACCEL + 2] + row[5])
    q = (s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3])
    half = quat_from_rotvec(0.5 * dt * gx, 0.5 * dt * gy, 0.5 * dt * gz)
    mid = quat_mul(q[0], q[1], q[2], q[3], half[0], half[1], half[2], half[3])
    R = matrix_entries(mid[0], mid[1], mid[2], mid[3])
    end = quat_mul(mid[0], mid[1], mid[2], mid[3], half[0], half[1], half[2], half[3])
    for i in range(4):
        s[S_Q + i] = end[i]
    s[S_DVEL] += dt * (R[0] * ax + R[1] * ay + R[2] * az)
    s[S_DVEL + 1] += dt * (R[3] * ax + R[4] * ay + R[5] * az)
    s[S_DVEL + 2] += dt * (R[6] * ax + R[7] * ay + R[8] * az)
    blend = min(1.0, VIBRATION_CUTOFF_RAD_S * dt)
    high2 = 0.0
    for i in range(3):
        s[S_SLOW + i] += blend * (row[3 + i] - s[S_SLOW + i])
        high2 += (row[3 + i] - s[S_SLOW + i]) ** 2
    s[S_VIBRATION2] += min(1.0, dt) * (high2 - s[S_VIBRATION2])  # mean over about a second


@kernel("void(float64, float64[::1], float64[::1])")
def _close_step(t: float, s: Float, out: Float) -> None:
    """Write the open step as one row and open the next one at t."""
    dt = (t - s[S_T_START]) * 1e-9
    w = rotvec_from_quat(s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3])
    out[U_T], out[U_DT], out[U_COUNT] = t, dt, s[S_COUNT]
    for i in range(3):
        out[U_DTHETA + i] = w[i]
        out[U_DVEL + i] = s[S_DVEL + i]
        out[U_GYRO + i] = s[S_GYRO + i]
        out[U_ACCEL + i] = s[S_ACCEL + i]
        out[U_GYRO_MEAN + i] = s[S_GYRO_SUM + i] / s[S_COUNT]
        out[U_ACCEL_MEAN + i] = s[S_ACCEL_SUM + i] / s[S_COUNT]
        s[S_DVEL + i] = s[S_GYRO_SUM + i] = s[S_ACCEL_SUM + i] = 0.0
    out[U_VIBRATION] = math.sqrt(max(0.0, s[S_VIBRATION2]))
    out[U_GAP_S], out[U_TEMPERATURE] = s[S_GAP], s[S_TEMPERATURE]
    s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3] = 1.0, 0.0, 0.0, 0.0
    s[S_COUNT] = s[S_GAP] = 0.0
    s[S_T_START] = t


@kernel("void(float64[::1], float64, float64[::1], float64[::1], float64[::1])")
def _through_chain(row: Float, t: float, s: Float, c: Float, stage: Float) -> None:
    """Calibrate and filter a believed IMU sample in place; keep what the board sent for the next one's check."""
    for i in range(6):
        s[S_RAW + i] = row[i]
    chain_imu(c, t, row, stage)
    if stage.shape[0] > 0:
        stage[G_USED] = 1.0


@kernel("boolean(float64[::1], float64, float64, float64[::1], int64[:, ::1], float64[::1])")
def _take_imu(row: Float, t: float, rate_hz: float, s: Float, n: Int, out: Float) -> bool:
    """Add a believed IMU sample; return True when it closed a step into `out`."""
    first = s[S_T_LAST] == NEVER_NS
    if first:
        s[S_T_START] = t
        s[S_CELL] = math.floor(t * 1e-9 * rate_hz + 1e-6)
        for i in range(3):
            s[S_SLOW + i] = row[3 + i]
    else:
        dt = (t - s[S_T_LAST]) * 1e-9
        if dt > BRIDGE_S:
            n[IMU, N_GAPS] += 1
            s[S_GAP], s[S_T_GAP] = max(s[S_GAP], dt), t
        _integrate(row, dt, s)
    for i in range(3):
        s[S_GYRO + i], s[S_ACCEL + i] = row[i], row[3 + i]
        if not first:
            s[S_GYRO_SUM + i] += row[i]
            s[S_ACCEL_SUM + i] += row[3 + i]
    s[S_COUNT] += 0.0 if first else 1.0
    s[S_T_LAST], s[S_TEMPERATURE] = t, row[6]
    cell = math.floor(t * 1e-9 * rate_hz + 1e-6)
    if first or cell <= s[S_CELL]:
        return False
    s[S_CELL] = cell
    _close_step(t, s, out)
    return True


@kernel(
    "UniTuple(int64, 3)(uint8[::1], int64[::1], float64[:, ::1], int64, float64, float64[::1], int64[:, ::1],"
    " float64[::1], float64[:, ::1], float64[:, ::1], float64[:, ::1])"
)
def condition(
    kind: Byte,
    t_ns: Int,
    data: Float,
    t0_ns: int,
    rate_hz: float,
    s: Float,
    n: Int,
    c: Float,
    steps: Float,
    meas: Float,
    stages: Float,
) -> tuple[int, int, int]:
    """Consume samples in order; return how many samples were consumed, navigation steps and measurements written.

    It stops early after the sample at which the delay of the IMU's filters changed (c[K_CHANGED]): what follows is for
    lanes that have been told.

    Args:
        kind: shape (n,), values of `Kind`.
        t_ns: shape (n,), board time.
        data: shape (n, ROW_WIDTH).
        t0_ns: board time that all emitted times count from.
        rate_hz: navigation steps a second.
        s: shape (S_SIZE,), memory between calls.
        n: shape (KINDS, N_COUNTERS), counters between calls.
        c: shape (K_SIZE,), the chain, `chain_layout`.
        steps: shape (≥ n, U_SIZE), written.
        meas: shape (≥ n, M_SIZE), written; M_STEP is the index of the step at whose end it is available, counted
            from the first step of this call.
        stages: shape (n, G_SIZE), rows of samples that went through the chain are written; or (1, 0) for none.
    """
    n_steps = n_meas = 0
    on, keep = c[K_ON + GYRO] > 0.0, stages.shape[1] > 0
    last = S_RAW if on else S_GYRO
    gyro_most, accel_most = c[K_CLIP_GYRO], c[K_CLIP_ACCEL]
    for i in range(kind.shape[0]):
        t = float(t_ns[i] - t0_ns)
        if kind[i] == IMU:
            row = data[i]
            if on:
                own_copy(row, c)
                row = c[K_ROW : K_ROW + ROW_WIDTH]
            believed = check_imu(row, t, last, gyro_most, accel_most, s, n)
            if believed == 0:
                continue  # neither its rate nor its age counts
            if believed == 2:
                count_clipped(row, t, c[GYRO_BLOCK + B_FULL_SCALE], c[ACCEL_BLOCK + B_FULL_SCALE], s, n)
            if on:
                _through_chain(row, t, s, c, stages[i if keep else 0])
            if _take_imu(row, t, rate_hz, s, n, steps[n_steps]):
                n_steps += 1
            if s[S_T_KIND + IMU] > NEVER_NS and t > s[S_T_KIND + IMU]:
                interval = (t - s[S_T_KIND + IMU]) * 1e-9
                s[S_RATE + IMU] += (0.01 if s[S_RATE + IMU] > 0.0 else 1.0) * (interval - s[S_RATE + IMU])
            s[S_T_KIND + IMU] = max(t, s[S_T_KIND + IMU])
            if on and c[K_CHANGED] > 0.0:
                return i + 1, n_steps, n_meas
        elif MAG <= kind[i] <= AIRSPEED or kind[i] == DMP:  # the rest is repeated by its lane, not fused
            for j in range(ROW_WIDTH):
                meas[n_meas, M_DATA + j] = data[i, j]
            take_aid(int(kind[i]), t, s, n, c, meas[n_meas], stages[i if keep else 0])
            meas[n_meas, M_STEP] = n_steps
            n_meas += 1
    return kind.shape[0], n_steps, n_meas


NO_STAGES: Final = np.empty((1, 0))


def accumulate(
    kind: Byte, t_ns: Int, data: Float, t0_ns: int, rate_hz: float, s: Float, n: Int, steps: Float, meas: Float
) -> tuple[int, int]:
    """Return how many steps and measurements were written, as `condition` does, without a chain."""
    c = np.zeros(K_SIZE)
    _, n_steps, n_meas = condition(kind, t_ns, data, t0_ns, rate_hz, s, n, c, steps, meas, NO_STAGES)
    return n_steps, n_meas

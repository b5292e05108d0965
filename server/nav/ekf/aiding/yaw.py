"""Heading from the yaw bank: the first one without a magnetometer, or a new one when the present one is far astray."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import ALIGNING, YAW
from server.nav.ekf.align import set_heading
from server.nav.ekf.blocks import switch_mag_on
from server.nav.ekf.events import add_event
from server.nav.ekf.layout import (
    A_T_ASTRAY,
    C_HAS_HEADING,
    C_MODE,
    E_BANK,
    H_ACC,
    H_AID,
    H_DATA,
    H_SIZE,
    H_STATUS,
    H_T,
    NEVER_NS,
    RESET,
    UNDECIDED,
    W_INNOV,
    W_OBS,
    W_VAR,
)
from server.nav.ekf.states import ACCEL_BIAS, ATT, GYRO_BIAS, MAG_BIAS, packed
from server.nav.ekf.update import reset_axis
from server.nav.ekf.yaw_bank import bank_turn
from server.nav.kernel import kernel
from server.nav.types import Float, Int

SURE_RAD: Final = math.radians(10.0)
ASTRAY_RAD: Final = math.radians(25.0)  # a magnetometer beside a motor; less is left to the magnetic bias
ASTRAY_SIGMA: Final = 6.0
ASTRAY_NS: Final = 5e9  # aerobatics upset the bank for seconds (a fixed wing's loops, data set x8)
GYRO_BIAS_AGAIN_RAD_S: Final = 0.01  # a wrong heading has spoiled them
ACCEL_BIAS_AGAIN_M_S2: Final = 0.2


@kernel("boolean(float64, float64[::1], float64[::1], float64[::1], int64[::1], float64[::1], float64[::1])")
def heading_due(t_ns: float, x: Float, P: Float, aux: Float, ctl: Int, bank: Float, h: Float) -> bool:
    """Return whether the bank has a heading to set; the row h says by how much to turn, at the newest step."""
    if ctl[C_MODE] == ALIGNING:
        return False
    angle, sigma = bank_turn(x, bank)
    far = sigma < SURE_RAD and abs(angle) > max(
        ASTRAY_RAD, ASTRAY_SIGMA * math.hypot(sigma, math.sqrt(P[packed(ATT + 2, ATT + 2)]))
    )
    if ctl[C_HAS_HEADING]:
        if not far:
            aux[A_T_ASTRAY] = NEVER_NS
            return False
        if aux[A_T_ASTRAY] == NEVER_NS:
            aux[A_T_ASTRAY] = t_ns
        if t_ns - aux[A_T_ASTRAY] < ASTRAY_NS:
            return False
        aux[A_T_ASTRAY] = NEVER_NS
    elif sigma > SURE_RAD:
        return False
    for i in range(H_SIZE):
        h[i] = 0.0
    h[H_AID], h[H_T], h[H_STATUS] = YAW, t_ns, UNDECIDED
    h[H_DATA], h[H_DATA + 1], h[H_ACC] = angle, 1.0 * ctl[C_HAS_HEADING], sigma
    return True


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1], float64[::1],"
    " float64[:, ::1])"
)
def bank_heading(h: Float, x: Float, P: Float, par: Float, aux: Float, ctl: Int, work: Float, events: Float) -> None:
    """Turn the heading by what the bank found; one that was astray has spoiled the biases as well, and the field."""
    set_heading(x, P, h[H_DATA], h[H_ACC])
    if h[H_DATA + 1] > 0.0:
        for i in range(3):
            reset_axis(P, GYRO_BIAS + i, GYRO_BIAS_AGAIN_RAD_S**2)
            reset_axis(P, ACCEL_BIAS + i, ACCEL_BIAS_AGAIN_M_S2**2)
        if P[packed(MAG_BIAS, MAG_BIAS)] > 0.0:
            switch_mag_on(x, P, par, aux, ctl, work)
    work[W_OBS] = work[W_INNOV] = h[H_DATA]
    work[W_VAR] = h[H_ACC] ** 2
    if h[H_STATUS] == UNDECIDED:
        add_event(events, ctl, E_BANK, h[H_T], h[H_DATA], h[H_ACC])
    h[H_STATUS] = RESET
    ctl[C_HAS_HEADING] = 1

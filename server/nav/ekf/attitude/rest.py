"""Is the board at rest? Then the mean rate is the gyro's bias and the velocity is zero."""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf.attitude.layout import (
    GYRO_BIAS,
    S_B_ACCEL,
    S_B_DT,
    S_B_GYRO,
    S_H,
    S_P,
    S_R_ACCEL,
    S_R_ACCEL_VAR,
    S_R_GYRO,
    S_R_GYRO_VAR,
    S_R_STILL_S,
    S_REST,
    S_X,
    VEL,
    N,
)
from server.nav.ekf.attitude.parameters import K_GYRO_NOISE, K_REST_ACCEL, K_REST_GYRO, K_REST_SPEED, K_REST_TIME
from server.nav.ekf.attitude.update import clear_row, fuse
from server.nav.kernel import kernel
from server.nav.types import Float

BLEND_S: Final = 0.5
LARGEST_BIAS_RAD_S: Final = 0.09  # 5 °/s: larger than a MEMS gyro's bias at power-up
SLOW_TURN_RAD_S: Final = 0.009  # 0.5 °/s: no bias moves that far between two rests, but a slow turn does
COLOUR: Final = 2.0  # a gyro's noise at rest is not quite white


@kernel("void(float64[::1], float64[::1])")
def watch(s: Float, par: Float) -> None:
    """Update the running spread of rate and specific force from the block, and the verdict s[S_REST]."""
    dt = s[S_B_DT]
    blend = 1.0 - math.exp(-dt / BLEND_S)
    gyro2 = accel2 = 0.0
    slow = True
    for i in range(3):
        dg, da = s[S_B_GYRO + i] / dt - s[S_R_GYRO + i], s[S_B_ACCEL + i] / dt - s[S_R_ACCEL + i]
        s[S_R_GYRO + i] += blend * dg
        s[S_R_ACCEL + i] += blend * da
        gyro2 += dg * dg
        accel2 += da * da
        room = SLOW_TURN_RAD_S + 4.0 * math.sqrt(s[S_P + (N + 1) * (GYRO_BIAS + i)])
        slow = slow and abs(s[S_R_GYRO + i] - s[S_X + GYRO_BIAS + i]) < room
        slow = slow and abs(s[S_R_GYRO + i]) < LARGEST_BIAS_RAD_S
    s[S_R_GYRO_VAR] += blend * (gyro2 - s[S_R_GYRO_VAR])
    s[S_R_ACCEL_VAR] += blend * (accel2 - s[S_R_ACCEL_VAR])
    still = slow and max(gyro2, s[S_R_GYRO_VAR]) < par[K_REST_GYRO] ** 2
    still = still and max(accel2, s[S_R_ACCEL_VAR]) < par[K_REST_ACCEL] ** 2
    s[S_R_STILL_S] = s[S_R_STILL_S] + dt if still else 0.0
    s[S_REST] = 1.0 if s[S_R_STILL_S] > par[K_REST_TIME] else 0.0


@kernel("void(float64[::1], float64[::1])")
def fuse_rest(s: Float, par: Float) -> None:
    """Take the block's mean rate as the gyro's bias (the Earth's rotation with it) and the velocity as zero."""
    dt = s[S_B_DT]
    for i in range(3):
        clear_row(s)
        s[S_H + GYRO_BIAS + i] = 1.0
        fuse(s, s[S_B_GYRO + i] / dt - s[S_X + GYRO_BIAS + i], (COLOUR * par[K_GYRO_NOISE]) ** 2 / dt)
    for i in range(3):
        clear_row(s)
        s[S_H + VEL + i] = 1.0
        fuse(s, -s[S_X + VEL + i], par[K_REST_SPEED] ** 2)

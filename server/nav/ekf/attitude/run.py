"""One navigation step of the attitude mode: the order of work, the guards, the output row."""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf.attitude.covariance import close_block
from server.nav.ekf.attitude.gravity import fuse_bounded_velocity
from server.nav.ekf.attitude.layout import (
    ATT,
    GYRO_BIAS,
    MAG_OFFSET,
    O_ATT_SIGMA,
    O_BIAS_SIGMA,
    O_DISTURBED,
    O_GYRO_BIAS,
    O_HEADING,
    O_MAG_OFFSET,
    O_OFFSET_SIGMA,
    O_Q,
    O_REST,
    O_SIZE,
    S_AGAIN,
    S_B_DT,
    S_B_SIZE,
    S_DISTURBED,
    S_FAILURES,
    S_HEADING,
    S_P,
    S_Q,
    S_REST,
    S_STARTED,
    S_W,
    S_X,
    N,
)
from server.nav.ekf.attitude.magnetic import fuse_field, lift
from server.nav.ekf.attitude.parameters import K_IMU_DELAY
from server.nav.ekf.attitude.propagate import integrate
from server.nav.ekf.attitude.rest import fuse_rest, watch
from server.nav.ekf.attitude.start import start
from server.nav.ekf.attitude.update import forget, inject
from server.nav.ekf.layout import U_GAP_S
from server.nav.kernel import kernel
from server.nav.rotation import quat_from_rotvec, quat_mul
from server.nav.types import Float

BLOCK_S: Final = 0.015
"""The covariance moves in blocks at least this long: one step at 50 Hz, two at 100 Hz, five at 286 Hz."""
GAP_RESTART_S: Final = 1.0  # past it nothing is left of the attitude of a moving board
UNKNOWN_RAD: Final = math.pi


@kernel("void(float64[::1], float64[::1])")
def _close(s: Float, par: Float) -> None:
    """Bring everything to the end of the block that is open, and open the next."""
    rested = s[S_REST]
    watch(s, par)
    if rested > s[S_REST]:
        lift(s, par)
    close_block(s, par)
    if s[S_REST] == 1.0:
        fuse_rest(s, par)
    else:
        fuse_bounded_velocity(s, par)
    inject(s)
    fuse_field(s, par)
    if s[S_P + (N + 1) * (ATT + 2)] > UNKNOWN_RAD**2:  # no magnetometer: a heading can be no more unknown than this
        forget(s, ATT + 2, UNKNOWN_RAD**2)
    for i in range(S_B_SIZE):
        s[S_B_DT + i] = 0.0


@kernel("boolean(float64[::1])")
def _sane(s: Float) -> bool:
    total = 0.0
    for i in range(S_P):
        total += s[i]
    for i in range(N):
        total += s[S_P + (N + 1) * i]
    return math.isfinite(total)


@kernel("void(float64[::1], float64[::1], float64[::1])")
def publish(s: Float, par: Float, out: Float) -> None:
    """Write the output row of the present state; NaN before there is an attitude.

    Args:
        s, par: shapes (S_SIZE,) and (K_SIZE,), memory and parameters.
        out: shape (O_SIZE,), written.
    """
    if s[S_STARTED] == 0.0:
        for i in range(O_SIZE):
            out[i] = math.nan
        out[O_DISTURBED], out[O_REST], out[O_HEADING] = s[S_DISTURBED], 0.0, 0.0
        return
    lead = par[K_IMU_DELAY]
    turn = quat_from_rotvec(s[S_W] * lead, s[S_W + 1] * lead, s[S_W + 2] * lead)
    q = quat_mul(s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3], turn[0], turn[1], turn[2], turn[3])
    sign = -1.0 if q[0] < 0.0 else 1.0
    for i in range(4):
        out[O_Q + i] = sign * q[i]
    for i in range(3):
        out[O_GYRO_BIAS + i], out[O_MAG_OFFSET + i] = s[S_X + GYRO_BIAS + i], s[S_X + MAG_OFFSET + i]
        out[O_ATT_SIGMA + i] = math.sqrt(s[S_P + (N + 1) * (ATT + i)])
        out[O_BIAS_SIGMA + i] = math.sqrt(s[S_P + (N + 1) * (GYRO_BIAS + i)])
        out[O_OFFSET_SIGMA + i] = math.sqrt(s[S_P + (N + 1) * (MAG_OFFSET + i)])
    out[O_DISTURBED], out[O_REST], out[O_HEADING] = s[S_DISTURBED], s[S_REST], s[S_HEADING]


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def step(u: Float, s: Float, par: Float, out: Float) -> None:
    """Advance by one navigation step and publish; start when there is nothing yet or a hole was too long.

    Args:
        u: shape (U_SIZE,), the step, columns of `server.nav.ekf.layout`.
        s: shape (S_SIZE,), memory, `layout.new_memory`.
        par: shape (K_SIZE,), `parameters.default_parameters`.
        out: shape (O_SIZE,), written.
    """
    if s[S_STARTED] == 0.0 or u[U_GAP_S] > GAP_RESTART_S:
        s[S_STARTED] = 0.0
        start(u, s, par)
    else:
        integrate(u, s)
        if s[S_B_DT] >= BLOCK_S:
            _close(s, par)
            if not _sane(s):
                s[S_STARTED] = s[S_AGAIN] = 0.0
                s[S_FAILURES] += 1.0
    publish(s, par, out)

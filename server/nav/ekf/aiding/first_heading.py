"""The first heading of a board that was aligned without one: from a late magnetometer, or from the course."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import (
    MULTIROTOR,
    REFUSED_DISTURBED,
)
from server.nav.ekf.aiding.mag import field_in_ned
from server.nav.ekf.align import HEADING_SIGMA_RAD, LEAST_NORTH_GAUSS, set_heading
from server.nav.ekf.blocks import switch_mag_on
from server.nav.ekf.events import add_event
from server.nav.ekf.layout import (
    A_DECLINATION,
    A_FIELD_D,
    A_FIELD_H,
    C_HAS_FIELD,
    C_HAS_HEADING,
    C_MAG_SEEN,
    E_COURSE,
    E_HEADING,
    H_ACC,
    H_DATA,
    H_STATUS,
    H_T,
    PAR_VEHICLE,
    RESET,
    UNDECIDED,
    W_OBS,
)
from server.nav.ekf.states import X_Q
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int

EXACT_SPEED_M_S: Final = 0.5  # a receiver of centimetres a second


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1],"
    " float64[::1], float64[:, ::1])"
)
def late_heading(
    h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float, events: Float
) -> None:
    """Take the heading from the first magnetic field that comes after the alignment."""
    z = field_in_ned(h, x, u)
    if math.hypot(z[0], z[1]) < LEAST_NORTH_GAUSS:
        h[H_STATUS] = REFUSED_DISTURBED
        return
    if not ctl[C_HAS_FIELD]:
        aux[A_FIELD_H], aux[A_FIELD_D] = math.hypot(z[0], z[1]), z[2]
    angle = aux[A_DECLINATION] - math.atan2(z[1], z[0])
    angle = (angle + math.pi) % (2.0 * math.pi) - math.pi
    set_heading(x, P, angle, HEADING_SIGMA_RAD)
    switch_mag_on(x, P, par, aux, ctl, work)
    work[W_OBS], work[W_OBS + 1], work[W_OBS + 2] = z[0], z[1], z[2]
    if h[H_STATUS] == UNDECIDED:
        add_event(events, ctl, E_HEADING, h[H_T], angle, 0.0)
    h[H_STATUS] = RESET
    ctl[C_HAS_HEADING] = 1


@kernel("boolean(float64[::1], float64[::1], int64[::1])")
def tells_heading(h: Float, par: Float, ctl: Int) -> bool:
    """Without a magnetometer, a vehicle that can only move forward shows its heading by its course."""
    if ctl[C_HAS_HEADING] or ctl[C_MAG_SEEN] or par[PAR_VEHICLE] == MULTIROTOR or h[H_STATUS] != UNDECIDED:
        return False
    return bool(math.hypot(h[H_DATA], h[H_DATA + 1]) > max(EXACT_SPEED_M_S, 10.0 * h[H_ACC]))


@kernel("void(float64[::1], float64[::1], float64[::1], int64[::1], float64[:, ::1])")
def course_heading(h: Float, x: Float, P: Float, ctl: Int, events: Float) -> None:
    """Turn the forward axis to the receiver's course."""
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    angle = math.atan2(h[H_DATA + 1], h[H_DATA]) - math.atan2(R[3], R[0])
    angle = (angle + math.pi) % (2.0 * math.pi) - math.pi
    set_heading(x, P, angle, HEADING_SIGMA_RAD)
    if h[H_STATUS] == UNDECIDED:
        add_event(events, ctl, E_COURSE, h[H_T], angle, 0.0)
    h[H_STATUS] = RESET
    ctl[C_HAS_HEADING] = 1

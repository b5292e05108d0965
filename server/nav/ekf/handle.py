"""What is done with one measurement at its place in the history: dispatch, bookkeeping, record."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import (
    AIRSPEED_AID,
    BARO_HEIGHT,
    DEAD_RECKONING,
    DRAG_AID,
    FUSED,
    GNSS_POSITION,
    GNSS_VELOCITY,
    GRAVITY,
    MAG_FIELD,
    REFUSED_GATE,
    REFUSED_NOT_READY,
    SIDESLIP,
    WHEELS,
    YAW,
    ZERO_RATE,
    ZERO_VELOCITY,
)
from server.nav.ekf.aiding import airspeed, baro, drag, gnss, mag, still, wheels
from server.nav.ekf.aiding.first_heading import course_heading, late_heading, tells_heading
from server.nav.ekf.aiding.yaw import bank_heading
from server.nav.ekf.events import add_event
from server.nav.ekf.layout import (
    A_T_GNSS,
    A_T_REFUSED,
    C_AIDS,
    C_BARO_SEEN,
    C_HAS_HEADING,
    C_HAS_SITE,
    C_MODE,
    C_POSITIONED,
    C_REFUSED_RUN,
    E_GNSS_BACK,
    E_GNSS_RESET,
    H_ACC,
    H_AID,
    H_STATUS,
    H_T,
    RESET,
    UNDECIDED,
    W_DX,
    W_INNOV,
    W_LEARN,
    W_OBS,
    W_RATIO,
)
from server.nav.ekf.states import N
from server.nav.ekf.update import inject
from server.nav.kernel import kernel
from server.nav.types import Float, Int

REACCEPT_S: Final = 10.0
"""A receiver whose fixes contradict the filter for this long, fix after fix, is right: start again from it."""
REACCEPT_FIXES: Final = 10
WORST_START_M: Final = 50.0
"""A first fix less accurate than this does not start the navigation."""

# Directly named, because compiled code resolves attributes of modules only at the top level.
gnss_position, gnss_velocity, gnss_reset = gnss.position, gnss.velocity, gnss.reset_position
baro_height, mag_field = baro.height, mag.field
car_wheels = wheels.wheels
rotor_drag = drag.drag
true_airspeed, wing_sideslip = airspeed.airspeed, airspeed.sideslip
zero_velocity, zero_rate, gravity = still.zero_velocity, still.zero_rate, still.gravity


@kernel("void(float64, float64, float64, float64, float64[::1], int64[::1], float64[:, ::1], float64[::1])")
def record(aid: float, status: float, t_valid: float, t_ns: float, work: Float, ctl: Int, out: Float, t: Float) -> None:
    """Append one aid row from work[W_OBS:W_RATIO + 1]."""
    k = ctl[C_AIDS]
    if k >= out.shape[0]:
        return
    out[k, 0], out[k, 1] = aid, FUSED if status == RESET else status
    for i in range(W_RATIO + 1 - W_OBS):
        out[k, 2 + i] = work[W_OBS + i]
    out[k, 15], t[k] = t_valid, t_ns
    ctl[C_AIDS] += 1


@kernel("void(float64[::1])")
def clear_record(work: Float) -> None:
    """Set the record to unknown and the collected correction to zero."""
    for i in range(W_OBS, W_RATIO):
        work[i] = math.nan
    work[W_RATIO] = 0.0
    for i in range(N):
        work[W_DX + i] = 0.0


@kernel("boolean(float64[::1], float64[::1], int64[::1])")
def _wants_reset(h: Float, aux: Float, ctl: Int) -> bool:
    if h[H_STATUS] == RESET:
        return True
    if h[H_STATUS] != UNDECIDED:
        return False
    if not ctl[C_POSITIONED]:
        return bool(ctl[C_HAS_SITE] and ctl[C_HAS_HEADING] and h[H_ACC] <= WORST_START_M)
    return bool(ctl[C_REFUSED_RUN] >= REACCEPT_FIXES and (h[H_T] - aux[A_T_REFUSED]) * 1e-9 > REACCEPT_S)


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1],"
    " float64[::1], float64[:, ::1])"
)
def _position(
    h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float, events: Float
) -> None:
    """GNSS position: start or restart from it, or correct with it; keep the account of refusals."""
    undecided = h[H_STATUS] == UNDECIDED
    if _wants_reset(h, aux, ctl):
        started = ctl[C_POSITIONED] == 1
        gnss_reset(h, x, P, u, par, aux, ctl, work)
        h[H_STATUS] = RESET
        if undecided:
            ctl[C_BARO_SEEN] = 0
            if started:
                size = math.sqrt(work[W_INNOV] ** 2 + work[W_INNOV + 1] ** 2)
                add_event(events, ctl, E_GNSS_RESET, h[H_T], size, work[W_INNOV + 2])
    elif not ctl[C_POSITIONED]:
        h[H_STATUS] = REFUSED_NOT_READY
    else:
        gnss_position(h, x, P, u, par, aux, ctl, work)
    if not undecided:
        return
    if h[H_STATUS] == FUSED or h[H_STATUS] == RESET:
        away = (h[H_T] - aux[A_T_GNSS]) * 1e-9
        if ctl[C_MODE] == DEAD_RECKONING:
            add_event(events, ctl, E_GNSS_BACK, h[H_T], away, math.sqrt(work[W_INNOV] ** 2 + work[W_INNOV + 1] ** 2))
        aux[A_T_GNSS] = h[H_T]
        ctl[C_REFUSED_RUN] = 0
    elif h[H_STATUS] == REFUSED_GATE:
        if ctl[C_REFUSED_RUN] == 0:
            aux[A_T_REFUSED] = h[H_T]
        ctl[C_REFUSED_RUN] += 1


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64[::1],"
    " float64[::1], float64[:, ::1], float64[::1], float64[:, ::1], float64)"
)
def handle(
    h: Float,
    x: Float,
    P: Float,
    u: Float,
    par: Float,
    aux: Float,
    ctl: Int,
    work: Float,
    aids: Float,
    aid_t: Float,
    events: Float,
    t_ns: float,
) -> None:
    """Apply one measurement of the history at its slot; the first time, decide and record it.

    Args:
        h: shape (H_SIZE,), the measurement; its status and variances are decided here, once.
        x, P: state and covariance at the end of the slot's step, corrected in place.
        u: the slot's navigation step.
        par, aux, ctl, work: parameters, memory and scratch.
        aids, aid_t, events: records written, counted in ctl.
        t_ns: the present step, for the record.
    """
    aid = int(h[H_AID])
    undecided = h[H_STATUS] == UNDECIDED
    if not undecided and h[H_STATUS] != FUSED and h[H_STATUS] != RESET:
        return
    clear_record(work)
    work[W_LEARN] = 1.0 if undecided else 0.0
    if aid == GNSS_POSITION:
        _position(h, x, P, u, par, aux, ctl, work, events)
    elif aid == YAW:
        bank_heading(h, x, P, par, aux, ctl, work, events)
    elif aid == MAG_FIELD:
        if ctl[C_HAS_HEADING] and h[H_STATUS] != RESET:
            mag_field(h, x, P, u, par, aux, ctl, work)
        else:
            late_heading(h, x, P, u, par, aux, ctl, work, events)
    elif aid == ZERO_RATE:
        zero_rate(h, x, P, u, par, aux, ctl, work)
    elif aid == GRAVITY:
        gravity(h, x, P, u, par, aux, ctl, work)
    elif aid == GNSS_VELOCITY and (h[H_STATUS] == RESET or tells_heading(h, par, ctl)):
        course_heading(h, x, P, ctl, events)
    elif not ctl[C_POSITIONED]:
        h[H_STATUS] = REFUSED_NOT_READY
    elif aid == GNSS_VELOCITY:
        gnss_velocity(h, x, P, u, par, aux, ctl, work)
    elif aid == BARO_HEIGHT:
        baro_height(h, x, P, u, par, aux, ctl, work)
    elif aid == ZERO_VELOCITY:
        zero_velocity(h, x, P, u, par, aux, ctl, work)
    elif aid == AIRSPEED_AID:
        true_airspeed(h, x, P, u, par, aux, ctl, work)
    elif aid == SIDESLIP:
        wing_sideslip(h, x, P, u, par, aux, ctl, work)
    elif aid == DRAG_AID:
        rotor_drag(h, x, P, u, par, aux, ctl, work)
    elif aid == WHEELS:
        car_wheels(h, x, P, u, par, aux, ctl, work)
    if h[H_STATUS] == UNDECIDED:
        h[H_STATUS] = REFUSED_NOT_READY
    if h[H_STATUS] == FUSED:
        inject(x, P, work)
    if undecided:
        record(h[H_AID], h[H_STATUS], h[H_T], t_ns, work, ctl, aids, aid_t)

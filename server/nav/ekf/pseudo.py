"""Which pseudo-measurements are due: of a board that is still, of one without GNSS, of each class of vehicle."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import (
    CAR,
    DRAG_AID,
    FIXED_WING,
    GRAVITY,
    HAND_HELD,
    MULTIROTOR,
    SIDESLIP,
    WHEELS,
    ZERO_RATE,
    ZERO_VELOCITY,
)
from server.nav.ekf.align import rest
from server.nav.ekf.history import attach
from server.nav.ekf.layout import (
    A_REST_HEIGHT,
    A_SPEED_GNSS,
    A_T_DRAG,
    A_T_GNSS_SEEN,
    A_T_GRAVITY,
    A_T_QUICK,
    A_T_RATE,
    A_T_SIDESLIP,
    A_T_STILL,
    A_T_WHEELS,
    C_POSITIONED,
    C_STILL_STEPS,
    C_VALID,
    H_ACC,
    H_AID,
    H_SIZE,
    H_STATUS,
    H_T,
    PAR_DRAG,
    PAR_VEHICLE,
    PAR_ZERO_VELOCITY,
    U_DT,
    U_T,
    UNDECIDED,
)
from server.nav.ekf.predict import gravity_here
from server.nav.ekf.states import X_POS, X_VEL
from server.nav.kernel import kernel
from server.nav.types import Float, Int

PSEUDO_INTERVAL_NS: Final = 1e8  # ten a second: the board's sway is correlated for about that long
WHEELS_INTERVAL_NS: Final = 2e8
FLYING_M_S: Final = 8.0  # over ground; a fixed wing this fast has taken off or is about to
AIRBORNE_M: Final = 2.0  # above where it stood still last: more than heights err by from take-off to landing
AIRBORNE_M_S: Final = 2.0  # over ground
LANDED_NS: Final = 1e9
REST_BEFORE_ZERO_S: Final = 1.0
STILL_SPEED_M_S: Final = 0.15
HOVER_VELOCITY_M_S: Final = 0.7
"""Without GNSS a hover looks like rest: a drift of 0.1 m/s that lasts for seconds, sampled ten times a second."""
CONFIRMED_NS: Final = 0.8e9
"""Rest is believed when it has lasted on for this long: a vehicle that lifts off gently is not held down. One that
lands gently must have stood before, `REST_BEFORE_ZERO_S`."""
BATCH: Final = 4  # rests confirmed at once: each time the filter is re-run from the first of them


@kernel("void(float64[::1], float64, float64)")
def _pseudo(h: Float, t_ns: float, aid: float) -> None:
    for i in range(H_SIZE):
        h[i] = 0.0
    h[H_AID], h[H_T], h[H_STATUS] = aid, t_ns, UNDECIDED


@kernel("boolean(float64[::1], float64[::1], float64[::1], float64[::1], int64[::1])")
def _rotors_carry(x: Float, u: Float, par: Float, aux: Float, ctl: Int) -> bool:
    """Return whether a multirotor is in the air: above where it stood still last, or faster than legs can be.

    On them the specific force across the body is the slope of the ground. A smooth flight looks still as well, so rest
    counts when it is confirmed, which takes along the height.
    """
    if par[PAR_VEHICLE] != MULTIROTOR or not ctl[C_POSITIONED] or u[U_T] - aux[A_T_STILL] < LANDED_NS:
        return False
    fast = x[X_VEL] ** 2 + x[X_VEL + 1] ** 2 > AIRBORNE_M_S**2
    return bool(fast or x[X_POS + 2] - aux[A_REST_HEIGHT] > AIRBORNE_M)  # NaN: it never stood still


@kernel(
    "int64(float64[::1], int64, float64[::1], float64[::1], int64[::1], float64[::1], float64[:, ::1],"
    " float64[:, :, ::1], int64[::1], float64[:, ::1], float64[::1], float64[::1], float64[::1])"
)
def pseudo_measurements(
    u: Float,
    dirty: int,
    x: Float,
    aux: Float,
    ctl: Int,
    work: Float,
    r_u: Float,
    r_m: Float,
    r_n: Int,
    aids: Float,
    aid_t: Float,
    h: Float,
    par: Float,
) -> int:
    """Attach zero velocity and zero rate at rest, gravity without GNSS; return the earliest dirty slot.

    A vehicle that flies or drives smoothly looks still to its IMU, so rest needs a second witness while one is there:
    the receiver's speed, or without receiver a velocity that the filter itself holds for zero.
    """
    t = u[U_T]
    rest(u, par, aux, ctl, gravity_here(x, aux, ctl))
    flying = par[PAR_VEHICLE] == FIXED_WING and x[X_VEL] ** 2 + x[X_VEL + 1] ** 2 > FLYING_M_S**2
    if ctl[C_POSITIONED] and flying and t - aux[A_T_SIDESLIP] >= WHEELS_INTERVAL_NS:
        aux[A_T_SIDESLIP] = t
        _pseudo(h, t, SIDESLIP)
        dirty = attach(h, dirty, t, ctl, work, r_u, r_m, r_n, aids, aid_t)
    if par[PAR_DRAG] > 0.0 and t - aux[A_T_DRAG] >= WHEELS_INTERVAL_NS and _rotors_carry(x, u, par, aux, ctl):
        aux[A_T_DRAG] = t
        _pseudo(h, t, DRAG_AID)
        dirty = attach(h, dirty, t, ctl, work, r_u, r_m, r_n, aids, aid_t)
    if ctl[C_POSITIONED] and par[PAR_VEHICLE] == CAR and t - aux[A_T_WHEELS] >= WHEELS_INTERVAL_NS:
        aux[A_T_WHEELS] = t
        _pseudo(h, t, WHEELS)
        dirty = attach(h, dirty, t, ctl, work, r_u, r_m, r_n, aids, aid_t)
    if not ctl[C_POSITIONED] and t - aux[A_T_GRAVITY] >= PSEUDO_INTERVAL_NS:
        aux[A_T_GRAVITY] = t
        _pseudo(h, t, GRAVITY)
        dirty = attach(h, dirty, t, ctl, work, r_u, r_m, r_n, aids, aid_t)
    fresh = t - aux[A_T_GNSS_SEEN] < 2e9
    if ctl[C_POSITIONED]:
        speed = math.sqrt(x[X_VEL] ** 2 + x[X_VEL + 1] ** 2 + x[X_VEL + 2] ** 2)
        if speed > STILL_SPEED_M_S or (fresh and aux[A_SPEED_GNSS] > STILL_SPEED_M_S):
            aux[A_T_QUICK] = t
    first = CONFIRMED_NS + (BATCH - 1) * PSEUDO_INTERVAL_NS
    if t - aux[A_T_RATE] < BATCH * PSEUDO_INTERVAL_NS or ctl[C_VALID] * u[U_DT] * 1e9 <= first + PSEUDO_INTERVAL_NS:
        return dirty
    settled = first + REST_BEFORE_ZERO_S * 1e9
    if ctl[C_STILL_STEPS] * u[U_DT] * 1e9 < settled or t - aux[A_T_QUICK] < settled:
        return dirty
    aux[A_T_RATE] = t
    rolls = par[PAR_VEHICLE] == CAR or par[PAR_VEHICLE] == HAND_HELD
    for k in range(BATCH):
        at_rest = t - first + k * PSEUDO_INTERVAL_NS
        if ctl[C_POSITIONED]:
            aux[A_T_STILL] = t
            aux[A_REST_HEIGHT] = x[X_POS + 2]
            _pseudo(h, at_rest, ZERO_VELOCITY)
            h[H_ACC] = par[PAR_ZERO_VELOCITY] if fresh or rolls else HOVER_VELOCITY_M_S
            dirty = attach(h, dirty, t, ctl, work, r_u, r_m, r_n, aids, aid_t)
        _pseudo(h, at_rest, ZERO_RATE)
        dirty = attach(h, dirty, t, ctl, work, r_u, r_m, r_n, aids, aid_t)
    return dirty

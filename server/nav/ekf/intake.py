"""From a checked measurement on the wire side to rows of the history, with its time of validity."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import (
    AIRSPEED,
    AIRSPEED_AID,
    ALIGNING,
    BARO,
    BARO_HEIGHT,
    FUSED,
    GNSS,
    GNSS_POSITION,
    GNSS_VELOCITY,
    MAG,
    MAG_FIELD,
    REFUSED_NOT_READY,
)
from server.nav.ekf.aiding.yaw import heading_due
from server.nav.ekf.delays import MAG as MAG_DELAY
from server.nav.ekf.delays import POSITION, VELOCITY, use_estimate
from server.nav.ekf.handle import clear_record, record
from server.nav.ekf.history import attach
from server.nav.ekf.layout import (
    A_GNSS_INTERVAL,
    A_GNSS_JITTER_VAR,
    A_GNSS_JITTER_VAR_D,
    A_GNSS_WANDER_VAR,
    A_GNSS_WANDER_VAR_D,
    A_MAG_SUM,
    A_MAG_WEIGHT,
    A_SPEED_GNSS,
    A_T_AIRSPEED,
    A_T_GNSS,
    A_T_GNSS_SEEN,
    A_T_MAG,
    C_ALIGN_STEPS,
    C_MAG_SEEN,
    C_MODE,
    H_ACC,
    H_AID,
    H_DATA,
    H_FLOOR,
    H_SIZE,
    H_STATUS,
    H_T,
    H_WANDER,
    H_WANDER_D,
    M_DATA,
    M_KIND,
    M_STATUS,
    M_T,
    NEVER_NS,
    PAR_BARO_DELAY,
    PAR_GNSS_DELAY,
    PAR_GNSS_JITTER,
    PAR_GNSS_WANDER,
    PAR_IMU_DELAY,
    PAR_MAG_DELAY,
    UNDECIDED,
    W_DELAYS,
    W_USED,
)
from server.nav.ekf.yaw_bank import bank_velocity
from server.nav.kernel import kernel
from server.nav.types import Float, Int

MAG_INTERVAL_NS: Final = 40e6  # field noise of a vehicle is correlated longer than this: more samples add no knowledge
AIRSPEED_INTERVAL_NS: Final = 9e7  # a pitot tube's errors last longer: more samples add no knowledge
LONGER: Final = 2.5
UNKNOWN_H_ACC_M: Final = 2.5  # single-frequency receiver in the open
UNKNOWN_V_ACC_M: Final = 5.0
UNKNOWN_S_ACC_M_S: Final = 0.3
UNKNOWN_FLOOR_M: Final = 0.3
UNKNOWN_FLOOR_M_S: Final = 0.1
"""A receiver that does not say how good it is smooths its fixes: small innovations prove nothing below these."""
WANDER_SHARE: Final = 0.7
"""Share of a stand-alone receiver's reported accuracy (68 % of the horizontal error) that is common to fixes of the
same minutes, per axis: ionosphere, orbits and multipath."""
RTK_FIX: Final = 5.0  # fix_type of float and fixed carrier-phase solutions, which do not wander
MIN_ACC_M: Final = 0.02
MIN_ACC_M_S: Final = 0.02


@kernel("float64(float64, float64, float64)")
def _known(value: float, otherwise: float, least: float) -> float:
    return max(least, value) if math.isfinite(value) else otherwise


@kernel("void(float64[::1], float64, float64, float64[::1])")
def _start_row(h: Float, aid: float, t_ns: float, m: Float) -> None:
    for i in range(H_SIZE):
        h[i] = 0.0
    h[H_AID], h[H_T], h[H_STATUS] = aid, t_ns, UNDECIDED
    for i in range(3):
        h[H_DATA + i] = m[M_DATA + i]


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1])")
def position_row(h: Float, m: Float, par: Float, aux: Float) -> None:
    """Fill a GNSS position row: latitude, longitude rad, height m, standard deviations m; note its slow error's.

    What is told holds for a horizontal axis; down, the receiver's own ratio of vertical to horizontal is added.
    """
    h[H_DATA] = math.radians(m[M_DATA])
    h[H_DATA + 1] = math.radians(m[M_DATA + 1])
    h[H_FLOOR] = 0.0 if math.isfinite(m[M_DATA + 6]) else UNKNOWN_FLOOR_M
    h[H_ACC] = h[H_ACC + 1] = _known(m[M_DATA + 6], UNKNOWN_H_ACC_M, MIN_ACC_M)
    h[H_ACC + 2] = _known(m[M_DATA + 7], UNKNOWN_V_ACC_M, MIN_ACC_M)
    ratio = math.sqrt(2.0) * h[H_ACC + 2] / h[H_ACC]
    if math.isfinite(par[PAR_GNSS_WANDER]):
        h[H_WANDER], h[H_WANDER_D] = par[PAR_GNSS_WANDER], par[PAR_GNSS_WANDER] * ratio
    elif not m[M_DATA + 9] >= RTK_FIX:
        h[H_WANDER], h[H_WANDER_D] = WANDER_SHARE * h[H_ACC], h[H_ACC + 2]
    if h[H_WANDER] > 0.0:
        aux[A_GNSS_WANDER_VAR], aux[A_GNSS_WANDER_VAR_D] = h[H_WANDER] ** 2, h[H_WANDER_D] ** 2
    if math.isfinite(par[PAR_GNSS_JITTER]):
        aux[A_GNSS_JITTER_VAR] = par[PAR_GNSS_JITTER] ** 2
        aux[A_GNSS_JITTER_VAR_D] = (par[PAR_GNSS_JITTER] * ratio) ** 2


@kernel("void(float64[::1], float64[::1])")
def velocity_row(h: Float, m: Float) -> None:
    """Fill a GNSS velocity row: NED m/s and standard deviations m/s."""
    for i in range(3):
        h[H_DATA + i] = m[M_DATA + 3 + i]
        h[H_FLOOR] = 0.0 if math.isfinite(m[M_DATA + 8]) else UNKNOWN_FLOOR_M_S
        h[H_ACC + i] = _known(m[M_DATA + 8], UNKNOWN_S_ACC_M_S, MIN_ACC_M_S)


@kernel("void(float64[::1], float64, float64[::1])")
def _note_gnss(m: Float, t_valid: float, aux: Float) -> None:
    """Keep the receiver's interval and speed, which the rest and outage logic need."""
    if aux[A_T_GNSS_SEEN] > NEVER_NS:
        interval = min(10.0, max(0.0, (t_valid - aux[A_T_GNSS_SEEN]) * 1e-9))
        first = aux[A_T_GNSS] == NEVER_NS
        if not first:  # an outage is not the receiver's interval
            interval = min(interval, LONGER * aux[A_GNSS_INTERVAL])
        aux[A_GNSS_INTERVAL] += (1.0 if first else 0.2) * (interval - aux[A_GNSS_INTERVAL])
    aux[A_T_GNSS_SEEN] = t_valid
    aux[A_SPEED_GNSS] = math.sqrt(m[M_DATA + 3] ** 2 + m[M_DATA + 4] ** 2)


@kernel(
    "int64(float64[::1], int64, float64, float64[::1], float64[::1], float64[::1], float64[::1], float64[::1],"
    " int64[::1], float64[::1], float64[:, ::1], float64[:, :, ::1], int64[::1], float64[:, ::1], float64[::1],"
    " float64[::1])"
)
def take(
    m: Float,
    dirty: int,
    t_ns: float,
    x: Float,
    P: Float,
    bank: Float,
    par: Float,
    aux: Float,
    ctl: Int,
    work: Float,
    r_u: Float,
    r_m: Float,
    r_n: Int,
    aids: Float,
    aid_t: Float,
    h: Float,
) -> int:
    """Take one measurement; return the earliest dirty slot.

    The filter's clock is the IMU's stamp: a measurement stamped t, valid at t − delay, belongs to the IMU sample
    stamped t − delay + IMU delay.
    """
    kind = int(m[M_KIND])
    if kind != GNSS and kind != BARO and kind != MAG and kind != AIRSPEED:
        return dirty
    delay = par[PAR_GNSS_DELAY] if kind == GNSS else (par[PAR_BARO_DELAY] if kind == BARO else par[PAR_MAG_DELAY])
    aid = GNSS_POSITION if kind == GNSS else (BARO_HEIGHT if kind == BARO else MAG_FIELD)
    if kind == AIRSPEED:
        aid, delay = AIRSPEED_AID, par[PAR_BARO_DELAY]  # a pressure sensor as well
    if kind == MAG:
        delay += work[W_USED + MAG_DELAY]
        use_estimate(work, MAG_DELAY)
    slower = 0.0
    if kind == GNSS and work[W_DELAYS] > 0.0:
        delay += work[W_USED + POSITION]
        slower = work[W_USED + VELOCITY] - work[W_USED + POSITION]
        use_estimate(work, POSITION)
        use_estimate(work, VELOCITY)
    t_valid = m[M_T] + (par[PAR_IMU_DELAY] - delay) * 1e9
    status = int(m[M_STATUS])
    if kind == AIRSPEED and status == FUSED:
        if m[M_T] - aux[A_T_AIRSPEED] < AIRSPEED_INTERVAL_NS:
            return dirty
        aux[A_T_AIRSPEED] = m[M_T]
    if kind == MAG and status == FUSED:
        ctl[C_MAG_SEEN] = 1
        if ctl[C_MODE] == ALIGNING:
            if ctl[C_ALIGN_STEPS] == 0:  # moving: only the newest sample has anything to do with the attitude
                aux[A_MAG_SUM] = aux[A_MAG_SUM + 1] = aux[A_MAG_SUM + 2] = aux[A_MAG_WEIGHT] = 0.0
            for i in range(3):
                aux[A_MAG_SUM + i] += m[M_DATA + i]
            aux[A_MAG_WEIGHT] += 1.0
        elif m[M_T] - aux[A_T_MAG] < MAG_INTERVAL_NS:
            return dirty
        aux[A_T_MAG] = m[M_T]
    if status == FUSED and ctl[C_MODE] == ALIGNING:
        status = REFUSED_NOT_READY
    if status != FUSED:
        clear_record(work)
        record(aid, status, t_valid, t_ns, work, ctl, aids, aid_t)
        if kind == GNSS:  # one message, two measurements: both accounts say what became of it
            record(GNSS_VELOCITY, status, t_valid, t_ns, work, ctl, aids, aid_t)
        return dirty
    if kind == GNSS:
        _note_gnss(m, t_valid, aux)
        moved = bank_velocity(t_valid - slower * 1e9, m[M_DATA + 3], m[M_DATA + 4], m[M_DATA + 8], bank)
        if moved and heading_due(t_ns, x, P, aux, ctl, bank, h):
            dirty = attach(h, dirty, t_ns, ctl, work, r_u, r_m, r_n, aids, aid_t)
        if math.isfinite(m[M_DATA]) and math.isfinite(m[M_DATA + 1]):
            _start_row(h, GNSS_POSITION, t_valid, m)
            position_row(h, m, par, aux)
            dirty = attach(h, dirty, t_ns, ctl, work, r_u, r_m, r_n, aids, aid_t)
        if not (math.isfinite(m[M_DATA + 3]) and math.isfinite(m[M_DATA + 4])):
            return dirty
        _start_row(h, GNSS_VELOCITY, t_valid - slower * 1e9, m)
        velocity_row(h, m)
    else:
        _start_row(h, aid, t_valid, m)
        if kind == BARO:
            h[H_DATA] = m[M_DATA + 1]
        elif kind == AIRSPEED:
            h[H_DATA], h[H_DATA + 1] = m[M_DATA], m[M_DATA + 1]
    return attach(h, dirty, t_ns, ctl, work, r_u, r_m, r_n, aids, aid_t)

"""One measurement that is not the IMU's: checked, put in order, calibrated and filtered, its time of validity set."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import (
    AIRSPEED,
    BARO,
    FUSED,
    GNSS,
    MAG,
    REFUSED_DISTURBED,
    REFUSED_ORDER,
    REFUSED_RANGE,
    REFUSED_REPEATED,
)
from server.nav.constants import ISA_EXPONENT, ISA_HEIGHT_M, ISA_PRESSURE_PA
from server.nav.ekf.layout import M_DATA, M_KIND, M_STATUS, M_T
from server.nav.kernel import kernel
from server.nav.preprocess import chain_layout as at
from server.nav.preprocess.chain_run import chain_aid, chain_airspeed, chain_baro
from server.nav.preprocess.check import check_baro, check_gnss, check_mag
from server.nav.preprocess.memory import (
    N_CLIPPED,
    N_ORDER,
    N_RANGE,
    N_REPEATED,
    N_SAMPLES,
    NEVER_NS,
    S_RATE,
    S_T_KIND,
    S_T_LAST,
)
from server.nav.preprocess.units import convert
from server.nav.types import Float, Int

FUTURE_NS: Final = 2e9
"""An aid stamped this far after the newest IMU sample is not of the same clock."""


@kernel("int64(int64)")
def _sensor_of(kind: int) -> int:
    """Return the chain's number of the sensor of magnetic, barometric or airspeed samples."""
    return at.MAG if kind == MAG else (at.BARO if kind == BARO else at.AIRSPEED)


@kernel("void(int64, float64[::1], float64[::1], int64[::1])")
def _from_counts(kind: int, row: Float, c: Float, counters: Int) -> None:
    """Convert raw counts in place; count a sample at the end of a range that was told."""
    block = at.K_BLOCKS + _sensor_of(kind) * at.B_SIZE
    numbers = 3 if kind == MAG else 1
    if c[block + at.B_UNITS] > 0.0:
        if kind == MAG:
            convert(c, block, row, 0)
        else:
            row[0] = c[block + at.B_SCALE] * (row[0] - c[block + at.B_ZERO])
            row[1] = math.nan  # follows from the pressure
    full = c[block + at.B_FULL_SCALE]
    if full > 0.0:
        at_end = False
        for i in range(numbers):
            at_end |= abs(row[i]) >= (1.0 - at.FULL_SCALE_TOLERANCE) * full
        counters[N_CLIPPED] += at_end


@kernel("float64(int64, float64, int64, float64[::1], float64[::1], float64[::1])")
def _through_chain(kind: int, t: float, status: int, row: Float, c: Float, stage: Float) -> float:
    """Calibrate and filter a believed sample in place; return the delay of its filters, s."""
    if status != FUSED and not (kind == MAG and status == REFUSED_DISTURBED):
        return 0.0
    b = at.K_BLOCKS + _sensor_of(kind) * at.B_SIZE
    if c[b + at.B_FILLED] > 0.0 and t <= c[b + at.B_T_LAST]:
        return 0.0
    delay = 0.0
    if kind == MAG:
        delay = chain_aid(c, at.MAG, t, row, 0, stage)
    elif kind == BARO:
        delay = chain_baro(c, t, row, stage)
    elif math.isfinite(row[0]) or math.isfinite(row[1]):
        delay = chain_airspeed(c, t, row, stage)
    else:
        return 0.0
    if stage.shape[0] > 0:
        stage[at.G_USED] = 1.0
    return float(delay)


@kernel("void(float64[::1], float64[::1])")
def _note_pressure(row: Float, c: Float) -> None:
    """Keep the static pressure for the density of the air; from the standard atmosphere where only a height is told."""
    if row[0] > 0.0 and math.isfinite(row[0]):
        c[at.K_PRESSURE] = row[0]
    else:
        share = max(0.01, 1.0 - row[1] / ISA_HEIGHT_M)
        c[at.K_PRESSURE] = ISA_PRESSURE_PA * share ** (1.0 / ISA_EXPONENT)


@kernel("void(int64, float64, float64[::1], int64[:, ::1], float64[::1], float64[::1], float64[::1])")
def take_aid(kind: int, t: float, s: Float, n: Int, c: Float, out: Float, stage: Float) -> None:
    """Check one measurement whose row is already copied into out[M_DATA:].

    Args:
        kind: value of `Kind`. t: its stamp, ns.
        s, n, c: memory, counters and the chain's array between calls.
        out: shape (M_SIZE,), completed: M_T is when the filtered value was valid.
        stage: shape (G_SIZE,), written where the chain is on, or (0,).
    """
    row = out[M_DATA:]
    counters = n[kind]
    status = FUSED
    on = False
    if MAG <= kind <= AIRSPEED and kind != GNSS:
        on = c[at.K_ON + _sensor_of(kind)] > 0.0
    if on:
        _from_counts(kind, row, c, counters)
    if kind == MAG:
        status = check_mag(row, c, s, counters)
    elif kind == GNSS:
        status = check_gnss(row, counters)
    elif kind == BARO:
        status = check_baro(row, counters)
    delay = 0.0
    if s[S_T_LAST] > NEVER_NS and t > s[S_T_LAST] + FUTURE_NS:  # a stamp of another clock would poison the order
        counters[N_RANGE] += 1
        status = REFUSED_RANGE
    elif t <= s[S_T_KIND + kind]:
        repeated = t == s[S_T_KIND + kind]
        counters[N_REPEATED if repeated else N_ORDER] += 1
        status = REFUSED_REPEATED if repeated else REFUSED_ORDER
    else:
        if status == FUSED:
            counters[N_SAMPLES] += 1
            if s[S_T_KIND + kind] > NEVER_NS:
                interval = (t - s[S_T_KIND + kind]) * 1e-9
                s[S_RATE + kind] += (0.1 if s[S_RATE + kind] > 0.0 else 1.0) * (interval - s[S_RATE + kind])
            s[S_T_KIND + kind] = t
            if kind == BARO:
                _note_pressure(row, c)
        if on:
            delay = _through_chain(kind, t, status, row, c, stage)
    out[M_KIND], out[M_T], out[M_STATUS] = kind, t - delay * 1e9, status

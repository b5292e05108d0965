"""True airspeed, and the sideslip of a fixed wing: both see the velocity against the air, so both see the wind."""

from __future__ import annotations

import math
from typing import Final

from server.nav.codes import FUSED, REFUSED_GATE, REFUSED_NOT_READY, REFUSED_RANGE
from server.nav.ekf.blocks import switch_wind_on
from server.nav.ekf.layout import (
    H_DATA,
    H_STATUS,
    H_VAR,
    HANDLER,
    PAR_GATE,
    UNDECIDED,
    W_H,
    W_INNOV,
    W_OBS,
    W_PRED,
    W_RATIO,
    W_VAR,
)
from server.nav.ekf.states import ATT, VEL, WIND, X_POS, X_Q, X_VEL, X_WIND, packed
from server.nav.ekf.update import clear_row, correction_seen, fuse, project
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries
from server.nav.types import Float, Int

LEAST_M_S: Final = 5.0  # below it a pitot tube shows its zero error and the wind on the ground
NOISE_M_S: Final = 1.0
SHARE: Final = 0.05  # position error of the static port and an uncalibrated ratio
SLIP_RAD: Final = 0.1  # coordinated flight keeps the ball in the middle; gusts do not
CORRELATION: Final = 4.0  # variance factor: gusts and slips last longer than the interval
SEA_LEVEL_KG_M3: Final = 1.225
TOP_M_S: Final = 500.0


@kernel("float64(float64, float64, float64)")
def true_airspeed(diff_pressure_pa: float, tas_m_s: float, height_m: float) -> float:
    """Return the true airspeed, m/s, as reported, else from pressure and standard density [S0 eq. 3.24]; else NaN."""
    if math.isfinite(tas_m_s):
        return tas_m_s
    if not math.isfinite(diff_pressure_pa):
        return math.nan
    density = SEA_LEVEL_KG_M3 * max(0.1, 1.0 - 2.25577e-5 * height_m) ** 4.2559
    return math.sqrt(2.0 * max(0.0, diff_pressure_pa) / density)


@kernel("void(float64[::1], float64, float64, float64)")
def _against_air(work: Float, en: float, ee: float, ed: float) -> None:
    """Set the row of H along a direction in NED: it sees velocity less wind."""
    clear_row(work)
    work[W_H + VEL], work[W_H + VEL + 1], work[W_H + VEL + 2] = en, ee, ed
    work[W_H + WIND], work[W_H + WIND + 1] = -en, -ee


@kernel("void(float64[::1], float64[::1], float64[::1], float64[::1], float64, float64, float64)")
def _decide_and_fuse(
    h: Float, P: Float, par: Float, work: Float, observed: float, predicted: float, var: float
) -> None:
    """Gate once, then correct; H is in work."""
    work[W_OBS], work[W_PRED], work[W_INNOV] = observed, predicted, observed - predicted
    if h[H_STATUS] == UNDECIDED:
        h[H_VAR] = var
        work[W_VAR] = project(P, work) + var
        work[W_RATIO] = work[W_INNOV] ** 2 / (par[PAR_GATE] ** 2 * work[W_VAR])
        h[H_STATUS] = FUSED if work[W_RATIO] <= 1.0 else REFUSED_GATE
    if h[H_STATUS] == FUSED:
        total = project(P, work) + h[H_VAR]
        fuse(P, work, work[W_INNOV] - correction_seen(work), total)


@kernel(HANDLER)
def airspeed(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Handle an airspeed: data = differential pressure Pa, true airspeed m/s, either may be NaN."""
    speed = true_airspeed(h[H_DATA], h[H_DATA + 1], x[X_POS + 2])
    if not math.isfinite(speed) or speed > TOP_M_S:
        h[H_STATUS] = REFUSED_RANGE
        return
    work[W_OBS] = speed
    if h[H_STATUS] == UNDECIDED and speed < LEAST_M_S:
        h[H_STATUS] = REFUSED_NOT_READY
        return
    if not P[packed(WIND, WIND)] > 0.0:
        switch_wind_on(x, P, par, work)
    an, ae, ad = x[X_VEL] - x[X_WIND], x[X_VEL + 1] - x[X_WIND + 1], x[X_VEL + 2]
    predicted = math.sqrt(an * an + ae * ae + ad * ad)
    if predicted < 1.0:  # its direction is noise
        h[H_STATUS] = REFUSED_NOT_READY
        return
    _against_air(work, an / predicted, ae / predicted, ad / predicted)
    _decide_and_fuse(h, P, par, work, speed, predicted, CORRELATION * (NOISE_M_S + SHARE * speed) ** 2)


@kernel(HANDLER)
def sideslip(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Correct a fixed wing's sideways velocity against the air towards zero: R_bn (v − w) across, and [v − w]× δθ."""
    if not P[packed(WIND, WIND)] > 0.0:
        switch_wind_on(x, P, par, work)
    an, ae, ad = x[X_VEL] - x[X_WIND], x[X_VEL + 1] - x[X_WIND + 1], x[X_VEL + 2]
    R = matrix_entries(x[X_Q], x[X_Q + 1], x[X_Q + 2], x[X_Q + 3])
    rn, re, rd = R[1], R[4], R[7]
    _against_air(work, rn, re, rd)
    work[W_H + ATT] = re * ad - rd * ae
    work[W_H + ATT + 1] = rd * an - rn * ad
    work[W_H + ATT + 2] = rn * ae - re * an
    speed2 = an * an + ae * ae + ad * ad
    _decide_and_fuse(h, P, par, work, 0.0, rn * an + re * ae + rd * ad, CORRELATION * SLIP_RAD**2 * max(25.0, speed2))

"""Barometric height against height less the baro's datum, which drifts with the weather and is a state of its own."""

from __future__ import annotations

from typing import Final

from server.nav.codes import FUSED, REFUSED_GATE, REFUSED_STALE
from server.nav.ekf.aiding.gnss import tracked_ratio
from server.nav.ekf.blocks import start_datum
from server.nav.ekf.layout import (
    A_K_BARO,
    A_T_BARO,
    A_T_RESET,
    C_BARO_SEEN,
    H_DATA,
    H_STATUS,
    H_T,
    H_VAR,
    HANDLER,
    PAR_BARO_NOISE,
    PAR_GATE,
    RESET,
    U_T,
    UNDECIDED,
    W_H,
    W_INNOV,
    W_OBS,
    W_PRED,
    W_RATIO,
    W_VAR,
)
from server.nav.ekf.states import BARO, POS, X_BARO, X_POS, X_VEL, packed
from server.nav.ekf.update import clear_row, correction_seen, fuse, project
from server.nav.kernel import kernel
from server.nav.types import Float, Int

FLOOR_M: Final = 0.05
LEARN: Final = 0.02
DATUM_LOST_NS: Final = 10e9


@kernel(HANDLER)
def height(h: Float, x: Float, P: Float, u: Float, par: Float, aux: Float, ctl: Int, work: Float) -> None:
    """Handle a baro height: data = height m in the baro's own datum; decide at first use, then correct."""
    if h[H_T] < aux[A_T_RESET]:  # its datum belongs to the height that GNSS has put aside
        h[H_STATUS] = REFUSED_STALE
        return
    fresh = h[H_STATUS] == UNDECIDED
    if fresh and h[H_T] - aux[A_T_BARO] > DATUM_LOST_NS:
        ctl[C_BARO_SEEN] = 0  # contradicted that long, it is another datum: GNSS has carried the height meanwhile
    now = x[X_POS + 2] - (h[H_T] - u[U_T]) * 1e-9 * x[X_VEL + 2]
    if not ctl[C_BARO_SEEN] or h[H_STATUS] == RESET or not P[packed(BARO, BARO)] > 0.0:
        if h[H_VAR] == 0.0:
            h[H_VAR] = max(FLOOR_M**2, aux[A_K_BARO] * par[PAR_BARO_NOISE] ** 2)
        start_datum(x, P, work, now - h[H_DATA], h[H_VAR])
        work[W_OBS] = work[W_PRED] = now
        aux[A_T_BARO] = max(h[H_T], aux[A_T_BARO])
        ctl[C_BARO_SEEN] = 1
        h[H_STATUS] = RESET
        return
    work[W_OBS], work[W_PRED] = h[H_DATA] + x[X_BARO], now
    work[W_INNOV] = work[W_OBS] - now
    clear_row(work)
    work[W_H + POS + 2] = work[W_H + BARO] = -1.0
    own = project(P, work)
    if fresh:
        noise = par[PAR_BARO_NOISE] ** 2
        excess = (work[W_INNOV] ** 2 - own) / par[PAR_BARO_NOISE] ** 2
        tells = noise / (own + noise)  # while the height itself is uncertain nothing is learned
        aux[A_K_BARO] = tracked_ratio(aux[A_K_BARO], excess, LEARN * tells * tells)
        h[H_VAR] = max(FLOOR_M**2, aux[A_K_BARO] * par[PAR_BARO_NOISE] ** 2)
        work[W_VAR] = own + h[H_VAR]
        work[W_RATIO] = work[W_INNOV] ** 2 / (par[PAR_GATE] ** 2 * work[W_VAR])
        h[H_STATUS] = FUSED if work[W_RATIO] <= 1.0 else REFUSED_GATE
        if h[H_STATUS] == FUSED:
            aux[A_T_BARO] = h[H_T]
    if h[H_STATUS] == FUSED:
        fuse(P, work, work[W_INNOV] - correction_seen(work), own + h[H_VAR])

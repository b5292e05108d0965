"""Barometric height. Its datum drifts with the weather, so it is kept apart and tied slowly to GNSS heights."""

from __future__ import annotations

from typing import Final

from server.nav.codes import FUSED, REFUSED_GATE, REFUSED_STALE
from server.nav.ekf.aiding.gnss import tracked_ratio
from server.nav.ekf.layout import (
    A_BARO_OFFSET,
    A_BARO_OFFSET_VAR,
    A_K_BARO,
    A_T_BARO,
    A_T_RESET,
    C_BARO_SEEN,
    H_DATA,
    H_STATUS,
    H_T,
    H_VAR,
    HANDLER,
    PAR_BARO_DRIFT,
    PAR_BARO_NOISE,
    PAR_GATE,
    U_T,
    UNDECIDED,
    W_H,
    W_INNOV,
    W_OBS,
    W_PRED,
    W_RATIO,
    W_VAR,
)
from server.nav.ekf.states import POS, X_POS, X_VEL, packed
from server.nav.ekf.update import clear_row, correction_seen, fuse, project, reset_axis
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
    down = packed(POS + 2, POS + 2)
    if h[H_STATUS] == UNDECIDED and h[H_T] - aux[A_T_BARO] > DATUM_LOST_NS:
        ctl[C_BARO_SEEN] = 0  # contradicted that long, it is another datum: GNSS has carried the height meanwhile
    tau = (h[H_T] - u[U_T]) * 1e-9
    if not ctl[C_BARO_SEEN]:  # what is known of the height becomes what is known of the datum
        aux[A_BARO_OFFSET] = x[X_POS + 2] - tau * x[X_VEL + 2] - h[H_DATA]
        aux[A_BARO_OFFSET_VAR] = P[down]
        aux[A_T_BARO] = h[H_T]
        reset_axis(P, POS + 2, par[PAR_BARO_NOISE] ** 2)
        ctl[C_BARO_SEEN] = 1
    predicted = x[X_POS + 2] - tau * x[X_VEL + 2] - aux[A_BARO_OFFSET]
    work[W_INNOV] = h[H_DATA] - predicted
    work[W_OBS], work[W_PRED] = h[H_DATA] + aux[A_BARO_OFFSET], predicted + aux[A_BARO_OFFSET]
    if h[H_STATUS] == UNDECIDED:
        excess = (work[W_INNOV] ** 2 - P[down]) / par[PAR_BARO_NOISE] ** 2
        aux[A_K_BARO] = tracked_ratio(aux[A_K_BARO], excess, LEARN)
        h[H_VAR] = max(FLOOR_M**2, aux[A_K_BARO] * par[PAR_BARO_NOISE] ** 2)
        work[W_VAR] = P[down] + h[H_VAR]
        work[W_RATIO] = work[W_INNOV] ** 2 / (par[PAR_GATE] ** 2 * work[W_VAR])
        h[H_STATUS] = FUSED if work[W_RATIO] <= 1.0 else REFUSED_GATE
        if h[H_STATUS] == FUSED:
            aux[A_BARO_OFFSET_VAR] += par[PAR_BARO_DRIFT] ** 2 * max(0.0, h[H_T] - aux[A_T_BARO]) * 1e-9
            aux[A_T_BARO] = h[H_T]
    if h[H_STATUS] == FUSED:
        clear_row(work)
        work[W_H + POS + 2] = -1.0
        total = project(P, work) + h[H_VAR]
        fuse(P, work, work[W_INNOV] - correction_seen(work), total)

"""The preprocessed sensors as rows for people: what the estimators were given, one row per navigation step."""

from __future__ import annotations

import math

from server.nav.codes import AIRSPEED, BARO, FUSED, MAG
from server.nav.ekf.layout import (
    M_DATA,
    M_KIND,
    M_STATUS,
    M_STEP,
    U_ACCEL_MEAN,
    U_COUNT,
    U_GYRO_MEAN,
    U_TEMPERATURE,
    U_VIBRATION,
)
from server.nav.kernel import kernel
from server.nav.types import Float


@kernel("void(float64[:, ::1], float64[:, ::1], float64[::1], float64[:, ::1])")
def filtered_rows(steps: Float, meas: Float, held: Float, out: Float) -> None:
    """Write STEP_COLUMNS for each step; slower sensors hold their newest value.

    Args:
        steps: shape (n, U_SIZE). meas: shape (k, M_SIZE), in order of arrival.
        held: shape (5,), magnetic field gauss (3), baro altitude m, airspeed m/s, kept between calls; NaN unknown.
        out: shape (n, len(STEP_COLUMNS)), written.
    """
    k = 0
    for n in range(steps.shape[0]):
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            if meas[k, M_STATUS] == FUSED:
                if meas[k, M_KIND] == MAG:
                    held[0], held[1], held[2] = meas[k, M_DATA], meas[k, M_DATA + 1], meas[k, M_DATA + 2]
                elif meas[k, M_KIND] == BARO:
                    held[3] = meas[k, M_DATA + 1]
                elif meas[k, M_KIND] == AIRSPEED and math.isfinite(meas[k, M_DATA + 1]):
                    held[4] = meas[k, M_DATA + 1]
            k += 1
        for i in range(3):
            out[n, i], out[n, 3 + i] = steps[n, U_GYRO_MEAN + i], steps[n, U_ACCEL_MEAN + i]
        for i in range(5):
            out[n, 6 + i] = held[i]
        out[n, 11], out[n, 12], out[n, 13] = steps[n, U_VIBRATION], steps[n, U_TEMPERATURE], steps[n, U_COUNT]

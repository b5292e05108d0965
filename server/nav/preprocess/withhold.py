"""Measurements held back on purpose, marked once, before any lane sees them."""

from __future__ import annotations

from typing import Final

from server.nav.codes import AIRSPEED, BARO, FUSED, GNSS, MAG, REFUSED_DISABLED, REFUSED_DISTURBED, REFUSED_WITHHELD
from server.nav.ekf.layout import M_KIND, M_STATUS, M_T
from server.nav.kernel import kernel
from server.nav.types import Float

USE_GNSS: Final = 1
USE_BARO: Final = 2
USE_MAG: Final = 4
USE_AIRSPEED: Final = 8


@kernel("void(float64[:, ::1], float64[:, ::1], float64, int64)")
def withhold(meas: Float, withheld: Float, gnss_delay_s: float, use: int) -> None:
    """Set the status of measurements that are switched off, or of GNSS valid inside a withheld interval.

    Args:
        meas: shape (k, M_SIZE), marked in place.
        withheld: shape (j, 2), intervals [a, b) of validity, ns since the first sample.
        gnss_delay_s: a fix stamped t is valid at t − delay.
        use: bits USE_*.
    """
    for k in range(meas.shape[0]):
        m = meas[k]
        kind = int(m[M_KIND])
        if m[M_STATUS] != FUSED and not (kind == MAG and m[M_STATUS] == REFUSED_DISTURBED):  # a lane may use that one
            continue
        bit = USE_GNSS if kind == GNSS else (USE_BARO if kind == BARO else (USE_MAG if kind == MAG else 0))
        bit = USE_AIRSPEED if kind == AIRSPEED else bit
        if bit and not use & bit:
            m[M_STATUS] = REFUSED_DISABLED
        elif kind == GNSS:
            t = m[M_T] - gnss_delay_s * 1e9
            for i in range(withheld.shape[0]):
                if withheld[i, 0] <= t < withheld[i, 1]:
                    m[M_STATUS] = REFUSED_WITHHELD

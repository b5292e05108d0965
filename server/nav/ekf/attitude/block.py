"""The attitude mode over a block of steps and measurements, as the lanes get them."""

from __future__ import annotations

from server.nav.codes import FUSED, MAG, REFUSED_DISTURBED
from server.nav.ekf.attitude.run import step
from server.nav.ekf.attitude.sample import take_mag
from server.nav.ekf.layout import M_DATA, M_KIND, M_STATUS, M_STEP, M_T
from server.nav.kernel import kernel
from server.nav.types import Float


@kernel("void(float64[:, ::1], float64[:, ::1], float64, float64[::1], float64[::1], float64[:, ::1])")
def run_block(steps: Float, meas: Float, mag_delay_s: float, s: Float, par: Float, rows: Float) -> None:
    """Run over a block; a field of unlikely strength is taken too, because an attached magnet makes just that.

    Args:
        steps: shape (n, U_SIZE). meas: shape (k, M_SIZE), M_STEP ascending in [0, n); only magnetic ones are used.
        mag_delay_s: known age of the magnetometer's value at its stamp; what is left of it is learned.
        s, par: shapes (S_SIZE,) and (K_SIZE,), memory and parameters.
        rows: shape (n, O_SIZE), written.
    """
    k = 0
    for n in range(steps.shape[0]):
        step(steps[n], s, par, rows[n])
        while k < meas.shape[0] and meas[k, M_STEP] <= n:
            if meas[k, M_KIND] == MAG and meas[k, M_STATUS] in (FUSED, REFUSED_DISTURBED):
                take_mag(meas[k, M_DATA : M_DATA + 3], meas[k, M_T] - mag_delay_s * 1e9, s, par)
            k += 1

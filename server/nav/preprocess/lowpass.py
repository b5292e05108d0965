"""First-order low-pass, set by its cut-off frequency [S0 eq. 3.28-3.31].

y[n] = a x[n] + (1 − a) y[n − 1] with a = T / (T + RC) and RC = 1 / (2π f_c): the smaller a, the smoother. S0 uses
a = 0.98 and sees a long delay: it swapped the two weights. T is the interval at hand, so samples that come unevenly are
weighted by their time.
"""

from __future__ import annotations

import math

from server.nav.kernel import kernel
from server.nav.preprocess.chain_layout import Z_LOWPASS
from server.nav.types import Float


@kernel("float64(float64, float64)")
def weight(interval_s: float, cutoff_hz: float) -> float:
    """Return a, the new sample's weight."""
    return interval_s / (interval_s + 1.0 / (2.0 * math.pi * cutoff_hz))


@kernel("float64(float64)")
def lowpass_delay(cutoff_hz: float) -> float:
    """Return the group delay at frequency zero, s: (1 − a)/a samples of T, which is RC whatever the rate."""
    return 1.0 / (2.0 * math.pi * cutoff_hz) if cutoff_hz > 0.0 else 0.0


@kernel("float64(float64[::1], int64, float64, float64)")
def lowpass(c: Float, z: int, value: float, a: float) -> float:
    """Return the filtered value; the channel's states begin at c[z]."""
    c[z + Z_LOWPASS] += a * (value - c[z + Z_LOWPASS])
    return float(c[z + Z_LOWPASS])

"""Butterworth low-pass of order 1 to 4 as second-order sections, direct form II transposed [S1 eq. 3.14-3.15].

Poles of the analog prototype in pairs: s² + s/Q + 1 with 1/Q = 2 cos θ; an odd order has s + 1 besides. The bilinear
transform, warped so that the cut-off is met exactly, is s → (1/k) (1 − z⁻¹)/(1 + z⁻¹) with k = tan(π f_c T).
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.kernel import kernel
from server.nav.preprocess.chain_layout import SECTIONS, Z_SECTIONS
from server.nav.types import Float

HIGHEST: Final = 0.45
"""Share of the sample rate: a cut-off above it leaves nothing to filter, and the filter is left out."""


@kernel("int64(int64, float64, float64, float64[::1])")
def design(order: int, cutoff_hz: float, interval_s: float, out: Float) -> int:
    """Write the sections' coefficients; return how many sections there are, 0 when nothing is to be filtered.

    Args:
        order: 1 to 4.
        cutoff_hz: where the power is halved; 0 = no filter.
        interval_s: between samples.
        out: shape (SECTIONS · 5,), written: b0 b1 b2 a1 a2 of each section, a0 = 1.
    """
    if cutoff_hz <= 0.0 or interval_s <= 0.0 or cutoff_hz * interval_s >= HIGHEST:
        return 0
    k = math.tan(math.pi * cutoff_hz * interval_s)
    n = 0
    if order % 2 == 1:
        out[0] = out[1] = k / (1.0 + k)
        out[2] = out[4] = 0.0
        out[3] = (k - 1.0) / (k + 1.0)
        n = 1
    for pair in range(order // 2):
        damping = 2.0 * math.sin(math.pi * (2 * pair + 1) / (2 * order))
        a0 = 1.0 + damping * k + k * k
        b = 5 * n
        out[b] = out[b + 2] = k * k / a0
        out[b + 1] = 2.0 * k * k / a0
        out[b + 3] = 2.0 * (k * k - 1.0) / a0
        out[b + 4] = (1.0 - damping * k + k * k) / a0
        n += 1
    return n


@kernel("float64(float64[::1], int64, float64)")
def group_delay(coefficients: Float, sections: int, interval_s: float) -> float:
    """Return the group delay at frequency zero, s: Σ (Σ n b_n / Σ b_n − Σ n a_n / Σ a_n) T over the sections."""
    samples = 0.0
    for i in range(sections):
        k = 5 * i
        b0, b1, b2 = coefficients[k], coefficients[k + 1], coefficients[k + 2]
        a1, a2 = coefficients[k + 3], coefficients[k + 4]
        samples += (b1 + 2.0 * b2) / (b0 + b1 + b2) - (a1 + 2.0 * a2) / (1.0 + a1 + a2)
    return samples * interval_s


@kernel("float64(float64[::1], int64, int64, int64, float64)")
def butterworth(c: Float, k: int, sections: int, z: int, value: float) -> float:
    """Return the filtered value.

    Args:
        c: the chain's array. k: where the coefficients begin in it. sections: in use.
        z: where the channel's states begin in it.
    """
    for i in range(sections):
        b, s = k + 5 * i, z + Z_SECTIONS + 2 * i
        y = c[b] * value + c[s]
        c[s] = c[b + 1] * value - c[b + 3] * y + c[s + 1]
        c[s + 1] = c[b + 2] * value - c[b + 4] * y
        value = y
    return value


@kernel("void(float64[::1], int64, int64, float64, float64)")
def settle(c: Float, k: int, z: int, value: float, sign: float) -> None:
    """Add sign times the states that a constant value leaves behind, for all sections; unused ones hold zeros there.

    Setting them (from zero) starts the filter without a transient; taking the old coefficients' off and adding the
    new ones' changes the coefficients without a step.
    """
    for i in range(SECTIONS):
        b, s = k + 5 * i, z + Z_SECTIONS + 2 * i
        c[s] += sign * (1.0 - c[b]) * value
        c[s + 1] += sign * (c[b + 2] - c[b + 4]) * value

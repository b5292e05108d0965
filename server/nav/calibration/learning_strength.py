"""How much the strength of the field varies: moments of the readings, from which any constant offset can be judged.

With p = R̄ᵀ z and y = |z|² of a block's mean sample z, the strength squared without an offset b is y − 2 b·p + b². Its
variation over the turning that is remembered follows for every b from first and second moments of (p, y) alone, and the
least of it over all b is the unevenness of place and sensor, free of what is not known of the offset yet. It is S0's
pair (3.21) over all pairs of readings at once.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.calibration.learning_layout import (
    C_B_N,
    C_B_RM,
    C_B_Z,
    C_PATCH2,
    C_RESIDUAL2,
    C_U,
    C_U_P,
    C_U_RAD,
    C_U_SIZE,
    C_WHITE2,
    F_X,
    K_PATCH,
    K_PATCH_MAX,
    K_PATCH_MIN,
    OFFSET,
)
from server.nav.kernel import kernel
from server.nav.types import Float

MEMORY_RAD: Final = 20.0  # turning over which it is averaged
FREE: Final = 4.0  # numbers that a fit of strength and offset takes from the data
ALIKE_RAD: Final = 0.35  # turning after which another reading tells something new
BELIEF: Final = 0.7  # readings that the first guess at the unevenness counts for
RIDGE2: Final = 1e-6  # gauss²: directions in which the readings hardly differ fit nothing


@kernel("UniTuple(float64, 4)(float64[::1])")
def reading(c: Float) -> tuple[float, float, float, float]:
    """Return (p, y) of the open block: its mean sample in the body, and |mean in frame i|²."""
    n = c[C_B_N]
    z0, z1, z2 = c[C_B_Z] / n, c[C_B_Z + 1] / n, c[C_B_Z + 2] / n
    p0 = (c[C_B_RM] * z0 + c[C_B_RM + 3] * z1 + c[C_B_RM + 6] * z2) / n
    p1 = (c[C_B_RM + 1] * z0 + c[C_B_RM + 4] * z1 + c[C_B_RM + 7] * z2) / n
    p2 = (c[C_B_RM + 2] * z0 + c[C_B_RM + 5] * z1 + c[C_B_RM + 8] * z2) / n
    return p0, p1, p2, z0 * z0 + z1 * z1 + z2 * z2


@kernel("float64(float64[::1], float64[::1])")
def departure2(s: Float, c: Float) -> float:
    """Return (strength without the filter's offset − its RMS over what is remembered)², gauss²; 0 before that."""
    if c[C_U_RAD] == 0.0:
        return 0.0
    p0, p1, p2, y = reading(c)
    b0, b1, b2 = s[F_X + OFFSET], s[F_X + OFFSET + 1], s[F_X + OFFSET + 2]
    own2 = b0 * b0 + b1 * b1 + b2 * b2
    now2 = y - 2.0 * (b0 * p0 + b1 * p1 + b2 * p2) + own2
    mean2 = c[C_U + 3] - 2.0 * (b0 * c[C_U] + b1 * c[C_U + 1] + b2 * c[C_U + 2]) + own2
    return (math.sqrt(max(0.0, now2)) - math.sqrt(max(0.0, mean2))) ** 2


@kernel("void(float64[::1])")
def forget_strength(c: Float) -> None:
    """Start anew: field or offset have changed."""
    for i in range(C_U_SIZE):
        c[C_U + i] = 0.0


@kernel("void(float64[::1], float64)")
def remember_strength(c: Float, rad: float) -> None:
    """Add the open block after a turn of `rad`: running mean (4) and covariance (4, 4) of (p, y)."""
    x = reading(c)
    c[C_U_RAD] = min(c[C_U_RAD] + rad, MEMORY_RAD)
    blend = min(1.0, rad / c[C_U_RAD])
    keep = 1.0 - blend
    d0, d1, d2, d3 = x[0] - c[C_U], x[1] - c[C_U + 1], x[2] - c[C_U + 2], x[3] - c[C_U + 3]
    d = (d0, d1, d2, d3)
    for i in range(4):
        c[C_U + i] += blend * d[i]
        for j in range(4):
            c[C_U_P + 4 * i + j] = keep * (c[C_U_P + 4 * i + j] + blend * d[i] * d[j])


@kernel("float64(float64[::1])")
def _least(c: Float) -> float:
    """Return the variance of y − 2 b·p for the b that makes it least, by Cholesky, gauss⁴."""
    p = C_U_P
    a00, a11, a22 = c[p] + RIDGE2, c[p + 5] + RIDGE2, c[p + 10] + RIDGE2
    l00 = math.sqrt(a00)
    l10, l20 = c[p + 1] / l00, c[p + 2] / l00
    l11 = math.sqrt(max(a11 - l10 * l10, RIDGE2))
    l21 = (c[p + 6] - l20 * l10) / l11
    l22 = math.sqrt(max(a22 - l20 * l20 - l21 * l21, RIDGE2))
    v0 = c[p + 3] / l00
    v1 = (c[p + 7] - l10 * v0) / l11
    v2 = (c[p + 11] - l20 * v0 - l21 * v1) / l22
    return float(max(0.0, c[p + 15] - v0 * v0 - v1 * v1 - v2 * v2))


@kernel("void(float64[::1], float64[::1], float64[::1])")
def learn_unevenness(s: Float, c: Float, par: Float) -> None:
    """Set the unevenness to what the best constant offset leaves, weighed with the first guess."""
    b0, b1, b2 = s[F_X + OFFSET], s[F_X + OFFSET + 1], s[F_X + OFFSET + 2]
    mean2 = c[C_U + 3] - 2.0 * (b0 * c[C_U] + b1 * c[C_U + 1] + b2 * c[C_U + 2]) + b0 * b0 + b1 * b1 + b2 * b2
    if not mean2 > 0.0:
        return
    varies2 = _least(c) / (4.0 * mean2)
    n = c[C_U_RAD] / ALIKE_RAD
    told = max(0.0, n - FREE)
    c[C_RESIDUAL2] = (BELIEF * par[K_PATCH] ** 2 + n * varies2) / (BELIEF + told)
    even2 = c[C_RESIDUAL2] - min(c[C_WHITE2] / c[C_B_N], 0.5 * c[C_RESIDUAL2])
    c[C_PATCH2] = min(max(even2, par[K_PATCH_MIN] ** 2), par[K_PATCH_MAX] ** 2)

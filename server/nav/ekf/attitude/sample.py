"""Magnetic samples: collected in NED over a block, and compared with what the filter expects.

In NED, with q_true = Exp(δθ) q and the field's error held as ξ = δf − δθ × f: R̂ z = f + ξ + R̂ o + τ ω × f, free of δθ.
"""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf.attitude.layout import (
    FIELD,
    MAG_DELAY,
    MAG_OFFSET,
    S_H,
    S_M_COUNT,
    S_M_R,
    S_M_SIZE,
    S_M_W,
    S_M_Z,
    S_Q,
    S_STARTED,
    S_T,
    S_W,
    S_X,
)
from server.nav.ekf.attitude.parameters import K_SIZE
from server.nav.ekf.attitude.update import clear_row
from server.nav.kernel import kernel
from server.nav.rotation import matrix_entries, quat_from_rotvec, quat_mul
from server.nav.types import Float

OLDEST_S: Final = 0.1
"""The attitude is carried back to a sample's time with the newest rate, but not further than this."""
LARGEST_GAUSS: Final = 16.0  # full scale of common magnetometers


@kernel("void(float64[::1], float64, float64[::1], float64[::1])")
def take_mag(m_b: Float, t_ns: float, s: Float, par: Float) -> None:
    """Collect one magnetic sample; it is used when the next block of steps closes.

    Args:
        m_b: shape (3,), body FRD, gauss. Not finite or absurd: ignored.
        t_ns: time of validity on the clock of U_T; call it after the step that contains it.
        s, par: shapes (S_SIZE,) and (K_SIZE,), memory and parameters.
    """
    size = abs(m_b[0]) + abs(m_b[1]) + abs(m_b[2])
    if s[S_STARTED] == 0.0 or par.shape[0] != K_SIZE or not 0.0 < size < LARGEST_GAUSS:
        return
    age = min(max((s[S_T] - t_ns) * 1e-9, -OLDEST_S), OLDEST_S)
    back = quat_from_rotvec(-s[S_W] * age, -s[S_W + 1] * age, -s[S_W + 2] * age)
    q = quat_mul(s[S_Q], s[S_Q + 1], s[S_Q + 2], s[S_Q + 3], back[0], back[1], back[2], back[3])
    R = matrix_entries(q[0], q[1], q[2], q[3])
    for i in range(3):
        s[S_M_Z + i] += R[3 * i] * m_b[0] + R[3 * i + 1] * m_b[1] + R[3 * i + 2] * m_b[2]
        s[S_M_W + i] += R[3 * i] * s[S_W] + R[3 * i + 1] * s[S_W + 1] + R[3 * i + 2] * s[S_W + 2]
        for j in range(3):
            s[S_M_R + 3 * i + j] += R[3 * i + j]
    s[S_M_COUNT] += 1.0


@kernel("void(float64[::1])")
def clear_samples(s: Float) -> None:
    """Forget the samples collected."""
    for i in range(S_M_SIZE):
        s[S_M_COUNT + i] = 0.0


@kernel("float64(float64[::1])")
def level_field(s: Float) -> float:
    """Return the horizontal part of the mean sample, gauss."""
    return float(math.hypot(s[S_M_Z], s[S_M_Z + 1]) / s[S_M_COUNT])


@kernel("void(float64[::1], int64)")
def field_row(s: Float, i: int) -> None:
    """Set H for component i, NED, of the mean sample."""
    n, f, w = s[S_M_COUNT], S_X + FIELD, S_M_W
    j, k = (i + 1) % 3, (i + 2) % 3
    clear_row(s)
    s[S_H + FIELD + i] = 1.0
    for c in range(3):
        s[S_H + MAG_OFFSET + c] = s[S_M_R + 3 * i + c] / n
    s[S_H + MAG_DELAY] = (s[w + j] * s[f + k] - s[w + k] * s[f + j]) / n


@kernel("float64(float64[::1], int64)")
def innovation(s: Float, i: int) -> float:
    """Return component i, NED, of the mean sample minus the expected one, gauss."""
    n, f, o, w = s[S_M_COUNT], S_X + FIELD, S_X + MAG_OFFSET, S_M_W
    j, k = (i + 1) % 3, (i + 2) % 3
    y = s[S_M_Z + i] / n - s[f + i] - s[S_X + MAG_DELAY] * (s[w + j] * s[f + k] - s[w + k] * s[f + j]) / n
    for c in range(3):
        y -= s[S_M_R + 3 * i + c] / n * s[o + c]
    return float(y)

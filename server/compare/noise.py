"""A lane's jitter: what it does from step to step while the board itself does nothing.

White noise of standard deviation σ has second differences x[k−1] − 2 x[k] + x[k+1] of variance 6 σ²; their RMS / √6 in
quiet seconds is therefore σ for white noise, and less for noise that a filter has smoothed. Slow errors do not count.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.compare.contract import NoiseOut
from server.compare.signals import Rows, roll_pitch_yaw
from server.nav.types import Float, Int

LEAST_TRIPLES: Final = 100


def noise(rows: Rows, quiet_t_ns: Int, quiet: Float) -> NoiseOut | None:
    """Return the jitter of everything the lane knows, None when it was never quiet for long enough.

    Args:
        rows: the lane's.
        quiet_t_ns: shape (n,), ascending stamps.
        quiet: shape (n,), 1 where the board was quiet around that stamp, else 0.
    """
    if not len(quiet_t_ns) or not len(rows.t_ns):
        return None
    nearest = np.clip(np.searchsorted(quiet_t_ns, rows.t_ns), 0, len(quiet_t_ns) - 1)
    calm = (quiet[nearest] > 0.0) & (np.abs(quiet_t_ns[nearest] - rows.t_ns) < 50_000_000)
    angles = roll_pitch_yaw(rows.data[:, :4])
    out = NoiseOut(
        tilt_rad=jitter(rows.t_ns, angles[:, :2], calm, period=2.0 * math.pi),
        heading_rad=jitter(rows.t_ns, angles[:, 2:], calm, period=2.0 * math.pi),
        height_m=jitter(rows.t_ns, rows.data[:, 6:7], calm),
        vertical_m_s=jitter(rows.t_ns, rows.data[:, 9:10], calm),
        horizontal_m_s=jitter(rows.t_ns, rows.data[:, 7:9], calm),
    )
    return out if any(value is not None for value in out.model_dump().values()) else None


def jitter(t_ns: Int, values: Float, calm: np.ndarray, period: float = 0.0) -> float | None:
    """Return the RMS second difference / √6 over evenly spaced calm triples; None for fewer than LEAST_TRIPLES.

    Args:
        t_ns: shape (n,), ascending.
        values: shape (n, axes); rows with NaN are left out, neighbours then being further apart.
        calm: shape (n,), bool.
        period: of an angle, 0 for other values.
    """
    known = np.isfinite(values).all(axis=1)
    t, v, calm = t_ns[known], values[known], calm[known]
    if len(t) < LEAST_TRIPLES + 2:
        return None
    steps_ns = np.diff(t)
    usual_ns = float(np.median(steps_ns))
    even = np.abs(steps_ns - usual_ns) <= 0.5 * usual_ns
    first = np.diff(v, axis=0)
    if period:
        first = np.remainder(first + 0.5 * period, period) - 0.5 * period
    second = np.diff(first, axis=0)[even[1:] & even[:-1] & calm[2:] & calm[1:-1] & calm[:-2]]
    return math.sqrt(float((second * second).mean()) / 6.0) if len(second) >= LEAST_TRIPLES else None

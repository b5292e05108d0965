"""How late a lane is against the reference: the shift at which their motions are most alike.

Both are put on one even grid, the lane's own spacing. r(τ) = Σ a(t + τ)·b(t) / √(Σ a² · Σ b²) over stamps both know,
means removed; its peak within ±1 s, refined by the parabola through the three highest lags, is the delay.

Its standard error comes from ten parts of the record: what is left after the shift, regressed on the motion's
derivative in each, says how differently they would have it. Slow motion tells little of a delay; the figure says so.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.signal import correlate as fft_correlate

from server.compare.contract import DelayOut, DelaysOut
from server.compare.signals import Rows, body_rates
from server.nav.types import Float
from server.replay.interpolate import sampled

LONGEST_S: Final = 1.0
LEAST_PEAK: Final = 0.7
LEAST_SAMPLES: Final = 100
PARTS: Final = 10
ROUNDING: Final = 1e-9
LEAST_RATE_RAD_S: Final = 0.02
LEAST_VERTICAL_M_S: Final = 0.3
LEAST_HORIZONTAL_M_S: Final = 0.3
"""RMS of the reference's motion below which there is nothing to line up."""
LEAST_SPACING_S: Final = 0.002


def delays(lane: Rows, reference: Rows) -> DelaysOut:
    """Return how late the lane's attitude, height and horizontal velocity are."""
    grid = _grid(lane, reference)
    if grid is None:
        return DelaysOut(attitude=None, vertical=None, horizontal=None)
    spacing_s, ours, theirs = grid
    vertical = [_vertical(rows, spacing_s) for rows in (ours, theirs)]
    if np.isnan(vertical[0][1]).all() or np.isnan(vertical[1][1]).all():  # one has no vertical speed: heights alone
        vertical = [(speed, speed) for speed, _ in vertical]
    return DelaysOut(
        attitude=correlate(
            body_rates(ours[:, :4], spacing_s), body_rates(theirs[:, :4], spacing_s), spacing_s, LEAST_RATE_RAD_S
        ),
        vertical=correlate(vertical[0][1][:, None], vertical[1][1][:, None], spacing_s, LEAST_VERTICAL_M_S),
        horizontal=correlate(ours[:, 7:9], theirs[:, 7:9], spacing_s, LEAST_HORIZONTAL_M_S),
    )


def _grid(lane: Rows, reference: Rows) -> tuple[float, Float, Float] | None:
    """Return the spacing in s and both on an even grid over the stretch that both cover; None when there is none."""
    if len(lane.t_ns) < LEAST_SAMPLES or len(reference.t_ns) < LEAST_SAMPLES:
        return None
    step_ns = max(int(np.median(np.diff(lane.t_ns))), round(LEAST_SPACING_S * 1e9))
    first = int(lane.t_ns[np.searchsorted(lane.t_ns, max(lane.t_ns[0], reference.t_ns[0]))])
    at_ns = np.arange(first, min(lane.t_ns[-1], reference.t_ns[-1]) + 1, step_ns, dtype=np.int64)
    ours, theirs = (sampled(at_ns, each.t_ns, np.ascontiguousarray(each.data[:, :10])) for each in (lane, reference))
    return step_ns * 1e-9, ours, theirs


def _vertical(rows: Float, spacing_s: float) -> tuple[Float, Float]:
    """Return the vertical speed upwards from the height, and as the rows themselves say."""
    if len(rows) < 2:
        return np.empty(0), np.empty(0)
    return np.gradient(rows[:, 6], spacing_s), -rows[:, 9]


def correlate(late: Float, early: Float, spacing_s: float, least_rms: float) -> DelayOut | None:
    """Return by how much `late` lags `early`; None without excitation, resemblance, or a peak inside the search.

    Args:
        late: shape (n, axes); NaN = unknown.
        early: the same, on the same even grid.
        spacing_s: of the grid.
        least_rms: of `early` about its mean, all axes together, for there to be excitation.
    """
    a, b = _centred(late), _centred(early)
    known = np.isfinite(early).all(axis=1)
    most = min(math.ceil(LONGEST_S / spacing_s), len(a) // 4)
    if known.sum() < LEAST_SAMPLES or most < 2:
        return None
    if math.sqrt(float((b[known] ** 2).sum(axis=1).mean())) < least_rms:
        return None
    lags = np.arange(-most, most + 1)
    r = _resemblances(a, b, most)
    top = int(np.argmax(r))
    if not 0 < top < len(r) - 1 or r[top] < LEAST_PEAK:
        return None
    before, peak, after = r[top - 1 : top + 2].tolist()
    curve = before - 2.0 * peak + after
    if curve >= 0.0:
        return None
    shift = 0.5 * (before - after) / curve
    peak = min(peak - 0.25 * (before - after) * shift, 1.0)
    return DelayOut(
        delay_s=(float(lags[top]) + shift) * spacing_s,
        standard_error_s=_standard_error(a, b, int(lags[top]), shift) * spacing_s,
        peak=peak,
    )


def _centred(values: Float) -> Float:
    """Return the values about their mean; rows with an unknown one become NaN throughout."""
    known = np.asarray(np.isfinite(values).all(axis=1))
    mean = values[known].mean(axis=0) if known.any() else 0.0
    return np.asarray(np.where(known[:, None], values - mean, np.nan))


def _shifted(a: Float, b: Float, lag: int) -> tuple[Float, Float]:
    """Return a(t + lag) and b(t) where both exist."""
    n = len(a) - abs(lag)
    return a[max(lag, 0) : max(lag, 0) + n], b[max(-lag, 0) : max(-lag, 0) + n]


def _standard_error(a: Float, b: Float, lag: int, shift: float) -> float:
    """Return the standard error of a delay of lag + shift in samples, its parts taken as independent."""
    x, y = _shifted(a, b, lag)
    slope = np.gradient(y, axis=0)
    both = np.flatnonzero(np.isfinite(x[:, 0] + slope[:, 0]))
    products = -((x - y) * slope)[both].sum(axis=1)
    squares = (slope * slope)[both].sum(axis=1)
    parts = np.array([[part.sum() for part in np.array_split(each, PARTS)] for each in (products, squares)])
    scatter = math.sqrt(float(((parts[0] - shift * parts[1]) ** 2).sum()) * PARTS / (PARTS - 1))
    total = float(parts[1].sum())
    return scatter / total if total > 0.0 else math.inf


def _resemblances(a: Float, b: Float, most: int) -> Float:
    """Return the correlation of a(t + lag) with b(t), over the rows both know, for lags from −most to most."""
    known = [np.isfinite(each[:, 0]).astype(np.float64) for each in (a, b)]
    x, y = np.nan_to_num(a), np.nan_to_num(b)
    middle = slice(len(b) - 1 - most, len(b) + most)

    def over_lags(one: Float, other: Float) -> Float:
        return np.asarray(fft_correlate(one, other, mode="full", method="fft")[middle])

    products = sum((over_lags(x[:, axis], y[:, axis]) for axis in range(x.shape[1])), np.zeros(2 * most + 1))
    squares = over_lags((x * x).sum(axis=1), known[1]) * over_lags(known[0], (y * y).sum(axis=1))
    size = np.sqrt(np.maximum(squares, 0.0))
    usable = size > ROUNDING * size.max()
    return np.divide(products, size, out=np.zeros_like(products), where=usable)

"""Moving mean over the newest samples [S0 §3.4.2], and the wait of a quicker sensor for a slower one."""

from __future__ import annotations

from server.nav.kernel import kernel
from server.nav.preprocess.chain_layout import WINDOW_MAX, Z_RING
from server.nav.types import Float


@kernel("float64(int64, int64, float64)")
def window_delay(samples: int, lag: int, interval_s: float) -> float:
    """Return the group delay, s: half the window's span, and the wait."""
    return (0.5 * (samples - 1) + lag) * interval_s


@kernel("float64(float64[::1], int64, int64, float64, int64, int64, int64)")
def window(c: Float, z: int, head: int, value: float, samples: int, lag: int, filled: int) -> float:
    """Put the value into the ring; return the mean of `samples` values, the newest of which is `lag` old.

    The sum is taken anew each time: a running one collects rounding errors for as long as the board is on. Until the
    ring holds enough, the mean is over those that are there.

    Args:
        c: the chain's array. z: where the channel's states begin in it.
        head: place in the ring for this value.
        samples, lag: together at most WINDOW_MAX.
        filled: values in the ring before this one.
    """
    c[z + Z_RING + head] = value
    have = filled + 1
    begin = min(lag, have - 1)
    end = min(lag + samples, have)
    total = 0.0
    for i in range(begin, end):
        total += c[z + Z_RING + (head - i) % WINDOW_MAX]
    return total / (end - begin)

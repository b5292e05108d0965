"""Random errors of the demo board's sensors: drift with a memory, the on-board low-pass, vibration."""

from __future__ import annotations

import math

import numpy as np

from server.nav.types import Float


class GaussMarkov:
    """First-order Gauss-Markov errors: each of standard deviation sigma, forgotten over tau."""

    def __init__(self, rng: np.random.Generator, sigma: Float, tau_s: float, step_s: float) -> None:
        self._rng = rng
        self._decay = math.exp(-step_s / tau_s)
        self._drive = sigma * math.sqrt(1.0 - self._decay**2)
        self.value = sigma * rng.standard_normal(sigma.shape)

    def step(self) -> Float:
        """Advance by one step and return the new errors."""
        self.value = self._decay * self.value + self._drive * self._rng.standard_normal(self._drive.shape)
        return self.value


class LowPass:
    """The board's IMU filter: second-order Butterworth, then a mean over `mean` samples; as one finite response."""

    def __init__(self, delay_s: float, mean: int, step_s: float) -> None:
        """Set the filter up so that slow signals leave it `delay_s` late."""
        self._taps = _response(delay_s - 0.5 * (mean - 1) * step_s, step_s)
        self._taps = np.convolve(self._taps, np.full(mean, 1.0 / mean))
        self._tail: Float | None = None

    def step(self, rows: Float) -> Float:
        """Return the filtered rows, shape (n, c) as given; before the first row its value had always been there."""
        if self._tail is None:
            self._tail = np.repeat(rows[:1], self._taps.size - 1, axis=0)
        full = np.concatenate([self._tail, rows])
        self._tail = full[rows.shape[0] :]
        return np.stack([np.convolve(column, self._taps, "valid") for column in full.T], axis=1)


def _response(delay_s: float, step_s: float) -> Float:
    """Return the impulse response of a Butterworth low-pass with the given delay at zero frequency.

    For H(s) = Ω²/(s² + √2 Ω s + Ω²) that delay is √2/Ω, and the bilinear transform keeps it exactly.
    """
    k = 2.0 * delay_s / (math.sqrt(2.0) * step_s)  # 2/(Ω·step)
    a0, a1, a2 = k * k + math.sqrt(2.0) * k + 1.0, 2.0 - 2.0 * k * k, k * k - math.sqrt(2.0) * k + 1.0
    n = math.ceil(12.0 * delay_s / step_s)
    taps = np.zeros(n + 2)
    for i, x in enumerate([1.0, 2.0, 1.0] + [0.0] * (n - 3)):
        taps[i + 2] = (x - a1 * taps[i + 1] - a2 * taps[i]) / a0
    return np.asarray(taps[2:] / taps.sum())


def quantised(values: Float, step: float) -> Float:
    """Return the nearest multiples of `step`; the values themselves when it is 0."""
    return np.round(values / step) * step if step > 0.0 else values

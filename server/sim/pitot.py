"""The demo board's pressure tube, which it has with `errors=raw` only: pitot along body x against static pressure."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.types import Float
from server.sim.noise import GaussMarkov
from server.sim.truth import TruthState

AIR_KG_M3: Final = 1.17
"""Standard density at the site."""
NOISE_PA: Final = 0.8  # Sensirion SDP3x 0.1 Pa, TE MS4525 2 Pa
DRIFT_PA: Final = 0.3
DRIFT_S: Final = 200.0
FAN_M_S: Final = 8.0
FAN_SWING_M_S: Final = 5.0
FAN_S: Final = 2.5
"""A fan that swings to and fro: 5 to 100 Pa. Regular, so that a few seconds are enough to see it."""
GUST_M_S: Final = 1.5
GUST_S: Final = 1.0
STEP_S: Final = 0.1


class Pitot:
    """Differential pressure ten times a second."""

    def __init__(self, rng: np.random.Generator, noise: float, offset_pa: float) -> None:
        self._rng, self._noise, self._offset_pa = rng, noise, offset_pa
        self._drift = GaussMarkov(rng, np.array([noise * DRIFT_PA]), DRIFT_S, 2.0 * STEP_S)
        self._gust = GaussMarkov(rng, np.array([GUST_M_S]), GUST_S, STEP_S)
        self._last: Float | None = None

    def step(self, state: TruthState, is_windy: bool) -> Float:
        """Return the values in force at the start, middle and end of a block of 200 ticks, Pa, shape (3,).

        Args:
            state: truth of the block, 201 rows.
            is_windy: gusts blow into the tube, wherever the board is.
        """
        rows = slice(100, None, 100)
        speed = np.vecmat(state.vel_n_m_s[rows] - state.wind_n_m_s[rows], state.R_nb[rows])[:, 0]
        fan = FAN_M_S + FAN_SWING_M_S * np.sin(2.0 * math.pi / FAN_S * state.t_s[rows])
        gusts = np.concatenate([self._gust.step(), self._gust.step()])
        speed = speed + (fan + gusts if is_windy else 0.0)
        fresh = 0.5 * AIR_KG_M3 * np.maximum(speed, 0.0) ** 2 + self._offset_pa + self._drift.step()
        fresh = fresh + self._noise * NOISE_PA * self._rng.standard_normal(2)
        values = np.concatenate([fresh[:1] if self._last is None else self._last, fresh])
        self._last = values[-1:]
        return values

"""The "autopilot's own estimate" of the demo board: truth plus plausible errors, not the work of a filter.

It stands in for what a board's EKF reports, so that the `onboard` lane has something to show. Its errors wander as such
an estimate's do: half a degree of heading, the receiver's slow position error, drift without GNSS, recovery after.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.types import Float, Int
from server.sim.noise import GaussMarkov
from server.sim.sensors import BLOCK, BLOCK_S, SensorBlock
from server.sim.settings import SimSettings

TILT_RAD: Final = math.radians(0.15)
HEADING_RAD: Final = math.radians(0.5)
ATTITUDE_S: Final = 40.0
VELOCITY_M_S: Final = 0.03
VELOCITY_S: Final = 4.0
POSITION_M: Final = np.array([0.08, 0.08, 0.12])
POSITION_S: Final = 10.0
DRIFT_M_S2: Final = np.array([0.012, -0.016, 0.0])
"""A tilt error of 0.1° without GNSS to correct it."""
RECOVERY_S: Final = 1.5


class Onboard:
    """The emulated estimate; errors run in a straight line over each block, so they have no steps."""

    def __init__(self, settings: SimSettings) -> None:
        rng = np.random.default_rng([settings.seed, 3])
        noise = settings.noise
        attitude = noise * np.array([TILT_RAD, TILT_RAD, HEADING_RAD])
        self._attitude = GaussMarkov(rng, attitude, ATTITUDE_S, BLOCK_S)
        self._velocity = GaussMarkov(rng, np.full(3, noise * VELOCITY_M_S), VELOCITY_S, BLOCK_S)
        self._position = GaussMarkov(rng, noise * POSITION_M, POSITION_S, BLOCK_S)
        self._outages_s = settings.outages_s
        self._after = self._errors(np.zeros(3))
        self._before = self._after

    def step(self, gnss_error_n_m: Float) -> None:
        """Move on to the next block; `gnss_error_n_m` is the receiver's slow error, shape (3,)."""
        for source in (self._attitude, self._velocity, self._position):
            source.step()
        self._before, self._after = self._after, self._errors(gnss_error_n_m)

    def _errors(self, gnss_error_n_m: Float) -> Float:
        position = self._position.value + gnss_error_n_m * [1.0, 1.0, 0.3]  # baro carries most of the height
        return np.concatenate([self._attitude.value, self._velocity.value, position])

    def rows(self, block: SensorBlock, row: Int) -> tuple[Float, Float, Float]:
        """Return q_nb (n, 4), velocity (n, 3) and position (n, 3), NED from the site, at rows of `block.state`."""
        share = (row / BLOCK)[:, None]
        error = self._before + share * (self._after - self._before)
        state = block.state
        moved, faster = self._drift(state.t_s[row])
        q_nb = _turned(error[:, :3], state.q_nb[row])
        return q_nb, state.vel_n_m_s[row] + error[:, 3:6] + faster, state.pos_n_m[row] + error[:, 6:] + moved

    def _drift(self, t_s: Float) -> tuple[Float, Float]:
        """Return position and velocity error from dead reckoning, each (n, 3)."""
        moved, faster = np.zeros((t_s.size, 3)), np.zeros((t_s.size, 3))
        for start_s, end_s in self._outages_s:
            blind_s = np.clip(t_s - start_s, 0.0, end_s - start_s)[:, None]
            fade = np.exp(-np.maximum(t_s - end_s, 0.0) / RECOVERY_S)[:, None]
            moved += 0.5 * DRIFT_M_S2 * blind_s**2 * fade
            faster += DRIFT_M_S2 * blind_s * fade
        return moved, faster


def _turned(error_n_rad: Float, q_nb: Float) -> Float:
    """Return Exp(error) ⊗ q_nb with w ≥ 0, for small errors about the NED axes."""
    w, v = q_nb[:, :1], q_nb[:, 1:]
    half = 0.5 * error_n_rad
    scalar = w - np.sum(half * v, axis=1, keepdims=True)
    vector = v + w * half + np.cross(half, v)
    q = np.concatenate([scalar, vector], axis=1)
    return np.asarray(q * np.sign(scalar) / np.linalg.norm(q, axis=1, keepdims=True))

"""A board that turns in a known field: navigation steps and magnetic measurements with everything known about them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from server.nav.calibration.mag_learning import MagLearner, MagLearnState
from server.nav.codes import FUSED, MAG
from server.nav.ekf import layout as at

Floats = np.ndarray[Any, np.dtype[np.float64]]
FIELD_N = np.array([0.21, 0.02, 0.43])
STEP_HZ = 50.0
FINE = 4  # the truth is known at this multiple of the step rate


def nothing(t_s: Floats) -> Floats:
    """No disturbance."""
    return np.zeros((len(t_s), 3))


@dataclass(kw_only=True)
class World:
    """What is simulated; rates in rad/s, field in gauss, time in s."""

    duration_s: float = 60.0
    seed: int = 1
    rate_rad_s: float = 1.0
    rest_s: float = 0.0
    offset: tuple[float, float, float] = (0.12, -0.07, 0.2)
    attached: Callable[[Floats], Floats] = nothing  # body
    room: Callable[[Floats], Floats] = nothing  # NED
    soft_iron: Floats = field(default_factory=lambda: np.eye(3))
    noise: float = 0.005
    gyro_noise: float = 0.003
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_matrix: Floats = field(default_factory=lambda: np.eye(3))
    mag_hz: float = 50.0
    delay_s: float = 0.0
    uneven: float = 0.0  # σ of a field that changes from place to place, over about 2 s
    one_axis: bool = False


def _rates(world: World, t_s: Floats, rng: np.random.Generator) -> Floats:
    """Sums of sines of unlike frequencies about all axes, none of them before the rest ends."""
    rate = np.zeros((len(t_s), 3))
    for axis in range(3):
        for _ in range(4):
            rate[:, axis] += np.sin(2 * np.pi * rng.uniform(0.03, 0.4) * t_s + rng.uniform(0, 2 * np.pi))
    if world.one_axis:
        rate[:, :2] = 0.0
    rate *= world.rate_rad_s / np.sqrt(2.0)
    rate[t_s < world.rest_s] = 0.0
    return rate


def _wander(t_s: Floats, sigma: float, rng: np.random.Generator) -> Floats:
    """A random field, correlated over 2 s."""
    decay = np.exp(-(t_s[1] - t_s[0]) / 2.0)
    drive = np.sqrt(1 - decay**2) * sigma * rng.standard_normal((len(t_s), 3))
    return np.asarray(lfilter([1.0], [1.0, -decay], drive, axis=0))


def simulate(world: World) -> tuple[Floats, Floats]:
    """Return (steps, meas) of `server.nav.ekf.layout`."""
    rng = np.random.default_rng(world.seed)
    dt = 1.0 / (STEP_HZ * FINE)
    t_s = np.arange(round(world.duration_s / dt) + 1) * dt
    rate = _rates(world, t_s, rng)
    first = Rotation.from_rotvec(rng.standard_normal((1, 3)))
    turns = Rotation.concatenate([first, Rotation.from_rotvec(rate[:-1] * dt)])
    R = _running_product(turns).as_matrix()
    return _steps(world, rate, dt, rng), _meas(world, t_s, R, rng)


def _running_product(turns: Rotation) -> Rotation:
    """Return all products turns[0] … turns[k], by doubling the reach."""
    reach = 1
    while reach < len(turns):
        turns = Rotation.concatenate([turns[:reach], turns[:-reach] * turns[reach:]])
        reach *= 2
    return turns


def _steps(world: World, rate: Floats, dt: float, rng: np.random.Generator) -> Floats:
    measured = rate[:-1] @ world.gyro_matrix.T + world.gyro_bias
    count = len(measured) // FINE
    steps = np.zeros((count, at.U_SIZE))
    whole = Rotation.identity(count)
    for part in range(FINE):
        whole = whole * Rotation.from_rotvec(measured[part::FINE][:count] * dt)
    steps[:, at.U_DTHETA : at.U_DTHETA + 3] = whole.as_rotvec()
    steps[:, at.U_DTHETA : at.U_DTHETA + 3] += world.gyro_noise * dt * FINE * rng.standard_normal((count, 3))
    steps[:, at.U_DT], steps[:, at.U_COUNT] = dt * FINE, FINE
    steps[:, at.U_T] = np.round(np.arange(1, count + 1) * dt * FINE * 1e9)
    return steps


def _meas(world: World, t_s: Floats, R_nb: Floats, rng: np.random.Generator) -> Floats:
    here = FIELD_N + world.room(t_s) + _wander(t_s, world.uneven, rng)
    own = np.einsum("kji,kj->ki", R_nb, here) @ world.soft_iron.T + world.offset + world.attached(t_s)
    stamps_s = np.arange(0.5, t_s[-1], 1.0 / world.mag_hz)
    index = np.clip(np.round((stamps_s - world.delay_s) / (t_s[1] - t_s[0])).astype(int), 0, len(t_s) - 1)
    meas = np.full((len(stamps_s), at.M_SIZE), np.nan)
    meas[:, at.M_KIND], meas[:, at.M_STATUS], meas[:, at.M_T] = MAG, FUSED, np.round(stamps_s * 1e9)
    meas[:, at.M_DATA : at.M_DATA + 3] = own[index] + world.noise * rng.standard_normal((len(index), 3))
    meas[:, at.M_STEP] = np.ceil(np.round(stamps_s * STEP_HZ, 6)) - 1
    return meas[meas[:, at.M_STEP] < (len(t_s) - 1) // FINE]


def learn(learner: MagLearner, steps: Floats, meas: Floats, every: int = 5) -> list[MagLearnState]:
    """Step through everything; return the state after each `every` steps."""
    states = []
    for begin in range(0, len(steps), every):
        end = min(begin + every, len(steps))
        first, last = np.searchsorted(meas[:, at.M_STEP], (begin, end))
        own = meas[first:last].copy()
        own[:, at.M_STEP] -= begin
        learner.step(np.ascontiguousarray(steps[begin:end]), own)
        states.append(learner.state())
    return states


def normalised2(state: MagLearnState, truth: Floats) -> float:
    """Mean over the axes of (error/σ)²: 1 on average when σ is honest."""
    return float(np.mean(((state.offset_gauss - truth) / state.sigma_gauss) ** 2))

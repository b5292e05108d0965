"""The demo board in the hand: one motion after another on one spot, as truth at any time.

The board turns about its own IMU, which stays at the place of departure; taken out of the flight, it is carried there
first. A hand trembles while it moves the board; on the table nothing moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.polynomial import Polynomial

from server.nav.types import Float
from server.sim import earth
from server.sim import quaternion as quat
from server.sim.hand_turns import Turn
from server.sim.truth import TruthState, smooth

DIFFERENCE_S: Final = 1e-3
"""Velocity and acceleration are central differences over this: exact to 1e-4 of a motion at 5 Hz."""
CALM_S: Final = 0.3
"""In which a hand's trembling comes and goes."""
TREMOR_HZ: Final = np.array([1.3, 2.9, 8.7])
"""Sway, wobble and the physiological tremor of 8 to 12 Hz [Stiles & Randall 1967]."""
TREMOR_M_S2: Final = np.array([0.08, 0.10, 0.06])
TREMOR_RAD: Final = np.array([8e-3, 4e-3, 4e-4])
SHAKE_HZ: Final = np.array([2.3, 3.7, 5.9])
SHAKE_RAD_PER_M_S2: Final = np.array([0.02, 0.01, 0.004])
"""Amplitude of the tilting that goes with each m/s² of shaking."""
PHASE_RAD: Final = np.array([[0.0, 1.9, 4.1], [2.2, 0.4, 5.3], [3.6, 5.0, 1.1]])
"""Of each axis (row) and frequency: fixed, so that equal commands give equal motions."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Start:
    """How the board is when a hand takes it: place and its derivatives NED, rate FRD, (3,) each; attitude (4,)."""

    pos_n_m: Float
    vel_n_m_s: Float
    accel_n_m_s2: Float
    q_nb: Float
    rate_b_rad_s: Float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hand:
    """What a hand does with the board from `start_ms` on.

    Attributes:
        turns: one after the other; the last attitude stays.
        carry: polynomials of north, east and down (m) over s since the start, all 0 at `carry_s` and after.
        trembling_s: intervals since the start in which it is in the hand; the last may end at infinity.
        shaking_s: interval in which it is shaken, by `shake_m_s2` RMS.
    """

    start_ms: int
    turns: tuple[Turn, ...]
    carry: tuple[Polynomial, ...]
    carry_s: float
    trembling_s: tuple[tuple[float, float], ...] = ()
    shaking_s: tuple[float, float] = (0.0, 0.0)
    shake_m_s2: float = 0.0
    end_s: float = field(init=False)

    def __post_init__(self) -> None:
        """Note when all is done."""
        turning_s = sum(turn.duration_s for turn in self.turns)
        object.__setattr__(self, "end_s", max(turning_s, self.carry_s, self.shaking_s[1]))

    @property
    def done_s(self) -> float:
        """Board time at which all is done."""
        return self.start_ms * 1e-3 + self.end_s

    @property
    def is_held(self) -> bool:
        """The hand does not let go in the end."""
        return any(math.isinf(end_s) for _, end_s in self.trembling_s)

    def at(self, t_s: Float) -> TruthState:
        """Return the truth at board times, shape (n,)."""
        u = t_s - self.start_ms * 1e-3
        h = DIFFERENCE_S
        before, pos, after = self.place_at(u - h), self.place_at(u), self.place_at(u + h)
        vel, pull = (after - before) / (2.0 * h), (after - 2.0 * pos + before) / h**2
        q_nb = self.q_at(u)
        R_nb = quat.matrices(q_nb)
        gravity = earth.gravity_m_s2(earth.SITE_ALT_M - pos[:, 2])
        turn = earth.turn_rate_n_rad_s(vel)
        force = pull - np.outer(gravity, [0.0, 0.0, 1.0])
        force += np.cross(2.0 * earth.EARTH_RATE_N_RAD_S + turn, vel)
        return TruthState(
            t_s=t_s,
            pos_n_m=pos,
            vel_n_m_s=vel,
            wind_n_m_s=np.zeros_like(pos),
            q_nb=q_nb,
            R_nb=R_nb,
            accel_b_m_s2=np.asarray(np.vecmat(force, R_nb)),
            spin_b_rad_s=np.asarray(np.vecmat(earth.EARTH_RATE_N_RAD_S + turn, R_nb)),
            flying=np.zeros_like(t_s),
        )

    def start_at(self, t_s: float) -> Start:
        """Return how the next hand finds the board."""
        u, h = t_s - self.start_ms * 1e-3, DIFFERENCE_S
        before, pos, after = self.place_at(np.array([u - h, u, u + h]))
        q_before, q_nb, q_after = self.q_at(np.array([u - h, u, u + h]))
        return Start(
            pos_n_m=pos,
            vel_n_m_s=(after - before) / (2.0 * h),
            accel_n_m_s2=(after - 2.0 * pos + before) / h**2,
            q_nb=q_nb,
            rate_b_rad_s=quat.log(quat.product(quat.inverse(q_before), q_after)) / (2.0 * h),
        )

    def place_at(self, u_s: Float) -> Float:
        """Return the position NED from the site, shape (n, 3), at seconds since the start."""
        carried = np.stack([np.where(u_s < self.carry_s, axis(u_s), 0.0) for axis in self.carry], axis=1)
        omega = 2.0 * math.pi * TREMOR_HZ
        trembled = self._trembling(u_s)[:, None] * _waves(u_s, TREMOR_HZ, TREMOR_M_S2 / omega**2)
        size = self.shake_m_s2 * math.sqrt(2.0 / SHAKE_HZ.size) / (2.0 * math.pi * SHAKE_HZ) ** 2
        return np.asarray(carried + trembled + self._shaking(u_s)[:, None] * _waves(u_s, SHAKE_HZ, size))

    def q_at(self, u_s: Float) -> Float:
        """Return the attitude q_nb, shape (n, 4), continuous in sign, at seconds since the start."""
        q_nb = np.repeat(self.turns[-1].end[None], u_s.size, axis=0)
        begin = sum(turn.duration_s for turn in self.turns)
        for turn in reversed(self.turns):
            begin -= turn.duration_s
            rows = u_s < begin + turn.duration_s
            if rows.any():
                q_nb[rows] = turn.q_nb(np.maximum(u_s[rows] - begin, 0.0))
        tilt = self._trembling(u_s)[:, None] * _waves(u_s, TREMOR_HZ, TREMOR_RAD)
        tilt += self._shaking(u_s)[:, None] * _waves(u_s, SHAKE_HZ, self.shake_m_s2 * SHAKE_RAD_PER_M_S2)
        return _one_sign(quat.product(q_nb, quat.turned(tilt)))

    def _trembling(self, u_s: Float) -> Float:
        return sum((_window(u_s, *interval) for interval in self.trembling_s), np.zeros_like(u_s))

    def _shaking(self, u_s: Float) -> Float:
        return _window(u_s, *self.shaking_s)


def carried_home(start: Start) -> tuple[tuple[Polynomial, ...], float]:
    """Return the way home (north, east, down in m over s), at rest there, and how many s it takes.

    Quintic, gentle enough for a hand on the run.
    A minimum-jerk way of length d in T has accelerations up to 5.8 d/T²: 5 m/s² here.
    """
    away_m, speed_m_s = float(np.linalg.norm(start.pos_n_m)), float(np.linalg.norm(start.vel_n_m_s))
    duration_s = max(1.5, math.sqrt(1.16 * away_m), speed_m_s)
    paths = zip(start.pos_n_m, start.vel_n_m_s, start.accel_n_m_s2, strict=True)
    return tuple(_quintic(p * 1.0, v * 1.0, a * 1.0, duration_s) for p, v, a in paths), duration_s


def _quintic(pos: float, vel: float, accel: float, duration_s: float) -> Polynomial:
    """Return the polynomial of degree 5 from the given state to rest at 0."""
    t = duration_s
    low = Polynomial([pos, vel, 0.5 * accel])
    rest = -np.array([float(low(t)), float(low.deriv(1)(t)), float(low.deriv(2)(t))])
    powers = np.array([[t**3, t**4, t**5], [3 * t**2, 4 * t**3, 5 * t**4], [6 * t, 12 * t**2, 20 * t**3]])
    return Polynomial([*low.coef, *np.linalg.solve(powers, rest)])


def _waves(u_s: Float, hz: Float, size: Float) -> Float:
    """Return sums of sines about or along each axis, shape (n, 3)."""
    angle = 2.0 * math.pi * hz * u_s[:, None, None] + PHASE_RAD
    return np.asarray(np.sin(angle) @ size)


def _window(u_s: Float, start_s: float, end_s: float) -> Float:
    """Return 1 inside an interval, 0 outside, with soft edges inside it."""
    return np.asarray(smooth((u_s - start_s) / CALM_S) * smooth((end_s - u_s) / CALM_S))


def _one_sign(q_nb: Float) -> Float:
    """Return the same rotations, each of the sign of the one before, the first with w ≥ 0."""
    q_nb = q_nb / np.linalg.norm(q_nb, axis=1, keepdims=True)
    flips = np.where(np.sum(q_nb[1:] * q_nb[:-1], axis=1) < 0.0, -1.0, 1.0)
    sign = np.concatenate([[-1.0 if q_nb[0, 0] < 0.0 else 1.0], flips])
    return np.asarray(q_nb * np.cumprod(sign)[:, None])

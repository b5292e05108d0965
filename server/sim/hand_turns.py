"""How a hand or a turntable turns the demo board: pieces of attitude over time, each at rest at its end."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from server.nav.types import Float
from server.sim import quaternion as quat

HAND_S: Final = 1.5
"""A pose takes a hand this long at least."""
HAND_RAD_S: Final = 2.5
"""And no faster than this."""
COAST_S: Final = 0.4
"""In which a turn that was interrupted comes to rest."""
RAMP_S: Final = 1.0
"""In which a long turn gets up to speed, and down."""

SWEEP_S: Final = 35.0
"""One spiral of the field over the body's whole sphere."""
SWEEP_TURNS: Final = 15
"""Its windings: 12° apart, so that no tenth of the sphere's height slips through."""
SWEEP_POLE: Final = 0.985
"""Cosine of the polar angle at which it begins: 10°, a winding that a hand can follow."""
SWEEP_SWELL: Final = 0.9
"""Twice as fast at the equator as near the poles, where the windings are narrow: 1 to 2 rad/s in all."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turn:
    """One piece: `q_nb` takes seconds since its beginning, shape (n,), up to `duration_s`."""

    duration_s: float
    q_nb: Callable[[Float], Float]

    @property
    def end(self) -> Float:
        """The attitude in which it ends, shape (4,)."""
        return np.asarray(self.q_nb(np.array([self.duration_s]))[0])


def jerkless(u: Float) -> Float:
    """Return the minimum-jerk step from 0 to 1 over 0 … 1 [Flash & Hogan 1985], with clipped ends."""
    x = np.clip(u, 0.0, 1.0)
    return np.asarray(x**3 * (10.0 - 15.0 * x + 6.0 * x**2))


def _area(u: Float) -> Float:
    """Return the integral of `jerkless` from 0; 0.5 at 1."""
    x = np.clip(u, 0.0, 1.0)
    return np.asarray(x**4 * (2.5 - 3.0 * x + x**2))


def eased(t_s: Float, duration_s: float, ramp_s: float) -> Float:
    """Return a clock that starts and stops softly: it shows `duration_s` − `ramp_s` in the end, rate 1 in between."""
    after = np.clip(t_s - ramp_s, 0.0, duration_s - 2.0 * ramp_s)
    ends = _area(t_s / ramp_s) + 0.5 - _area((duration_s - t_s) / ramp_s)
    return np.asarray(after + ramp_s * ends)


def hold(q_nb: Float, duration_s: float) -> Turn:
    """Return rest in an attitude, shape (4,)."""
    return Turn(duration_s=duration_s, q_nb=lambda t: np.repeat(q_nb[None], t.size, axis=0))


def coast(q_nb: Float, rate_b_rad_s: Float) -> Turn:
    """Return the end of a turn that had this rate, shape (3,), body FRD."""
    return Turn(
        duration_s=COAST_S,
        q_nb=lambda t: quat.product(
            q_nb, quat.turned(np.outer(t - COAST_S * _area(t / COAST_S), np.asarray(rate_b_rad_s)))
        ),
    )


def move(q_nb: Float, vector_b_rad: Float, least_s: float = HAND_S) -> Turn:
    """Return the hand's way by a rotation vector, (3,), body FRD: minimum jerk, never faster than `HAND_RAD_S`."""
    angle = float(np.linalg.norm(vector_b_rad))
    duration_s = max(HAND_S, least_s, 1.875 * angle / HAND_RAD_S)
    return Turn(
        duration_s=duration_s,
        q_nb=lambda t: quat.product(q_nb, quat.turned(np.outer(jerkless(t / duration_s), vector_b_rad))),
    )


def lay(q_nb: Float, down_b: Float, least_s: float = HAND_S) -> Turn:
    """Return the shortest way to have `down_b`, a unit vector of shape (3,), body FRD, point down."""
    present_b = quat.matrices(q_nb[None])[0][2]
    return move(q_nb, quat.between(down_b, present_b), least_s)


def whole_turns(q_nb: Float, axis: int, turns: int, rate_rad_s: float) -> Turn:
    """Return exactly so many turns about a body axis, softly started and stopped; none the less n·2π."""
    angle, sense = 2.0 * math.pi * abs(turns), math.copysign(1.0, turns)
    ramp_s = min(RAMP_S, 0.5 * angle / rate_rad_s)
    duration_s = angle / rate_rad_s + ramp_s

    def q_of(t_s: Float) -> Float:
        return quat.product(q_nb, quat.about(axis, sense * rate_rad_s * eased(t_s, duration_s, ramp_s)))

    return Turn(duration_s=duration_s, q_nb=q_of)


def on_and_on(q_nb: Float, axis: int, duration_s: float, rate_rad_s: float) -> Turn:
    """Return turning about one body axis for a time."""
    return Turn(
        duration_s=duration_s,
        q_nb=lambda t: quat.product(q_nb, quat.about(axis, rate_rad_s * eased(t, duration_s, RAMP_S))),
    )


def sweep(field_n: Float, pole: int, duration_s: float) -> Turn:
    """Return the turn that leads the field over the body's sphere on a spiral, no further than `duration_s` allows.

    The field's direction in the body is Rz(φ) Ry(θ) z with θ from pole to pole and φ = 2·windings·θ. What turns about
    the field is taken out (χ' = φ' cos θ), so the body is never turned in vain: its rate is the spiral's speed.

    Args:
        field_n: shape (3,), direction of the Earth's field NED.
        pole: body axis in which the spiral begins, so that the next one differs.
        duration_s: at most `SWEEP_S`.
    """
    up = np.array([0.0, 0.0, 1.0])
    to_field = quat.turned(quat.between(up, field_n / np.linalg.norm(field_n)))
    to_pole = quat.turned(quat.between(np.eye(3)[pole], up))

    def q_of(t_s: Float) -> Float:
        x = eased(t_s, duration_s, RAMP_S) / (SWEEP_S - RAMP_S)
        way = (x + SWEEP_SWELL * (1.0 - np.cos(math.pi * x)) / math.pi) / (1.0 + 2.0 * SWEEP_SWELL / math.pi)
        theta = np.arccos(SWEEP_POLE * (1.0 - 2.0 * way))
        phi, chi = 2.0 * SWEEP_TURNS * theta, 2.0 * SWEEP_TURNS * np.sin(theta)
        tilted = quat.product(quat.about(2, chi), quat.about(1, -theta))
        return quat.product(quat.product(to_field, quat.product(tilted, quat.about(2, -phi))), to_pole)

    return Turn(duration_s=duration_s, q_nb=q_of)

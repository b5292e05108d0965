"""What a hand does when it is told something: a command and how the board is now → a motion."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.types import Float
from server.sim import quaternion as quat
from server.sim.hand import Hand, Start, carried_home
from server.sim.hand_turns import SWEEP_S, Turn, coast, hold, lay, move, on_and_on, sweep, whole_turns
from server.simulator import Fly, Motion, Pose, Shake, Spin, Turntable

STILL_RAD_S: Final = 1e-3
"""A board that turns faster than this is stopped first."""
SPIN_RAD_S: Final = 1.5
UPRIGHT_B: Final = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
"""What points down when x, y or z is upright: nose up, right side up, level."""
LEVEL_B: Final = np.array([0.0, 0.0, 1.0])
AXES: Final = "xyz"
LEAST_SWEEP_S: Final = 4.0
"""A rest of the time shorter than this begins no new spiral."""


def hand_for(command: Motion, start: Start, start_ms: int, field_n: Float, ready_q_nb: Float, lying: bool) -> Hand:
    """Return the motion that carries a command out.

    Args:
        command: what was asked for.
        start: how the board is now.
        start_ms: board time now.
        field_n: shape (3,), the Earth's field NED.
        ready_q_nb: shape (4,), attitude in which a flight begins.
        lying: it is in the hand already; a board from the air is laid level before it is shaken.
    """
    carry, carry_s = carried_home(start)
    turns = _stopped(start)
    q_nb = turns[-1].end if turns else start.q_nb
    least_s = carry_s - sum(turn.duration_s for turn in turns)
    if isinstance(command, Pose):
        turns.append(lay(q_nb, _unit(command.down_b), least_s))
        end_s = math.inf if command.is_held else _length(turns)
        return _hand(start_ms, turns, (carry, carry_s), ((0.0, end_s),))
    if isinstance(command, Fly):
        vector = quat.log(quat.product(quat.inverse(q_nb), ready_q_nb))
        turns.append(move(q_nb, vector, least_s))
        return _hand(start_ms, turns, (carry, carry_s), ((0.0, _length(turns)),))
    if isinstance(command, Shake):
        turns.append(hold(q_nb, 0.0) if lying else lay(q_nb, LEVEL_B, least_s))
        begin_s = 0.0 if lying else _length(turns)
        shaking = (begin_s, begin_s + command.duration_s)
        return _hand(start_ms, turns, (carry, carry_s), ((0.0, begin_s),), shaking, command.strength_m_s2)
    if isinstance(command, Turntable):
        turns.append(lay(q_nb, UPRIGHT_B[AXES.index(command.axis)], least_s))
        laid_s = _length(turns)
        turns.append(hold(turns[-1].end, command.rest_s))
        turns.append(whole_turns(turns[-1].end, AXES.index(command.axis), command.turns, command.rate_rad_s))
        return _hand(start_ms, turns, (carry, carry_s), ((0.0, laid_s),))
    turns += _spin(command, q_nb, field_n, least_s)
    return _hand(start_ms, turns, (carry, carry_s), ((0.0, _length(turns)),))


def _spin(command: Spin, q_nb: Float, field_n: Float, least_s: float) -> list[Turn]:
    if command.about:
        axis = AXES.index(command.about)
        laid = lay(q_nb, UPRIGHT_B[axis], least_s)
        return [laid, on_and_on(laid.end, axis, command.duration_s, SPIN_RAD_S)]
    turns: list[Turn] = []
    left_s, pole = command.duration_s, 2
    while not turns or left_s >= LEAST_SWEEP_S:
        spiral = sweep(field_n, pole, min(left_s, SWEEP_S))
        begin = spiral.q_nb(np.zeros(1))[0]
        taken = move(q_nb, quat.log(quat.product(quat.inverse(q_nb), begin)), 0.0 if turns else least_s)
        turns += [taken, spiral]
        q_nb, pole = spiral.end, (pole + 1) % 3
        left_s -= taken.duration_s + spiral.duration_s
    return turns


def _stopped(start: Start) -> list[Turn]:
    """Return what ends the turning that goes on, if it does."""
    moving = float(np.linalg.norm(start.rate_b_rad_s)) > STILL_RAD_S
    return [coast(start.q_nb, start.rate_b_rad_s)] if moving else []


def _hand(
    start_ms: int,
    turns: list[Turn],
    home: tuple[tuple[np.polynomial.Polynomial, ...], float],
    trembling_s: tuple[tuple[float, float], ...],
    shaking_s: tuple[float, float] = (0.0, 0.0),
    shake_m_s2: float = 0.0,
) -> Hand:
    return Hand(
        start_ms=start_ms,
        turns=tuple(turns),
        carry=home[0],
        carry_s=home[1],
        trembling_s=trembling_s,
        shaking_s=shaking_s,
        shake_m_s2=shake_m_s2,
    )


def _length(turns: list[Turn]) -> float:
    return sum(turn.duration_s for turn in turns)


def _unit(vector: tuple[float, float, float]) -> Float:
    return np.array(vector) / math.hypot(*vector)

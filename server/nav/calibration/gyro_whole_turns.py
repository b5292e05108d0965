"""Which movements were whole turns, and the scale they give [S1 eq. 3.10, 3.11]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.codes import failure
from server.nav.calibration.gyro_turns import Movement
from server.nav.calibration.statistics import rms
from server.nav.calibration.types import Failure, Options
from server.nav.types import Float

TURN_RAD: Final = 2.0 * np.pi
END_SIGMA_RAD: Final = float(np.radians(0.5))  # how well a hand stops where it started, against an edge
UNKNOWN_TURNS: Final = 0.3  # of a turn: when nobody says how many, the nearest whole number must be this near
ALIKE: Final = 0.7  # in counts: a movement of this share of the largest about its axis is a turn as well
AXES: Final = "xyz"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Turn:
    """A movement that was taken for whole turns about an axis."""

    axis: int
    turns: float
    movement: Movement

    @property
    def measured_rad(self) -> float:
        """The integral's magnitude, in the unit of the data times seconds."""
        return abs(float(self.movement.angle[self.axis]))

    @property
    def scale(self) -> float:
        """S1 (3.11)."""
        return TURN_RAD * self.turns / self.measured_rad

    @property
    def scale_sigma(self) -> float:
        """1σ from the end position, the bias and the noise."""
        end = END_SIGMA_RAD / (TURN_RAD * self.turns)
        return self.scale * float(np.hypot(end, self.movement.sigma[self.axis] / self.measured_rad))


def _turns_of(movement: Movement, axis: int, options: Options) -> float:
    """Return how many whole turns a movement in SI was about the axis, 0 when it was none."""
    turned = abs(float(movement.angle[axis])) / TURN_RAD
    asked = options.turns
    if np.isnan(asked):
        asked = float(round(turned))
        near = min(grades.TURN_MISMATCH * asked, UNKNOWN_TURNS)
    else:
        near = grades.TURN_MISMATCH * asked
    return asked if asked > 0.0 and abs(turned - asked) <= near else 0.0


def find_turns(movements: Sequence[Movement], options: Options) -> list[Turn]:
    """Return the movements that were whole turns, oldest first; those between two rests, or else the others."""
    for both in (True, False):
        found = _pure_turns([m for m in movements if m.both == both], options)
        if found:
            return found
    return []


def _pure_turns(movements: Sequence[Movement], options: Options) -> list[Turn]:
    wanted = AXES if options.axis == "" else options.axis
    pure = [m for m in movements if m.purity >= grades.TURN_PURE and AXES[m.axis] in wanted]
    if options.unit == "si":
        found = [Turn(axis=m.axis, turns=_turns_of(m, m.axis, options), movement=m) for m in pure]
        return [turn for turn in found if turn.turns > 0.0]
    largest = max((abs(float(m.angle[m.axis])) for m in movements), default=0.0)
    lively = [m for m in pure if abs(float(m.angle[m.axis])) >= ALIKE * largest and _is_lively(m)]
    return [Turn(axis=m.axis, turns=options.turns, movement=m) for m in lively]


def _is_lively(movement: Movement) -> bool:
    """Return whether an angle in counts is a movement at all, not noise: well above its own 1σ."""
    return abs(float(movement.angle[movement.axis])) > 50.0 * float(movement.sigma[movement.axis])


def why_no_turn(movements: Sequence[Movement], options: Options) -> Failure:
    """Return why none of the movements is a turn."""
    asked = 1.0 if np.isnan(options.turns) else options.turns
    if not movements:
        return failure("not-turned", 0.0, grades.TURN_LEAST * TURN_RAD, "rad")
    angles = np.array([m.angle for m in movements])
    largest = np.abs(angles).max(axis=0)
    axis = int(np.argmax(largest)) if options.axis == "" else AXES.index(options.axis)
    most = movements[int(np.argmax(np.abs(angles).max(axis=1)))]
    lively = options.unit == "si" or _is_lively(most)
    if not lively or (options.unit == "si" and largest.max() < grades.TURN_LEAST * TURN_RAD):
        return failure("not-turned", float(largest.max()), grades.TURN_LEAST * TURN_RAD, "rad")
    share = abs(float(most.angle[axis])) / float(np.linalg.norm(most.angle))
    if most.axis != axis or share < grades.TURN_PURE:
        return failure("axis-mismatch", share, grades.TURN_PURE)
    return failure("turns-mismatch", float(largest[axis]) / TURN_RAD, asked, "turns")


def scale_of(turns: Sequence[Turn]) -> tuple[float, float]:
    """Return the weighted mean of the scales of one axis, and its 1σ, widened when they disagree."""
    scales = np.array([turn.scale for turn in turns])
    weights = np.array([turn.scale_sigma for turn in turns]) ** -2
    mean = float(weights @ scales / weights.sum())
    chi2 = float(weights @ (scales - mean) ** 2) / max(len(turns) - 1, 1)
    return mean, float(np.sqrt(max(chi2, 1.0) / weights.sum()))


def plain_scale(turns: Sequence[Turn], unit: str) -> Float:
    """Return what stands before a calibration: 1 in SI; in counts the one factor that fits all turns best."""
    if unit == "si":
        return np.ones(3)
    counts = np.array([turn.measured_rad for turn in turns])
    truth = np.array([TURN_RAD * turn.turns for turn in turns])
    return np.full(3, float(counts @ truth / (counts @ counts)))


def angle_left(turns: Sequence[Turn], scale: Float) -> float:
    """Return the RMS over turns of the angle that the scale leaves wrong, rad."""
    return rms(np.array([scale[turn.axis] * turn.measured_rad - TURN_RAD * turn.turns for turn in turns]))


def angle_after(turns: Sequence[Turn], scale: Float) -> float:
    """Return the same for the fitted scale; an axis turned once fits exactly, so there its 1σ stands."""
    left = []
    for turn in turns:
        alone = sum(other.axis == turn.axis for other in turns) == 1
        wrong = scale[turn.axis] * turn.measured_rad - TURN_RAD * turn.turns
        left.append(turn.scale_sigma * turn.measured_rad if alone else wrong)
    return rms(np.array(left))


def turn_details(turns: Sequence[Turn]) -> dict[str, float]:
    """Return per axis the turns, the movements, the mean integral (in the unit of the data times s) and the time."""
    out: dict[str, float] = {}
    for i, axis in enumerate(AXES):
        mine = [turn for turn in turns if turn.axis == i]
        if mine:
            out[f"turns_{axis}"] = float(sum(turn.turns for turn in mine))
            out[f"movements_{axis}"] = float(len(mine))
            out[f"integral_{axis}"] = float(np.mean([turn.measured_rad for turn in mine]))
            out[f"span_{axis}_s"] = float(sum(turn.movement.span_s for turn in mine))
    return out

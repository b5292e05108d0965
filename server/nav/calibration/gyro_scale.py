"""The gyro's scale from whole turns [S1 eq. 3.10, 3.11]: k = 2πn / |∫ (raw − bias) dt|, the bias from rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from server.nav.calibration import grades
from server.nav.calibration.blocks import B_MEAN, B_T0, B_T1
from server.nav.calibration.codes import failure
from server.nav.calibration.gyro_ranges import given_movements
from server.nav.calibration.gyro_turns import Movement, Rest, find_movements, find_rests, new_table
from server.nav.calibration.gyro_whole_turns import (
    AXES,
    TURN_RAD,
    Turn,
    angle_after,
    angle_left,
    find_turns,
    plain_scale,
    scale_of,
    turn_details,
    why_no_turn,
)
from server.nav.calibration.types import NAN, CalKind, Check, Failure, Fit, Options, Progress, Residual, Value
from server.nav.types import Float, Int, Kind

KIND: Final = CalKind.GYRO_SCALE


class GyroScale:
    """Finds whole turns between rests and fits the scale of each axis that was turned."""

    def __init__(self, options: Options) -> None:
        """Start without samples.

        Raises:
            ValueError: counts without the number of turns, or a number that is not positive.
        """
        if options.unit == "raw" and np.isnan(options.turns):
            msg = (
                "turns must be given with raw counts, because counts have no angle; set --turns to the whole turns made"
            )
            raise ValueError(msg)
        if not np.isnan(options.turns) and not options.turns > 0.0:
            msg = f"turns must be above 0, is {options.turns:g}; either sense counts as positive"
            raise ValueError(msg)
        self._options = options
        self._table = new_table()
        self._given: list[Movement] | None = None
        self._given_rest = False
        self._known: tuple[int, list[Rest], list[Movement]] = (-1, [], [])

    def feed(self, kind: Kind, t_ns: Int, rows: Float) -> None:
        """Take samples (`types.Collector`)."""
        if kind == Kind.IMU:
            self._table.feed(t_ns, rows)

    def fit_ranges(self, t_ns: Int, rows: Float, ranges: Sequence[tuple[int, int]]) -> Fit:
        """Fit with these sample ranges [first, end) as turns, each integrated over exactly its samples.

        Ranges at rest among them are recognised and give the bias; without one the rests of the stream do.
        """
        self._given, self._given_rest = given_movements(t_ns, rows, ranges, self._options.unit)
        self.feed(Kind.IMU, t_ns, rows)
        return self.fit()

    def _seen(self) -> tuple[list[Rest], list[Movement]]:
        blocks = self._table.rows
        if self._known[0] != len(blocks):
            rests = find_rests(blocks, self._options.unit)
            self._known = (len(blocks), rests, find_movements(blocks, rests, self._table.quantum[:3]))
        return self._known[1], self._known[2]

    def _movements(self) -> list[Movement]:
        return self._seen()[1] if self._given is None else self._given

    def progress(self) -> Progress:
        """Return how far it is (`types.Collector`)."""
        rests, movements = self._seen()
        blocks = self._table.rows
        turns = find_turns([m for m in movements if m.both], self._options)
        is_still = bool(rests) and rests[-1].end == len(blocks)
        angle = movements[-1].angle if movements and not is_still else np.zeros(3)
        asked = TURN_RAD * (1.0 if np.isnan(self._options.turns) else self._options.turns)
        share = 0.8 * min(float(np.max(np.abs(angle))) / asked, 1.0) if self._options.unit == "si" else 0.0
        phase, instruction = _move(self._table.samples, bool(rests), bool(turns))
        values = {f"turned_{axis}_rad": float(angle[i]) for i, axis in enumerate(AXES)}
        if len(blocks):
            values["rate_rad_s"] = float(np.linalg.norm(blocks[-1, B_MEAN : B_MEAN + 3]))
        still_s = float(blocks[-1, B_T1] - blocks[rests[-1].start, B_T0]) * 1e-9 if is_still else 0.0
        return Progress(
            fraction=1.0 if turns else (0.1 + share if rests else 0.0),
            phase=phase,
            instruction=instruction,
            samples=self._table.samples,
            is_enough=bool(turns),
            is_complete=bool(turns),
            values={"still_s": still_s, "turns_found": float(len(turns)), **values},
        )

    def fit(self) -> Fit:
        """Fit, or refuse (`types.Collector`)."""
        movements = self._movements()
        turns = find_turns(movements, self._options)
        why = self._failure(movements, turns)
        if why is not None:
            return Fit(kind=KIND, failure=why, samples=self._table.samples)
        scale, sigma = np.ones(3), np.full(3, NAN)
        for i in {turn.axis for turn in turns}:
            scale[i], sigma[i] = scale_of([turn for turn in turns if turn.axis == i])
        bias = np.mean([turn.movement.bias for turn in turns], axis=0)
        bias_sigma = np.sqrt(np.mean([turn.movement.bias_sigma**2 for turn in turns], axis=0))
        measured = np.isfinite(sigma)
        judged = {"sigma_share": float(np.max(sigma[measured] / scale[measured]))}
        if self._options.unit == "si":
            judged["change_share"] = float(np.max(np.abs(scale - 1.0)))
        return Fit(
            kind=KIND,
            parameters={"scale": scale, "bias": bias},
            sigma={"scale": sigma, "bias": bias_sigma},
            residual_before=Residual(value=angle_left(turns, plain_scale(turns, self._options.unit)), unit="rad"),
            residual_after=Residual(value=angle_after(turns, scale), unit="rad"),
            coverage=float(measured.sum()) / (3.0 if self._options.axis == "" else 1.0),
            grade=grades.grade(KIND, judged),
            samples=self._table.samples,
            details=turn_details(turns),
        )

    def _failure(self, movements: Sequence[Movement], turns: Sequence[Turn]) -> Failure | None:
        if self._table.samples == 0:
            return failure("no-data")
        if not movements and not (self._given_rest if self._given is not None else self._seen()[0]):
            return failure("motion")
        moved = [turn.movement for turn in turns] or movements
        share = max((float(m.saturated[m.axis]) for m in moved), default=0.0)
        if share > 0.0:
            return failure("saturated", share, 0.0)
        return None if turns else why_no_turn(movements, self._options)

    def check(self, parameters: Mapping[str, Value]) -> Check:
        """Judge the scale on fresh turns: the angle that is left over, against a share of it (`types.Collector`)."""
        movements = self._movements()
        scale = np.asarray(parameters["scale"])
        turns = find_turns([m for m in movements if m.both], self._options)  # a turn that goes on is no turn yet
        why = self._failure(movements, turns)
        if why is not None:
            return Check(ok=False, residual=Residual(value=NAN, unit="rad"), limit=NAN, samples=0, failure=why)
        value = angle_left(turns, scale)
        limit = grades.CHECK_TURN_SHARE * TURN_RAD * float(np.mean([turn.turns for turn in turns]))
        residual = Residual(value=value, unit="rad")
        return Check(ok=value <= limit, residual=residual, limit=limit, samples=self._table.samples)


def _move(samples: int, rested: bool, turned: bool) -> tuple[str, str]:
    if samples == 0:
        return "waiting", "wait"
    if turned:
        return "enough", "done"
    if not rested:
        return "hold-still", "hold-still"
    return "turn", "turn-table"

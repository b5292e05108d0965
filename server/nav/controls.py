"""What a person changes of the preprocessing while samples flow: calibration, filters, learning in flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from server.nav.calibration.applied import Calibration
from server.nav.calibration.mag_learning import MagLearnState
from server.nav.calibration_events import calibration_event, chain_event, level_event
from server.nav.field_learning import FieldLearning
from server.nav.lanes.bank import LaneBank
from server.nav.lanes.base import LaneContext
from server.nav.parts import Part
from server.nav.preprocess.chain_parameters import ChainInfo
from server.nav.preprocess.conditioning import Conditioning
from server.nav.preprocess.rebase import Rebase
from server.nav.record import Record
from server.nav.types import Event, Float, Kind


class Controls:
    """The part of `engine.NavEngine` that carries such a change to everything that holds calibrated values."""

    _bank: LaneBank
    _conditioning: Conditioning
    _learning: FieldLearning
    _record: Record
    _untold: list[Event]
    _held: Float
    _started: bool
    _t0_ns: int

    def _lane_context(self) -> LaneContext:
        raise NotImplementedError

    def set_calibration(self, calibration: Calibration) -> None:
        """Put a calibration in force from the next sample on; raw rows stay raw.

        On the ground every lane starts anew with the better sensors: what it had learned of the worse ones, a tilt from
        an accelerometer's offset among it, is worth nothing. Under way the main lane's biases are carried over, so that
        its solution does not jump. A level that changes turns the body frame: every lane starts anew. A change of gyro,
        magnetometer or level starts learning in flight anew.

        Raises:
            ValueError: a number that is none, or a matrix that cannot be inverted; nothing is changed then.
        """
        if not self._started:
            self._conditioning.calibrate(calibration)
            self._untold.append(calibration_event(calibration, 0, anew=False))
            return
        change = self._conditioning.calibrate(calibration)
        anew = change.turns_vectors and not self._record.moves
        self._follow(change, anew=anew)
        self._untold.append(calibration_event(calibration, self._record.t_ns, anew=anew))

    @property
    def calibration(self) -> Calibration:
        """The calibration in force."""
        return self._conditioning.chain.calibration

    def _follow(self, change: Rebase, *, anew: bool = False) -> None:
        """Carry everything over that holds calibrated values, or start the lanes anew."""
        A, d = change.mag
        if not change.keeps_learning:
            self._learning.restart()
        self._held[:3] = A @ self._held[:3] + d
        self._held[3] += change.baro_m
        if change.is_level_changed:
            self._untold.append(level_event(self._record.t_ns))
            self._bank.restart()
        elif anew:
            self._bank.restart()
        else:
            self._bank.rebase(change)

    def set_chain(self, sensor: str, values: Mapping[str, float]) -> None:
        """Change parameters of one sensor's preprocessing from the next sample on; its filters start anew.

        Another unit or mounting changes what every estimator has learned: the lanes start anew then.

        Raises:
            ValueError: unknown sensor or parameter, or a value outside its limits; nothing is changed then.
        """
        turned = self._conditioning.set_chain(sensor, values)
        self._untold.append(chain_event(sensor, values, self._record.t_ns))
        self._conditioning.take_changed()
        if self._started:
            if turned:
                self._learning.restart()  # what was learned is of another unit or of other axes
                if self._conditioning.chain.has_learned:
                    self._conditioning.learn(np.zeros(3))
                self._bank.restart()
            self._bank.start(self._lane_context())

    def set_mag_learning(self, run: bool, apply: bool) -> None:
        """Switch learning the magnetic offset in flight, and its use, on or off from the next step on.

        Run alone only watches. Applied, a converged offset is taken off the field that every lane gets, approached in
        small moves at whole seconds of board time; the main lane's own magnetic bias is carried over with each.
        """
        self._learning.choose(run, apply)

    def mag_learning(self) -> MagLearnState | None:
        """Return what has been learned of the magnetic offset; None when it does not run."""
        return self._learning.state()

    @property
    def mag_learned_gauss(self) -> Float:
        """The learned offset that is taken off the calibrated field now, shape (3,), body."""
        return self._conditioning.chain.learned_gauss

    def chain(self) -> tuple[ChainInfo, ...]:
        """Return the preprocessing of every sensor: its parameters as they are set, and what its filters delay."""
        return self._conditioning.chain.infos()

    def converted(self, kind: Kind, rows: Float) -> Float:
        """Return raw rows, shape (n, ROW_WIDTH), in SI and body axes: what a calibration is made of.

        They differ from the raw ones only where raw counts or a mounting are set.
        """
        return self._conditioning.chain.converted(kind, rows)

    def _told_before(self) -> Part:
        """Return what was changed between two calls, as events at the last known time."""
        part = Part()
        part.events = [replace(event, t_ns=max(event.t_ns, self._t0_ns)) for event in self._untold]
        self._untold = []
        return part

    @property
    def _may_move(self) -> bool:
        """True when the magnetic offset in use may have to move."""
        return (self._learning.run and self._learning.apply) or self._conditioning.chain.has_learned

    def _move_offset(self) -> None:
        """Follow what is learned of the magnetic offset in flight, by a little."""
        offset = self._learning.moved(self._conditioning.chain.learned_gauss)
        if offset is not None:
            self._follow(self._conditioning.learn(offset))

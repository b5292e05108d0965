"""What a person chose of a board's engine, kept for the engine that follows one that failed."""

from __future__ import annotations

from collections.abc import Mapping

from server.board_parts import Engine
from server.nav.calibration.applied import Calibration


class Choices:
    """Lanes and their numbers, calibration, preprocessing, learning; everything acts from the engine's next step."""

    def __init__(self, lanes: tuple[str, ...]) -> None:
        self.lanes = lanes
        self.calibration = Calibration()
        self.mag_learning = (False, False)
        self._lane_values: dict[str, dict[str, float]] = {}
        self._chain_values: dict[str, dict[str, float]] = {}

    def tell(self, engine: Engine) -> None:
        """Tell a new engine everything."""
        engine.choose_lanes(self.lanes)
        for lane, values in self._lane_values.items():
            engine.set_lane_parameters(lane, values)
        if not self.calibration.is_identity:
            engine.set_calibration(self.calibration)
        for sensor, values in self._chain_values.items():
            engine.set_chain(sensor, values)
        if any(self.mag_learning):
            engine.set_mag_learning(*self.mag_learning)

    def choose_lanes(self, engine: Engine, names: tuple[str, ...]) -> None:
        """Run these lanes; `ValueError`, and nothing changed, for names that cannot be."""
        engine.choose_lanes(names)
        self.lanes = names

    def set_lane_parameters(self, engine: Engine, lane: str, values: Mapping[str, float]) -> None:
        """Change numbers of one lane; `ValueError`, and nothing changed, for what it does not take."""
        engine.set_lane_parameters(lane, values)
        self._lane_values.setdefault(lane, {}).update(values)

    def set_calibration(self, engine: Engine, calibration: Calibration) -> None:
        """Put a calibration in force."""
        engine.set_calibration(calibration)
        self.calibration = calibration

    def set_chain(self, engine: Engine, sensor: str, values: Mapping[str, float]) -> None:
        """Change the preprocessing of one sensor; `ValueError`, and nothing changed, for what it does not take."""
        engine.set_chain(sensor, values)
        self._chain_values.setdefault(sensor, {}).update(values)

    def set_mag_learning(self, engine: Engine, run: bool, apply: bool) -> None:
        """Switch learning in flight and its use."""
        engine.set_mag_learning(run, apply)
        self.mag_learning = (run, apply)

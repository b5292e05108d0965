"""Every lane there is, by name, and what a person may change of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from server.nav.lanes.ahrs_fixed_gain import AhrsFixedGain
from server.nav.lanes.altitude_complementary import AltitudeComplementary
from server.nav.lanes.altitude_inertial import AltitudeInertial
from server.nav.lanes.altitude_kalman import AltitudeKalman
from server.nav.lanes.base import Lane, LaneContext, Parameter, Provides
from server.nav.lanes.complementary import Complementary
from server.nav.lanes.complementary_1 import Complementary1
from server.nav.lanes.dmp import Dmp
from server.nav.lanes.ins_ekf import InsEkf
from server.nav.lanes.kalman_angle_bias import KalmanAngleBias
from server.nav.lanes.nav_position import NavPosition
from server.nav.lanes.smoother import Smoother
from server.nav.lanes.vqf import Vqf

ESTIMATORS: Final[dict[str, type[Lane]]] = {
    "ins_ekf": InsEkf,
    "complementary_1": Complementary1,
    "kalman_angle_bias": KalmanAngleBias,
    "dmp": Dmp,
    "complementary": Complementary,
    "ahrs_fixed_gain": AhrsFixedGain,
    "nav_position": NavPosition,
    "altitude_complementary": AltitudeComplementary,
    "altitude_inertial": AltitudeInertial,
    "altitude_kalman": AltitudeKalman,
    "vqf": Vqf,
}
"""Lanes that compute; the main lane first."""
REPEATERS: Final[dict[str, Provides]] = {"onboard": "full", "reference": "full"}
"""Lanes that publish what someone else computed (`passthrough`)."""
LANES: Final = (*ESTIMATORS, *REPEATERS)
"""Lanes that a live board can run."""
AFTERWARDS: Final[dict[str, type[Lane]]] = {"smoother": Smoother}
"""Lanes that need the whole recording: no rows while it runs, all of them when it ends (`LaneBank.finish`)."""
COMPUTED: Final[dict[str, type[Lane]]] = ESTIMATORS | AFTERWARDS
RECORDED_LANES: Final = (*LANES, *AFTERWARDS)
"""Lanes that a recording can be run through."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaneInfo:
    """One lane as a person chooses it.

    Attributes:
        running: it is among the chosen ones and has not failed.
        failure: why it was put aside; "" otherwise.
        values: of each of `parameters`, NaN = the vehicle class's own.
    """

    name: str
    provides: Provides
    running: bool
    failure: str
    parameters: tuple[Parameter, ...]
    values: Mapping[str, float]


def check_lanes(names: tuple[str, ...], known: tuple[str, ...] = LANES) -> None:
    """Raise ValueError for a lane that is not known, one named twice, or none at all."""
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(f"no lane called {', '.join(unknown)}; there are: {', '.join(known)}")
    if not names or len(set(names)) != len(names):
        raise ValueError(f"lanes {', '.join(names) or '(none)'}: name at least one, each once")


def parameters_of(lane: str) -> tuple[Parameter, ...]:
    """Return what may be changed of a lane; nothing of those that repeat."""
    return COMPUTED[lane].parameters if lane in COMPUTED else ()


def provides_of(lane: str) -> Provides:
    """Return what a lane estimates."""
    return COMPUTED[lane].provides if lane in COMPUTED else REPEATERS[lane]


def defaults_of(lane: str) -> dict[str, float]:
    """Return every parameter of a lane at its default."""
    return {parameter.name: parameter.default for parameter in parameters_of(lane)}


def check_values(lane: str, values: Mapping[str, float], known_lanes: tuple[str, ...] = LANES) -> None:
    """Raise ValueError, naming value, limits and remedy, for what a lane does not take."""
    check_lanes((lane,), known_lanes)
    known = {parameter.name: parameter for parameter in parameters_of(lane)}
    for name, value in values.items():
        if name not in known:
            there = ", ".join(known) or "none"
            raise ValueError(f"lane {lane} has no parameter {name}; there are: {there}")
        one = known[name]
        own = math.isnan(value) and math.isnan(one.default)  # back to the vehicle class's own
        if not own and not one.minimum <= value <= one.maximum:
            unit = f" {one.unit}" if one.unit else ""
            raise ValueError(
                f"{lane}.{name} = {value:g}{unit} is outside {one.minimum:g} … {one.maximum:g}{unit}; "
                f"the default is {'the vehicle class’s own' if math.isnan(one.default) else format(one.default, 'g')}"
            )


def make(name: str, context: LaneContext) -> Lane:
    """Return a new lane, before its first step."""
    factory: Callable[[LaneContext], Lane] = COMPUTED[name]
    return factory(context)

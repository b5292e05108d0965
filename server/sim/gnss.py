"""The demo board's GNSS receiver: late, five times a second, with errors that remember, and blind on request.

Figures: u-blox M9-class receiver with open sky. Its error is not white: most of it wanders over a minute, as the
atmosphere and the constellation do, and no filter can see it from inside. The reported accuracies are those of the
errors drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from server.nav.types import Float
from server.sim import earth
from server.sim.noise import GaussMarkov
from server.sim.settings import SimSettings
from server.sim.truth import TruthState

EPOCH_MS: Final = 200
STAMP_LATE_MS: Final = 98
"""From the time a solution is valid to its `time_usec`: measured on ArduPilot."""
ARRIVAL_LATE_MS: Final = 158
"""From the time a solution is valid to the time the board has it."""
FIRST_FIX_MS: Final = 2000
"""Hot start: no fix before."""

WANDER_S: Final = 60.0
JITTER_S: Final = 1.0
VELOCITY_S: Final = 0.4
AXES: Final = np.array([1.0, 1.0, 1.7])
"""Vertical errors are the larger ones: the satellites are all above."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """How good the solutions are: standard deviations per horizontal axis; down they are larger by `AXES`."""

    fix_type: int
    wander_m: float
    jitter_m: float
    velocity_m_s: float

    @property
    def h_acc_m(self) -> float:
        """What the receiver says of its horizontal position: both axes together."""
        return math.sqrt(2.0) * math.hypot(self.wander_m, self.jitter_m)

    @property
    def v_acc_m(self) -> float:
        """What it says of its height."""
        return float(AXES[2]) * math.hypot(self.wander_m, self.jitter_m)

    @property
    def s_acc_m_s(self) -> float:
        """What it says of its speed over ground: along the course, one axis' error."""
        return self.velocity_m_s


STANDARD: Final = Quality(fix_type=3, wander_m=0.25, jitter_m=0.03, velocity_m_s=0.04)
RTK: Final = Quality(fix_type=6, wander_m=0.006, jitter_m=0.006, velocity_m_s=0.025)
"""Carrier phase with fixed ambiguities: u-blox F9-class, 10 mm + 1 ppm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix:
    """One solution as the receiver hands it over.

    Attributes:
        stamp_ms: the receiver's own time stamp in board time; 0 before the first solution.
        fix_type: MAVLink's: 1 no fix, 3 three-dimensional.
        lat_deg, lon_deg, alt_m: position, above mean sea level.
        vel_n_m_s, vel_e_m_s: velocity over ground.
        h_acc_m, v_acc_m, s_acc_m_s: the receiver's own word for its errors; 0 = unknown.
    """

    stamp_ms: int = 0
    fix_type: int = 1
    satellites: int = 0
    lat_deg: float = 0.0
    lon_deg: float = 0.0
    alt_m: float = 0.0
    vel_n_m_s: float = 0.0
    vel_e_m_s: float = 0.0
    hdop: float = 99.99
    h_acc_m: float = 0.0
    v_acc_m: float = 0.0
    s_acc_m_s: float = 0.0


class Receiver:
    """Produces one solution per epoch, valid at the first row of the block it is given."""

    def __init__(self, rng: np.random.Generator, settings: SimSettings) -> None:
        noise, step_s = settings.noise, EPOCH_MS * 1e-3
        self._outages_s = settings.outages_s
        self._quality = quality = RTK if settings.rtk else STANDARD
        self._wander = GaussMarkov(rng, noise * quality.wander_m * AXES, WANDER_S, step_s)
        self._jitter = GaussMarkov(rng, noise * quality.jitter_m * AXES, JITTER_S, step_s)
        self._velocity = GaussMarkov(rng, noise * quality.velocity_m_s * AXES, VELOCITY_S, step_s)
        self._last = Fix()

    @property
    def wander_n_m(self) -> Float:
        """The slow error now, NED, shape (3,)."""
        return self._wander.value

    def step(self, tick_ms: int, state: TruthState) -> tuple[Fix, Fix]:
        """Return the solution before and the one valid at `tick_ms`, which the board has `ARRIVAL_LATE_MS` later."""
        before = self._last
        pos = state.pos_n_m[:1] + self._wander.step() + self._jitter.step()
        vel = state.vel_n_m_s[0] + self._velocity.step()
        if tick_ms < FIRST_FIX_MS or self.is_out(tick_ms * 1e-3):
            self._last = replace(before, fix_type=1, satellites=min(before.satellites, 2))
        else:
            self._last = _solution(tick_ms, pos, vel, self._quality)
        return before, self._last

    def is_out(self, t_s: float) -> bool:
        """True while the settings take the receiver's view of the sky."""
        return any(start_s <= t_s < end_s for start_s, end_s in self._outages_s)


def _solution(tick_ms: int, pos_n_m: Float, vel_n_m_s: Float, quality: Quality) -> Fix:
    lat_deg, lon_deg, alt_m = earth.geodetic_from_ned(pos_n_m)[0].tolist()
    return Fix(
        stamp_ms=tick_ms + STAMP_LATE_MS,
        fix_type=quality.fix_type,
        satellites=17 + round(2.0 * math.sin(tick_ms * 1e-4)),
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        alt_m=alt_m,
        vel_n_m_s=float(vel_n_m_s[0]),
        vel_e_m_s=float(vel_n_m_s[1]),
        hdop=0.7,
        h_acc_m=quality.h_acc_m,
        v_acc_m=quality.v_acc_m,
        s_acc_m_s=quality.s_acc_m_s,
    )

"""What `navdeck compare` may be told, parsed once: lanes, parameters, windows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from server.lane_values import LaneValues
from server.replay.errors import ReplayError
from server.replay.options import Stretch, checked_lanes, lanes_from_text, outage_from_text, values_from_texts

DEFAULT_CHOSEN: Final = "ins_ekf"


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """A comparison's choices, checked.

    Attributes:
        lanes: to show; `chosen` and `reference` run too.
        chosen: differences are to this one.
        reference: errors are against this one; None = the log's reference, else the board's own solution.
        parameters: lane → parameter → value, for what differs from the defaults.
        gnss_outages: stretches whose GNSS is withheld, seconds after the first sample.
        windows: stretches with figures and plots of their own, seconds after the first sample.
        nav_rate_hz: None = the default.
    """

    lanes: tuple[str, ...]
    chosen: str = DEFAULT_CHOSEN
    reference: str | None = None
    parameters: LaneValues = field(default_factory=dict)
    gnss_outages: tuple[Stretch, ...] = ()
    windows: tuple[Stretch, ...] = ()
    nav_rate_hz: float | None = None

    @property
    def running(self) -> tuple[str, ...]:
        """Every lane the engine is to run; each possible reference among them."""
        extra = (self.chosen, self.reference) if self.reference else (self.chosen, "reference", "onboard")
        return tuple(dict.fromkeys((*self.lanes, *extra)))


def options_from_text(
    *,
    lanes: str = "all",
    chosen: str = DEFAULT_CHOSEN,
    reference: str | None = None,
    parameters: Sequence[str] = (),
    gnss_outages: Sequence[str] = (),
    windows: Sequence[str] = (),
    nav_rate_hz: float | None = None,
) -> Options:
    """Return the options of a command line.

    Raises:
        ReplayError: one of them is not usable; the message says which, why, and the remedy.
    """
    for name in (chosen, *([reference] if reference else [])):
        checked_lanes([name])
    return Options(
        lanes=lanes_from_text(lanes),
        chosen=chosen,
        reference=reference,
        parameters=values_from_texts(parameters),
        gnss_outages=tuple(outage_from_text(text) for text in gnss_outages),
        windows=tuple(window_from_text(text) for text in windows),
        nav_rate_hz=nav_rate_hz,
    )


def window_from_text(text: str) -> Stretch:
    """Return (a, b) of "A:B", seconds after the first sample.

    Raises:
        ReplayError: not two numbers with 0 ≤ A < B.
    """
    try:
        start_s, stop_s = (float(part) for part in text.split(":"))
    except ValueError:
        raise ReplayError(f"--window {text!r} is not A:B in seconds. Write for example 60:90.") from None
    if not (math.isfinite(start_s) and math.isfinite(stop_s) and 0.0 <= start_s < stop_s):
        raise ReplayError(
            f"--window {text} is not a stretch: A and B are seconds after the log's first sample, with 0 ≤ A < B."
        )
    return start_s, stop_s

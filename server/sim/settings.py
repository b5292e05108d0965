"""What the demo board may be told, and the link text that tells it: `sim:?seed=3&wind=4&outage=60:85`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal
from urllib.parse import parse_qsl, urlsplit

EXAMPLE: Final = "sim:?seed=3&wind=4&outage=60:85"


@dataclass(frozen=True, slots=True, kw_only=True)
class SimSettings:
    """The demo board's set-up; equal settings give equal bytes.

    Attributes:
        seed: draws the sensors' biases, all noise and the gusts.
        speed: board seconds per host second.
        wind_m_s: mean wind at 10 m and above; gusts of about a quarter of it come on top.
        outages_s: intervals [a, b) of board time, s since power-up, in which the receiver has no fix.
        rate_hz: fastest rate the board grants any message; whole milliseconds, so 333 is every 3 ms.
        noise: factor on every sensor error. 0 is a board of ideal sensors (delays and the wire's resolution stay): for
            calculations only, since as a link it would look broken, its readings never changing at rest.
        errors: "raw" = the sensors err as they left the factory, worth calibrating (`server.sim.errors`), and there is
            a pressure tube; "calibrated" = they err as on a board that somebody took care of.
        rtk: the receiver has a carrier-phase solution (fix_type 6, 1 cm) instead of a plain one (fix_type 3, 0.4 m).
    """

    seed: int = 1
    speed: float = 1.0
    wind_m_s: float = 4.0
    outages_s: tuple[tuple[float, float], ...] = ()
    rate_hz: float = 333.0
    noise: float = 1.0
    rtk: bool = False
    errors: Literal["calibrated", "raw"] = "calibrated"

    @property
    def shortest_interval_ms(self) -> int:
        """Shortest message interval the board grants, ms."""
        return max(1, math.floor(1000.0 / self.rate_hz))


LIMITS: Final[dict[str, tuple[str, float, float, str]]] = {
    "speed": ("speed", 0.1, 20.0, "board seconds per host second"),
    "wind": ("wind_m_s", 0.0, 12.0, "m/s"),
    "rate_hz": ("rate_hz", 1.0, 1000.0, "Hz"),
    "noise": ("noise", 0.01, 10.0, "a factor on every sensor error"),
}
"""URL option: (field of `SimSettings`, least, greatest, unit)."""

OPTIONS: Final = ("seed", *LIMITS, "outage", "rtk", "errors")


def sim_settings(url: str) -> SimSettings:
    """Return the settings that a `sim:` link asks for.

    Raises:
        ValueError: the text is no `sim:` link, or an option is unknown, given twice, malformed or out of range; the
            message names the value, what is allowed and how to write it.
    """
    parts = urlsplit(url)
    if parts.scheme != "sim" or parts.netloc or parts.path.strip("/") or parts.fragment:
        raise ValueError(f"{url!r} is not a demo board: write sim: alone or with options, such as {EXAMPLE}")
    values: dict[str, object] = {}
    outages: list[tuple[float, float]] = []
    for key, text in parse_qsl(parts.query, keep_blank_values=True):
        if key == "outage":
            outages += [_interval(part) for part in text.split(",")]
        else:
            name, value = _option(key, text)
            if name in values:
                raise ValueError(f"sim: {key} is given twice; leave one of them out")
            values[name] = value
    return SimSettings(outages_s=tuple(sorted(outages)), **values)  # type: ignore[arg-type]  # `_option` checks each


def _option(key: str, text: str) -> tuple[str, float | str]:
    if key == "errors":
        if text not in {"calibrated", "raw"}:
            raise ValueError(f"sim: errors={text!r} is neither calibrated nor raw; write errors=raw to calibrate it")
        return key, text
    if key == "rtk":
        if text not in {"0", "1"}:
            raise ValueError(f"sim: rtk={text!r} is neither 0 nor 1; write rtk=1 for a centimetre receiver")
        return key, text == "1"
    if key == "seed":
        if not text.isascii() or not text.isdecimal() or len(text) > 9:
            raise ValueError(f"sim: seed={text!r} is not a whole number from 0 to 999999999; write for instance seed=3")
        return key, int(text)
    if key not in LIMITS:
        raise ValueError(f"sim: option {key!r} is unknown; allowed are {', '.join(OPTIONS)}, as in {EXAMPLE}")
    name, least, greatest, unit = LIMITS[key]
    value = _number(text)
    if not least <= value <= greatest:
        raise ValueError(f"sim: {key}={text!r} is not a number from {least:g} to {greatest:g} ({unit})")
    return name, value


def _interval(text: str) -> tuple[float, float]:
    start, colon, end = text.partition(":")
    a, b = _number(start), _number(end)
    if not colon or not 0.0 <= a < b < math.inf:
        raise ValueError(f"sim: outage={text!r} is not START:END in seconds since power-up; write outage=60:85")
    return a, b


def _number(text: str) -> float:
    """Return the number written in `text`, NaN when there is none (every range check then fails)."""
    try:
        return float(text)
    except ValueError:
        return math.nan

"""Events of the main lane: what the kernel counted in numbers, as sentences for people."""

from __future__ import annotations

import math
from typing import Final

from server.nav.ekf import layout as at
from server.nav.types import Event

EVENT_TEXTS: Final[dict[int, tuple[str, str, str, tuple[str, str]]]] = {
    at.E_ALIGNED: (
        "aligned",
        "info",
        "Aligned; heading σ {0:.3g} rad, tilt σ {1:.3g} rad.",
        ("sigma_heading_rad", "sigma_tilt_rad"),
    ),
    at.E_GNSS_RESET: (
        "gnss-reset",
        "caution",
        "GNSS contradicted the filter for ten seconds; position moved by {0:.1f} m, height by {1:.1f} m.",
        ("horizontal_m", "down_m"),
    ),
    at.E_GNSS_LOST: (
        "gnss-lost",
        "caution",
        "No GNSS fix for {0:.1f} s: dead reckoning. Check the antenna's view of the sky.",
        ("age_s", ""),
    ),
    at.E_GNSS_BACK: (
        "gnss-back",
        "info",
        "GNSS is back after {0:.1f} s; the position was {1:.2f} m away.",
        ("outage_s", "horizontal_m"),
    ),
    at.E_YAW_RESET: ("yaw-reset", "info", "Heading turned by {0:.3f} rad: declination is known now.", ("yaw_rad", "")),
    at.E_HEADING: (
        "heading-found",
        "info",
        "Heading found from the magnetometer, turned by {0:.2f} rad.",
        ("yaw_rad", ""),
    ),
    at.E_BANK: (
        "heading-from-motion",
        "info",
        "Heading found from accelerations against GNSS velocities: turned by {0:+.2f} rad, σ {1:.2g} rad.",
        ("yaw_rad", "sigma_rad"),
    ),
    at.E_COURSE: ("heading-from-course", "info", "Heading taken from the GNSS course: {0:+.2f} rad.", ("yaw_rad", "")),
    at.E_DELAYS: (
        "delay-found",
        "info",
        "Found from the innovations: GNSS is {0:.3f} s late, its velocity {1:.3f} s. A setting would fix them.",
        ("gnss_delay_s", "gnss_velocity_delay_s"),
    ),
    at.E_HANDOVER: (
        "position-known",
        "info",
        "GNSS navigation takes over from the attitude filter: attitude changes by {0:.3f} rad.",
        ("attitude_rad", ""),
    ),
    at.E_FAILED: ("filter-failed", "warning", "The filter lost its numbers and starts again; report this.", ("", "")),
    at.E_GAP: (
        "imu-gap",
        "warning",
        "No IMU data for {0:.2f} s: aligning again. Check the link and the board's load.",
        ("gap_s", ""),
    ),
}


def event(code: int, t_ns: int, first: float, second: float) -> Event:
    """Return the event of a kernel's row: its code, board time, and the two numbers of its sentence."""
    key, severity, text, names = EVENT_TEXTS[code]
    numbers = zip(names, (float(first), float(second)), strict=True)
    values = tuple((name, v) for name, v in numbers if name and math.isfinite(v))
    sentence = text.format(first, second)
    if code == at.E_ALIGNED and math.isnan(first):
        sentence = f"Aligned; tilt σ {second:.3g} rad. Heading unknown: no magnetometer was heard."
    return Event(t_ns=t_ns, code=key, severity=severity, text=sentence, values=values)

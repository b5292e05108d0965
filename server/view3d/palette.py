"""Every colour of the 3D view and what it means; the page draws the legend from the same values."""

from __future__ import annotations

import zlib
from typing import Final

import numpy as np
from numpy.typing import NDArray

from server.nav.types import Float, VehicleClass

Rgb = tuple[int, int, int]

THEMES: Final = ("dark", "light")

LANE_RGB: Final[dict[str, dict[str, Rgb]]] = {
    "dark": {"ins_ekf": (86, 180, 233), "onboard": (230, 159, 0), "reference": (238, 95, 217)},
    "light": {"ins_ekf": (0, 114, 178), "onboard": (168, 100, 0), "reference": (179, 18, 159)},
}
"""Colours of the lanes, the page's `--lane-…` tokens; colour-blind-safe [Okabe and Ito 2008], reference magenta."""

SPARE_RGB: Final[tuple[Rgb, ...]] = ((0, 158, 115), (213, 94, 0), (240, 228, 66), (150, 120, 210), (140, 140, 140))
"""For lanes without a fixed colour, chosen by their name."""

SCALE_RGB: Final[tuple[Rgb, ...]] = ((88, 80, 200), (38, 139, 230), (20, 175, 160), (130, 205, 80), (250, 225, 60))
"""Stops of the sequential scale, dark to bright, even in lightness so that it reads without hue."""

SPEED_TOP_M_S: Final[dict[VehicleClass, float]] = {
    VehicleClass.UNKNOWN: 15.0,
    VehicleClass.MULTIROTOR: 15.0,
    VehicleClass.FIXED_WING: 40.0,
    VehicleClass.CAR: 30.0,
    VehicleClass.HAND_HELD: 3.0,
}
"""Speed at the bright end of the scale (0 at the dark end); fixed, so that a colour means the same all flight."""

SIGMA_RANGE_M: Final = (0.02, 20.0)
"""Horizontal 1 σ at the dark and at the bright end of the scale, logarithmic between."""

FIX_FUSED_RGB: Final[Rgb] = (20, 165, 150)
FIX_REFUSED_RGB: Final[Rgb] = (240, 150, 20)
ACCURACY_RGB: Final[Rgb] = (20, 165, 150)
ELLIPSOID_RGB: Final[Rgb] = (90, 170, 255)
HEADING_CONE_RGB: Final[Rgb] = (255, 196, 60)
TILT_CONE_RGB: Final[Rgb] = (170, 140, 255)
NORTH_RGB: Final[Rgb] = (224, 60, 60)

BODY_RGB: Final[Rgb] = (62, 70, 82)
TRIM_RGB: Final[Rgb] = (112, 122, 138)
FRONT_RGB: Final[Rgb] = (255, 122, 26)
REAR_DISC_RGB: Final[Rgb] = (150, 160, 175)
GLASS_RGB: Final[Rgb] = (120, 190, 235)
PORT_RGB: Final[Rgb] = (225, 50, 50)
STARBOARD_RGB: Final[Rgb] = (40, 185, 90)

SKY_CSS: Final[dict[str, str]] = {
    "dark": "linear-gradient(#0d1725 0%, #1b2d44 34%, #34495f 50%, #2b3744 100%)",
    "light": "linear-gradient(#7fb2e0 0%, #bcd9f0 34%, #e9f2f8 50%, #dfe6e4 100%)",
}
GROUND_RGB: Final[dict[str, Rgb]] = {"dark": (30, 38, 46), "light": (222, 228, 222)}
CELL_RGB: Final[dict[str, Rgb]] = {"dark": (58, 72, 86), "light": (190, 198, 198)}
SECTION_RGB: Final[dict[str, Rgb]] = {"dark": (70, 88, 106), "light": (140, 152, 158)}


def lane_rgb(lane: str, theme: str) -> Rgb:
    """Return the lane's colour, the same in every session."""
    return LANE_RGB[theme].get(lane) or SPARE_RGB[zlib.crc32(lane.encode()) % len(SPARE_RGB)]


def scale_rgb(fraction: Float) -> NDArray[np.uint8]:
    """Return colours of the sequential scale.

    Args:
        fraction: shape (n,), 0 dark to 1 bright, clipped; NaN is dark.

    Returns:
        Shape (n, 3), uint8.
    """
    stops = np.array(SCALE_RGB, dtype=np.float64)
    at = np.clip(np.nan_to_num(fraction), 0.0, 1.0) * (len(stops) - 1)
    places = np.arange(len(stops), dtype=np.float64)
    return np.stack([np.interp(at, places, stops[:, i]) for i in range(3)], axis=1).astype(np.uint8)


def linear_from_srgb(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the same colours with linear instead of sRGB values [IEC 61966-2-1]; any shape, uint8."""
    c = rgb / 255.0
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return np.rint(255.0 * linear).astype(np.uint8)


def speed_fraction(speed_m_s: Float, vehicle: VehicleClass) -> Float:
    """Return the place of a speed (m/s) on the scale, linear from zero."""
    return speed_m_s / SPEED_TOP_M_S[vehicle]


def sigma_fraction(sigma_m: Float) -> Float:
    """Return the place of a horizontal 1 σ (m) on the scale, logarithmic."""
    low, high = np.log(SIGMA_RANGE_M[0]), np.log(SIGMA_RANGE_M[1])
    clipped = np.maximum(np.nan_to_num(sigma_m, nan=SIGMA_RANGE_M[0]), SIGMA_RANGE_M[0])
    return np.asarray((np.log(clipped) - low) / (high - low), dtype=np.float64)

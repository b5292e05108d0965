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
    "dark": {
        "ins_ekf": (89, 160, 249),
        "complementary": (156, 244, 206),
        "nav_position": (240, 225, 80),
        "onboard": (222, 150, 50),
        "reference": (222, 80, 175),
        "smoother": (0, 144, 90),
        "complementary_1": (34, 240, 253),
        "kalman_angle_bias": (226, 70, 50),
        "dmp": (164, 107, 245),
        "ahrs_fixed_gain": (226, 253, 132),
        "vqf": (174, 174, 174),
        "altitude_complementary": (228, 158, 34),
        "altitude_inertial": (129, 220, 255),
        "altitude_kalman": (122, 119, 186),
    },
    "light": {
        "ins_ekf": (30, 85, 160),
        "complementary": (0, 132, 116),
        "nav_position": (122, 116, 36),
        "onboard": (125, 70, 11),
        "reference": (160, 20, 140),
        "smoother": (0, 50, 30),
        "complementary_1": (21, 144, 161),
        "kalman_angle_bias": (160, 70, 50),
        "dmp": (105, 40, 176),
        "ahrs_fixed_gain": (115, 135, 55),
        "vqf": (58, 58, 58),
        "altitude_complementary": (121, 96, 6),
        "altitude_inertial": (29, 72, 124),
        "altitude_kalman": (188, 96, 225),
    },
}
"""Colours of the lanes, the same as on the page (`web/src/ui/lanes.ts`). Within each kind of lane (full, attitude,
altitude; the page tells kinds apart by solid, dashed and dotted lines) they stay apart for colour-blind eyes too: a
test of the page simulates them. The reference is magenta."""

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

FACE_DONE_RGB: Final[Rgb] = (30, 160, 90)
FACE_NEXT_RGB: Final[Rgb] = (245, 165, 20)
FACE_MISSING_RGB: Final[Rgb] = (135, 145, 158)
FACE_TICK_RGB: Final[Rgb] = (250, 252, 255)
GHOST_RGB: Final[Rgb] = (70, 190, 230)

POINT_RGB: Final[dict[str, Rgb]] = {"dark": (120, 200, 255), "light": (20, 80, 160)}
GLOBE_RGB: Final[dict[str, Rgb]] = {"dark": (120, 160, 200), "light": (70, 105, 150)}
OPEN_RGB: Final[dict[str, Rgb]] = {"dark": (245, 165, 20), "light": (190, 95, 0)}
OFFSET_RGB: Final[dict[str, Rgb]] = {"dark": (235, 110, 200), "light": (160, 20, 140)}
RESIDUAL_RGB: Final[tuple[Rgb, ...]] = ((30, 140, 235), (120, 150, 180), (250, 120, 20), (225, 40, 30))
"""Stops from a point on the fitted surface to one that is far from it: blue to orange, which colour-blind eyes part."""

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
    return _between(SCALE_RGB, fraction)


def residual_rgb(fraction: Float) -> NDArray[np.uint8]:
    """Return colours, shape (n, 3), for residuals, shape (n,): 0 on the fitted surface, 1 far from it, clipped."""
    return _between(RESIDUAL_RGB, fraction)


def _between(colours: tuple[Rgb, ...], fraction: Float) -> NDArray[np.uint8]:
    stops = np.array(colours, dtype=np.float64)
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

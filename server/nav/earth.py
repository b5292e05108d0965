"""The Earth as the filter needs it: gravity, radii of curvature, its rate in NED. WGS-84 throughout."""

from __future__ import annotations

import math

from server.nav.constants import (
    WGS84_A_M,
    WGS84_E2,
    WGS84_F,
    WGS84_GAMMA_EQUATOR_M_S2,
    WGS84_M,
    WGS84_SOMIGLIANA_K,
)
from server.nav.kernel import kernel


@kernel("UniTuple(float64, 3)(float64, float64)")
def gravity_and_radii(sin2: float, height_m: float) -> tuple[float, float, float]:
    """Return normal gravity m/s² and the meridian and prime vertical radii m, from the squared sine of the latitude.

    [NIMA TR8350.2, eq. 4-1, 4-3 and §3.2]
    """
    w2 = 1.0 - WGS84_E2 * sin2
    inverse = 1.0 / math.sqrt(w2)
    h = height_m * (1.0 / WGS84_A_M)
    surface = WGS84_GAMMA_EQUATOR_M_S2 * (1.0 + WGS84_SOMIGLIANA_K * sin2) * inverse
    gravity = surface * (1.0 - 2.0 * (1.0 + WGS84_F + WGS84_M - 2.0 * WGS84_F * sin2) * h + 3.0 * h * h)
    prime = WGS84_A_M * inverse
    return gravity, prime * (1.0 - WGS84_E2) * inverse * inverse, prime


@kernel("float64(float64, float64)")
def normal_gravity(lat_rad: float, height_m: float) -> float:
    """Return normal gravity in m/s² at a geodetic latitude and height [NIMA TR8350.2, eq. 4-1 and 4-3]."""
    return gravity_and_radii(math.sin(lat_rad) ** 2, height_m)[0]


@kernel("UniTuple(float64, 2)(float64)")
def curvature_radii(lat_rad: float) -> tuple[float, float]:
    """Return (meridian, prime vertical) radii of curvature in m at a geodetic latitude [NIMA TR8350.2, §3.2]."""
    w2 = 1.0 - WGS84_E2 * math.sin(lat_rad) ** 2
    prime = WGS84_A_M / math.sqrt(w2)
    return prime * (1.0 - WGS84_E2) / w2, prime


@kernel("UniTuple(float64, 3)(float64, float64, float64, float64, float64, float64)")
def ned_from_lla(
    lat_rad: float, lon_rad: float, height_m: float, lat0_rad: float, lon0_rad: float, height0_m: float
) -> tuple[float, float, float]:
    """Return metres north, east, down along the ellipsoid's own curves from the origin (not a tangent plane).

    Exact in height and to second order in the horizontal distance: 1 mm at 1 km, 0.1 m at 10 km at mid latitudes.
    Longitudes may differ across the date line.
    """
    meridian, prime = curvature_radii(0.5 * (lat_rad + lat0_rad))
    height = 0.5 * (height_m + height0_m)
    dlon = (lon_rad - lon0_rad + math.pi) % (2.0 * math.pi) - math.pi
    north = (lat_rad - lat0_rad) * (meridian + height)
    east = dlon * (prime + height) * math.cos(0.5 * (lat_rad + lat0_rad))
    return north, east, height0_m - height_m

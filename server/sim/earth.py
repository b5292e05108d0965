"""The demo board's Earth: WGS-84 ellipsoid, normal gravity, Earth rate, standard atmosphere.

Written apart from `server.nav.earth` on purpose: truth that shares the estimator's formulas would hide their mistakes.
Constants from NIMA TR8350.2, third edition, tables 3.1 to 3.4.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from server.nav.types import Float

SEMI_MAJOR_M: Final = 6378137.0
FLATTENING: Final = 1.0 / 298.257223563
ECCENTRICITY_SQ: Final = FLATTENING * (2.0 - FLATTENING)
EARTH_RATE_RAD_S: Final = 7.292115e-5
GRAVITY_EQUATOR_M_S2: Final = 9.7803253359
SOMIGLIANA_K: Final = 0.00193185265241
CENTRIFUGAL_RATIO: Final = 0.00344978650684  # ω²a²b/GM

SITE_LAT_DEG: Final = 47.3977
SITE_LON_DEG: Final = 8.5456
SITE_ALT_M: Final = 488.0
"""A field in Zürich, above mean sea level."""
GEOID_M: Final = 47.3
"""Height of the geoid above the ellipsoid there (EGM96, rounded)."""

_SIN_SQ: Final = math.sin(math.radians(SITE_LAT_DEG)) ** 2
_CURVE: Final = 1.0 - ECCENTRICITY_SQ * _SIN_SQ
_HEIGHT_M: Final = SITE_ALT_M + GEOID_M
RADIUS_N_M: Final = SEMI_MAJOR_M * (1.0 - ECCENTRICITY_SQ) / _CURVE**1.5 + _HEIGHT_M
"""Metres northward per radian of latitude at the site; 20 m of climb change it by 3e-6."""
RADIUS_E_M: Final = SEMI_MAJOR_M / math.sqrt(_CURVE) + _HEIGHT_M
"""Radius of curvature across the meridian at the site, m."""

EARTH_RATE_N_RAD_S: Final = EARTH_RATE_RAD_S * np.array(
    [math.cos(math.radians(SITE_LAT_DEG)), 0.0, -math.sin(math.radians(SITE_LAT_DEG))]
)
"""Rotation of the Earth at the site, NED."""


def geodetic_from_ned(pos_n_m: Float) -> Float:
    """Return latitude and longitude in degrees and height above sea level in metres, shape (n, 3).

    Args:
        pos_n_m: shape (n, 3), path lengths north, east and down from the site.
    """
    lat_deg = SITE_LAT_DEG + np.degrees(pos_n_m[:, 0] / RADIUS_N_M)
    lon_deg = SITE_LON_DEG + np.degrees(pos_n_m[:, 1] / (RADIUS_E_M * math.cos(math.radians(SITE_LAT_DEG))))
    return np.column_stack([lat_deg, lon_deg, SITE_ALT_M - pos_n_m[:, 2]])


def gravity_m_s2(alt_m: Float) -> Float:
    """Return normal gravity at the site's latitude (Somigliana, TR8350.2 eq. 4-1 and 4-3), shape (n,).

    Args:
        alt_m: shape (n,), height above mean sea level.
    """
    surface = GRAVITY_EQUATOR_M_S2 * (1.0 + SOMIGLIANA_K * _SIN_SQ) / math.sqrt(_CURVE)
    ratio = (np.asarray(alt_m) + GEOID_M) / SEMI_MAJOR_M
    shape = 1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * _SIN_SQ
    return np.asarray(surface * (1.0 - 2.0 * shape * ratio + 3.0 * ratio**2))


def turn_rate_n_rad_s(vel_n_m_s: Float) -> Float:
    """Return the rotation of the local NED frame over the Earth (transport rate), shape (n, 3)."""
    east = vel_n_m_s[:, 1] / RADIUS_E_M
    tangent = math.tan(math.radians(SITE_LAT_DEG))
    return np.column_stack([east, -vel_n_m_s[:, 0] / RADIUS_N_M, -east * tangent])


def pressure_pa(alt_m: Float) -> Float:
    """Return the standard atmosphere's pressure, shape (n,) [ISO 2533, troposphere]."""
    return np.asarray(101325.0 * (1.0 - 0.0065 * np.asarray(alt_m) / 288.15) ** 5.2558797)

"""Constants of the Earth and of the field, each with its source; SI units."""

from __future__ import annotations

from typing import Final

# WGS-84 ellipsoid and normal gravity [NIMA TR8350.2, tables 3.1, 3.3, 3.4].
WGS84_A_M: Final = 6378137.0
WGS84_F: Final = 1.0 / 298.257223563
WGS84_E2: Final = WGS84_F * (2.0 - WGS84_F)
WGS84_GAMMA_EQUATOR_M_S2: Final = 9.7803253359
WGS84_SOMIGLIANA_K: Final = 0.00193185265241
WGS84_M: Final = 0.00344978650684  # ω² a² b / GM
EARTH_RATE_RAD_S: Final = 7.292115e-5

STANDARD_GRAVITY_M_S2: Final = 9.80665

# International standard atmosphere below 11 km, as S0 (3.27) uses it: H = 44330.8 (1 − (P/P0)^0.19026).
ISA_PRESSURE_PA: Final = 101325.0
ISA_HEIGHT_M: Final = 44330.8
ISA_EXPONENT: Final = 0.19026

# The Earth's field lies between about 0.22 gauss (South Atlantic) and 0.67 gauss (magnetic poles) [WMM2025 report, §1].
EARTH_FIELD_MIN_GAUSS: Final = 0.20
EARTH_FIELD_MAX_GAUSS: Final = 0.70

NAV_RATE_MIN_HZ: Final = 1.0
NAV_RATE_MAX_HZ: Final = 2000.0
"""Navigation steps a second that the engine takes."""

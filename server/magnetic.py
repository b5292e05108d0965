"""The Earth's magnetic field by the World Magnetic Model: the shell computes it, the engine is handed the result."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from server.nav.types import Float

WMM_EDITIONS: Final = ((2010.0, "2010"), (2015.0, "2015"), (2018.71, "2015v2"), (2020.0, "2020"), (2025.0, "2025"))
"""From when each edition the library ships holds: its epoch, or for the out-of-cycle 2015v2 its date of 2018-09-18."""

WMM_EPOCH_YEAR: Final = WMM_EDITIONS[-1][0]
"""Epoch of the newest edition: the date used when none is known."""

WMM_LAST_YEAR: Final = WMM_EPOCH_YEAR + 5.0
WMM_FIRST_YEAR: Final = WMM_EDITIONS[0][0]

_GAUSS_FROM_NT: Final = 1e-5
_POLE_DEG: Final = 90.0 - 1e-9  # the library's recurrence divides by the distance to the pole


def wmm_field(lat_deg: float, lon_deg: float, alt_m: float, decimal_year: float) -> tuple[Float, float]:
    """Return the field (NED, gauss, shape (3,)) and the decimal year that was used.

    Args:
        lat_deg: geodetic latitude.
        lon_deg: longitude, any turn.
        alt_m: height; WGS-84 or mean sea level, the difference is below the model's error. NaN = 0.
        decimal_year: date; NaN takes the newest model's own epoch, a date outside of every edition's life is
            held at the nearest end. The returned year says so.

    Raises:
        ValueError: the place is not on Earth.
    """
    if not (math.isfinite(lon_deg) and abs(lat_deg) <= 90.0):
        raise ValueError(f"no magnetic field at lat_deg={lat_deg}, lon_deg={lon_deg}: give a latitude in -90..90")
    year = WMM_EPOCH_YEAR if math.isnan(decimal_year) else min(max(decimal_year, WMM_FIRST_YEAR), WMM_LAST_YEAR)
    result = _model(year).calculate(
        glat=min(max(lat_deg, -_POLE_DEG), _POLE_DEG),
        glon=math.remainder(lon_deg, 360.0),
        alt=(alt_m if math.isfinite(alt_m) else 0.0) * 1e-3,
        time=year,
    )
    return np.array([result.x, result.y, result.z]) * _GAUSS_FROM_NT, year


def _model(year: float) -> Any:  # noqa: ANN401  (the library has no types)
    """Return a fresh model of the edition that covers `year`; it keeps scratch state, so it is never shared."""
    from importlib import import_module

    from pygeomag import GeoMag

    edition = next(name for start, name in reversed(WMM_EDITIONS) if year >= start)
    data = getattr(import_module(f"pygeomag.wmm.wmm_{edition}"), f"WMM_{edition}")
    return GeoMag(coefficients_data=data)

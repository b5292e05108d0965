"""The local frame's origin: when it is known, where it is, and which magnetic field it has."""

from __future__ import annotations

import math
from typing import Final

from server.nav.earth import normal_gravity
from server.nav.types import EngineSettings, FieldModel, Site

DATE_PATIENCE_NS: Final = 2_000_000_000
"""A board that tells its date does so every second; after two the model's own epoch must do."""


class SiteFinder:
    """Decide once where the origin is: from settings at once, else from the first 3-D fix and the board's date."""

    def __init__(self, settings: EngineSettings, field_model: FieldModel) -> None:
        self._settings, self._field_model = settings, field_model
        self.board_year = math.nan
        self.awaits_date = False  # the protocol is one that sends dates
        self._fix: tuple[float, float, float] | None = None
        self._t_fix_ns = 0
        self.site: Site | None = None
        if math.isfinite(settings.site_lat_deg) and math.isfinite(settings.site_lon_deg):
            alt_m = settings.site_alt_m if math.isfinite(settings.site_alt_m) else 0.0
            self._fix = (settings.site_lat_deg, settings.site_lon_deg, alt_m)

    @property
    def has_fix(self) -> bool:
        """Whether the place is known and only the date is waited for."""
        return self._fix is not None

    def take_fix(self, lat_deg: float, lon_deg: float, alt_m: float, t_ns: int) -> bool:
        """Take the first 3-D fix as the place; return whether it was one."""
        if self._fix is None and math.isfinite(lat_deg) and math.isfinite(lon_deg):
            self._fix, self._t_fix_ns = (lat_deg, lon_deg, alt_m if math.isfinite(alt_m) else 0.0), t_ns
            return True
        return False

    def settle(self, t_ns: int) -> Site | None:
        """Return the site when it can be settled at t_ns, and was not before."""
        if self.site is not None or self._fix is None:
            return None
        year, source = self._date()
        if source == "model-epoch" and self.awaits_date and t_ns - self._t_fix_ns < DATE_PATIENCE_NS:
            return None
        lat_deg, lon_deg, alt_m = self._fix
        field, used = self._field_model(lat_deg, lon_deg, alt_m, year)
        self.site = Site(
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            alt_m=alt_m,
            gravity_m_s2=normal_gravity(math.radians(lat_deg), alt_m),
            declination_rad=math.atan2(field[1], field[0]),
            field_n_gauss=tuple(float(v) for v in field),
            decimal_year=used,
            date_source=source,
        )
        return self.site

    def _date(self) -> tuple[float, str]:
        if math.isfinite(self._settings.decimal_year):
            return self._settings.decimal_year, "settings"
        if math.isfinite(self.board_year):
            return self.board_year, "board"
        return math.nan, "model-epoch"

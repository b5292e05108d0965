"""What a person told and what the site knows, as the options of a collector."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from server.nav.calibration.types import GRAVITY_M_S2, NAN, Options

if TYPE_CHECKING:
    from server.nav.types import Site
    from server.wire_calibration import OptionsIn


def options_from(told: OptionsIn, site: Site | None) -> Options:
    """Return the options; a person's word wins over the site's."""
    field = np.array(site.field_n_gauss) if site is not None else np.empty(0)
    strength = float(np.linalg.norm(field)) if field.size else NAN
    if field.size and told.strength_gauss is not None:
        field = field * (told.strength_gauss / strength)
    gravity = site.gravity_m_s2 if site is not None else GRAVITY_M_S2
    return Options(
        unit="si",
        strength=told.strength_gauss if told.strength_gauss is not None else strength,
        gravity_m_s2=told.gravity_m_s2 if told.gravity_m_s2 is not None else gravity,
        axis=told.axis or "",
        turns=told.turns if told.turns is not None else NAN,
        ellipsoid_parameters=told.ellipsoid_parameters,
        duration_s=told.duration_s if told.duration_s is not None else NAN,
        heading_rad=math.radians(told.heading_deg) if told.heading_deg is not None else NAN,
        heading_sigma_rad=math.radians(told.heading_sigma_deg),
        field_n_gauss=tuple(field.tolist()),
        height_m=told.height_m if told.height_m is not None else NAN,
    )

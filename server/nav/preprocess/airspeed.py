"""Differential pressure → true airspeed with the density of the air at hand [S0 eq. 3.24-3.25]."""

from __future__ import annotations

import math
from typing import Final

from server.nav.constants import ISA_EXPONENT, ISA_PRESSURE_PA
from server.nav.kernel import kernel

AIR_J_KG_K: Final = 287.05  # specific gas constant of dry air
KELVIN: Final = 273.15
ISA_KELVIN: Final = 288.15
SEA_LEVEL_KG_M3: Final = 1.225


@kernel("float64(float64, float64)")
def air_density(pressure_pa: float, temperature_degc: float) -> float:
    """Return ρ = p / (R T), kg/m³ [S0 eq. 3.25].

    Args:
        pressure_pa: static pressure; NaN: the standard atmosphere's density at sea level is returned.
        temperature_degc: of the air; NaN: the standard atmosphere's at that pressure.
    """
    if not pressure_pa > 0.0:
        return SEA_LEVEL_KG_M3
    kelvin = temperature_degc + KELVIN
    if not kelvin > 0.0:
        kelvin = ISA_KELVIN * (pressure_pa / ISA_PRESSURE_PA) ** ISA_EXPONENT
    return pressure_pa / (AIR_J_KG_K * kelvin)


@kernel("float64(float64, float64)")
def airspeed_from_pressure(diff_pressure_pa: float, density_kg_m3: float) -> float:
    """Return V = √(2 (p_t − p_s) / ρ), m/s [S0 eq. 3.24]; a negative difference is no wind, 0 m/s."""
    return math.sqrt(2.0 * max(0.0, diff_pressure_pa) / density_kg_m3)

"""Units as figures and verbs print them: of our own data in watts, of a foreign measurement what it says of itself and no more."""

from __future__ import annotations

from optsim.cube import FOREIGN, OVER_RESPONSE, UNITS

WATTS = "W m⁻² sr⁻¹ nm⁻¹"
NAMED = {"relative": "relative units", "electron": "electrons", "DN": "digital numbers (DN)"}


def cube_unit(units: str) -> str:
    """Return a cube's unit in words; ``units`` as in the attribute of ``radiance``."""
    if units == UNITS:
        return WATTS
    if units.endswith(OVER_RESPONSE):
        plain = units.removesuffix(OVER_RESPONSE)
        return f"{'frame units' if plain == 'relative' else NAMED.get(plain, plain)} over response"
    return NAMED.get(units, units)


def frame_unit(units: str, model: str = "") -> str:
    """Return what frames count, in words; ``units`` and ``model`` are their attributes."""
    return f"sum of band radiances, {WATTS}" if units == "relative" and model != FOREIGN else NAMED.get(units, units)

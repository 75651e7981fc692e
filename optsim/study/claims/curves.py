"""Which response curves the three sensors have: one factor of the readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from optsim.camera import Bayer, Foveon, Mono, Sensor, sensors
from optsim.camera.absolute import AssumedEfficiencies
from optsim.camera.emulate import GlassPlates
from optsim.camera.sensor import COLOUR_NAMES


@dataclass(frozen=True)
class Curves:
    """A set of three sensors under a name.

    Args:
        name: for files and tables.
        make: returns monochrome, Bayer and Foveon sensor.
    """

    name: str
    make: Callable[[], tuple[Sensor, ...]]

    def of(self, sensor: str) -> Sensor:
        """Return the sensor of that name: mono, bayer or foveon."""
        return {made.name: made for made in _made(self)}[sensor]


@cache
def _made(curves: Curves) -> tuple[Sensor, ...]:
    return curves.make()


def _with_foveon(foveon: Foveon) -> tuple[Sensor, ...]:
    return (*sensors()[:2], foveon)


def _glass() -> tuple[Sensor, ...]:
    behind = GlassPlates().before(Mono())
    return _with_foveon(Foveon(**{name: sensor.curve for name, sensor in zip(COLOUR_NAMES, behind)}))


PUBLISHED = Curves("published", sensors)
"""Flat mono, Nikon 5100 and Sigma SD Merrill as measured by NPL, each curve's maximum 1."""
PHYSICAL_FOVEON = Curves("physical-foveon", lambda: _with_foveon(Foveon.physical()))
"""Foveon's layers by the absorption of silicon."""
GLASS_FOVEON = Curves("glass-foveon", _glass)
"""Foveon emulated by a flat sensor behind red, green and blue glass, as in the paper's test bed."""
PHOTONS = Curves("photons", lambda: AssumedEfficiencies().sensors())
"""Absolute efficiencies by assumption: mono (silicon) and Bayer 0.5 at their peaks, the Foveon's layers together 0.6."""


def without_mosaic(bayer: Bayer) -> Foveon:
    """Return a sensor with the mosaic's three curves in every pixel: what a demosaiced frame pretends to be."""
    return Foveon(red=bayer.red, green=bayer.green, blue=bayer.blue)

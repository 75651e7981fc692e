"""Scene + Bands -> radiance cube. The only package that imports Mitsuba, and only when a render starts."""

from optsim.render.backend import doctor
from optsim.render.passes import render
from optsim.render.settings import RenderSettings

__all__ = ["RenderSettings", "doctor", "render"]

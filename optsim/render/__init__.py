"""Scene + Bands -> radiance cube. The only package that imports Mitsuba, and only when a render starts."""

from optsim.render.backend import doctor
from optsim.render.needs import Effect, Needs, explain
from optsim.render.picture import render, render_with_film
from optsim.render.settings import RenderSettings
from optsim.render.stream import CubeSink, render_to

__all__ = ["CubeSink", "Effect", "Needs", "RenderSettings", "doctor", "explain", "render", "render_to", "render_with_film"]

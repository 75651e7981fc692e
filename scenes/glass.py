"""A glass ball and a glass prism on the chart: refraction, caustics, and colours fanned out when an Abbe number is given."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, InstanceOf

from scenes.color_checker import ColorChecker, Region, square_lamp
from scenes.library import illuminant
from scenes.lights import ConstantSky, Light
from scenes.materials import Dielectric, Diffuse
from scenes.meshes import cylinder
from scenes.model import Model, ranged
from scenes.scene import Scene
from scenes.shapes import Shape, Sphere
from scenes.spectrum import Spectrum
from scenes.viewpoint import Perspective

LAMP_PLACE = (-3.0, 2.0, 6.0)
"""In sides of the chart."""
LAMP_HALF = 1.6
"""Large, so that caustics are soft."""
SKY = 0.4
"""Irradiance of the sky as a fraction of the lamp's."""


class Glass(Model):
    """The colour checker lying under a glass ball and a triangular glass bar, seen at an angle.

    Args:
        name: of the scene.
        index: of the glass at 587.56 nm.
        abbe: its Abbe number; None for no dispersion (a dispersive render costs several times as much).
        lamp: relative spectrum of the lamp and of the sky.
        irradiance: of the lamp on the middle of the chart, mean over 450 to 670 nm, in W m^-2 nm^-1.
    """

    place: ClassVar[str] = "glass"
    name: str = "glass"
    index: Annotated[float, ranged(1, 4, "(refractive index)")] = 1.6204
    abbe: Annotated[float, ranged(5, 1000, "(Abbe number)")] | None = None
    lamp: InstanceOf[Spectrum] = Field(default_factory=lambda: illuminant("xenon"))
    irradiance: Annotated[float, ranged(0, 1e20, "W m^-2 nm^-1")] = 0.01

    def build(self) -> Scene:
        """Return the scene."""
        chart = ColorChecker(lamp=self.lamp, irradiance=self.irradiance)
        table = chart.flat("table", "table", Region(-2, -2, 3, 3), -1)
        own = {"glass": Dielectric(index=self.index, abbe=self.abbe), "table": Diffuse(reflectance=Spectrum.constant(0.25))}
        return Scene(
            name=self.name,
            shapes=(table, *chart.shapes(), *self._glasses()),
            materials=chart.materials() | own,
            lights=self._lights(chart),
            viewpoint=Perspective(origin=(0.0, -0.48, 0.47), target=(0.0, -0.01, 0.01), up=(0, 0, 1), fov_deg=25),
            description="A glass ball and a glass prism over the colour checker: refraction and caustics, "
            + ("without dispersion." if self.abbe is None else f"and colours fanned out (Abbe number {self.abbe:g})."),
        )

    def _glasses(self) -> tuple[Shape, ...]:
        lying = np.eye(4)
        turn = np.deg2rad(70)
        about_z = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        lying[:3, :3] = about_z @ [[0, 0, -1], [0, 1, 0], [1, 0, 0]]
        lying[:3, 3] = (0.05, -0.02, 0.0155)
        return (
            Sphere(name="ball", material="glass", center=(-0.045, 0.02, 0.0455), radius=0.045),
            cylinder("prism", "glass", (0.03, 0.11), lying, 3),
        )

    def _lights(self, chart: ColorChecker) -> tuple[Light, ...]:
        sky = self.lamp.scaled(SKY * self.irradiance / np.pi / float(self.lamp.band_mean(450.0, 670.0)))
        place = tuple(x * chart.side_m for x in LAMP_PLACE)
        lamp = square_lamp(place, LAMP_HALF * chart.side_m, Spectrum.constant(1.0))
        level = self.irradiance / lamp.irradiance_per_radiance((0, 0, 0), (0, 0, 1)) / float(self.lamp.band_mean(450.0, 670.0))
        return (square_lamp(place, LAMP_HALF * chart.side_m, self.lamp.scaled(level)), ConstantSky(radiance=sky))

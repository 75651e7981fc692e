"""A room with a red and a green wall, two blocks and a lamp in the ceiling: light that goes from surface to surface."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, InstanceOf

from scenes.library import illuminant, reflectance
from scenes.lights import AreaLight
from scenes.materials import Diffuse
from scenes.model import Model, ranged
from scenes.scene import Scene
from scenes.shapes import Box, Rectangle, Shape
from scenes.spectrum import Spectrum
from scenes.viewpoint import Perspective

WHITE = "neutral 8 (.23 D)"


class Cornell(Model):
    """A cube of one metre after Goral et al. (1984) with walls of measured paints, open towards the camera, z up.

    Args:
        name: of the scene.
        lamp: relative spectrum of the lamp.
        radiance: of the lamp, mean over 450 to 670 nm, in W m^-2 sr^-1 nm^-1.
    """

    place: ClassVar[str] = "cornell"
    name: str = "cornell"
    lamp: InstanceOf[Spectrum] = Field(default_factory=lambda: illuminant("A"))
    radiance: Annotated[float, ranged(0, 1e20, "W m^-2 sr^-1 nm^-1")] = 0.1

    def build(self) -> Scene:
        """Return the scene."""
        return Scene(
            name=self.name,
            shapes=(*self._walls(), *self._blocks()),
            materials={
                "white": Diffuse(reflectance=reflectance(WHITE)),
                "red": Diffuse(reflectance=reflectance("red")),
                "green": Diffuse(reflectance=reflectance("green")),
            },
            lights=(self._light(),),
            viewpoint=Perspective(origin=(0, -1.85, 0.5), target=(0, 0, 0.5), up=(0, 0, 1), fov_deg=40),
            description="A room with a red and a green wall and two blocks: each surface is lit by the others.",
        )

    def _walls(self) -> tuple[Shape, ...]:
        def wall(name: str, material: str, center: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...]) -> Rectangle:
            return Rectangle(name=name, material=material, center=center, half_u=u, half_v=v)

        return (
            wall("floor", "white", (0, 0, 0), (0.5, 0, 0), (0, 0.5, 0)),
            wall("ceiling", "white", (0, 0, 1), (0, 0.5, 0), (0.5, 0, 0)),
            wall("back", "white", (0, 0.5, 0.5), (0.5, 0, 0), (0, 0, 0.5)),
            wall("left", "red", (-0.5, 0, 0.5), (0, 0.5, 0), (0, 0, 0.5)),
            wall("right", "green", (0.5, 0, 0.5), (0, 0, 0.5), (0, 0.5, 0)),
        )

    def _blocks(self) -> tuple[Shape, ...]:
        def block(name: str, center: tuple[float, float], half: tuple[float, float], turn_deg: float) -> Box:
            c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
            side, height = half
            u, v = (side * c, side * s, 0.0), (-side * s, side * c, 0.0)
            return Box(name=name, material="white", center=(*center, height), half_u=u, half_v=v, half_w=(0, 0, height))

        return (block("tall block", (-0.17, 0.13), (0.15, 0.3), 17), block("low block", (0.18, -0.15), (0.15, 0.15), -17))

    def _light(self) -> AreaLight:
        mean = float(self.lamp.band_mean(450.0, 670.0))
        radiance = self.lamp.scaled(self.radiance / mean) if mean > 0 else self.lamp
        return AreaLight(center=(0, 0, 0.998), half_u=(0, 0.1, 0), half_v=(0.13, 0, 0), radiance=radiance)

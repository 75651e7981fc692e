"""A small world of blocks: the chart in relief with a ball, a ring and a box, a floor and a wall; colours bleed into each other."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, InstanceOf

from scenes.color_checker import COLUMNS, LIGHT_BAND_NM, square_lamp
from scenes.library import illuminant, reflectance, reflectances
from scenes.lights import ConstantSky, Light
from scenes.materials import Diffuse, Material
from scenes.meshes import torus
from scenes.model import Model, ranged
from scenes.scene import Scene
from scenes.shapes import Box, Rectangle, Shape, Sphere
from scenes.spectrum import Spectrum
from scenes.viewpoint import Perspective

PITCH_M = 0.05
BLOCK_M = 0.044
HEIGHTS_M = (0.008, 0.020, 0.012, 0.028, 0.016, 0.024)


class Relief(Model):
    """The chart as blocks of different heights, z up, with a red ball, a yellow ring and a green box; all of it diffuse.

    Args:
        name: of the scene.
        lamp: relative spectrum of the lamp and of the sky.
        irradiance: of the lamp on the middle of the chart, mean over 450 to 670 nm, in W m^-2 nm^-1.
        sky: irradiance of the sky there, as a fraction of the lamp's.
        ring_sections: facets round the ring and its tube.
    """

    place: ClassVar[str] = "relief"
    name: str = "relief"
    lamp: InstanceOf[Spectrum] = Field(default_factory=lambda: illuminant("xenon"))
    irradiance: Annotated[float, ranged(0, 1e20, "W m^-2 nm^-1")] = 0.01
    sky: Annotated[float, ranged(0, 1e6, "of the lamp")] = 0.15
    ring_sections: Annotated[int, Field(ge=3, le=128)] = 24

    def build(self) -> Scene:
        """Return the scene."""
        return Scene(
            name=self.name,
            shapes=(*self._room(), *self._blocks(), *self._things()),
            materials=self._materials(),
            lights=self._lights(),
            viewpoint=Perspective(origin=(0.02, -0.62, 0.44), target=(0.0, -0.015, 0.012), up=(0, 0, 1), fov_deg=29),
            description="The chart as blocks with a ball, a ring and a box before a wall: shadows and light from surface to surface.",
        )

    def _room(self) -> list[Shape]:
        floor = Rectangle(name="floor", material="floor", center=(0, 0, 0), half_u=(1.2, 0, 0), half_v=(0, 1.2, 0))
        wall = Rectangle(name="wall", material="wall", center=(0, 0.24, 0.4), half_u=(1.2, 0, 0), half_v=(0, 0, 0.4))
        return [floor, wall]

    def _blocks(self) -> list[Shape]:
        blocks: list[Shape] = []
        half = BLOCK_M / 2
        for i, name in enumerate(reflectances()):
            row, column = divmod(i, COLUMNS)
            height = HEIGHTS_M[(2 * column + 3 * row) % len(HEIGHTS_M)] / 2
            center = ((column - 2.5) * PITCH_M, (1.5 - row) * PITCH_M, height)
            blocks.append(Box(name=name, material=name, center=center, half_u=(half, 0, 0), half_v=(0, half, 0), half_w=(0, 0, height)))
        return blocks

    def _things(self) -> list[Shape]:
        tilt = np.eye(4)
        a = np.deg2rad(20)
        tilt[:3, :3] = [[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]
        tilt[:3, 3] = (0.105, -0.165, 0.0245)
        c, s = np.cos(0.5) * 0.028, np.sin(0.5) * 0.028
        return [
            Sphere(name="ball", material="red", center=(-0.105, -0.155, 0.036), radius=0.036),
            torus("ring", "yellow", (0.036, 0.012), tilt, self.ring_sections),
            Box(name="box", material="green", center=(0.0, -0.165, 0.028), half_u=(c, s, 0), half_v=(-s, c, 0), half_w=(0, 0, 0.028)),
        ]

    def _materials(self) -> dict[str, Material]:
        patches: dict[str, Material] = {name: Diffuse(reflectance=reflectance(name)) for name in reflectances()}
        return patches | {"floor": Diffuse(reflectance=Spectrum.constant(0.35)), "wall": Diffuse(reflectance=reflectance("light skin"))}

    def _lights(self) -> tuple[Light, ...]:
        lamp = square_lamp((-0.6, -0.7, 1.3), 0.12, Spectrum.constant(1.0))
        unit = self.lamp.scaled(self.irradiance / float(self.lamp.band_mean(*LIGHT_BAND_NM)))
        radiance = unit.scaled(1 / lamp.irradiance_per_radiance((0, 0, 0), (0, 0, 1)))
        return (square_lamp((-0.6, -0.7, 1.3), 0.12, radiance), ConstantSky(radiance=unit.scaled(self.sky / np.pi)))

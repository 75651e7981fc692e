"""Seven alcoves, each ten times dimmer than the one before: six decades of light in one picture."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field, InstanceOf

from scenes.library import illuminant, reflectance, reflectances
from scenes.lights import AreaLight
from scenes.materials import Diffuse, Material
from scenes.model import Model, ranged
from scenes.scene import Scene
from scenes.shapes import Rectangle, Shape
from scenes.spectrum import Spectrum
from scenes.viewpoint import Orthographic

HALF, DEPTH = 0.07, 0.2
"""Half the width of an alcove and its depth, in metres; the picture is one metre wide."""
PATCHES = 3


class DimBright(Model):
    """A row of alcoves with black walls between them, each with a lamp of its own and three patches on its back wall.

    Args:
        name: of the scene.
        alcoves: 2 to 12; each is ten times dimmer than the one to its left.
        lamp: relative spectrum of the lamps.
        radiance: of the brightest lamp, mean over 450 to 670 nm, in W m^-2 sr^-1 nm^-1.
    """

    place: ClassVar[str] = "dim_bright"
    name: str = "dim-bright"
    alcoves: Annotated[int, Field(ge=2, le=12)] = 7
    lamp: InstanceOf[Spectrum] = Field(default_factory=lambda: illuminant("xenon"))
    radiance: Annotated[float, ranged(0, 1e20, "W m^-2 sr^-1 nm^-1")] = 1.0

    def build(self) -> Scene:
        """Return the scene; z is towards the camera, y up."""
        pitch = 1 / self.alcoves
        half = HALF * 7 / self.alcoves
        shapes: list[Shape] = []
        names = reflectances()
        materials: dict[str, Material] = {"black": Diffuse(reflectance=0.0), "grey": Diffuse(reflectance=0.2)}
        lights = []
        mean = float(self.lamp.band_mean(450.0, 670.0))
        unit = self.lamp.scaled(self.radiance / mean) if mean > 0 else self.lamp
        for i in range(self.alcoves):
            x = (i + 0.5) * pitch - 0.5
            shapes += self._walls(i, x, half)
            for j in range(PATCHES):
                patch = names[(PATCHES * i + j) % len(names)]
                materials[patch] = Diffuse(reflectance=reflectance(patch))
                name, y = f"alcove {i} patch {j}", (j - 1) * 0.22
                shapes.append(
                    Rectangle(name=name, material=patch, center=(x, y, -DEPTH + 1e-4), half_u=(0.8 * half, 0, 0), half_v=(0, 0.09, 0))
                )
            lamp = {"center": (x, 0.39, -DEPTH / 2), "half_u": (0.6 * half, 0, 0), "half_v": (0, 0, 0.3 * DEPTH)}
            lights.append(AreaLight(**lamp, radiance=unit.scaled(10.0**-i)))
        front = Orthographic(origin=(0, 0, 2), target=(0, 0, 0), up=(0, 1, 0), half_height=0.5)
        return Scene(
            name=self.name,
            shapes=tuple(shapes),
            materials=materials,
            lights=tuple(lights),
            viewpoint=front,
            description=f"{self.alcoves} alcoves with three patches each; every alcove is ten times dimmer than the one to its left.",
        )

    def _walls(self, i: int, x: float, half: float) -> list[Shape]:
        """Return back, sides, floor and ceiling of an alcove, seen from inside; black sides keep the light in."""

        def wall(name: str, material: str, center: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...]) -> Rectangle:
            return Rectangle(name=f"alcove {i} {name}", material=material, center=center, half_u=u, half_v=v)

        deep = DEPTH / 2
        return [
            wall("back", "grey", (x, 0, -DEPTH), (half, 0, 0), (0, 0.4, 0)),
            wall("left", "black", (x - half, 0, -deep), (0, 0.4, 0), (0, 0, deep)),
            wall("right", "black", (x + half, 0, -deep), (0, 0, deep), (0, 0.4, 0)),
            wall("floor", "black", (x, -0.4, -deep), (0, 0, deep), (half, 0, 0)),
            wall("ceiling", "black", (x, 0.4, -deep), (half, 0, 0), (0, 0, deep)),
        ]

"""The first target: a chart of 24 patches on a dark board, lit by a xenon lamp, filling the picture exactly."""

from __future__ import annotations

from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, InstanceOf

from scenes.library import illuminant, reflectance, reflectances
from scenes.lights import AreaLight
from scenes.materials import Diffuse, Material, Reflectance
from scenes.model import Model, ranged, vector
from scenes.scene import Scene
from scenes.shapes import Rectangle, Shape
from scenes.spectrum import Spectrum
from scenes.viewpoint import Orthographic

COLUMNS, ROWS = 6, 4
PATCH = (0.1243, 0.2011)
"""Width and height of a patch, as fractions of the picture. Borders fall where they fall, as in a photograph: on a dyadic grid, such
as multiples of 1/64, a Haar basis recovers the chart 15 dB better than any other (docs/decisions/0003-basis.md)."""
GAP = 0.0317
MARGIN = ((1 - COLUMNS * PATCH[0] - (COLUMNS - 1) * GAP) / 2, (1 - ROWS * PATCH[1] - (ROWS - 1) * GAP) / 2)
FRAME = 0.0173
HAIR = 2.0**-16
"""How far patches stand in front of the board (and bars in front of patches), as a fraction of its side: a coat of ink, 4 um on the
default board. So thin that its shadow is a thousandth of a mirror wide."""
LAMP_PLACE = (-2.0, 2.4, 8.0)
"""The lamp's middle in sides of the board: 21 degrees off the view, 8.6 sides away. The light falls by about a sixth across the board."""
LAMP_HALF = 0.2
"""Half the lamp's side, in sides of the board."""
LIGHT_BAND_NM = (450.0, 670.0)


class Region(NamedTuple):
    """A rectangle of the picture in fractions: x from left, y from top, each 0 to 1."""

    left: float
    top: float
    right: float
    bottom: float


class ColorChecker(Model):
    """The chart seen square on, every patch in one plane: no surface sees another.

    Args:
        name: of the scene.
        side_m: of the square board, 1e-3 to 1e3 m.
        lamp: relative spectrum of the lamp.
        irradiance: on the middle of the board, mean over 450 to 670 nm, in W m^-2 nm^-1 (0.01 is about 1000 lx).
        board: reflectance of the board.
        frame: reflectance of the frame round it.
    """

    place: ClassVar[str] = "color_checker"
    name: str = "color-checker"
    side_m: Annotated[float, ranged(1e-3, 1e3, "m")] = 0.25
    lamp: InstanceOf[Spectrum] = Field(default_factory=lambda: illuminant("xenon"))
    irradiance: Annotated[float, ranged(0, 1e20, "W m^-2 nm^-1")] = 0.01
    board: Reflectance = Field(default_factory=lambda: Spectrum.constant(0.04))
    frame: Reflectance = Field(default_factory=lambda: Spectrum.constant(0.02))

    def patch_boxes(self) -> dict[str, Region]:
        """Return where each patch lies in the picture, by its name, rows of six from the top left."""
        boxes = {}
        for i, name in enumerate(reflectances()):
            row, column = divmod(i, COLUMNS)
            left, top = MARGIN[0] + column * (PATCH[0] + GAP), MARGIN[1] + row * (PATCH[1] + GAP)
            boxes[name] = Region(left, top, left + PATCH[0], top + PATCH[1])
        return boxes

    def build(self) -> Scene:
        """Return the scene."""
        return Scene(
            name=self.name,
            shapes=self.shapes(),
            materials=self.materials(),
            lights=(self.light(),),
            viewpoint=self.viewpoint(),
            description="24 patches (BabelColor Average) on a 4 % board, lit by a xenon lamp; flat and seen square on.",
        )

    def shapes(self) -> tuple[Shape, ...]:
        """Return board, frame and patches."""
        inner = 1 - FRAME
        frame = {
            "frame top": Region(0, 0, 1, FRAME),
            "frame bottom": Region(0, inner, 1, 1),
            "frame left": Region(0, FRAME, FRAME, inner),
            "frame right": Region(inner, FRAME, 1, inner),
        }
        parts: list[Shape] = [self.flat("board", "board", Region(0, 0, 1, 1), 0)]
        parts += [self.flat(name, "frame", region, 1) for name, region in frame.items()]
        parts += [self.flat(name, name, region, 1) for name, region in self.patch_boxes().items()]
        return tuple(parts)

    def materials(self) -> dict[str, Material]:
        """Return the materials of board, frame and patches by name."""
        patches: dict[str, Material] = {name: Diffuse(reflectance=reflectance(name)) for name in reflectances()}
        return patches | {"board": Diffuse(reflectance=self.board), "frame": Diffuse(reflectance=self.frame)}

    def light(self) -> AreaLight:
        """Return the lamp: a square that faces the middle of the board, as bright as ``irradiance`` asks."""
        lamp = square_lamp(tuple(x * self.side_m for x in LAMP_PLACE), LAMP_HALF * self.side_m, Spectrum.constant(1.0))
        mean = float(self.lamp.band_mean(*LIGHT_BAND_NM))
        radiance = self.lamp.scaled(self.irradiance / lamp.irradiance_per_radiance((0, 0, 0), (0, 0, 1)) / mean) if mean > 0 else self.lamp
        return AreaLight(center=lamp.center, half_u=lamp.half_u, half_v=lamp.half_v, radiance=radiance)

    def viewpoint(self) -> Orthographic:
        """Return the view that the board fills exactly."""
        return Orthographic(origin=(0, 0, 4 * self.side_m), target=(0, 0, 0), up=(0, 1, 0), half_height=self.side_m / 2)

    def flat(self, name: str, material: str, region: Region, layer: int) -> Rectangle:
        """Return a rectangle over a region of the picture, ``layer`` hairs in front of the board, facing the camera (+z)."""
        s = self.side_m
        center = ((region.left + region.right - 1) / 2 * s, (1 - region.top - region.bottom) / 2 * s, layer * HAIR * s)
        half_u, half_v = ((region.right - region.left) / 2 * s, 0, 0), (0, (region.bottom - region.top) / 2 * s, 0)
        return Rectangle(name=name, material=material, center=center, half_u=half_u, half_v=half_v)


def square_lamp(center: tuple[float, ...], half: float, radiance: Spectrum, target: tuple[float, ...] = (0, 0, 0)) -> AreaLight:
    """Return a square area light at center that faces target; lengths in metres, radiance in W m^-2 sr^-1 nm^-1."""
    toward = np.subtract(target, center)
    across = np.cross(toward, (0.0, 0.0, 1.0) if abs(toward[1]) > 0.9 * np.linalg.norm(toward) else (0.0, 1.0, 0.0))
    half_u = across / np.linalg.norm(across) * half
    half_v = np.cross(toward, half_u)
    half_v = half_v / np.linalg.norm(half_v) * half
    return AreaLight(center=vector(center), half_u=vector(half_u), half_v=vector(half_v), radiance=radiance)

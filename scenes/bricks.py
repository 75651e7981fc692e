"""Two figures of toy bricks before a wall: a subject with small parts, shadows and shiny paint (after Rueda et al. 2015, Fig. 10)."""

from __future__ import annotations

from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, InstanceOf

from scenes.color_checker import square_lamp
from scenes.library import illuminant, reflectance
from scenes.lights import ConstantSky, Light
from scenes.materials import Diffuse, Material
from scenes.meshes import cylinder
from scenes.model import Model, ranged
from scenes.scene import Scene
from scenes.shapes import Box, Rectangle, Shape
from scenes.spectrum import Spectrum
from scenes.viewpoint import Perspective

UNIT_M = 0.008
"""Side of a stud's cell."""
LEFT = {"legs": "blue", "chest": "green", "arms": "yellow green", "head": "yellow", "helmet": "neutral 5 (.70 D)"}
RIGHT = {"legs": "black 2 (1.5 D)", "chest": "blue flower", "arms": "blue", "head": "yellow", "helmet": "red"}
"""What the figures are painted with."""


class Point(NamedTuple):
    """A place in the scene and what is there.

    Args:
        position: in metres.
        material: name of the material.
    """

    position: tuple[float, float, float]
    material: str


class Bricks(Model):
    """A figure with a green chest and one with a red helmet, of boxes and round studs, on a base plate before a wall, z up.

    Args:
        name: of the scene.
        lamp: relative spectrum of the lamp and of the weak light from all round.
        irradiance: of the lamp on the middle of the base plate, mean over 450 to 670 nm, in W m^-2 nm^-1.
        sky: irradiance of the light from all round there, as a fraction of the lamp's.
    """

    place: ClassVar[str] = "bricks"
    name: str = "bricks"
    lamp: InstanceOf[Spectrum] = Field(default_factory=lambda: illuminant("xenon"))
    irradiance: Annotated[float, ranged(0, 1e20, "W m^-2 nm^-1")] = 0.01
    sky: Annotated[float, ranged(0, 1e6, "of the lamp")] = 0.2

    def build(self) -> Scene:
        """Return the scene."""
        left, right = _figure("left", -0.024, LEFT), _figure("right", 0.024, RIGHT)
        shapes = (*_room(), *left, *right)
        used = {shape.material for shape in shapes}
        return Scene(
            name=self.name,
            shapes=shapes,
            materials={name: _paint(name) for name in sorted(used)},
            lights=self._lights(),
            viewpoint=Perspective(origin=(0.0, -0.30, 0.085), target=(0.0, 0.0, 0.036), up=(0, 0, 1), fov_deg=18.5),
            description="Two figures of toy bricks, one with a green chest and one with a red helmet, on a base plate before a wall.",
        )

    def reference_points(self) -> dict[str, Point]:
        """Return the two places whose spectra are compared: the front of the green chest and of the red helmet."""
        return {
            "green chest": Point((-0.024, -UNIT_M, 0.0350), "green"),
            "red helmet": Point((0.024, -1.15 * UNIT_M, 0.0665), "red"),
        }

    def picture_points(self) -> dict[str, tuple[float, float]]:
        """Return where the reference points lie in a square picture, as fractions (from left, from top)."""
        view = self.build().viewpoint
        assert isinstance(view, Perspective)
        right, up, forward = view.axes()
        tangent = np.tan(np.deg2rad(view.fov_deg) / 2)
        found = {}
        for name, point in self.reference_points().items():
            away = np.subtract(point.position, view.origin)
            x, y = float(away @ right), float(away @ up)
            reach = 2 * tangent * float(away @ forward)
            found[name] = (0.5 + x / reach, 0.5 - y / reach)
        return found

    def _lights(self) -> tuple[Light, ...]:
        place, half = (-0.25, -0.45, 0.5), 0.06
        unit = self.lamp.scaled(self.irradiance / float(self.lamp.band_mean(450.0, 670.0)))
        lamp = square_lamp(place, half, Spectrum.constant(1.0))
        radiance = unit.scaled(1 / lamp.irradiance_per_radiance((0, 0, 0), (0, 0, 1)))
        return (square_lamp(place, half, radiance), ConstantSky(radiance=unit.scaled(self.sky / np.pi)))


def _paint(name: str) -> Material:
    if name == "wall":
        return Diffuse(reflectance=reflectance("blue sky"))
    if name == "plate":
        return Diffuse(reflectance=reflectance("bluish green"))
    return Diffuse(reflectance=reflectance(name))


def _room() -> list[Shape]:
    """Return the plate with its studs and the wall."""
    shapes: list[Shape] = [
        Rectangle(name="plate", material="plate", center=(0, 0, 0), half_u=(0.3, 0, 0), half_v=(0, 0.12, 0)),
        Rectangle(name="wall", material="wall", center=(0, 0.06, 0.15), half_u=(0.3, 0, 0), half_v=(0, 0, 0.15)),
    ]
    for i in range(-6, 7):
        for j in range(-4, 6):
            if not (j in (-1, 0) and abs(abs(i) - 3) <= 1):  # where feet stand
                shapes.append(_stud(f"stud {i} {j}", "plate", (i * UNIT_M, j * UNIT_M, 0.0)))
    return shapes


def _stud(name: str, material: str, foot: tuple[float, float, float], radius: float = 0.3 * UNIT_M, height: float = 0.0017) -> Shape:
    return cylinder(name, material, (radius, height), (foot[0], foot[1], foot[2] + height / 2), 12)


def _block(name: str, material: str, center: tuple[float, float, float], half: tuple[float, float, float]) -> Box:
    return Box(name=name, material=material, center=center, half_u=(half[0], 0, 0), half_v=(0, half[1], 0), half_w=(0, 0, half[2]))


def _figure(side: str, x: float, paint: dict[str, str]) -> list[Shape]:
    """Return a figure of blocks: legs, hips, chest, arms, head, helmet with a brim and a stud on top."""
    u = UNIT_M
    shapes: list[Shape] = []
    for step, at in (("left", -1.0), ("right", 1.0)):
        shapes.append(_block(f"{side} {step} leg", paint["legs"], (x + 0.55 * at * u, 0, 0.0105), (0.5 * u, 0.8 * u, 0.0105)))
        shapes.append(_block(f"{side} {step} foot", paint["legs"], (x + 0.55 * at * u, -u, 0.0025), (0.5 * u, 0.2 * u, 0.0025)))
        shapes.append(_block(f"{side} {step} arm", paint["arms"], (x + 1.75 * at * u, -0.3 * u, 0.0345), (0.3 * u, 0.5 * u, 0.0085)))
        shapes.append(_block(f"{side} {step} hand", paint["head"], (x + 1.75 * at * u, -0.6 * u, 0.0235), (0.25 * u, 0.3 * u, 0.0025)))
    shapes += [
        _block(f"{side} hips", paint["legs"], (x, 0, 0.0232), (1.1 * u, 0.85 * u, 0.0022)),
        _block(f"{side} chest", paint["chest"], (x, 0, 0.0354), (1.4 * u, u, 0.0099)),
        cylinder(f"{side} neck", paint["head"], (0.4 * u, 0.002), (x, 0, 0.0463), 24),
        cylinder(f"{side} head", paint["head"], (0.85 * u, 0.0125), (x, 0, 0.05355), 48),
        cylinder(f"{side} helmet", paint["helmet"], (1.15 * u, 0.0085), (x, 0, 0.06405), 48),
        _block(f"{side} brim", paint["helmet"], (x, -1.0 * u, 0.0605), (0.8 * u, 0.45 * u, 0.0006)),
        _stud(f"{side} top", paint["helmet"], (x, 0, 0.0683)),
    ]
    return shapes

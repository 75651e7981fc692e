"""Random scenes by number: as many as statistics need, of reflectances that learning has not seen (or has, when asked for)."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, InstanceOf

from scenes.color_checker import HAIR, ColorChecker, Region
from scenes.library import illuminant, reflectance, test_samples, training_samples
from scenes.materials import Diffuse, Material
from scenes.model import Model, ranged
from scenes.scene import Scene
from scenes.shapes import Box, Mesh, Shape, Sphere
from scenes.spectrum import Spectrum
from scenes.textured import random_weights
from scenes.textures import Textured

_STREAM = 0x73636E65  # keeps these random numbers apart from every other use of the same seed
SPECTRA_A_TEXTURE = 6
TEXELS = 181


class Procedural(Model):
    """A board with a random texture, and cards, discs and triangles on it at random places, some of them textured.

    Flat by default, so that no surface sees another; ``solids`` adds balls and blocks that throw shadows and colour.

    Args:
        seed: which scene, 0 to 2^63 - 1.
        flats: how many flat things lie on the board, 0 to 200.
        solids: how many balls and blocks stand on it, 0 to 50.
        training: whether reflectances come from the half of the colour samples to learn from, not from the half to test with.
        lamp: relative spectrum of the lamp.
        irradiance: on the middle of the board, mean over 450 to 670 nm, in W m^-2 nm^-1.
    """

    place: ClassVar[str] = "procedural"
    seed: Annotated[int, Field(ge=0, le=2**63 - 1)] = 0
    flats: Annotated[int, Field(ge=0, le=200)] = 24
    solids: Annotated[int, Field(ge=0, le=50)] = 0
    training: bool = False
    lamp: InstanceOf[Spectrum] = Field(default_factory=lambda: illuminant("xenon"))
    irradiance: Annotated[float, ranged(0, 1e20, "W m^-2 nm^-1")] = 0.01

    @property
    def name(self) -> str:
        """Return procedural-SEED, with what else it depends on."""
        return f"procedural-{self.seed}" + ("-training" if self.training else "") + (f"-{self.solids}-solids" if self.solids else "")

    def build(self) -> Scene:
        """Return the scene."""
        return _Builder(self).scene()


class _Builder:
    """Draw one scene from its own stream of random numbers."""

    def __init__(self, recipe: Procedural) -> None:
        self.recipe = recipe
        key = (_STREAM, int(recipe.training))
        self.stream = np.random.Generator(np.random.Philox(np.random.SeedSequence(recipe.seed, spawn_key=key)))
        self.chart = ColorChecker(lamp=recipe.lamp, irradiance=recipe.irradiance)
        self.names = training_samples() if recipe.training else test_samples()
        self.materials: dict[str, Material] = {}

    def scene(self) -> Scene:
        """Return the scene."""
        shapes: list[Shape] = [self.chart.flat("board", self._texture(), Region(0, 0, 1, 1), 0)]
        shapes += [self._flat(i) for i in range(self.recipe.flats)]
        shapes += [self._solid(i) for i in range(self.recipe.solids)]
        return Scene(
            name=self.recipe.name,
            shapes=tuple(shapes),
            materials=self.materials,
            lights=(self.chart.light(),),
            viewpoint=self.chart.viewpoint(),
            description=f"Random scene {self.recipe.seed}: {self.recipe.flats} flat and {self.recipe.solids} solid things on a texture.",
        )

    def _plain(self) -> str:
        name = str(self.stream.choice(self.names))
        self.materials[name] = Diffuse(reflectance=reflectance(name))
        return name

    def _texture(self) -> str:
        chosen = self.stream.choice(self.names, SPECTRA_A_TEXTURE, replace=False)
        rough, contrast = self.stream.uniform(0.6, 1.6), self.stream.uniform(1, 3)
        weights = random_weights((TEXELS, TEXELS), SPECTRA_A_TEXTURE, rough, int(self.stream.integers(2**62)), contrast)
        name = f"texture {len(self.materials)}"
        self.materials[name] = Textured(basis=tuple(reflectance(str(n)) for n in chosen), weights=weights)
        return name

    def _flat(self, i: int) -> Shape:
        """Return the i-th flat thing, i + 1 hairs above the board: sizes fall as a power law, as in natural pictures."""
        size = 0.02 * (0.25 / 0.02) ** self.stream.random() ** 2
        x, y = self.stream.random(2)
        kind = self.stream.integers(4)
        if kind <= 1:
            width, height = size * self.stream.uniform(0.5, 1.5, 2)
            region = Region(max(0, x - width), max(0, y - height), min(1, x + width), min(1, y + height))
            return self.chart.flat(f"card {i}", self._texture() if kind == 0 and size > 0.05 else self._plain(), region, i + 1)
        corners = 3 if kind == 2 else 48
        angles = 2 * np.pi * (np.arange(corners) + self.stream.random()) / corners
        ring = np.stack([x - 0.5 + size * np.cos(angles), 0.5 - y + size * np.sin(angles), np.full(corners, (i + 1) * HAIR)], axis=1)
        fan = np.array([[0, k, k + 1] for k in range(1, corners - 1)])
        return Mesh(name=f"{'triangle' if kind == 2 else 'disc'} {i}", material=self._plain(), vertices=ring * self.chart.side_m, faces=fan)

    def _solid(self, i: int) -> Shape:
        s = self.chart.side_m
        x, y = self.stream.uniform(-0.42, 0.42, 2) * s
        radius = self.stream.uniform(0.02, 0.06) * s
        above = (self.recipe.flats + 2) * HAIR * s
        if self.stream.random() < 0.5:
            return Sphere(name=f"ball {i}", material=self._plain(), center=(x, y, above + radius), radius=radius)
        turn, height = self.stream.uniform(0, np.pi), self.stream.uniform(0.01, 0.06) * s
        u, v = (radius * np.cos(turn), radius * np.sin(turn), 0.0), (-radius * np.sin(turn), radius * np.cos(turn), 0.0)
        return Box(name=f"block {i}", material=self._plain(), center=(x, y, above + height), half_u=u, half_v=v, half_w=(0, 0, height))

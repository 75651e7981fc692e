"""Pairs of patches that a standard observer cannot tell apart in daylight, but can under a lamp, and a spectral camera always."""

from __future__ import annotations

from functools import cache
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, InstanceOf

from scenes.color_checker import ColorChecker, Region
from scenes.library import illuminant, observer, reflectance, samples
from scenes.materials import Diffuse, Material
from scenes.model import Model, ranged
from scenes.scene import Scene
from scenes.shapes import Shape
from scenes.spectrum import Spectrum

PAIRS = 24
LOWEST, HIGHEST = 0.01, 0.95
"""Reflectances that a metamer is kept between."""


class Metamers(Model):
    """24 pairs of reflectances, left and right half of each patch, of equal colour under D65 (theory.md (R.36)).

    Args:
        name: of the scene.
        lamp: relative spectrum of the lamp; "D65" makes the pairs look alike, "A" does not.
        irradiance: on the middle of the board, mean over 450 to 670 nm, in W m^-2 nm^-1.
    """

    place: ClassVar[str] = "metamers"
    name: str = "metamers"
    lamp: InstanceOf[Spectrum] = Field(default_factory=lambda: illuminant("D65"))
    irradiance: Annotated[float, ranged(0, 1e20, "W m^-2 nm^-1")] = 0.01

    def build(self) -> Scene:
        """Return the scene."""
        chart = ColorChecker(lamp=self.lamp, irradiance=self.irradiance)
        shapes: list[Shape] = [chart.flat("board", "board", Region(0, 0, 1, 1), 0)]
        materials: dict[str, Material] = {"board": Diffuse(reflectance=chart.board)}
        for i, (box, pair) in enumerate(zip(chart.patch_boxes().values(), metamer_pairs(), strict=True)):
            middle = (box.left + box.right) / 2
            halves = (Region(box.left, box.top, middle, box.bottom), Region(middle, box.top, box.right, box.bottom))
            for side, half, curve in zip(("left", "right"), halves, pair):
                name = f"pair {i + 1} {side}"
                materials[name] = Diffuse(reflectance=curve)
                shapes.append(chart.flat(name, name, half, 1))
        return Scene(
            name=self.name,
            shapes=tuple(shapes),
            materials=materials,
            lights=(chart.light(),),
            viewpoint=chart.viewpoint(),
            description="24 pairs of patches of equal colour under D65 for the CIE 1931 observer, of different spectra.",
        )


@cache
def metamer_pairs() -> tuple[tuple[Spectrum, Spectrum], ...]:
    """Return 24 pairs (colour sample, metamer): equal tristimulus values under D65, spectra as far apart as they may be."""
    names = samples()
    curves = np.stack([reflectance(name).value for name in names])
    grid = reflectance(names[0]).wavelength_nm
    seen = tristimulus_weights(grid)
    hidden = np.eye(grid.size) - seen.T @ np.linalg.solve(seen @ seen.T, seen)
    pairs = []
    for i in np.linspace(0, len(names) - 1, PAIRS).round().astype(int):
        base = np.clip(curves[i], LOWEST, HIGHEST)
        black = (curves - base) @ hidden  # metameric blacks: what of each difference no observer sees
        room = np.where(black > 0, HIGHEST - base, LOWEST - base)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.min(np.where(np.abs(black) > 1e-12, room / black, np.inf), axis=1)
        reach = np.where(np.isfinite(reach), np.minimum(reach, 1.0), 0.0)
        best = int(np.argmax(reach * np.linalg.norm(black, axis=1)))
        other = np.clip(base + reach[best] * black[best], 0, 1)
        pairs.append((Spectrum(grid, base, names[i]), Spectrum(grid, other, f"metamer of {names[i]}")))
    return tuple(pairs)


def tristimulus_weights(nodes_nm: np.ndarray, lamp: str = "D65") -> np.ndarray:
    """Return the (3, n) matrix from a reflectance's node values (linear between nodes) to X, Y, Z under a lamp, Y = 1 for white.

    Integrals are sums over 1 nm steps of the observer's data within the nodes' range.
    """
    curves, light = observer(), illuminant(lamp)
    fine = np.arange(np.ceil(nodes_nm[0]), np.floor(nodes_nm[-1]) + 1)
    hats = np.stack([np.interp(fine, nodes_nm, unit) for unit in np.eye(nodes_nm.size)], axis=1)
    table = np.stack([curve.at(fine) for curve in curves.values()]) * light.at(fine)
    return (table @ hats) / table[1].sum()

"""Which materials of Mitsuba's lose energy: measured in a furnace, told before rendering (theory.md R.53)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from scenes.materials import Material, RoughPlastic
from scenes.scene import Scene
from scenes.visibility import used_materials


@dataclass(frozen=True, eq=False)
class FurnaceTable:
    """Hold the share of light that a white plastic ball loses under an even sky, by coat.

    Args:
        index: (n,) refractive indices of the coat.
        roughness: (m,) GGX alphas.
        loss: (n, m) shares, mean over a ball seen out to 0.9 of its radius.
    """

    index: np.ndarray
    roughness: np.ndarray
    loss: np.ndarray

    def at(self, index: float, roughness: float) -> float:
        """Interpolate in the index and the logarithm of the roughness."""
        by_index = [np.interp(np.log(roughness), np.log(self.roughness), row) for row in self.loss]
        return float(np.interp(index, self.index, by_index))


FURNACE = FurnaceTable(
    np.array([1.05, 1.3, 1.5, 1.8, 2.2, 3.0]),
    np.array([0.01, 0.1, 0.3, 1.0]),
    np.array(
        [
            [0.0023, 0.0348, 0.1283, 0.3897],
            [0.0108, 0.0634, 0.2326, 0.5592],
            [0.0183, 0.0834, 0.2872, 0.6352],
            [0.0304, 0.1131, 0.3524, 0.7020],
            [0.0415, 0.1525, 0.4182, 0.7452],
            [0.0755, 0.2233, 0.4917, 0.7679],
        ]
    ),
)
"""Mitsuba 3.9.1, roughplastic: its coat scatters light once only, what meets the rough surface twice is lost."""


def loss_of_energy(material: Material) -> float:
    """Return the share of light that a material loses against one that only absorbs what its data say: 0 for all but plastic."""
    return FURNACE.at(material.index, material.roughness) if isinstance(material, RoughPlastic) else 0.0


def losses(scene: Scene, error: float) -> Iterator[str]:
    """Yield a sentence for each material that loses more than the error asked for."""
    for name, material in used_materials(scene).items():
        lost = loss_of_energy(material)
        if lost > error:
            yield (
                f"material {name!r} ({type(material).__name__}) loses up to {lost:.2g} of the light it should give back, more than the "
                f"error asked for ({error:g}): Mitsuba's rough coat reflects once only; smoother coats lose less, diffuse surfaces nothing"
            )

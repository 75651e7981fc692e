"""The cubes that figures and claims look at: loaded when asked for, one exposure a target."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np

from optsim.cube import Bands
from optsim.report.color import Exposure, exposure_of, lab, srgb
from optsim.report.data import RunData, Series, Truth
from optsim.report.select import Recipe, main_recipe, pick

KEPT = 10
"""Estimates held in memory at once (12.6 MB each at 256 x 256 x 24)."""


COHERENT_PX = 8
"""Side of the squares whose mean colour counts as false colour: four periods of a Bayer mosaic."""


class Gallery:
    """Serve truths, estimates and their pictures from a run.

    Args:
        run: the run.
        recipe: which estimates are meant; None means the run's main recipe.
    """

    def __init__(self, run: RunData, recipe: Recipe | None = None) -> None:
        self.run = run
        self.recipe = recipe or main_recipe(run)
        self._cubes: OrderedDict[tuple[str, str, float], np.ndarray | None] = OrderedDict()
        self._exposures: dict[str, Exposure] = {}

    def truth(self, target: str) -> Truth:
        """Return the truth of a target that has one."""
        return self.run.truths[target]

    def bands(self, target: str) -> Bands:
        """Return the bands of a target that has a truth."""
        return self.run.truths[target].bands

    def estimate(self, target: str, series: Series, R: float) -> np.ndarray | None:
        """Return the estimate (y, x, K) of the first seed, or None when not run."""
        key = (target, series.key, round(R, 9))
        if key not in self._cubes:
            rows = pick(self.run, self.recipe, target, series, R)
            self._cubes[key] = self.run.cube_of(rows[0]) if rows else None
            while len(self._cubes) > KEPT:
                self._cubes.popitem(last=False)
        self._cubes.move_to_end(key)
        return self._cubes[key]

    def exposure(self, target: str) -> Exposure:
        """Return the exposure that truth and estimates of a target share."""
        if target not in self._exposures:
            truth = self.truth(target)
            self._exposures[target] = exposure_of(truth.radiance, truth.bands, truth.light)
        return self._exposures[target]

    def srgb(self, cube: np.ndarray, target: str) -> np.ndarray:
        """Return the picture (y, x, 3) of a cube in a target's exposure."""
        return srgb(cube, self.bands(target), self.exposure(target))

    def chroma_error(self, cube: np.ndarray, target: str, window: tuple[slice, slice], block: int = COHERENT_PX) -> float:
        """Return the mean CIE 1976 chroma difference sqrt(da*^2 + db*^2) to the truth inside a window: false colour.

        Spectra are averaged over block x block pixels first. Aliasing tints whole areas and survives the mean; noise of
        single pixels does not.
        """
        bands, exposure = self.bands(target), self.exposure(target)
        pair = (block_means(cube[window], block), block_means(self.truth(target).radiance[window], block))
        estimate, truth = (lab(c, bands, exposure) for c in pair)
        return float(np.mean(np.hypot(*np.moveaxis(estimate - truth, -1, 0)[1:])))


def block_means(cube: np.ndarray, block: int) -> np.ndarray:
    """Average (y, x, K) over block x block pixels, cutting what is left over; at most the whole picture is one block."""
    block = min(block, *cube.shape[:2])
    rows, columns = (n // block for n in cube.shape[:2])
    cut = np.asarray(cube[: rows * block, : columns * block], np.float64)
    return cut.reshape(rows, block, columns, block, -1).mean((1, 3))


def finest_window(cube: np.ndarray, fraction: float = 0.19) -> tuple[slice, slice]:
    """Return the square window where the picture changes most from column to column: where a mosaic must alias.

    Args:
        cube: (y, x, K).
        fraction: side of the window over the shorter side of the picture; at least 8 pixels where there are as many.
    """
    grey = np.asarray(cube, np.float64).mean(-1)
    height, width = grey.shape
    side = min(height, width, max(8, round(fraction * min(height, width))))
    energy = np.zeros_like(grey)
    energy[:, 1:-1] = np.abs(grey[:, :-2] - 2 * grey[:, 1:-1] + grey[:, 2:])
    total = np.zeros((height + 1, width + 1))
    total[1:, 1:] = energy.cumsum(0).cumsum(1)
    sums = total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
    y, x = np.unravel_index(int(np.argmax(sums)), sums.shape)
    return slice(int(y), int(y) + side), slice(int(x), int(x) + side)

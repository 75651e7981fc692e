"""From transport replicates to band radiances: means, standard errors, and the error of a picture with its confidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from optsim.render.replicates import Replicates
from optsim.render.tiles import Tiles

FLOAT32_LEVELS = (1e-25, 1e30)
"""Mean radiances between these keep at least 12 decades below them in float32."""
CONFIDENCE = 0.95
TAILS = 0.7
"""Share of the degrees of freedom that counts: noise of paths has heavier tails than a normal distribution."""


@dataclass(frozen=True)
class TileNoise:
    """Hold the noise of a part of a picture.

    Args:
        squares: (tiles, K) sums over each tile's pixels of the variance of a band's mean radiance.
        levels: (tiles, K) sums over each tile's pixels of the radiance.
        sizes: (tiles,) pixels of each tile.
    """

    squares: np.ndarray
    levels: np.ndarray
    sizes: np.ndarray

    @property
    def pixels(self) -> int:
        """Return the number of pixels."""
        return int(self.sizes.sum())

    @property
    def level(self) -> np.ndarray:
        """Return the (K,) sums of the radiance."""
        return self.levels.sum(0)

    @property
    def errors(self) -> np.ndarray:
        """Return each band's RMS standard error over the part divided by its mean radiance; a black band has error 0."""
        size, mean = np.sqrt(self.squares.sum(0) / self.pixels), self.level / self.pixels
        return np.divide(size, mean, out=np.zeros_like(size), where=mean > 0)


def tile_noise(groups: list[Replicates], weights: list[np.ndarray], part: Tiles) -> TileNoise:
    """Estimate the noise of each tile and band from the scatter of the passes (theory.md (R.43)); at least two passes."""
    shape = (part.count, len(weights[0]))
    squares, levels = np.zeros(shape), np.zeros(shape)
    for group, weight in zip(groups, weights):
        count = np.zeros(part.count, np.int64)
        count[part.of_pixel] = group.counts
        assert group.band_scatter is not None
        squares += group.band_scatter / (count * (count - 1))[:, None]
        with threadpool_limits(1):
            for block in part.blocks():
                levels += part.sums(weight @ group.mean[:, block], block)
    return TileNoise(squares, levels, part.sizes)


def joined(parts: list[TileNoise]) -> TileNoise:
    """Put the tiles of all parts of a picture together."""
    return TileNoise(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("squares", "levels", "sizes")))


def relative_bound(radiance: np.ndarray, bound: np.ndarray) -> np.ndarray:
    """Return each band's RMS error bound over the picture divided by the band's mean radiance; arrays (pixels, K)."""
    size = np.sqrt(np.mean(np.square(bound, dtype=np.float64), axis=0))
    level = np.mean(radiance, axis=0, dtype=np.float64)
    return np.divide(size, level, out=np.zeros_like(size), where=level > 0)


def kept_as(level: float) -> type[np.float32] | type[np.float64]:
    """Return the type that holds radiances of this mean: float32 unless it would lose them."""
    return np.float32 if level == 0 or FLOAT32_LEVELS[0] < level < FLOAT32_LEVELS[1] else np.float64


def band_radiance(groups: list[Replicates], weights: list[np.ndarray], part: Tiles) -> tuple[np.ndarray, np.ndarray | None]:
    """Return (pixels, K) float64 radiance and standard error (None with a single pass), theory.md (R.24) and (R.28)."""
    count = len(weights[0])
    radiance = np.zeros((part.pixels, count))
    stderr = np.zeros((part.pixels, count)) if all(group.count > 1 for group in groups) else None
    with threadpool_limits(1):  # one BLAS thread: the same bytes whatever the number of cores
        for block in part.blocks():
            radiance[block] = sum(group.mean[:, block].T @ weight.T for group, weight in zip(groups, weights))
            if stderr is not None:
                variance = sum(
                    (np.sqrt(group.scatter[:, block].T / (group.counts[block] * (group.counts[block] - 1))[:, None]) @ np.abs(weight).T)
                    ** 2
                    for group, weight in zip(groups, weights)
                )
                stderr[block] = np.sqrt(variance)
    return radiance, stderr


class ErrorBars:
    """Gather over the parts of a picture what its error and the error's confidence interval need (theory.md (R.44)).

    Args:
        count: K.
    """

    def __init__(self, count: int) -> None:
        self._squares, self._level = np.zeros(count), np.zeros(count)
        self._sum, self._fourth, self._fourth_share = np.zeros(count), np.zeros(count), np.zeros(count)
        self._pixels = 0

    def add(self, noise: TileNoise, stderr: np.ndarray, counts: np.ndarray) -> None:
        """Take in a part: its noise, its standard errors (pixels, K) and the passes of every pixel."""
        self._squares += noise.squares.sum(0)
        self._level += noise.level
        self._pixels += noise.pixels
        square = stderr * stderr
        fourth = square * square * ((counts - 1) / (counts + 1))[:, None]  # unbiased for the squared variance
        self._sum += square.sum(0)
        self._fourth += fourth.sum(0)
        self._fourth_share += (fourth / (counts - 1)[:, None]).sum(0)

    def notes(self) -> np.ndarray:
        """Return all that is gathered, as (5 K + 1,) numbers."""
        return np.concatenate([self._squares, self._level, self._sum, self._fourth, self._fourth_share, [self._pixels]])

    @classmethod
    def from_notes(cls, notes: np.ndarray, count: int) -> ErrorBars:
        """Go on from :meth:`notes`."""
        bars = cls(count)
        bars._squares, bars._level, bars._sum, bars._fourth, bars._fourth_share = notes[:-1].reshape(5, count).copy()
        bars._pixels = int(notes[-1])
        return bars

    def bounds(self) -> np.ndarray:
        """Return (3, K): relative RMS error, and the ends of the 95 % interval of what was really made."""
        from scipy.special import fdtri

        mean = self._level / max(1, self._pixels)
        error = np.sqrt(self._squares / max(1, self._pixels))
        error = np.divide(error, mean, out=np.zeros_like(error), where=mean > 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            made, told = self._sum**2 / self._fourth, self._sum**2 / self._fourth_share
        tail = (1 - CONFIDENCE) / 2
        found = [error]
        for probability in (tail, 1 - tail):
            factor = np.sqrt(fdtri(np.where(made > 0, TAILS * made, 1), np.where(told > 0, TAILS * told, 1), probability))
            found.append(np.where(error > 0, error * factor, 0))
        return np.array(found)

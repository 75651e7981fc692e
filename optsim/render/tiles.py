"""A picture in tiles: each gets as many paths as its noise deserves, whatever parts of the picture are rendered at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TILE = 32
"""Pixels along each side of a tile."""


@dataclass(frozen=True)
class Samples:
    """Hold how many paths each pixel of a part of the picture gets in one pass.

    Args:
        first: number of the part's first pixel; the part is whole rows.
        counts: (pixels of the part,) uint32.
    """

    first: int
    counts: np.ndarray


@dataclass(frozen=True)
class Traced:
    """Hold one pass of a part of the picture.

    Args:
        values: (n, pixels) mean transport.
        cut: share of light cut off by the depth limit.
        told: (2, pixels) share of the paths that met dispersing glass before any surface that scatters, and mean transport that came to
            such surfaces by way of glass or mirrors; (0, pixels) where there is neither.
    """

    values: np.ndarray
    cut: float
    told: np.ndarray


class Tiles:
    """Divide rows of a picture into squares of 32 x 32 pixels, the last in a row and column smaller.

    Args:
        film: (height, width) of the picture.
        top: first row of the part that is meant, a multiple of 32.
        bottom: last row plus one; None for the picture's.
        side: of a tile; the part is one tile when it is 0.
    """

    def __init__(self, film: tuple[int, int], top: int = 0, bottom: int | None = None, side: int = TILE) -> None:
        self.film, self.top, self.bottom, self.side = film, top, film[0] if bottom is None else bottom, side
        self.width, self.rows = film[1], self.bottom - top
        self.across = -(-self.width // side) if side else 1
        self.count = self.across * -(-self.rows // side) if side else 1
        columns = np.arange(self.width) // side if side else np.zeros(self.width, np.int64)
        rows = np.arange(self.rows) // side if side else np.zeros(self.rows, np.int64)
        self.of_pixel = (rows[:, None] * self.across + columns).ravel()
        self.sizes = np.bincount(self.of_pixel, minlength=self.count)

    @property
    def first(self) -> int:
        """Return the number of the part's first pixel in the picture."""
        return self.top * self.width

    @property
    def pixels(self) -> int:
        """Return the number of pixels of the part."""
        return self.rows * self.width

    def blocks(self) -> list[slice]:
        """Return the pixels of each row of tiles: sums over one never depend on how much of the picture is rendered at a time."""
        step = (self.side or self.rows) * self.width
        return [slice(start, min(start + step, self.pixels)) for start in range(0, self.pixels, step)]

    def sums(self, values: np.ndarray, block: slice) -> np.ndarray:
        """Return (tiles, n): sums over the tiles of values (n, pixels of a block)."""
        tile = self.of_pixel[block]
        return np.stack([np.bincount(tile, row, self.count) for row in values], 1)

    def parts(self, rows: int) -> list[Tiles]:
        """Divide into parts of at most so many rows each (rounded down to whole tiles, at least one)."""
        step = max(1, rows // self.side) * self.side if self.side else self.rows
        return [Tiles(self.film, top, min(top + step, self.bottom), self.side) for top in range(self.top, self.bottom, step)]

"""Cut pixels along straight borders into trapezoids of one surface each: exact coverage, no samples (theory.md (R.38)).

Picture coordinates: x to the right, y downwards, pixel (i, j) covers [j, j + 1] x [i, i + 1].
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

EDGE = 1e-9
"""A border closer than this to a pixel's side, in pixels, runs along the side."""
SLIVER = 1e-13
"""Trapezoids of less than this share of a pixel are dropped."""
MAX_BORDERS = 64
"""Pixels that more borders cross are not cut."""
BLOCK = 2**21
"""Cuts x borders that are handled at a time."""


class NotFlat(Exception):
    """Say why a scene needs samples after all; not an error: the sampled route takes over."""


@dataclass(frozen=True)
class Cells:
    """Hold C trapezoids with horizontal parallel sides.

    Args:
        pixel: (C,) number of the pixel.
        low, high: (C,) y of the parallel sides, low < high.
        left: (C, 2) x of the left end of the side at low and at high.
        right: (C, 2) the same for the right end.
    """

    pixel: np.ndarray
    low: np.ndarray
    high: np.ndarray
    left: np.ndarray
    right: np.ndarray

    def __len__(self) -> int:
        return len(self.pixel)

    def take(self, chosen: np.ndarray) -> Cells:
        """Return some of the cells."""
        return Cells(*(a[chosen] for a in (self.pixel, self.low, self.high, self.left, self.right)))

    def middle(self) -> tuple[np.ndarray, np.ndarray]:
        """Return x and y of a point inside each."""
        return (self.left.sum(1) + self.right.sum(1)) / 4, (self.low + self.high) / 2

    def area(self) -> np.ndarray:
        """Return the (C,) areas."""
        return (self.high - self.low) * (self.right - self.left).sum(1) / 2

    def quarters(self) -> tuple[Cells, np.ndarray]:
        """Return four cells for each, cut half way up and across, and the number of the cell that each comes from."""
        middle = (self.low + self.high) / 2
        sides = np.stack([self.left, (self.left + self.right) / 2, self.right])
        between = sides.mean(2)
        parts = []
        for side in (0, 1):
            for low, high, ends in ((self.low, middle, (sides[:, :, 0], between)), (middle, self.high, (between, sides[:, :, 1]))):
                left, right = (np.stack([end[k] for end in ends], 1) for k in (side, side + 1))
                parts.append(Cells(self.pixel, low, high, left, right))
        return stack(parts), np.tile(np.arange(len(self)), 4)

    def points(self, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return x, y and weight, each (C, order^2), of the Gauss points; weights add to the area (theory.md (R.39))."""
        place, share = np.polynomial.legendre.leggauss(order)
        place, share = (place + 1) / 2, share / 2
        left = self.left[:, :1] + np.diff(self.left, axis=1) * place
        width = self.right[:, :1] + np.diff(self.right, axis=1) * place - left
        height = self.high - self.low
        x = left[:, :, None] + width[:, :, None] * place
        y = np.broadcast_to((self.low[:, None] + height[:, None] * place)[:, :, None], x.shape)
        weight = height[:, None, None] * (width * share)[:, :, None] * share
        shape = (len(self), order * order)
        return x.reshape(shape), y.reshape(shape), weight.reshape(shape)


def whole_pixels(pixel: np.ndarray, width: int) -> Cells:
    """Return pixels as cells."""
    x, y = (pixel % width).astype(np.float64), (pixel // width).astype(np.float64)
    return Cells(pixel, y, y + 1, np.stack([x, x], 1), np.stack([x + 1, x + 1], 1))


def stack(parts: list[Cells]) -> Cells:
    """Put cells together."""
    names = ("pixel", "low", "high", "left", "right")
    return Cells(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def join(parts: list[Cells]) -> Cells:
    """Put cells together, in the order of their pixels."""
    whole = stack(parts)
    return whole.take(np.argsort(whole.pixel, kind="stable"))


def crossed_pixels(segments: np.ndarray, height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Find the pixels whose inside segments cross.

    Args:
        segments: (S, 4) x0, y0, x1, y1.
        height, width: of the picture in pixels.

    Returns:
        (n,) pixel numbers, ascending, and (n, 4) the parts of the segments in them, in the pixel's own coordinates, y0 <= y1.
    """
    part, row, _ = _split(_upwards(segments[:, [1, 0, 3, 2]]), height)
    part, column, owner = _split(_upwards(part[:, [1, 0, 3, 2]]), width)
    row = row[owner]
    pixel = row * width + column
    local = part - np.stack([column, row, column, row], 1)
    local = _upwards(local[:, [1, 0, 3, 2]])[:, [1, 0, 3, 2]]
    order = np.argsort(pixel, kind="stable")
    return pixel[order], np.clip(local[order], 0, 1)


def _upwards(segments: np.ndarray) -> np.ndarray:
    """Swap the ends of segments (a0, b0, a1, b1) where a0 > a1."""
    return np.where((segments[:, 0] > segments[:, 2])[:, None], segments[:, [2, 3, 0, 1]], segments)


def _split(segments: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut segments (a0, b0, a1, b1), a0 <= a1, at whole a: the parts, the cell along a of each, and its segment."""
    a0, b0, a1, b1 = segments.T
    first = np.maximum(np.floor(a0 + EDGE), 0).astype(np.int64)
    last = np.minimum(np.ceil(a1 - EDGE) - 1, size - 1).astype(np.int64)
    count = np.maximum(last - first + 1, 0)
    owner = np.repeat(np.arange(len(segments)), count)
    cell = first[owner] + np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    slope = (b1 - b0) / np.where(a1 > a0, a1 - a0, 1)
    a0, b0, a1, b1, slope = (v[owner] for v in (a0, b0, a1, b1, slope))
    start, stop = np.maximum(a0, cell), np.minimum(a1, cell + 1)
    at_start, at_stop = np.where(start > a0, b0 + slope * (start - a0), b0), np.where(stop < a1, b0 + slope * (stop - a0), b1)
    return np.stack([start, at_start, stop, at_stop], 1), cell, owner


def cut_pixels(pixel: np.ndarray, inside: np.ndarray, width: int) -> Iterator[Cells]:
    """Cut pixels along the segments inside them; yields cells in blocks.

    Args:
        pixel, inside: of :func:`crossed_pixels`.
        width: of the picture.

    Raises:
        NotFlat: when more than 64 segments cross a pixel.
    """
    number, start, count = np.unique(pixel, return_index=True, return_counts=True)
    if len(count) and count.max() > MAX_BORDERS:
        raise NotFlat(f"{count.max()} borders cross a pixel")
    for borders in np.unique(count):
        chosen = np.flatnonzero(count == borders)
        cuts = 2 + 2 * borders + borders * (borders - 1) // 2
        step = max(1, BLOCK // int(cuts * borders))
        for i in range(0, len(chosen), step):
            these = chosen[i : i + step]
            yield _trapezoids(number[these], inside[start[these, None] + np.arange(borders)], width)


def _trapezoids(pixel: np.ndarray, segments: np.ndarray, width: int) -> Cells:
    """Cut P pixels along S segments each, (P, S, 4) in pixel coordinates with y0 <= y1: slabs between all ends and crossings."""
    x0, y0, x1, y1 = np.moveaxis(segments, 2, 0)
    slope = (x1 - x0) / np.where(y1 > y0, y1 - y0, 1)
    zero = np.zeros((len(pixel), 1))
    cuts = np.sort(np.concatenate([zero, zero + 1, y0, y1, _crossings(segments, slope)], axis=1), axis=1)
    which, slab = np.nonzero(np.diff(cuts, axis=1) > SLIVER)
    low, high = cuts[which, slab][:, None], cuts[which, slab + 1][:, None]
    x0, y0, y1, slope = (a[which] for a in (x0, y0, y1, slope))
    middle = (low + high) / 2
    active = (y0 <= middle) & (middle < y1)
    order = np.argsort(np.where(active, x0 + slope * (middle - y0), 0), axis=1, kind="stable")
    ends = []
    for y in (low, high):
        x = np.take_along_axis(np.where(active, np.clip(x0 + slope * (y - y0), 0, 1), 0), order, axis=1)
        ends.append(np.concatenate([np.zeros_like(y), x, np.ones_like(y)], axis=1))
    at_low, at_high = ends
    area = (high - low) * (np.diff(at_low, axis=1) + np.diff(at_high, axis=1)) / 2
    row, place = np.nonzero(area > SLIVER)
    number = pixel[which[row]]
    x, y = number % width, number // width
    left = np.stack([at_low[row, place] + x, at_high[row, place] + x], 1)
    right = np.stack([at_low[row, place + 1] + x, at_high[row, place + 1] + x], 1)
    return Cells(number, low[row, 0] + y, high[row, 0] + y, left, right)


def _crossings(segments: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return the y, (P, pairs), at which each two segments of a pixel cross, 0 where they don't."""
    x0, y0, _, y1 = np.moveaxis(segments, 2, 0)
    i, j = np.triu_indices(segments.shape[1], 1)
    at_zero = x0 - slope * y0
    with np.errstate(divide="ignore", invalid="ignore"):
        found = (at_zero[:, j] - at_zero[:, i]) / (slope[:, i] - slope[:, j])
    within = (found > np.maximum(y0[:, i], y0[:, j])) & (found < np.minimum(y1[:, i], y1[:, j]))
    return np.where(within, found, 0)

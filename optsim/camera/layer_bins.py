"""Layers with larger pixels than the sensor's grid: what a block of the grid collects is one number (theory.md (C.52))."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optsim.errors import InputError


def bin_layers(frames: np.ndarray, bins: Sequence[int]) -> np.ndarray:
    """Sum each layer's frames over blocks; the sum stands in the block's first pixel, the others hold 0.

    Args:
        frames: (L, C, M, W); blocks begin at row and column 0, those at the end may be cut.
        bins: C block sides, e.g. (2, 2, 1) for red, green, blue of a Quattro.

    Returns:
        ``frames`` itself when all bins are 1, else (L, C, M, W) of the same total.

    Raises:
        InputError: field ``bins``.
    """
    frames = np.asarray(frames)
    _check(bins, frames.shape[1])
    if all(side == 1 for side in bins):
        return frames
    result = np.zeros_like(frames)
    for channel, side in enumerate(bins):
        rows, columns = (np.arange(0, size, side) for size in frames.shape[-2:])
        sums = np.add.reduceat(np.add.reduceat(frames[:, channel], rows, axis=-2), columns, axis=-1)
        result[:, channel, ::side, ::side] = sums
    return result


def layer_sites(bins: Sequence[int], rows: int, columns: int) -> np.ndarray | None:
    """Return (C, rows, columns) bool, True where a layer has a pixel of its own; None when all bins are 1."""
    _check(bins, len(bins))
    if all(side == 1 for side in bins):
        return None
    row, column = np.arange(rows)[:, None], np.arange(columns)
    return np.stack([(row % side == 0) & (column % side == 0) for side in bins])


def _check(bins: Sequence[int], channels: int) -> None:
    if len(bins) != channels or any(side < 1 for side in bins):
        raise InputError("bins", tuple(bins), f"{channels} block sides, each at least 1 pixel")

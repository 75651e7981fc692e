"""Bilinear interpolation of a mosaic: what a camera's raw converter would do to coded frames before anyone inverts them."""

from __future__ import annotations

import numpy as np

TENT = np.array([0.5, 1.0, 0.5])


def bilinear(mosaic: np.ndarray, colors: np.ndarray, count: int = 3) -> np.ndarray:
    """Fill every pixel with every colour: the mean of the nearest pixels of that colour, weighted as a bilinear tent.

    Args:
        mosaic: (..., M, W) one number a pixel.
        colors: (M, W) index of each pixel's colour.
        count: of colours.

    Returns:
        (..., count, M, W); a pixel's own colour stays as it was.
    """
    from scipy.ndimage import convolve

    tent = np.outer(TENT, TENT)
    planes = []
    for color in range(count):
        here = (colors == color).astype(np.float64)
        weight = convolve(here, tent, mode="constant")
        flat = mosaic.reshape(-1, *mosaic.shape[-2:])
        sums = np.stack([convolve(plane * here, tent, mode="constant") for plane in flat]).reshape(mosaic.shape)
        planes.append(np.where(here > 0, mosaic, sums / np.where(weight > 0, weight, 1.0)))
    return np.stack(planes, axis=-3)

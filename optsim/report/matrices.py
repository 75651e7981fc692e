"""Small instances of the paper's H, computed by the operator that reconstructs: for its Fig. 2 and Fig. 4."""

from __future__ import annotations

import numpy as np

from recon.coded_aperture import CodedAperture

ROWS, COLUMNS, BANDS = 4, 4, 6
RGGB = np.array([[0, 1], [1, 2]])

# Fig. 4 draws stylised bands (1 to 6) in place of real curves, which never reach zero; red, green, blue.
BAYER_BANDS = ((5, 6), (2, 3, 4, 5), (1, 2))
FOVEON_BANDS = ((5, 6), (3, 4, 5), (1, 2, 3, 4))


def stylised(bands: tuple[tuple[int, ...], ...]) -> np.ndarray:
    """Return a (3, 6) response that is 1 on the listed bands (counted from 1) and 0 elsewhere."""
    response = np.zeros((len(bands), BANDS))
    for curve, numbers in enumerate(bands):
        response[curve, np.array(numbers) - 1] = 1
    return response


def matrix(response: np.ndarray, dispersed: bool = True, mosaic: np.ndarray | None = None) -> np.ndarray:
    """Return the dense H of an open 4 x 4 mask; columns: row fastest, then column, then band.

    Args:
        response: (C, K) response of each curve to each band.
        dispersed: shift band k by k pixels; otherwise all bands land on the mask's own columns.
        mosaic: (4, 4 + K - 1) curve of each pixel, or None for all curves at every pixel.
    """
    count = response.shape[1]
    first = np.arange(count) if dispersed else np.zeros(count, int)
    mask = np.ones((1, ROWS, COLUMNS))
    return CodedAperture(mask, response, first, np.ones((count, 1)), mosaic=mosaic).dense()


def mono_matrices() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Fig. 2's three matrices: one band; six bands without dispersion; six bands dispersed."""
    return matrix(np.ones((1, 1)), dispersed=False), matrix(np.ones((1, BANDS)), dispersed=False), matrix(np.ones((1, BANDS)))


def foveon_matrix() -> np.ndarray:
    """Return Fig. 4's Foveon H: red, green and blue blocks, one above the other."""
    return matrix(stylised(FOVEON_BANDS))


def bayer_blocks() -> np.ndarray:
    """Return Fig. 4's Bayer H as three stacked colour blocks whose rows are empty where a pixel has another colour.

    Their sum is the operator that reconstructs, which stores only one row a pixel.
    """
    width = COLUMNS + BANDS - 1
    mosaic = np.tile(RGGB, (ROWS, width))[:ROWS, :width]
    full = matrix(stylised(BAYER_BANDS))
    color_of_row = np.concatenate([(mosaic == c).T.ravel() for c in range(3)])
    return full * color_of_row[:, None]


def bayer_matrix() -> np.ndarray:
    """Return the Bayer H as the operator stores it: one row a pixel."""
    width = COLUMNS + BANDS - 1
    return matrix(stylised(BAYER_BANDS), mosaic=np.tile(RGGB, (ROWS, width))[:ROWS, :width])

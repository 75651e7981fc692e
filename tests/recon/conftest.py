"""Synthetic cubes and cameras for the tests of recon: small, seeded, without any scene or optics."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from recon.coded_aperture import CodedAperture


def smooth_cube(size: int, bands: int, seed: int = 3) -> np.ndarray:
    """Patches of smooth random spectra under a mild shading, peak 1: sparse in a wavelet x DCT basis, but not exactly."""
    draw = np.random.Generator(np.random.Philox(seed))
    position = np.linspace(0, 1, bands)
    cube = np.full((size, size, bands), 0.03)
    side = max(2, size // 4)
    for row in range(0, size, side):
        for column in range(0, size, side):
            center, width, base = draw.uniform(0, 1), draw.uniform(0.15, 0.6), draw.uniform(0.05, 0.5)
            spectrum = base + (1 - base) * np.exp(-(((position - center) / width) ** 2))
            cube[row : row + side - 1, column : column + side - 1] = spectrum * draw.uniform(0.3, 1)
    y, x = np.mgrid[:size, :size] / size - 0.5
    cube *= (1 - 0.4 * ((x + 0.2) ** 2 + (y - 0.1) ** 2))[:, :, None]
    return cube / cube.max()


def curves(bands: int) -> np.ndarray:
    """Three broad overlapping responses, red, green, blue, peak 1."""
    position = np.linspace(0, 1, bands)
    return np.stack([np.exp(-(((position - c) / w) ** 2)) for c, w in ((0.8, 0.6), (0.5, 0.5), (0.2, 0.6))])


def make_camera(
    sensor: str, shots: int, size: int, bands: int, *, seed: int = 0, dtype: Any = np.float64, spread: bool = False, repeated: bool = False
) -> CodedAperture:
    """A one-pixel-a-band camera (``spread``: three columns a band) behind Bernoulli masks."""
    draw = np.random.Generator(np.random.Philox(seed))
    masks = draw.integers(0, 2, (1 if repeated else shots, size, size))
    masks = np.broadcast_to(masks, (shots, size, size))
    taps = np.tile([0.125, 0.75, 0.125], (bands, 1)) if spread else np.ones((bands, 1))
    width = size + bands - 2 + taps.shape[1]
    response = np.ones((1, bands)) if sensor == "mono" else curves(bands)
    mosaic = None
    if sensor == "bayer":
        mosaic = np.array([[0, 1], [1, 2]])[np.arange(size)[:, None] % 2, np.arange(width) % 2]
    return CodedAperture(masks, response, np.arange(bands), taps, mosaic=mosaic, width=width, dtype=dtype)


@pytest.fixture(scope="session")
def cube_of() -> Callable[..., np.ndarray]:
    return smooth_cube


@pytest.fixture(scope="session")
def camera_of() -> Callable[..., CodedAperture]:
    return make_camera


@pytest.fixture(scope="session")
def psnr_of() -> Callable[[np.ndarray, np.ndarray], float]:
    def psnr(estimate: np.ndarray, truth: np.ndarray) -> float:
        error = ((np.asarray(estimate, np.float64) - truth) ** 2).mean((0, 1))
        return float(np.mean(10 * np.log10(truth.max() ** 2 / error)))

    return psnr

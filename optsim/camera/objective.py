"""The objective: from the picture of an ideal lens to the radiance at the mirrors, which is the truth (theory.md (C.36))."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from optsim.cube import bands_of, check_cube
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

    from optsim.camera.camera import CameraConfig

REACH_SIGMAS = 6.5
"""The Gaussian beyond is below 1e-10 of its light; kernels are scaled to 1."""


def through_objective(cube: xr.Dataset, camera: CameraConfig, samples: int = 1) -> xr.Dataset:
    """Return the radiance that the objective lays on the mirrors: falling as cos^4 from the middle, blurred (theory.md (C.36)).

    cos^4 needs the objective's ``focal_mm``. The blur is the pixels' mean of the blurred light, for light that is
    even inside each pixel. It takes nothing in from beyond the picture.

    Args:
        cube: picture of an ideal lens, (M samples, N samples) pixels over the mirrors.
        camera: whose objective and mirror pitch.
        samples: pixels along a mirror's side, at least 1.

    Returns:
        A cube of the same shape and type. Its attrs list the shares of the picture's light (radiance x band width)
        that were lost: ``objective_lost_cos4`` and ``objective_lost_outside`` (blurred out of the picture). Standard
        errors are carried along as those of independent pixels.

    Raises:
        InputError: field ``samples`` or see ``check_cube``.
    """
    check_cube(cube)
    rows, columns = cube["radiance"].shape[:2]
    if samples < 1 or rows % samples or columns % samples:
        raise InputError("samples", samples, f"at least 1 and a divisor of both sides of the {rows} x {columns} picture")
    objective, pixel_mm = camera.objective, camera.dmd.pitch_um / 1000 / samples
    if objective.psf_um == 0 and (objective.focal_mm is None or not objective.cos4):
        return cube
    fall = np.ones((rows, columns))
    if objective.cos4 and objective.focal_mm is not None:
        fall = cos4(rows, columns, pixel_mm, objective.focal_mm)
    kernel = blur_kernel(objective.psf_um / 1000 / pixel_mm)
    light = cube["radiance"].values.astype(np.float64) @ bands_of(cube).width
    result = cube.copy()
    result["radiance"] = cube["radiance"].copy(data=_blurred(cube["radiance"].values, fall, kernel))
    if "stderr" in cube:
        variance = _blurred(np.square(cube["stderr"].values, dtype=np.float64), fall**2, kernel**2)
        result["stderr"] = cube["stderr"].copy(data=np.sqrt(variance).astype(cube["stderr"].dtype))
    total = float(light.sum())
    stays = _stays(rows, kernel)[:, None] * _stays(columns, kernel)
    return result.assign_attrs(
        objective_lost_cos4=float((light * (1 - fall)).sum()) / total if total > 0 else 0.0,
        objective_lost_outside=float((light * fall * (1 - stays)).sum()) / total if total > 0 else 0.0,
    )


def cos4(rows: int, columns: int, pixel_mm: float, focal_mm: float) -> np.ndarray:
    """Return cos^4 of the field angle at pixel centres, (rows, columns): 1 / (1 + (r / f)^2)^2, r from the middle."""
    y, x = ((np.arange(n) - (n - 1) / 2) * (pixel_mm / focal_mm) for n in (rows, columns))
    return np.asarray(1 / (1 + x**2 + y[:, None] ** 2) ** 2)


def blur_kernel(sigma_px: float) -> np.ndarray:
    """Return a Gaussian between the means of pixels, (2 h + 1,), adding to 1.

    The share of an even pixel's light that another pixel collects: the Gaussian convolved with two pixel boxes.
    """
    from scipy.special import ndtr

    if sigma_px == 0:
        return np.ones(1)
    half = math.ceil(REACH_SIGMAS * sigma_px) + 1
    u = np.arange(-half - 1, half + 2, dtype=np.float64)
    twice = u * ndtr(u / sigma_px) + sigma_px * np.exp(-((u / sigma_px) ** 2) / 2) / math.sqrt(2 * math.pi)
    kernel = np.clip(np.diff(twice, 2), 0, None)
    kernel = (kernel + kernel[::-1]) / 2
    return np.asarray(kernel / kernel.sum())


def _blurred(values: np.ndarray, fall: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Return values x fall, convolved along rows and columns in float64, band by band, in the values' own type."""
    from scipy.ndimage import convolve1d

    result = np.empty(values.shape, values.dtype)
    for k in range(values.shape[2]):
        band = values[:, :, k] * fall
        for axis in (0, 1):
            band = convolve1d(band, kernel, axis=axis, mode="constant")
        result[:, :, k] = band
    return result


def _stays(count: int, kernel: np.ndarray) -> np.ndarray:
    """Return (count,) shares of each pixel's light that stay inside a line of pixels."""
    half = kernel.size // 2
    below = np.concatenate([[0.0], np.cumsum(kernel)])
    place = np.arange(count)
    low, high = np.clip(half - place, 0, kernel.size), np.clip(half + count - place, 0, kernel.size)
    return np.asarray(below[high] - below[low])

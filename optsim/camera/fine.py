"""The fine cube that a physical photograph integrates over, checked for fineness or interpolated when asked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np

from optsim.camera.model import Model, ranged
from optsim.cube import Bands, bands_of, check_cube, require_watts
from optsim.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

MIN_WAVELENGTHS, MIN_SAMPLES = 10, 2
_ALL = slice(None)
REMEDY = "--subdivide 10 --oversample 2"


class Interpolate(Model):
    """Allow a coarse cube: repeat it inside each mirror, and make it piecewise linear in wavelength with its own band means.

    Args:
        wavelengths: samples inside every band, 10 to 100.
        samples: along each mirror side, 2 to 8.
    """

    place: ClassVar[str] = "interpolate"
    wavelengths: Annotated[int, ranged(MIN_WAVELENGTHS, 100, "wavelengths a band")] = MIN_WAVELENGTHS
    samples: Annotated[int, ranged(MIN_SAMPLES, 8, "samples a mirror side")] = MIN_SAMPLES


class FineCube:
    """Hand out rows of the fine cube, (rows, N s, n) float32; interpolated rows are made when asked for.

    Args:
        cube: radiance of (M s', N s') pixels.
        bands: the K bands of the camera's discrete model.
        size: (M, N) mirrors.
        interpolate: None refuses a coarse cube.
        cover_nm: interpolated bands are extended (held constant) to these wavelengths.

    Raises:
        InputError: field ``cube`` (too coarse, naming the remedy; wrong size; gaps), or see ``check_cube`` and ``require_watts``.
    """

    def __init__(
        self, cube: xr.Dataset, bands: Bands, size: tuple[int, int], interpolate: Interpolate | None, cover_nm: tuple[float, float]
    ) -> None:
        check_cube(cube)
        require_watts(cube)
        self._radiance = cube["radiance"].values
        if self._radiance.min() < 0:
            raise InputError("radiance", float(self._radiance.min()), "at least 0 everywhere")
        given = bands_of(cube)
        samples = _samples(self._radiance.shape[:2], size)
        per_band = _wavelengths_per_band(given, bands)
        self.interpolated = samples < MIN_SAMPLES or per_band < MIN_WAVELENGTHS
        if self.interpolated and interpolate is None:
            found = f"{samples} x {samples} samples a mirror, {per_band} wavelengths inside the coarsest band"
            least = f"of at least {MIN_SAMPLES} x {MIN_SAMPLES} samples a mirror and {MIN_WAVELENGTHS} wavelengths a band"
            raise InputError("cube", found, f"{least}: render with {REMEDY}, or allow interpolation (--interpolate)")
        self._repeat = 1
        self._spectral: _Refinement | None = None
        self.bands, self.samples = given, samples
        if interpolate is not None and samples < MIN_SAMPLES:
            self._repeat = self.samples = interpolate.samples
        if interpolate is not None and per_band < MIN_WAVELENGTHS:
            self._spectral = _Refinement(given, -(-interpolate.wavelengths // max(1, per_band)), cover_nm)
            self.bands = self._spectral.bands
        self.shape = (size[0] * self.samples, size[1] * self.samples, self.bands.count)

    def rows(self, start: int, stop: int, wavelengths: slice = _ALL) -> np.ndarray:
        """Return fine rows start..stop-1 of some wavelengths as C-contiguous float32."""
        r = self._repeat
        part = self._radiance[start // r : -(-stop // r)]
        part = part[..., wavelengths] if self._spectral is None else self._spectral.apply(part)[..., wavelengths]
        if r > 1:
            part = np.repeat(np.repeat(part, r, axis=0), r, axis=1)[start % r :][: stop - start]
        return np.ascontiguousarray(part, np.float32)


class _Refinement:
    """Cut bands into parts: linear between band centres, then scaled so that every band keeps its mean."""

    def __init__(self, coarse: Bands, parts: int, cover_nm: tuple[float, float]) -> None:
        self.bands = coarse.subdivide(parts, (min(cover_nm[0], coarse.lower[0]), max(cover_nm[1], coarse.upper[-1])))
        center = self.bands.center
        right = np.clip(np.searchsorted(coarse.center, center), 1, max(1, coarse.count - 1))
        self._left, self._right = right - 1, np.minimum(right, coarse.count - 1)
        span = np.where(self._right > self._left, coarse.center[self._right] - coarse.center[self._left], 1.0)
        self._rise = np.clip((center - coarse.center[self._left]) / span, 0, 1)
        self._owner = np.clip(np.searchsorted(coarse.upper, center), 0, coarse.count - 1)
        inside = (center >= coarse.lower[0]) & (center <= coarse.upper[-1])
        self._mean = np.zeros((center.size, coarse.count))
        self._mean[np.arange(center.size)[inside], self._owner[inside]] = self.bands.width[inside]
        self._mean /= self._mean.sum(0)

    def apply(self, coarse: np.ndarray) -> np.ndarray:
        values = coarse.astype(np.float64)
        fine = values[..., self._left] * (1 - self._rise) + values[..., self._right] * self._rise
        mean = fine @ self._mean
        scale = np.divide(values, mean, out=np.ones_like(values), where=mean > 0)
        return (fine * scale[..., self._owner]).astype(np.float32)


def _samples(shape: tuple[int, ...], size: tuple[int, int]) -> int:
    samples = shape[0] // size[0]
    if samples < 1 or shape != (size[0] * samples, size[1] * samples):
        raise InputError(
            "cube", f"{shape[0]} x {shape[1]} pixels", f"a whole number of samples along each side of {size[0]} x {size[1]} mirrors"
        )
    if samples > 8:
        raise InputError("cube", f"{samples} x {samples} samples a mirror", "of at most 8 x 8 samples a mirror")
    return samples


def _wavelengths_per_band(fine: Bands, bands: Bands) -> int:
    """Count the fine bands inside the band that has fewest; 0 when one fine band is wider than a band's tenth allows."""
    if not fine.contiguous:
        raise InputError("cube", "bands with gaps or overlaps", "of touching bands")
    if fine.lower[0] > bands.lower[0] + 1e-3 or fine.upper[-1] < bands.upper[-1] - 1e-3:
        raise InputError(
            "cube", f"{fine.lower[0]:g}-{fine.upper[-1]:g} nm", f"covering the bands {bands.lower[0]:g}-{bands.upper[-1]:g} nm"
        )
    inside = (fine.center[:, None] > bands.lower) & (fine.center[:, None] < bands.upper)
    widest = np.where(inside, fine.width[:, None], 0).max(0)
    by_width = np.floor(bands.width / np.where(widest > 0, widest, np.inf) * (1 + 1e-9))
    return int(np.minimum(inside.sum(0), np.ceil(by_width)).min())

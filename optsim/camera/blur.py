"""The blurred image of one mirror and band on the pixel grid, at any sub-pixel place (theory.md (S.45))."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Otf = Callable[[float, np.ndarray, np.ndarray], np.ndarray]
"""``otf(wavelength_nm, fy, fx)`` at frequencies in cycles per px."""

Spectrum = Callable[[np.ndarray, np.ndarray], np.ndarray]

SIDE_PX = 64
PHASES = 32


@dataclass(frozen=True, eq=False)
class Window:
    """Hold the images of all bands, cut to the pixels within ``reach`` (down, across) of the one that holds the centroid.

    What lies farther out is put back in proportion, so that no light is lost.
    """

    spectra: Sequence[Spectrum]
    reach: tuple[int, int]
    samples: int

    @classmethod
    def fitting(cls, spectra: Sequence[Spectrum], error: float) -> Window:
        """Return the smallest window, as far out in both directions from the line, that holds all but ``error`` of every band's light."""
        samples = 8 if all(abs(complex(s(np.zeros((1, 1)), np.full((1, 1), 4.0))[0, 0])) < 1e-9 for s in spectra) else 16
        images = np.stack([_image(spectrum, samples) for spectrum in spectra])
        middle = SIDE_PX // 2
        most = middle - 1
        line = max(int(np.ceil(_half_width(image.sum(0), middle, 0.5))) for image in images)
        for reach in range(1, most + 1):
            across = min(most, reach + max(0, line - 1))
            inside = images[:, middle - reach : middle + reach + 1, middle - across : middle + across + 1].sum((1, 2))
            if (inside >= 1 - error).all():
                break
        return cls(spectra, (reach, across), samples)

    def exact(self, band: int) -> Callable[[np.ndarray], np.ndarray]:
        """Return the image as a function of one place (2, 1, 1) in px from a pixel's centre: (1, 1, Tr, Tc)."""

        def at(phase: np.ndarray) -> np.ndarray:
            return self._cut(_image(self.spectra[band], self.samples, float(phase[0, 0, 0]), float(phase[1, 0, 0])))[None, None]

        return at

    def table(self, band: int) -> Callable[[np.ndarray], np.ndarray]:
        """Return the image as a function of places (2, M, N): bilinear between 33 x 33 phases of a pixel, (M, N, Tr, Tc) float32."""
        images = self._phases(band)

        def at(phase: np.ndarray) -> np.ndarray:
            position = (phase + 0.5) * PHASES
            base = np.clip(np.floor(position), 0, PHASES - 1).astype(np.int64)
            v, u = (position - base).astype(np.float32)[..., None, None]
            i, j = base
            near = images[i, j] * (1 - u) + images[i, j + 1] * u
            far = images[i + 1, j] * (1 - u) + images[i + 1, j + 1] * u
            result: np.ndarray = near * (1 - v) + far * v
            return result

        return at

    def _phases(self, band: int) -> np.ndarray:
        """Return the images at all phases (33, 33, Tr, Tc) from one finely sampled image."""
        fine = _fine_image(self.spectra[band], self.samples)
        middle = SIDE_PX // 2 * PHASES
        step = np.arange(PHASES + 1) - PHASES // 2
        rows, columns = (middle + PHASES * np.arange(-r, r + 1) - step[:, None] for r in self.reach)
        images = fine[rows[:, None, :, None], columns[None, :, None, :]]
        return self._whole(images).astype(np.float32)

    def _cut(self, image: np.ndarray) -> np.ndarray:
        middle = SIDE_PX // 2
        y, x = self.reach
        return self._whole(image[middle - y : middle + y + 1, middle - x : middle + x + 1])

    @staticmethod
    def _whole(image: np.ndarray) -> np.ndarray:
        """Remove negative ripples and put back what lies outside."""
        positive = np.maximum(image, 0)
        result: np.ndarray = positive / positive.sum((-2, -1), keepdims=True)
        return result


def _half_width(profile: np.ndarray, middle: int, share: float) -> float:
    """Return the smallest half width in px around the middle that holds a share of the profile."""
    for half in range(middle):
        if profile[middle - half : middle + half + 1].sum() >= share:
            return float(half)
    return float(middle)


@functools.cache
def _frequencies(samples: int) -> tuple[np.ndarray, np.ndarray]:
    n = SIDE_PX * samples
    return np.fft.fftfreq(n, 1 / samples)[:, None], np.fft.rfftfreq(n, 1 / samples)[None, :]


def _image(spectrum: Spectrum, samples: int, y: float = 0.0, x: float = 0.0) -> np.ndarray:
    """Return the shares of pixels (64, 64) for a centroid at (y, x) from the middle pixel's centre."""
    fy, fx = _frequencies(samples)
    shifted = spectrum(fy, fx) * np.exp(-2j * np.pi * fy * y) * np.exp(-2j * np.pi * fx * x)
    return np.fft.fftshift(np.fft.irfft2(shifted, s=(SIDE_PX * samples,) * 2)[::samples, ::samples]) * samples**2


def _fine_image(spectrum: Spectrum, samples: int) -> np.ndarray:
    """Return the same at every 1 / 32 px, (2048, 2048), for a centroid in the middle; ``samples`` a px hold the spectrum."""
    fy, fx = _frequencies(samples)
    n, m = SIDE_PX * samples, SIDE_PX * PHASES
    values = spectrum(fy, fx)
    padded = np.zeros((m, m // 2 + 1), complex)
    half = n // 2
    padded[:half, : half + 1] = values[:half]
    padded[-half:, : half + 1] = values[half:]
    return np.fft.fftshift(np.fft.irfft2(padded, s=(m, m))) * PHASES**2

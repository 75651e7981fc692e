"""Radiance spectra to sRGB under their own light, with one exposure for a truth and all its estimates."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from optsim.cube import Bands
from scenes import library

# Bradford cone responses (Lam 1985, as in ICC.1:2022 annex E) and linear sRGB from XYZ (IEC 61966-2-1).
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
_WHITE = np.linalg.inv(XYZ_TO_RGB) @ np.ones(3)
D65 = _WHITE / _WHITE[1]
WHITE_QUANTILE = 0.995
"""The brightest half per cent of pixels, by luminance, is the white of a picture."""

GLARE_QUANTILE = 0.95
"""What is brighter than so many pixels may be glare."""

LAMP_SHARE, LAMP_EXCESS = 0.2, 4.0
"""A pixel that shows a lamp has this share of its luminance at least, and is so many times brighter than nine tenths of the picture."""


@lru_cache(maxsize=1)
def observer() -> tuple[np.ndarray, np.ndarray]:
    """Return (wavelength nm, (n, 3) colour matching functions) of the CIE 1931 2 degree observer."""
    curves = tuple(library.observer().values())
    return curves[0].wavelength_nm, np.stack([curve.value for curve in curves], axis=1)


def band_weights(bands: Bands) -> np.ndarray:
    """Integrate the observer over each band: (K, 3), nm. Exact for its piecewise linear curve; 0 outside it."""
    wavelength, values = observer()
    steps = np.diff(wavelength)[:, None] * (values[1:] + values[:-1]) / 2
    total = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])

    def integral(x: np.ndarray) -> np.ndarray:
        x = np.clip(x, wavelength[0], wavelength[-1])
        i = np.clip(np.searchsorted(wavelength, x, side="right") - 1, 0, wavelength.size - 2)
        t = (x - wavelength[i])[:, None]
        slope = (values[i + 1] - values[i]) / (wavelength[i + 1] - wavelength[i])[:, None]
        return total[i] + values[i] * t + slope * t**2 / 2

    return integral(bands.upper) - integral(bands.lower)


def xyz(cube: np.ndarray, bands: Bands) -> np.ndarray:
    """Return CIE XYZ of spectra (..., K), in radiance units x nm."""
    return np.asarray(cube, np.float64) @ band_weights(bands)


@dataclass(frozen=True, eq=False)
class Exposure:
    """Hold the XYZ that is shown as white; None when the bands hold no visible light."""

    white: np.ndarray | None


@dataclass(frozen=True, eq=False)
class SceneLight:
    """Hold what is known of the light of a picture, in its bands.

    Args:
        white: (K,) radiance of a white surface in it.
        lamps: (n, K) radiance of each lamp that may be seen.
    """

    white: np.ndarray
    lamps: np.ndarray

    @classmethod
    def of(cls, text: object, count: int) -> SceneLight | None:
        """Read the attribute ``illuminant`` that a render leaves: JSON; None where it is absent, dark, or of other than K bands."""
        if not isinstance(text, str):
            return None
        try:
            data = json.loads(text)
            white = np.asarray(data["white"], np.float64)
            lamps = np.asarray(data["lamps"], np.float64).reshape(-1, count)
        except (ValueError, KeyError, TypeError):
            return None
        fit = white.shape == (count,) and np.all(np.isfinite(white)) and np.all(np.isfinite(lamps)) and white.min() >= 0 < white.max()
        return cls(white, lamps) if fit else None


def lamps_seen(cube: np.ndarray, bands: Bands, light: SceneLight | None) -> np.ndarray:
    """Return where a picture shows a lamp itself: (y, x) of bool.

    A pixel does that which is a good part as bright as a lamp and far brighter than nine tenths of the picture; so do its
    neighbours, which a lamp may cover in part.
    """
    luminance = xyz(cube, bands)[..., 1]
    if light is None or not len(light.lamps):
        return np.zeros(luminance.shape, bool)
    own = xyz(light.lamps, bands)[:, 1]
    own = own[own > 0]
    if not len(own):
        return np.zeros(luminance.shape, bool)
    found = (luminance >= LAMP_SHARE * own.min()) & (luminance > LAMP_EXCESS * np.quantile(luminance, 0.9))
    if not 0 < found.mean() < 0.5:
        return np.zeros_like(found)
    around = np.pad(found, 1)
    height, width = found.shape
    return np.any([around[i : i + height, j : j + width] for i in range(3) for j in range(3)], axis=0)


def exposure_of(cube: np.ndarray, bands: Bands, light: SceneLight | None = None) -> Exposure:
    """Take the mean of the brightest half per cent of a picture as its white.

    Args:
        cube: (y, x, K).
        bands: its K bands.
        light: when it is known its colour is the white's, lamps that are seen do not count as brightest, and glare, brighter than a
            white surface in this light and than 95 % of the picture, does not darken the rest.
    """
    flat = xyz(cube, bands).reshape(-1, 3)
    luminance = flat[:, 1]
    counted = ~lamps_seen(cube, bands, light).ravel()
    white = flat[counted & (luminance >= np.quantile(luminance[counted], WHITE_QUANTILE))].mean(0)
    if not (white[1] > 0 and luminance.max() > 0):
        return Exposure(None)
    own = xyz(light.white, bands) if light is not None else white
    if own[1] <= 0:
        return Exposure(white)
    level = white[1] if light is None else min(white[1], max(own[1], float(np.quantile(luminance[counted], GLARE_QUANTILE))))
    return Exposure(own * level / own[1])


def adaptation(white: np.ndarray) -> np.ndarray:
    """Return the 3 x 3 matrix that carries a white of any luminance to D65's (0.95, 1, 1.09).

    A light too narrow to be adapted to (a cone that sees next to nothing of it) is only scaled.
    """
    scaled = white / white[1]
    cones = BRADFORD @ scaled
    if np.any(cones < 0.05 * cones.max()):
        return np.eye(3) / white[1]
    gain = np.diag((BRADFORD @ D65) / cones)
    return np.linalg.inv(BRADFORD) @ gain @ BRADFORD / white[1]


def linear_srgb(cube: np.ndarray, bands: Bands, exposure: Exposure) -> np.ndarray:
    """Return linear sRGB (..., 3), unclipped; the exposure's white is (1, 1, 1)."""
    if exposure.white is None:
        return np.zeros((*np.shape(cube)[:-1], 3))
    return xyz(cube, bands) @ (XYZ_TO_RGB @ adaptation(exposure.white)).T


def srgb(cube: np.ndarray, bands: Bands, exposure: Exposure) -> np.ndarray:
    """Return display sRGB (..., 3) in 0..1, clipped to the gamut; without visible light: mean radiance as grey."""
    if exposure.white is None:
        grey = np.asarray(cube, np.float64).mean(-1)
        top = grey.max()
        linear = np.repeat((grey / top if top > 0 else np.zeros_like(grey))[..., None], 3, axis=-1)
    else:
        linear = linear_srgb(cube, bands, exposure)
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def lab(cube: np.ndarray, bands: Bands, exposure: Exposure) -> np.ndarray:
    """Return CIE 1976 L*a*b* (..., 3) after adaptation to D65; zeros without visible light."""
    if exposure.white is None:
        return np.zeros((*np.shape(cube)[:-1], 3))
    t = xyz(cube, bands) @ adaptation(exposure.white).T / D65
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)

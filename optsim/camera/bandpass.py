"""What a band-pass filter with flanks lets through: exact integrals of curve x filter x photons (theory.md (C.38))."""

from __future__ import annotations

import numpy as np

from optsim.camera.optics_config import BandpassConfig
from optsim.camera.radiometry import PHOTONS_PER_JOULE_NM
from scenes.spectrum import Spectrum


def support_nm(bandpass: BandpassConfig) -> tuple[float, float]:
    """Return the wavelengths in nm between which the filter passes anything."""
    return max(bandpass.lower_nm - bandpass.edge_nm / 2, 0.0), bandpass.upper_nm + bandpass.edge_nm / 2


def filter_transmission(bandpass: BandpassConfig, wavelength_nm: np.ndarray) -> np.ndarray:
    """Return the filter's transmission inside its support: flanks rise and fall linearly through one half at the edges.

    Where the flanks meet, the lower one holds.
    """
    wavelength = np.asarray(wavelength_nm, np.float64)
    if bandpass.edge_nm == 0:
        return np.ones(wavelength.shape)
    rise = (wavelength - bandpass.lower_nm) / bandpass.edge_nm + 0.5
    fall = (bandpass.upper_nm - wavelength) / bandpass.edge_nm + 0.5
    return np.clip(np.minimum(rise, fall), 0.0, 1.0)


def passed_photons(bandpass: BandpassConfig, lower_nm: np.ndarray, upper_nm: np.ndarray, curve: Spectrum | None = None) -> np.ndarray:
    """Integrate curve(lambda) filter(lambda) lambda / (h c) over bands, exactly: a cubic between nodes, so Simpson's rule is exact.

    Args:
        bandpass: the filter; what lies outside its support gives 0.
        lower_nm, upper_nm: (K,) band edges in nm; a band with upper <= lower gives 0.
        curve: a quantum efficiency; None: 1 everywhere.

    Returns:
        (K,) float64, photons (or electrons) nm per joule.
    """
    first, last = support_nm(bandpass)
    lower, upper = (np.clip(np.asarray(edge, np.float64), first, last) for edge in (lower_nm, upper_nm))
    some = upper > lower
    if not some.any():
        return np.zeros(lower.shape)
    half, middle = bandpass.edge_nm / 2, (bandpass.lower_nm + bandpass.upper_nm) / 2
    bends = [bandpass.lower_nm + half, bandpass.upper_nm - half, middle]
    nodes = np.zeros(0) if curve is None else curve.wavelength_nm
    edges = np.unique(np.concatenate([nodes, bends, lower[some], upper[some]]))
    edges = edges[(edges >= lower[some].min()) & (edges <= upper[some].max())]
    low, high = edges[:-1], edges[1:]

    def integrand(x: np.ndarray) -> np.ndarray:
        response = 1.0 if curve is None else np.interp(x, curve.wavelength_nm, curve.value)
        return np.asarray(response * filter_transmission(bandpass, x) * x)

    pieces = (high - low) / 6 * (integrand(low) + 4 * integrand((low + high) / 2) + integrand(high))
    ends = np.searchsorted(edges, np.stack([lower[some], upper[some]], axis=1)).ravel()
    result = np.zeros(lower.shape)
    result[some] = np.add.reduceat(np.append(pieces, 0.0), ends)[::2]
    return result * PHOTONS_PER_JOULE_NM


def photons(lower_nm: np.ndarray, upper_nm: np.ndarray) -> np.ndarray:
    """Return the integral of lambda / (h c) over bands without any filter; 0 for empty bands."""
    return np.maximum(upper_nm - lower_nm, 0.0) * (upper_nm + lower_nm) / 2 * PHOTONS_PER_JOULE_NM

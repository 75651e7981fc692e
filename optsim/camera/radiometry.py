"""From spectral radiance at the mirrors to electrons (theory.md (C.8), (C.10))."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from optsim.errors import InputError
from scenes.spectrum import Spectrum

PLANCK_J_S = 6.62607015e-34
LIGHT_M_PER_S = 299792458.0
PHOTONS_PER_JOULE_NM = 1e-9 / (PLANCK_J_S * LIGHT_M_PER_S)
"""Photons of 1 nm in one joule: lambda / (h c) is this times the wavelength in nm."""

MIRROR_TILT_DEG = 12.0


def etendue_m2_sr(mirror_um: float, fill_factor: float, projected_solid_angle_sr: float) -> float:
    """Return area x fill factor x projected solid angle of one mirror, in m^2 sr (theory.md (C.8))."""
    return (mirror_um * 1e-6) ** 2 * fill_factor * projected_solid_angle_sr


def smallest_cone_sr(*f_numbers: float) -> float:
    """Return pi sin^2(theta) of the narrowest of several light cones at a mirror, in sr (theory.md (C.8)).

    A mirror that tilts by 12 degrees sends cones wider than that into each other's way: it counts as one of them (f/2.4).

    Raises:
        InputError: field ``f_number`` below 0.5.
    """
    for number in f_numbers:
        if not number >= 0.5:
            raise InputError("f_number", number, "at least 0.5, a hemisphere")
    sine = min([math.sin(math.radians(MIRROR_TILT_DEG)), *(1 / (2 * number) for number in f_numbers)])
    return math.pi * sine**2


def photon_integral(curve: Spectrum, lower_nm: np.ndarray, upper_nm: np.ndarray, through: Spectrum | None = None) -> np.ndarray:
    """Integrate curve(lambda) lambda / (h c) over bands, exactly: the integrand is at most cubic between nodes (theory.md (C.10)).

    Args:
        curve: a quantum efficiency.
        lower_nm, upper_nm: (K,) band edges in nm; a band with upper <= lower gives 0.
        through: a second factor, e.g. a filter's transmission or the light's spectrum.

    Returns:
        (K,) float64, in electrons nm per joule: electrons per radiant energy density in J/nm.
    """
    lower, upper = np.asarray(lower_nm, np.float64), np.asarray(upper_nm, np.float64)
    if not np.any(upper > lower):
        return np.zeros(lower.shape)
    ends = np.array([lower.min(), upper.max()])
    factors = [curve, Spectrum(ends, ends)] if through is None else [curve, through, Spectrum(ends, ends)]
    return product_integral(factors, lower, upper) * PHOTONS_PER_JOULE_NM


def product_integral(factors: Sequence[Spectrum], lower_nm: np.ndarray, upper_nm: np.ndarray) -> np.ndarray:
    """Integrate the product of up to three piecewise linear curves over bands, exactly: Simpson's rule between all nodes.

    Args:
        factors: one to three spectra, each held constant beyond its ends.
        lower_nm, upper_nm: (K,) band edges in nm; a band with upper <= lower gives 0.
    """
    lower, upper = np.asarray(lower_nm, np.float64), np.asarray(upper_nm, np.float64)
    if not 1 <= len(factors) <= 3:
        raise InputError("factors", len(factors), "one to three curves")
    open_bands = upper > lower
    if not open_bands.any():
        return np.zeros(lower.shape)
    edges = np.unique(np.concatenate([*(factor.wavelength_nm for factor in factors), lower[open_bands], upper[open_bands]]))
    edges = edges[(edges >= lower[open_bands].min()) & (edges <= upper[open_bands].max())]
    low, high = edges[:-1], edges[1:]

    def integrand(x: np.ndarray) -> np.ndarray:
        return np.asarray(np.prod([np.interp(x, factor.wavelength_nm, factor.value) for factor in factors], axis=0))

    pieces = (high - low) / 6 * (integrand(low) + 4 * integrand((low + high) / 2) + integrand(high))
    ends = np.searchsorted(edges, np.stack([lower[open_bands], upper[open_bands]], axis=1)).ravel()
    result = np.zeros(lower.shape)
    result[open_bands] = np.add.reduceat(np.append(pieces, 0.0), ends)[::2]
    return result

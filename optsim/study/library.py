"""What is known of spectra before a scene is seen: a basis learned from reflectances that no test scene shows (theory.md (S.60))."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optsim.errors import InputError

if TYPE_CHECKING:
    from optsim.cube import Bands
    from recon import Learned, Quality

LAMPS = ("xenon", "D65", "A")
"""Lamps under which the library is seen, besides one of equal energy: a reconstruction is not told the scene's."""


def training_spectra(bands: Bands) -> np.ndarray:
    """Return the radiances of the training half of the colour samples under several lamps, (n, K), each lamp's peak 1.

    None of the samples occurs in a chart, a textured board or a procedural scene: those show patches and the other half.

    Raises:
        InputError: field ``bands`` when they reach beyond 380 to 780 nm, where samples and lamps are known.
    """
    from scenes.library import illuminant, reflectance, training_samples

    samples, lights = [reflectance(name) for name in training_samples()], [illuminant(name) for name in LAMPS]
    low, high = max(s.range_nm[0] for s in samples + lights), min(s.range_nm[1] for s in samples + lights)
    given = float(bands.lower.min()), float(bands.upper.max())
    if given[0] < low or given[1] > high:
        raise InputError(
            "bands", f"{given[0]:g} to {given[1]:g} nm", f"within {low:g} to {high:g} nm, where the library of spectra is known"
        )
    reflectances = np.stack([sample.band_mean(bands.lower, bands.upper) for sample in samples])
    lamps = [np.ones(bands.count), *(light.band_mean(bands.lower, bands.upper) for light in lights)]
    return np.concatenate([reflectances * lamp / lamp.max() for lamp in lamps])


def learned_basis(bands: Bands) -> Learned:
    """Return the spectral basis of :func:`training_spectra`."""
    from recon import learned

    return learned(training_spectra(bands))


def quality(bands: Bands) -> Quality:
    """Return the quality mode for cubes of these bands: ``recon.reconstruct(H, g, prior=quality(bands))``.

    Raises:
        InputError: field ``bands``, see :func:`training_spectra`; ``recon.Quality()`` needs no library and takes any bands.
    """
    from recon import Quality

    return Quality(spectral=learned_basis(bands))

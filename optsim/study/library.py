"""What is known of spectra before a scene is seen: a basis learned from reflectances that no test scene shows (theory.md (S.60))."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from optsim.cube import Bands
    from recon import Learned, Quality

LAMPS = ("xenon", "D65", "A")
"""Lamps under which the library is seen, besides one of equal energy: a reconstruction is not told the scene's."""


def training_spectra(bands: Bands) -> np.ndarray:
    """Return the radiances of the training half of the colour samples under several lamps, (n, K), each lamp's peak 1.

    None of the samples occurs in a chart, a textured board or a procedural scene: those show patches and the other half.
    """
    from scenes.library import illuminant, reflectance, training_samples

    reflectances = np.stack([reflectance(name).band_mean(bands.lower, bands.upper) for name in training_samples()])
    lamps = [np.ones(bands.count), *(illuminant(name).band_mean(bands.lower, bands.upper) for name in LAMPS)]
    return np.concatenate([reflectances * lamp / lamp.max() for lamp in lamps])


def learned_basis(bands: Bands) -> Learned:
    """Return the spectral basis of :func:`training_spectra`."""
    from recon import learned

    return learned(training_spectra(bands))


def quality(bands: Bands) -> Quality:
    """Return the quality mode for cubes of these bands: ``recon.reconstruct(H, g, prior=quality(bands))``."""
    from recon import Quality

    return Quality(spectral=learned_basis(bands))

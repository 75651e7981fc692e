"""The library that the quality mode learns from: no test scene's spectra are in it, and no lamp is assumed."""

import numpy as np

from optsim.cube import Bands
from optsim.study.library import learned_basis, quality, training_spectra
from scenes import library as spectra_of
from scenes.library import illuminant, reflectance, reflectances, samples, training_samples


def test_the_library_shares_no_sample_with_charts_or_test_scenes():
    assert not set(training_samples()) & (set(spectra_of.test_samples()) | set(reflectances()))
    assert set(training_samples()) | set(spectra_of.test_samples()) == set(samples())
    bands = Bands.paper()
    library = training_spectra(bands)
    for name in (*reflectances(), *spectra_of.test_samples()):
        spectrum = reflectance(name).band_mean(bands.lower, bands.upper)
        assert np.abs(library - spectrum).max(1).min() > 1e-3


def test_every_lamp_lights_every_sample_once_and_has_peak_1():
    bands = Bands.paper()
    library = training_spectra(bands)
    count = len(training_samples())
    assert library.shape == (4 * count, 24)
    lamp = illuminant("D65").band_mean(bands.lower, bands.upper)
    np.testing.assert_allclose(library[2 * count : 3 * count] / library[:count], np.tile(lamp / lamp.max(), (count, 1)), rtol=1e-12)


def test_twelve_learned_spectra_hold_the_unseen_patches_to_half_a_percent():
    bands = Bands.paper()
    matrix = learned_basis(bands).matrix(24, np.float64)
    spectra = np.stack([reflectance(name).band_mean(bands.lower, bands.upper) for name in reflectances()])
    left = spectra - spectra @ matrix[:12].T @ matrix[:12]
    assert np.linalg.norm(left) < 0.005 * np.linalg.norm(spectra)
    assert quality(bands).spectral == learned_basis(bands)

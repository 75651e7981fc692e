"""Spectra become the colours that colour-science computes, and white stays white."""

import subprocess
import sys

import numpy as np
import pytest

from optsim.cube import Bands
from optsim.report.color import Exposure, SceneLight, adaptation, band_weights, exposure_of, lab, linear_srgb, srgb, xyz

colour = pytest.importorskip("colour")
FINE = Bands.from_edges(np.arange(377.5, 783.0, 5.0))


def sd_of(bands, values):
    return colour.SpectralDistribution(dict(zip(bands.center, values)))


@pytest.mark.parametrize("lamp", ["flat", "A", "D65", "xenon-like"])
@pytest.mark.parametrize("bands", [Bands.paper(), FINE], ids=["paper", "5 nm"])
def test_a_flat_white_under_its_own_light_is_neutral(lamp, bands):
    wl = bands.center
    light = {
        "flat": np.ones_like(wl),
        "A": (wl / 560) ** -5 / np.expm1(1.4388e7 / (2856 * wl)),
        "D65": np.interp(wl, *np.array([[400, 460, 500, 560, 600, 660, 700], [83, 118, 109, 100, 90, 80, 72]])),
        "xenon-like": 1 - ((wl - 470) / 400) ** 2,
    }[lamp]
    scene = np.linspace(0.02, 0.9, 48).reshape(6, 8, 1) * light
    exposure = exposure_of(scene, bands)
    picture = linear_srgb(scene, bands, exposure)
    assert np.abs(picture - picture.mean(-1, keepdims=True)).max() < 1e-3
    assert picture[-1, -1] == pytest.approx([1, 1, 1], abs=1e-3)
    assert np.abs(lab(scene, bands, exposure)[..., 1:]).max() < 0.1


def test_the_observer_is_read_without_importing_colour_science():
    code = "import sys; from optsim.report.color import observer; observer(); print('colour' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "False"


def test_tristimulus_values_agree_with_colour_science():
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    spectra = np.exp(-(((FINE.center - np.array([[450.0], [540.0], [620.0]])) / 40) ** 2))
    ours = xyz(spectra, FINE)
    for spectrum, mine in zip(spectra, ours):
        fine = sd_of(FINE, spectrum).interpolate(colour.SpectralShape(380, 780, 1))
        theirs = colour.sd_to_XYZ(fine, cmfs.copy().trim(fine.shape), k=1.0, method="Integration")
        assert mine == pytest.approx(theirs, rel=5e-3)


def test_band_weights_of_a_cut_observer_add_up_to_the_whole():
    whole = band_weights(Bands.from_edges([300.0, 900.0]))
    assert band_weights(FINE.subdivide(3)).sum(0) == pytest.approx(band_weights(FINE).sum(0), rel=1e-12)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    assert whole[0] == pytest.approx(np.trapezoid(cmfs.values, cmfs.wavelengths, axis=0), rel=1e-12)


def test_adaptation_agrees_with_colour_science():
    white = np.array([1.2, 1.1, 0.6])
    theirs = colour.adaptation.matrix_chromatic_adaptation_VonKries(
        white / white[1], np.array([0.95047, 1.0, 1.08883]), transform="Bradford"
    )
    assert adaptation(white) * white[1] == pytest.approx(theirs, abs=2e-3)


def test_lab_agrees_with_colour_science():
    bands = Bands.paper()
    rng = np.random.Generator(np.random.Philox(1))
    scene = rng.uniform(0.01, 1, (5, 5, 24))
    scene[0, 0] = 1.0
    exposure = exposure_of(scene, bands)
    adapted = xyz(scene, bands) @ adaptation(exposure.white).T
    d65 = colour.XYZ_to_xy(adaptation(exposure.white) @ exposure.white)
    assert lab(scene, bands, exposure) == pytest.approx(colour.XYZ_to_Lab(adapted, d65), abs=1e-6)


def test_srgb_encoding_agrees_with_colour_science():
    bands = Bands.paper()
    scene = np.linspace(0, 1, 50).reshape(5, 10, 1) * np.ones(24)
    exposure = exposure_of(scene, bands)
    linear = np.clip(linear_srgb(scene, bands, exposure), 0, 1)
    assert srgb(scene, bands, exposure) == pytest.approx(np.clip(colour.models.eotf_inverse_sRGB(linear), 0, 1), abs=1e-6)


def test_truth_and_estimate_share_one_exposure():
    bands = Bands.paper()
    truth = np.linspace(0.1, 1, 100).reshape(10, 10, 1) * np.ones(24)
    exposure = exposure_of(truth, bands)
    assert linear_srgb(truth / 2, bands, exposure) == pytest.approx(linear_srgb(truth, bands, exposure) / 2)


def test_a_lamps_image_in_glass_does_not_darken_the_picture():
    """A board of 80 % under a known light; two per cent of the pixels show glare, ten times as bright as white."""
    bands = Bands.paper()
    cube = np.full((20, 20, 24), 0.8)
    cube[0, :8] = 10.0
    light = SceneLight(np.ones(24), np.zeros((0, 24)))
    assert linear_srgb(cube, bands, exposure_of(cube, bands, light))[10, 10] == pytest.approx([0.8] * 3, rel=1e-2)
    assert linear_srgb(cube, bands, exposure_of(cube, bands))[10, 10] == pytest.approx([0.08] * 3, rel=1e-2), (
        "nothing is known of the light"
    )


def test_a_picture_brighter_than_its_light_would_have_it_is_exposed_for_its_brightest_surfaces():
    bands = Bands.paper()
    cube = np.linspace(1, 10, 400).reshape(20, 20, 1) * np.ones(24)
    light = SceneLight(np.full(24, 0.1), np.zeros((0, 24)))
    picture = linear_srgb(cube, bands, exposure_of(cube, bands, light))[..., 1]
    assert 0.04 < np.mean(picture > 1) <= 0.05
    assert picture.max() < 1.1


def test_without_visible_light_a_picture_is_the_mean_radiance_in_grey():
    infrared = Bands.from_edges([900.0, 910.0, 920.0])
    scene = np.linspace(0, 2, 12).reshape(3, 4, 1) * np.ones(2)
    exposure = exposure_of(scene, infrared)
    assert exposure.white is None
    picture = srgb(scene, infrared, exposure)
    assert np.all(picture[..., 0] == picture[..., 2])
    assert picture.max() == pytest.approx(1)
    assert np.all(srgb(np.zeros((2, 2, 2)), infrared, Exposure(None)) == 0)


def test_a_single_narrow_band_is_scaled_but_not_adapted():
    line = Bands.from_edges([589.0, 590.0])
    scene = np.ones((3, 3, 1))
    picture = srgb(scene, line, exposure_of(scene, line))
    assert np.all(np.isfinite(picture))
    assert picture[0, 0, 0] > picture[0, 0, 2]

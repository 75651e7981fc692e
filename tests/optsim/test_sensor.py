"""Sensors: curves, mosaics and layers."""

import numpy as np
import pytest

from optsim.camera import Bayer, BayerPhase, Foveon, Mono, sensors
from optsim.camera.radiometry import photon_integral
from optsim.camera.silicon import layer_absorption, silicon
from optsim.cube import Bands
from optsim.errors import InputError
from scenes.spectrum import Spectrum

ALL = sensors()
FLAT = Spectrum.constant(0.5, 400, 700)


def test_the_three_sensors_are_mono_bayer_and_foveon():
    assert [(s.name, s.channels, s.shots_per_group, len(s.curves)) for s in ALL] == [
        ("mono", 1, 3, 1),
        ("bayer", 1, 1, 3),
        ("foveon", 3, 1, 3),
    ]


@pytest.mark.parametrize("sensor", ALL[1:], ids=lambda s: s.name)
def test_published_curves_are_those_of_colour_science_with_peak_1(sensor):
    colour = pytest.importorskip("colour")
    name = {"bayer": "Nikon 5100 (NPL)", "foveon": "Sigma SDMerill (NPL)"}[sensor.name]
    published = colour.MSDS_CAMERA_SENSITIVITIES[name]
    bands = Bands.paper()
    inside = (published.wavelengths >= 455) & (published.wavelengths <= 660)
    expected = published.values[inside].T / published.values.max(0)[:, None]
    np.testing.assert_allclose(sensor.response(published.wavelengths[inside]), expected, atol=1e-6)
    assert sensor.band_mean(bands).shape == (3, 24)


@pytest.mark.parametrize("sensor", ALL, ids=lambda s: s.name)
def test_a_band_mean_is_the_integral_of_the_curve_over_the_band(sensor):
    from scipy.integrate import quad

    bands = Bands.paper()
    mean = sensor.band_mean(bands)
    for k in (0, 11, 23):
        low, high = bands.lower[k], bands.upper[k]
        for c, curve in enumerate(sensor.curves):
            nodes = curve.wavelength_nm[(curve.wavelength_nm > low) & (curve.wavelength_nm < high)]
            expected = quad(lambda x, c=curve: np.interp(x, c.wavelength_nm, c.value), low, high, points=nodes if nodes.size else None)[
                0
            ] / (high - low)
            assert mean[c, k] == pytest.approx(expected, rel=1e-10)


def test_S1_a_quantum_efficiency_of_0_is_valid_and_above_1_or_below_0_is_refused():
    assert Mono(curve=Spectrum.constant(0.0)).response(550.0).tolist() == [0.0]
    for bad in (1.2, -0.1):
        with pytest.raises(InputError, match=r"\[0, 1\]"):
            Mono(curve=Spectrum.constant(bad))
        with pytest.raises(InputError, match=r"sensor\.green"):
            Foveon(red=FLAT, green=Spectrum.constant(bad), blue=FLAT)


def test_S1_curves_that_do_not_cover_the_bands_are_refused_with_the_missing_range():
    with pytest.raises(InputError, match="missing: 680-700 nm"):
        Foveon.sigma().band_mean(Bands.from_edges([600, 650, 700]))
    with pytest.raises(InputError, match="missing: 390-400 and 680-690 nm"):
        Foveon.sigma().response([390.0, 690.0])
    Foveon.sigma().band_mean(Bands.from_edges([400, 680]))


@pytest.mark.parametrize("size", [(5, 7), (1, 1), (6, 6), (1, 4)])
@pytest.mark.parametrize("phase", BayerPhase)
def test_S2_every_pixel_has_one_colour_and_the_counts_follow_the_phase(size, phase):
    mosaic = Bayer.nikon(phase).mosaic(*size)
    assert mosaic.shape == size
    up = [(n + 1) // 2 for n in size]
    down = [n // 2 for n in size]
    cells = {(0, 0): up[0] * up[1], (0, 1): up[0] * down[1], (1, 0): down[0] * up[1], (1, 1): down[0] * down[1]}
    letters = "RGB"
    for colour in range(3):
        expected = sum(count for i, (_, count) in enumerate(cells.items()) if phase.name[i] == letters[colour])
        assert np.count_nonzero(mosaic == colour) == expected
    assert sum(np.count_nonzero(mosaic == c) for c in range(3)) == mosaic.size


def test_rggb_has_red_in_the_corner_and_green_beside_it():
    assert Bayer.nikon().mosaic(2, 4).tolist() == [[0, 1, 0, 1], [1, 2, 1, 2]]


@pytest.mark.parametrize(("depth", "share"), [(1e-20, 1e-20), (1.0, 1 - np.exp(-1)), (1e3, 1.0)])
def test_S3_one_layer_absorbs_1_minus_exp_of_its_optical_depth(depth, share):
    assert layer_absorption(depth, [0.0, 1.0])[0] == pytest.approx(share, rel=1e-15)


def test_S3_layers_and_what_passes_them_add_to_one():
    wavelength, absorption = silicon().wavelength_nm, silicon().absorption_per_um
    layers = layer_absorption(absorption, [0.0, 0.2, 0.6, 2.0])
    np.testing.assert_allclose(layers.sum(0) + np.exp(-absorption * 2.0), 1, rtol=0, atol=1e-15)
    assert wavelength[np.argmax(layers[0] / layers.sum(0))] < wavelength[np.argmax(layers[2] / layers.sum(0))]


def test_S3_silicon_absorbs_as_green_2008_prints():
    wavelength, absorption = silicon().wavelength_nm, silicon().absorption_per_um
    at = np.interp([450, 500, 550, 600, 650, 670], wavelength, absorption)
    np.testing.assert_allclose(at, [2.41, 1.11, 0.639, 0.417, 0.279, 0.239], rtol=0.005)


@pytest.mark.parametrize("borders", [[0.0], [0.5, 0.2], [-1.0, 1.0], [0.0, np.inf]])
def test_S3_borders_that_are_no_layers_are_refused(borders):
    with pytest.raises(InputError, match="borders_um"):
        layer_absorption(1.0, borders)


def test_the_silicon_sensor_collects_more_blue_than_red():
    blue, red = Mono.silicon().response([450.0, 670.0])[0]
    assert 1 > blue > red > 0


def test_electrons_per_joule_of_a_flat_curve_is_the_closed_form():
    joule_nm = 6.62607015e-34 * 299792458.0 * 1e9
    lower, upper = np.array([450.0, 500.0, 600.0]), np.array([470.0, 500.0, 668.5])
    expected = 0.5 * (upper**2 - lower**2) / 2 / joule_nm
    np.testing.assert_allclose(photon_integral(FLAT, lower, upper), expected, rtol=1e-14)


def test_electrons_per_joule_of_a_measured_curve_agrees_with_quadrature():
    from scipy.integrate import quad

    curve = Foveon.sigma().red
    nodes = curve.wavelength_nm[(curve.wavelength_nm > 501) & (curve.wavelength_nm < 563)]
    judge = quad(lambda x: np.interp(x, curve.wavelength_nm, curve.value) * x, 501, 563, points=nodes)[0] / (
        6.62607015e-34 * 299792458.0 * 1e9
    )
    assert photon_integral(curve, np.array([501.0]), np.array([563.0]))[0] == pytest.approx(judge, rel=1e-10)

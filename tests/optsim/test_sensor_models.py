"""Modelled sensors: silicon layers, the Quattro's larger pixels, user curves, absolute efficiencies."""

import numpy as np
import pytest

from optsim.camera import Bayer, Foveon, FrontFilter, Mono, Quattro, SiliconLayers, bin_layers, every_sensor, layer_sites
from optsim.camera.foveon_fit import fit_layers
from optsim.camera.silicon import silicon
from optsim.cube import Bands
from optsim.errors import InputError
from scenes.spectrum import Spectrum

VISIBLE = np.linspace(400, 680, 57)


@pytest.mark.parametrize("sensor", every_sensor(), ids=lambda s: f"{s.name} {s.curves[0].name}")
def test_every_sensor_has_efficiencies_in_0_to_1_over_the_papers_bands(sensor):
    mean = sensor.band_mean(Bands.paper())
    assert mean.shape == (len(sensor.curves), 24)
    assert (mean >= 0).all()
    assert (mean <= 1).all()
    assert mean.max() > 0.05
    assert len(sensor.layer_bins) == len(sensor.curves)


@pytest.mark.parametrize("crosstalk", [0.0, 0.15])
@pytest.mark.parametrize("coated", [True, False])
@pytest.mark.parametrize("front", [None, FrontFilter()])
def test_S3_filtered_reflected_collected_and_transmitted_light_add_to_one(crosstalk, coated, front):
    layers = SiliconLayers(borders_um=(0.2, 0.6, 2.0), crosstalk=crosstalk, coated=coated, front=front)
    parts = layers.account(VISIBLE)
    np.testing.assert_allclose(sum(parts.values()), 1, rtol=0, atol=1e-15)
    assert all((part >= -1e-16).all() for part in parts.values())
    if front is None and coated:
        np.testing.assert_allclose(layers.efficiencies(VISIBLE).sum(0) + parts["transmitted"], 1, rtol=0, atol=1e-15)


def test_bare_silicon_reflects_as_fresnels_formula_at_normal_incidence():
    index = np.interp(VISIBLE, silicon().wavelength_nm, silicon().index)
    got = SiliconLayers(coated=False, front=None).account(VISIBLE)["reflected"]
    np.testing.assert_allclose(got, ((index - 1) / (index + 1)) ** 2, rtol=1e-13)
    np.testing.assert_allclose(silicon().at([450, 550, 670])[0], [4.69, 4.08, 3.81], atol=0.01)


def test_crosstalk_moves_charge_between_layers_and_loses_none():
    apart, mixed = (SiliconLayers(crosstalk=x, front=None).efficiencies(VISIBLE) for x in (0.0, 0.2))
    np.testing.assert_allclose(mixed.sum(0), apart.sum(0), rtol=1e-14)
    np.testing.assert_allclose(mixed[0], 0.8 * apart[0] + 0.2 * apart[1], rtol=1e-13)
    np.testing.assert_allclose(mixed[2], 0.8 * apart[2] + 0.2 * apart[1], rtol=1e-13)


def test_the_foveons_layers_are_those_that_fit_the_measured_curves_and_the_misfit_is_told():
    fit = fit_layers(Foveon.sigma())
    np.testing.assert_allclose(fit.layers.borders_um, SiliconLayers().borders_um, atol=2e-3)
    np.testing.assert_allclose(list(fit.layers.front.model_dump().values()), list(FrontFilter().model_dump().values()), rtol=2e-3)
    modelled = SiliconLayers().efficiencies(Foveon.sigma().blue.wavelength_nm)[::-1]
    measured = np.stack([curve.value / curve.value.max() for curve in Foveon.sigma().curves])
    misfit = modelled / modelled.max(1, keepdims=True) - measured
    assert np.sqrt(np.mean(misfit**2)) == pytest.approx(fit.rms, rel=1e-3)
    assert np.abs(misfit).max() == pytest.approx(fit.largest, rel=1e-2)
    assert fit.at_bound


def test_a_fit_to_modelled_curves_finds_their_borders():
    truth = SiliconLayers(borders_um=(0.35, 1.4, 3.5), front=FrontFilter(blue_nm=440, blue_width_nm=20, red_nm=660, red_width_nm=4))
    fit = fit_layers(Foveon.physical(truth))
    np.testing.assert_allclose(fit.layers.borders_um, truth.borders_um, rtol=1e-3)
    assert fit.largest < 1e-5
    assert not fit.at_bound


def test_light_of_longer_wavelengths_is_collected_deeper():
    blue, green, red = SiliconLayers(front=None).efficiencies(VISIBLE)
    assert (np.diff(blue / green) < 0).all()
    assert (np.diff(red / green) > 0).all()


@pytest.mark.parametrize("borders", [(0.6, 0.2, 2.0), (0.0, 1.0, 2.0), (0.2, 0.2, 2.0), (1.0, 2.0, 101.0)])
def test_borders_out_of_order_are_refused(borders):
    with pytest.raises(InputError, match="borders_um"):
        SiliconLayers(borders_um=borders)


@pytest.mark.parametrize("size", [(6, 8), (5, 7), (1, 1), (2, 3)])
def test_the_quattros_lower_layers_hold_block_sums_in_their_blocks_first_pixels(size):
    frames = np.random.default_rng(1).uniform(0, 9, (2, 3, *size))
    binned = bin_layers(frames, Quattro.physical().layer_bins)
    np.testing.assert_array_equal(binned[:, 2], frames[:, 2])
    for channel in (0, 1):
        for i in range(size[0]):
            for j in range(size[1]):
                expected = frames[:, channel, i : i + 2, j : j + 2].sum((1, 2)) if i % 2 == j % 2 == 0 else np.zeros(2)
                np.testing.assert_allclose(binned[:, channel, i, j], expected, rtol=1e-14)
    np.testing.assert_allclose(binned.sum((2, 3)), frames.sum((2, 3)), rtol=1e-13)


def test_the_quattros_lower_layers_have_pixels_in_every_other_row_and_column_only():
    sites = layer_sites((2, 2, 1), 5, 7)
    assert sites.sum((1, 2)).tolist() == [12, 12, 35]
    assert sites[0, ::2, ::2].all()
    assert layer_sites((1, 1, 1), 5, 7) is None
    frames = np.ones((1, 3, 5, 7))
    assert bin_layers(frames, (1, 1, 1)) is frames
    with pytest.raises(InputError, match="bins"):
        bin_layers(frames, (2, 2))


def test_user_curves_are_read_as_they_stand(tmp_path):
    path = tmp_path / "own.csv"
    path.write_text("# measured on a bench\nred,wavelength_nm,blue,green\n0.1,450,0.4,0.2\n0.2,550,0.3,0.45\n0.5,670,0,0.1\n")
    sensor = Foveon.from_csv(path)
    np.testing.assert_allclose(sensor.response([450, 500, 670]), [[0.1, 0.15, 0.5], [0.2, 0.325, 0.1], [0.4, 0.35, 0.0]], atol=1e-15)
    assert Bayer.from_csv(path).mosaic(2, 2).tolist() == [[0, 1], [1, 2]]
    (tmp_path / "mono.csv").write_text("wavelength_nm,mono\n400,0.3\n700,0.6\n")
    assert Mono.from_csv(tmp_path / "mono.csv").response(550.0)[0] == pytest.approx(0.45)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wavelength_nm,red,green\n400,1,1\n500,1,1\n", "columns wavelength_nm, red, green, blue"),
        ("wavelength_nm,red,green,blue,blue\n400,1,1,1,1\n500,1,1,1,1\n", "columns wavelength_nm"),
        ("wavelength_nm,red,green,blue\n400,1,1,1\n500,1,x,1\n", "4 numbers in line 3"),
        ("wavelength_nm,red,green,blue\n400,1,1,1\n500,1,1\n", "4 numbers in line 3"),
        ("wavelength_nm,red,green,blue\n500,1,1,1\n400,1,1,1\n", "strictly increasing"),
        ("wavelength_nm,red,green,blue\n400,1,1,1\n500,nan,1,1\n", "finite"),
        ("wavelength_nm,red,green,blue\n400,1,1,1\n500,45,1,1\n", r"sensor\.csv\.red: must be in \[0, 1\]"),
        ("wavelength_nm,red,green,blue\n400,1,1,-0.1\n500,1,1,1\n", r"sensor\.csv\.blue"),
        ("wavelength_nm,red,green,blue\n", "2 to"),
        ("\x00\xff", "2 to"),
    ],
)
def test_S1_user_curves_that_are_no_efficiencies_are_refused_in_words(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        Foveon.from_csv(path)


def test_a_missing_curve_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"sensor\.csv.*FileNotFoundError"):
        Mono.from_csv(tmp_path / "none.csv")


@pytest.mark.parametrize("sensor", every_sensor(), ids=lambda s: f"{s.name} {s.curves[0].name}")
def test_an_absolute_efficiency_scales_all_curves_of_a_sensor_alike(sensor):
    wavelength = np.linspace(455, 660, 9)
    scaled = sensor.with_peak_qe(0.4)
    assert max(curve.maximum for curve in scaled.curves) == pytest.approx(0.4)
    ratio = scaled.response(wavelength).sum() / sensor.response(wavelength).sum()
    np.testing.assert_allclose(scaled.response(wavelength), ratio * sensor.response(wavelength), rtol=1e-12)
    assert type(scaled) is type(sensor)
    for bad in (0.0, 1.01, np.nan):
        with pytest.raises(InputError, match=r"sensor\.peak_qe"):
            sensor.with_peak_qe(bad)


def test_S1_a_curve_that_is_0_everywhere_has_no_peak_to_scale():
    with pytest.raises(InputError, match="peak_qe"):
        Mono(curve=Spectrum.constant(0.0)).with_peak_qe(0.5)

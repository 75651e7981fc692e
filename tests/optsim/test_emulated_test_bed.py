"""The paper's test bed: colour sensors emulated behind glass plates; and its monochromator."""

import numpy as np
import pytest
from scipy.integrate import quad

from optsim.camera import (
    Bayer,
    BayerPhase,
    CameraConfig,
    Distinct,
    Exact,
    Exposure,
    Foveon,
    Mono,
    Noise,
    band_model_of,
    masks_for,
    photograph,
    signal_of,
)
from optsim.camera.emulate import GlassPlate, GlassPlates, bayer_of, foveon_of, plate_exposures
from optsim.camera.monochromator import Monochromator, calibration_images, pinholes
from optsim.camera.silicon import FrontFilter
from optsim.cube import Bands, make_cube
from optsim.errors import InputError
from scenes.spectrum import Spectrum

pytestmark = pytest.mark.filterwarnings("ignore:the cube's wavelengths lie up to")
BANDS = Bands.from_edges([470, 500, 540, 590, 640])
CAMERA = CameraConfig().ideal()
FINE = BANDS.subdivide(10, cover=(450, 670))
SIZE = (6, 7)
MASKS = masks_for(Mono(), 2, Distinct(), SIZE, 3)
SENSORS = GlassPlates().before(Mono.silicon())


def scene(seed=0):
    rng = np.random.default_rng(seed)
    rows, columns = 2 * SIZE[0], 2 * SIZE[1]
    level = rng.uniform(0.2, 1, (rows, columns, 3))
    shapes = np.stack([np.exp(-(((FINE.center - c) / 40) ** 2)) for c in (480, 550, 620)])
    return make_cube((level @ shapes).astype(np.float32), FINE)


@pytest.fixture(scope="module")
def exposures():
    return plate_exposures(scene(), BANDS, CAMERA, MASKS, Exposure(time_s=0.02, seed=3), SENSORS)


def colour_sensor(kind, **more):
    return kind(**dict(zip(("red", "green", "blue"), (s.curve for s in SENSORS))), **more)


def test_three_exposures_behind_plates_are_a_foveon_with_the_products_as_curves(exposures):
    emulated = foveon_of(exposures)
    real = photograph(scene(), BANDS, CAMERA, colour_sensor(Foveon), MASKS, Exposure(time_s=0.02, seed=3))
    np.testing.assert_allclose(emulated["frames"].values, real["frames"].values, rtol=1e-12)
    np.testing.assert_allclose(emulated["response"].values, real["response"].values, rtol=1e-12)
    assert emulated.attrs["sensor"] == "foveon"
    assert emulated["channel"].values.tolist() == emulated["curve"].values.tolist() == ["red", "green", "blue"]


@pytest.mark.parametrize("phase", [BayerPhase.RGGB, BayerPhase.GBRG])
def test_keeping_each_colours_pixels_makes_a_bayer_sensor(exposures, phase):
    emulated = bayer_of(exposures, phase)
    real = photograph(scene(), BANDS, CAMERA, colour_sensor(Bayer, phase=phase), MASKS, Exposure(time_s=0.02, seed=3))
    np.testing.assert_allclose(emulated["frames"].values, real["frames"].values, rtol=1e-12)
    np.testing.assert_array_equal(emulated["cfa"].values, real["cfa"].values)
    assert emulated.attrs["sensor"] == "bayer"


REAL = CameraConfig(sensor={"prnu": 0.02, "pattern_seed": 3})
KNOWING = Exposure(time_s=0.02, shifts=Exact())


@pytest.fixture(scope="module")
def real_exposures():
    return plate_exposures(scene(), BANDS, REAL, MASKS, KNOWING, SENSORS)


@pytest.mark.parametrize(("join", "kind"), [(foveon_of, Foveon), (bayer_of, Bayer)])
def test_the_joined_file_of_a_real_camera_holds_the_H_that_the_real_colour_sensor_would_have(real_exposures, join, kind):
    joined, real = join(real_exposures), photograph(scene(), BANDS, REAL, colour_sensor(kind), MASKS, KNOWING)
    np.testing.assert_allclose(joined["frames"].values, real["frames"].values, rtol=1e-9, atol=1e-6)
    cube = np.random.default_rng(0).uniform(0, 1, (*SIZE, BANDS.count))
    ours, theirs = (band_model_of(f).operator(np.float64).forward(cube) for f in (joined, real))
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)


def test_a_mosaic_of_exposures_whose_H_knows_crosstalk_is_refused(exposures):
    three = tuple(frames.assign_attrs(crosstalk=0.02) for frames in exposures)
    assert foveon_of(three).attrs["crosstalk"] == 0.02
    with pytest.raises(InputError, match="crosstalk"):
        bayer_of(three)


@pytest.mark.parametrize("join", [foveon_of, bayer_of])
def test_the_joined_file_carries_its_own_H_in_the_units_of_each_exposure(join):
    """Each plate is exposed by itself to the same fill, so that the three times and responses differ."""
    noise = Noise(read_noise_e=0.0, shot_noise=False, bits=8, dark_e_per_s=1e4, offset_dn=3.0)
    digital = plate_exposures(scene(), BANDS, CAMERA, MASKS, Exposure(noise=noise, seed=3), SENSORS)
    times = [e.attrs["exposure_s"] for e in digital]
    assert len(set(times)) == 3
    joined = join(digital)
    assert joined.attrs["bits"] == 8
    assert [joined.attrs[f"exposure_{c}_s"] for c in ("red", "green", "blue")] == times
    model = band_model_of(joined)
    means = [photograph(scene(), BANDS, CAMERA, s, MASKS, Exposure(time_s=t)) for s, t in zip(SENSORS, times)]
    gain = 252 / CAMERA.sensor.full_well_e
    np.testing.assert_allclose(model.response, gain * np.concatenate([m["response"].values for m in means]), rtol=1e-12)
    expected = join(tuple(means))["frames"].values * gain
    assert np.abs(signal_of(joined) - expected).max() <= 0.5 + 1e-9


def test_the_three_exposures_have_noise_of_their_own():
    noise = Noise(read_noise_e=10.0, bits=16, gain_dn_per_e=10.0, offset_dn=1000.0)
    dark = make_cube(np.zeros((2 * SIZE[0], 2 * SIZE[1], FINE.count), np.float32), FINE)
    frames = foveon_of(plate_exposures(dark, BANDS, CAMERA, MASKS, Exposure(noise=noise, time_s=0.1), SENSORS))["frames"].values
    correlation = np.corrcoef(np.moveaxis(frames, 1, 0).reshape(3, -1)) - np.eye(3)
    assert np.abs(correlation).max() < 4 / np.sqrt(frames.size / 3)
    assert frames.std() == pytest.approx(100, rel=0.1)


def test_a_plate_loses_light_at_its_two_faces_and_by_its_edges():
    curve = GlassPlate(edges=FrontFilter(blue_nm=500, blue_width_nm=5, red_nm=1000, red_width_nm=1), peak=0.8, index=1.5).curve("test")
    assert curve.at(700.0) == pytest.approx(0.8 * 0.96**2, rel=1e-6)
    assert curve.at(500.0) == pytest.approx(0.4 * 0.96**2, rel=1e-9)
    behind = GlassPlates(red=curve).before(Mono.silicon())[0]
    for wavelength in (480.0, 503.3, 650.0):
        assert behind.response(wavelength)[0] == pytest.approx(curve.at(wavelength) * Mono.silicon().response(wavelength)[0], rel=2e-3)


def test_transmissions_above_one_and_curves_without_common_wavelengths_are_refused():
    with pytest.raises(InputError, match=r"glass\.green.*\[0, 1\]"):
        GlassPlates(green=Spectrum.constant(1.2))
    with pytest.raises(InputError, match="shares wavelengths"):
        GlassPlates(red=Spectrum([900, 1000], [0.5, 0.5])).before(Mono.silicon())


@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.01])
def test_a_slit_passes_a_trapezium_of_its_full_width_at_half_maximum(ratio):
    slit = Monochromator(bandwidth_nm=8.0, slit_ratio=ratio).slit(550.0)
    area = quad(lambda x: np.interp(x, slit.wavelength_nm, slit.value), 530, 570, points=list(slit.wavelength_nm))[0]
    assert area == pytest.approx(8.0, rel=1e-12)
    assert slit.at([546.0, 550.0, 554.0]).tolist() == pytest.approx([0.5, 1.0, 0.5])


def test_the_monochromator_finds_a_flat_spectrum_exactly_and_a_sloped_one_at_the_slits_weighted_centre():
    fine = Bands.from_edges(np.linspace(440, 680, 481))
    steps = Bands.from_edges([480, 490, 505, 530])
    instrument = Monochromator()
    flat = make_cube(np.full((2, 3, 480), 0.7, np.float32), fine)
    np.testing.assert_allclose(instrument.acquire(flat, steps, Mono.silicon())["radiance"].values, 0.7, rtol=1e-6)
    slope = make_cube(np.broadcast_to(fine.center, (2, 3, 480)).astype(np.float64), fine)
    got = instrument.acquire(slope, steps, Mono())["radiance"].values[0, 0]
    width = np.array([10.0, 15.0, 25.0])
    np.testing.assert_allclose(got, steps.center + width**2 / 6 / steps.center, rtol=2e-6)  # weight lambda over a triangle


def test_a_narrow_slit_finds_the_bands_means_of_a_smooth_target():
    fine = Bands.from_edges(np.linspace(440, 680, 961))
    steps = Bands.from_edges(np.linspace(470, 640, 18))
    target = 1 + 0.5 * np.sin(fine.center / 25)
    got = Monochromator(bandwidth_nm=2.0).acquire(make_cube(np.broadcast_to(target, (1, 1, 960)).copy(), fine), steps, Mono())
    np.testing.assert_allclose(got["radiance"].values[0, 0], 1 + 0.5 * np.sin(steps.center / 25), atol=2e-3)


def test_the_recorded_noise_is_that_of_the_exposure_chain():
    fine = Bands.from_edges(np.linspace(440, 680, 241))
    steps = Bands.from_edges([500, 510, 530])
    flat = make_cube(np.full((80, 80, 240), 3.0, np.float32), fine)
    noise = Noise(read_noise_e=20.0, bits=16)
    got = Monochromator().acquire(flat, steps, Mono(), noise, fill=0.5, seed=1)["radiance"].values
    electrons = 10_000.0
    expected = 3.0 * np.sqrt(electrons + 400 + (20_000 / 65535) ** 2 / 12) / electrons
    assert abs(got.mean() / 3 - 1) < 4 * expected / 3 / np.sqrt(got.size)
    np.testing.assert_allclose(got.std((0, 1)), expected, rtol=4 / np.sqrt(2 * 6400))
    again = Monochromator().acquire(flat, steps, Mono(), noise, fill=0.5, seed=1)["radiance"].values
    assert again.tobytes() == got.tobytes()


def test_slits_that_reach_beyond_the_cube_or_the_lamp_are_refused_with_the_range_they_need():
    fine = Bands.from_edges(np.linspace(450, 670, 221))
    cube = make_cube(np.ones((1, 1, 220), np.float32), fine)
    with pytest.raises(InputError, match=r"cube.*covering 643-677 nm"):
        Monochromator().acquire(cube, Bands(np.array([651.5]), np.array([668.5]), np.array([660.0])), Mono())
    with pytest.raises(InputError, match=r"monochromator\.lamp"):
        Monochromator(bandwidth_nm=5.0, lamp=Spectrum([500, 600], [1, 1])).white(480.0, fine, (1, 1))
    with pytest.raises(InputError, match="bandwidth_nm"):
        Monochromator().slit(500.0)


def test_a_white_target_shows_the_lamp_through_the_slit():
    fine = Bands.from_edges(np.linspace(500, 560, 61))
    lamp = Spectrum([400, 700], [1.0, 4.0])
    cube = Monochromator(bandwidth_nm=6.0, lamp=lamp).white(530.3, fine, (2, 4))
    energy = (cube["radiance"].values * fine.width).sum(2)
    assert cube["radiance"].shape == (2, 4, 60)
    np.testing.assert_allclose(energy, 6.0 * lamp.at(530.3), rtol=1e-6)  # a symmetric slit over a line: its centre's value


def test_calibration_spots_fall_where_the_prism_lays_their_wavelength():
    bands = Bands.from_edges([460, 500, 540, 590, 650])
    mask = pinholes((8, 10), 4)
    assert np.argwhere(mask[0]).tolist() == [[2, 2], [2, 6], [6, 2], [6, 6]]
    centers = (480.0, 530.0, 620.0)
    images = calibration_images(Monochromator(bandwidth_nm=1.0), centers, bands, CAMERA, mask)
    for center, frames in zip(centers, images):
        image = frames["frames"].values[0, 0]
        half = image.shape[0] // 2
        columns = np.arange(image.shape[1])
        found = (image[:half] * columns).sum() / image[:half].sum()
        expected = CAMERA.dispersion.position_px(np.array([center]))[0][0] + 4 * CAMERA.mirror_px
        assert found == pytest.approx(expected, abs=0.05)

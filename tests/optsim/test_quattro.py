"""The Quattro through the whole camera: photograph, noise, H and its inverse."""

import numpy as np
import pytest

from optsim.camera import (
    CameraConfig,
    Distinct,
    Exposure,
    Foveon,
    Noise,
    Quattro,
    band_model_of,
    bin_layers,
    layer_sites,
    masks_for,
    measure_matched,
    photograph,
    signal_of,
)
from optsim.cube import Bands, make_cube
from recon import Admm, reconstruct

pytestmark = pytest.mark.filterwarnings("ignore:the cube's wavelengths lie up to")
BANDS = Bands.from_edges([470, 500, 540, 590, 640])
FINE = BANDS.subdivide(10, cover=(450, 670))
CAMERA = CameraConfig().ideal()
SENSOR, FULL = Quattro.physical(), Foveon.physical()
SIZE = (7, 9)
MASKS = masks_for(SENSOR, 2, Distinct(), SIZE, 3)


@pytest.fixture(scope="module")
def scene():
    level = np.random.default_rng(0).uniform(0.2, 1, (2 * SIZE[0], 2 * SIZE[1], 1))
    return make_cube((level * (1 + np.sin(FINE.center / 60))).astype(np.float32), FINE)


def test_the_quattros_frames_are_the_foveons_with_the_lower_layers_summed_over_blocks(scene):
    quattro, foveon = (photograph(scene, BANDS, CAMERA, s, MASKS, Exposure(time_s=1.0)) for s in (SENSOR, FULL))
    np.testing.assert_allclose(quattro["frames"].values, bin_layers(foveon["frames"].values, (2, 2, 1)), rtol=1e-12)
    assert quattro.attrs["sensor"] == "quattro"


def test_the_quattros_H_sums_the_same_blocks(scene):
    cube = np.random.default_rng(1).uniform(0, 1, (*SIZE, BANDS.count))
    quattro, foveon = (photograph(scene, BANDS, CAMERA, s, MASKS, Exposure(time_s=1.0)) for s in (SENSOR, FULL))
    ours, full = (band_model_of(f).operator(np.float64).forward(cube) for f in (quattro, foveon))
    np.testing.assert_allclose(ours, bin_layers(full, (2, 2, 1)), rtol=1e-12)


def test_places_without_a_pixel_carry_no_signal_and_no_noise(scene):
    noise = Noise(read_noise_e=30.0, dark_e_per_s=50.0, offset_dn=100.0)
    frames = photograph(scene, BANDS, CAMERA, SENSOR, MASKS, Exposure(noise=noise))
    sites = layer_sites(SENSOR.layer_bins, *frames["frames"].shape[-2:])
    assert (signal_of(frames)[:, ~sites] == 0).all()
    assert (signal_of(frames)[:, sites] != 0).mean() > 0.9


def test_a_cube_is_found_from_the_quattros_matched_frames():
    level = np.random.default_rng(2).uniform(0.2, 1, (1, 1, BANDS.count))
    truth = np.broadcast_to(level, (8, 8, BANDS.count))
    frames = measure_matched(make_cube(truth.astype(np.float32), BANDS), SENSOR, masks_for(SENSOR, 8, Distinct(), (8, 8), 0))
    found = reconstruct(band_model_of(frames).operator(np.float64), signal_of(frames), tau=1e-6, solver=Admm()).cube
    np.testing.assert_allclose(found, truth, atol=0.02)

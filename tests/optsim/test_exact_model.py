"""H that knows everything against photograph(): cubes of one mirror give its columns, any cube gives the frames."""

import numpy as np
import pytest

from optsim.camera import (
    Bayer,
    CameraConfig,
    Distinct,
    Exact,
    Exposure,
    Foveon,
    Mono,
    OwnShifts,
    Quattro,
    masks_for,
    photograph,
    physical_model,
)
from optsim.cube import Bands, make_cube
from recon.operator import adjoint_error

BANDS = Bands.from_edges([540.0, 544.0, 549.0, 555.0, 562.0, 568.0, 573.0])
SIZE = (11, 12)
SLOPE = {"mono": 0.0, "foveon": 0.02, "bayer": 0.02, "quattro": 0.02}
"""Curves that change differently inside a band lay its light differently; H lays it alike for all."""


def fine_cube(coarse):
    """A cube that is constant inside every mirror and band, as fine as photograph() asks for."""
    fine = BANDS.subdivide(10)
    owner = np.searchsorted(BANDS.upper, fine.center)
    return make_cube(np.repeat(np.repeat(coarse, 2, 0), 2, 1)[:, :, owner], fine)


def lacking(camera, sensor, masks, knowledge, *, sub_pixels=3, coarse=None):
    """Return the rms of photograph() - H f over that of photograph(), for a random cube."""
    coarse = np.random.default_rng(0).random((*SIZE, BANDS.count)) if coarse is None else coarse
    frames = photograph(fine_cube(coarse), BANDS, camera, sensor, masks, Exposure(time_s=1.0, sub_pixels=sub_pixels))["frames"].values
    h = physical_model(camera, sensor, BANDS, masks, knowledge).operator(np.float64)
    return float(np.linalg.norm(frames - h.forward(coarse)) / np.linalg.norm(frames))


@pytest.mark.parametrize("sensor", [Mono(), Foveon.sigma(), Bayer.nikon(), Quattro.physical()], ids=["mono", "foveon", "bayer", "quattro"])
def test_columns_of_the_dense_h_are_photographs_of_one_mirror_in_one_band(sensor):
    """Rotated, displaced, magnified mirrors that leak, before uneven pixels with crosstalk; without blur."""
    facts = CameraConfig().model_dump(exclude_none=True)
    facts["relay"]["diffraction"] = False
    facts["dmd"] |= {"rotation_deg": 1.0, "offset_x_px": 0.3, "offset_y_px": -0.2, "scale": 1.03, "leak": 0.0}
    facts["sensor"] |= {"crosstalk": 0.03, "prnu": 0.03}
    camera = CameraConfig(**facts)
    masks = np.ones((1, *SIZE), np.uint8)
    dense = physical_model(camera, sensor, BANDS, masks, Exact(error=1e-3)).operator(np.float64).dense()
    for band, mirror in ((1, (0, 0)), (3, (5, 6)), (5, (8, 11))):
        coarse = np.zeros((*SIZE, BANDS.count))
        coarse[(*mirror, band)] = 1
        frames = photograph(fine_cube(coarse), BANDS, camera, sensor, masks, Exposure(time_s=1.0))["frames"].values
        column = dense[:, (band * SIZE[1] + mirror[1]) * SIZE[0] + mirror[0]]
        np.testing.assert_allclose(column, frames.transpose(0, 1, 3, 2).ravel(), atol=(4e-3 + SLOPE[sensor.name]) * frames.max())


def test_exact_h_reproduces_the_default_cameras_photograph_to_the_stated_error():
    camera, masks = CameraConfig(), masks_for(Mono(), 1, Distinct(), SIZE, 0)
    assert lacking(camera, Mono(), masks, Exact(0.02), sub_pixels=5) < 0.02
    assert lacking(camera, Mono(), masks, OwnShifts(), sub_pixels=5) > 0.05


@pytest.mark.slow
def test_exact_h_with_a_small_error_reproduces_photographs_with_fine_sub_pixels():
    camera, masks = CameraConfig(), masks_for(Mono(), 2, Distinct(), SIZE, 0)
    assert lacking(camera, Mono(), masks, Exact(0.004), sub_pixels=9) < 0.004


@pytest.mark.parametrize(
    "table",
    [
        {"dmd": {"leak": 0.02, "dead_share": 0.05, "stuck_share": 0.05}},
        {"sensor": {"prnu": 0.05}},
        {"sensor": {"crosstalk": 0.05}},
        {"bandpass": {"lower_nm": 473.0, "edge_nm": 4.0}},
        {"dmd": {"offset_x_px": 0.4}},
        {"dmd": {"rotation_deg": 2.0}},
        {"dmd": {"pitch_um": 15.0}},
        {"relay": {"distortion_per_mm2": 1e-2}},
    ],
    ids=["mirrors", "prnu", "crosstalk", "flanks", "offset", "rotation", "pitch", "distortion"],
)
def test_each_fact_of_the_camera_is_in_exact_h(table):
    ideal = CameraConfig().ideal().model_dump(exclude_none=True)
    camera = CameraConfig(**{name: ideal[name] | table.get(name, {}) for name in ideal})
    masks = masks_for(Mono(), 1, Distinct(), SIZE, 1)
    assert lacking(camera, Mono(), masks, Exact(error=1e-3)) < 0.004


def test_exact_h_of_the_default_camera_has_an_exact_adjoint():
    for sensor in (Mono(), Bayer.nikon(), Quattro.physical()):
        masks = masks_for(sensor, 1, Distinct(), SIZE, 1)
        assert adjoint_error(physical_model(CameraConfig(), sensor, BANDS, masks, Exact()).operator(np.float64)) < 1e-14

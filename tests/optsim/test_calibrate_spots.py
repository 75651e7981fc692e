"""Spots in images and files: centroids against the path's positions and their errors, CSV round trips, H from a calibration."""

import numpy as np
import pytest

from optsim.camera import CameraConfig, Exact, Exposure, Mono, Noise, masks_for, physical_model
from optsim.camera.calibrate import Spots, calibrate, find_spots, read_spots, simulate_spots
from optsim.camera.dmd import Distinct
from optsim.camera.monochromator import Monochromator, calibration_images, pinholes
from optsim.cube import Bands
from optsim.errors import InputError

CAMERA = CameraConfig.parse_toml("[dmd]\nleak = 0.0\n[sensor]\nprnu = 0.0\n[relay]\ndiffraction = false")
TRUE = CAMERA.model_copy(update={"dmd": CAMERA.dmd.model_copy(update={"offset_x_px": 0.8, "offset_y_px": -0.4, "rotation_deg": 0.3})})
MASK = pinholes((48, 48), 16)
BANDS = Bands.from_edges(np.linspace(450, 670, 30))


def images(nm, camera=TRUE, noise=None, seed=0):
    return calibration_images(Monochromator(bandwidth_nm=1.0), nm, BANDS, camera, MASK, Exposure(noise=noise, seed=seed))


def missed(spots, camera=TRUE):
    x, y, _ = camera.optics.position_px(spots.wavelength_nm, spots.X_mm, spots.Y_mm)
    return spots.x_px - x, spots.y_px - y


def test_sharp_spots_without_noise_lie_where_the_path_lays_them():
    spots = find_spots(images([520.0, 620.0]), [520.0, 620.0], MASK, CAMERA)
    assert spots.count == 18
    x, y = missed(spots)
    assert np.abs(y).max() < 1e-3
    assert np.abs(x).max() < 0.03  # the slit's light is laid at the centres of fine bands, 0.76 nm wide


def test_centroids_scatter_as_their_stated_errors():
    nm = [600.0]
    sharp = find_spots(images(nm), nm, MASK, CAMERA)
    pulls = []
    for seed in range(6):
        noisy = find_spots(images(nm, noise=Noise(bits=16, offset_dn=300), seed=seed), nm, MASK, CAMERA)
        pulls += [(noisy.x_px - sharp.x_px) / noisy.sigma_x_px, (noisy.y_px - sharp.y_px) / noisy.sigma_y_px]
    assert 0.85 < np.concatenate(pulls).std() < 1.15


def test_blurred_spots_are_fitted_with_the_cameras_own_blur():
    blurred = TRUE.model_copy(update={"relay": TRUE.relay.model_copy(update={"diffraction": True})})
    drawing = CAMERA.model_copy(update={"relay": blurred.relay})
    spots = find_spots(images([600.0], blurred), [600.0], MASK, drawing)
    assert spots.count == 9
    for error in missed(spots, blurred):
        assert np.abs(error).max() < 0.05  # the photograph's own grid of a third of a pixel moves light by up to 0.03 px


def test_images_calibrate_the_camera_that_made_them():
    nm = [470.0, 560.0, 655.0]
    spots = find_spots(images(nm, noise=Noise(bits=16)), nm, MASK, CAMERA)
    found = calibrate(CAMERA, spots)
    rows = {row["name"]: row["fitted"] for row in found.parameters()}
    assert rows["offset_x_px"] == pytest.approx(0.8, abs=0.02)
    assert rows["offset_y_px"] == pytest.approx(-0.4, abs=0.02)
    assert rows["rotation_deg"] == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("offset", [{"offset_x_px": -40.0}, {"offset_y_px": -40.0}, {"offset_x_px": 600.0}])
def test_spots_out_of_reach_of_their_drawn_places_are_not_mistaken_for_others(offset):
    """The drawing is wrong by two and a half (or more) distances of open mirrors: the spots nearest to a place are others' spots."""
    elsewhere = CAMERA.model_copy(update={"dmd": CAMERA.dmd.model_copy(update=offset)})
    with pytest.raises(InputError, match="spots that stand out"):
        find_spots(images([520.0]), [520.0], MASK, elsewhere)


def test_what_holds_no_spots_is_refused():
    dark = images([520.0])
    dark[0]["frames"] = dark[0]["frames"] * 0
    for arguments, field in (
        ((dark, [520.0], MASK, CAMERA), "images"),
        ((dark, [], MASK, CAMERA), "wavelength_nm"),
        ((dark, [520.0], 0 * MASK, CAMERA), "mask"),
        ((dark, [520.0], MASK, CAMERA, 0), "half_px"),
        ((dark, [520.0], MASK, CAMERA, 8), "mask"),
    ):
        with pytest.raises(InputError, match=field):
            find_spots(*arguments)


def test_a_calibrated_h_is_nearer_to_the_cameras_own_than_the_drawn_one():
    simulated = simulate_spots(CAMERA, 0.1, seed=3, size=(16, 16))
    found = calibrate(CAMERA, simulated.spots)
    bands, masks = Bands.paper(), masks_for(Mono(), 1, Distinct(), (16, 16), 0)
    cube = np.random.default_rng(0).uniform(0, 1, (16, 16, 24))

    def frames(camera, knowledge):
        return physical_model(camera, Mono(), bands, masks, knowledge).operator(np.float64).forward(cube)[..., 4:16]

    true = frames(simulated.truth.camera, Exact())
    drawn, calibrated = (np.linalg.norm(frames(CAMERA, k) - true) for k in (None, found.knowledge))
    assert calibrated < 0.1 * drawn


# --- files ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [True, False])
def test_spots_are_read_back_bit_for_bit(tmp_path, known):
    spots = simulate_spots(CAMERA, 0.1, seed=1).spots
    if not known:
        spots = Spots(spots.wavelength_nm, spots.X_mm, spots.Y_mm, spots.x_px, spots.y_px)
    spots.write(tmp_path / "spots.csv")
    back = read_spots(tmp_path / "spots.csv")
    assert back.errors_known == known
    for name in ("wavelength_nm", "X_mm", "Y_mm", "x_px", "y_px", "sigma_x_px", "sigma_y_px"):
        np.testing.assert_array_equal(getattr(back, name), getattr(spots, name))


def test_one_column_of_errors_serves_both_axes(tmp_path):
    (tmp_path / "s.csv").write_text("x_px,y_px,wavelength_nm,X_mm,Y_mm,sigma_px\n1,2,500,0,0,0.1\n\n3,4,600,0,0,0.2\n")
    spots = read_spots(tmp_path / "s.csv")
    np.testing.assert_array_equal(spots.sigma_x_px, [0.1, 0.2])
    np.testing.assert_array_equal(spots.sigma_y_px, [0.1, 0.2])


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("", "SPOTS"),
        ("wavelength_nm,X_mm,Y_mm,x_px,y_px\n", "SPOTS"),
        ("wavelength_nm,X_mm,Y_mm,x_px\n500,0,0,1\n", "SPOTS"),
        ("wavelength_nm,X_mm,Y_mm,x_px,y_px,color\n500,0,0,1,1,red\n", "SPOTS"),
        ("wavelength_nm,X_mm,Y_mm,x_px,y_px\n500,0,0,1\n", "SPOTS"),
        ("wavelength_nm,X_mm,Y_mm,x_px,y_px\n500,0,0,one,1\n", "x_px"),
        ("wavelength_nm,X_mm,Y_mm,x_px,y_px\n500,0,0,nan,1\n", "x_px"),
        ("wavelength_nm,X_mm,Y_mm,x_px,y_px\n-500,0,0,1,1\n", "wavelength_nm"),
        ("wavelength_nm,X_mm,Y_mm,x_px,y_px,sigma_px\n500,0,0,1,1,0\n", "sigma_x_px"),
        ("wavelength_nm,X_mm,Y_mm,x_px,y_px,sigma_x_px\n500,0,0,1,1,0.1\n", "sigma_y_px"),
    ],
)
def test_a_wrong_file_is_refused_and_the_place_named(tmp_path, text, field):
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(InputError, match=field):
        read_spots(tmp_path / "s.csv")


def test_a_missing_file_and_bad_simulations_are_refused(tmp_path):
    with pytest.raises(InputError, match="SPOTS"):
        read_spots(tmp_path / "none.csv")
    for wrong in ({"noise_px": -1}, {"noise_px": np.nan}, {"wavelengths": 1}, {"seed": -1}):
        with pytest.raises(InputError):
            simulate_spots(CAMERA, **wrong)

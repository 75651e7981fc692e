"""H with everything the camera does to light, against rays laid on the pixels one by one."""

import numpy as np
import pytest
from scipy.stats import qmc

from optsim.camera import CameraConfig, CenterTable, Foveon, Mono, OwnShifts, UnitShift, physical_model
from optsim.camera.band_model import Assumed, Exact
from optsim.cube import Bands
from optsim.errors import InputError
from recon.operator import adjoint_error

BANDS = Bands.from_edges([470.0, 474.0, 480.0, 550.0, 565.0, 660.0, 668.0])


def camera(**tables):
    """The default camera's optics with perfect mirrors and pixels, and nothing but what is asked for."""
    ideal = CameraConfig().ideal().model_dump(exclude_none=True)
    for name, table in tables.items():
        ideal[name] = {**ideal.get(name, {}), **table}
    return CameraConfig(**ideal)


def share_of_pixels(cam, mirror, size, band, width, rays=2**16):
    """Follow rays from all over one mirror to the sensor and count them pixel by pixel, weighted by photons."""
    (m, n), (rows, columns) = mirror, size
    pitch = cam.dmd.pitch_um / 1000
    a, b, c, u, v = qmc.Sobol(5, seed=1).random(rays).T
    wavelength = BANDS.lower[band] + (BANDS.upper[band] - BANDS.lower[band]) * a
    X, Y = (n - columns / 2 + b) * pitch, (m - rows / 2 + c) * pitch
    disc = None if cam.optics.pupil() is None else np.stack([np.sqrt(u) * np.cos(2 * np.pi * v), np.sqrt(u) * np.sin(2 * np.pi * v)], -1)
    x, y, valid = cam.optics.position_px(wavelength, X, Y, disc)
    column, row = np.floor(x + columns / 2).astype(int), np.floor(y + rows / 2).astype(int)
    on = valid & (column >= 0) & (column < width) & (row >= 0) & (row < rows)
    light = wavelength * cam.optics.transmission(wavelength)
    image = np.zeros((rows, width))
    np.add.at(image, (row[on], column[on]), light[on] / light.sum())
    return image


def image_of(model, mirror, band):
    cube = np.zeros((*model.masks.shape[1:], BANDS.count))
    cube[(*mirror, band)] = 1
    return model.operator(np.float64).forward(cube)[0, 0] / model.response[0, band]


FACTS = {
    "offset": {"dmd": {"offset_x_px": 0.3, "offset_y_px": -0.4}},
    "rotation": {"dmd": {"rotation_deg": 2.0}},
    "scale": {"dmd": {"scale": 1.07}},
    "distortion": {"relay": {"distortion_per_mm2": 5e-3}},
    "tilt": {"dmd": {"tilt_deg": 24.0}},
    "smile": {"prism": {"apex_inner_deg": 40.0, "outer": "N-BK7", "inner": "F2"}, "relay": {"focal_mm": 50.0, "collimator_mm": 69.1}},
    "pitch": {"dmd": {"pitch_um": 10.8}},
}


SHEAR = {"rotation": 0.01, "tilt": 0.018}
"""H takes a mirror's image as a rectangle along rows and columns; rotated and tilted mirrors have other shapes."""


@pytest.mark.parametrize("fact", FACTS)
def test_exact_h_lays_each_mirrors_light_where_its_rays_land(fact):
    cam = camera(**FACTS[fact])
    size = (20, 26)
    model = physical_model(cam, Mono(), BANDS, np.ones((1, *size)), Exact(error=1e-4))
    for mirror in ((0, 0), (3, 24), (11, 12), (19, 25)):
        for band in (0, 2, 5):
            expected = share_of_pixels(cam, mirror, size, band, model.width)
            np.testing.assert_allclose(image_of(model, mirror, band), expected, atol=SHEAR.get(fact, 0) + 1e-3)


@pytest.mark.parametrize("mount", ["tilted", "converging"])
def test_exact_h_spreads_the_light_cone_where_a_chief_ray_is_not_enough(mount):
    facts = {"dmd": {"tilt_deg": 24.0}, "relay": {"scheimpflug": False}} if mount == "tilted" else {"relay": {"converging": True}}
    cam = camera(**facts)
    size = (24, 24)
    model = physical_model(cam, Mono(), BANDS, np.ones((1, *size)), Exact(error=1e-3))
    for mirror in ((2, 3), (12, 12), (22, 20)):
        expected = share_of_pixels(cam, mirror, size, 3, model.width)
        np.testing.assert_allclose(image_of(model, mirror, 3), expected, atol=8e-3)


def test_exact_h_of_the_ideal_camera_is_the_simple_operator_of_its_own_shifts():
    from recon.coded_aperture import CodedAperture

    masks = np.ones((1, 12, 14))
    own, exact = (physical_model(CameraConfig().ideal(), Foveon.sigma(), BANDS, masks, k) for k in (OwnShifts(), Exact()))
    cube = np.random.default_rng(0).random((12, 14, BANDS.count))
    assert isinstance(exact.operator(np.float64), CodedAperture)
    np.testing.assert_array_equal(own.response, exact.response)
    seen = own.operator(np.float64).forward(cube)
    np.testing.assert_allclose(exact.operator(np.float64).forward(cube), seen, atol=2e-3 * seen.max())


def test_exact_h_knows_leak_and_pixel_gains():
    cam = camera(dmd={"leak": 0.01, "dead_share": 0.1, "stuck_share": 0.05}, sensor={"prnu": 0.02})
    masks = np.random.default_rng(1).integers(0, 2, (2, 10, 12))
    exact = physical_model(cam, Mono(), BANDS, masks, Exact())
    assert exact.mirrors.min() == 0.01
    assert exact.mirrors.max() == 1
    assert exact.gain.std() == pytest.approx(0.02, rel=0.2)
    cube = np.random.default_rng(0).random((10, 12, BANDS.count))
    seen = exact.operator(np.float64).forward(cube)
    wrong = physical_model(cam, Mono(), BANDS, masks).operator(np.float64).forward(cube)
    assert np.abs(seen / wrong.max() - wrong / wrong.max()).max() > 0.01
    assert adjoint_error(exact.operator(np.float64)) < 1e-14


def test_diffraction_spreads_light_over_rows_and_loses_none():
    cam = camera(relay={"diffraction": True})
    model = physical_model(cam, Mono(), BANDS, np.ones((1, 40, 40)), Exact(error=0.02))
    assert model.taps.shape[1:3] == (1, 1)
    np.testing.assert_allclose(model.taps.sum((1, 2, 3, 4)), 1, rtol=1e-12)
    wide = physical_model(cam, Mono(), BANDS, np.ones((1, 40, 40)), Exact(error=0.01))
    assert wide.taps.shape[3] > model.taps.shape[3] > 1
    assert adjoint_error(model.operator(np.float64)) < 1e-14


def test_a_blur_over_a_varying_field_is_the_same_blur_moved():
    """Diffraction with a rotation: at any mirror the taps are those of a camera without rotation moved to the same place."""
    size = (21, 21)
    still = physical_model(camera(relay={"diffraction": True}), Mono(), BANDS, np.ones((1, *size)), Exact())
    turned = camera(relay={"diffraction": True}, dmd={"rotation_deg": 3.0})
    model = physical_model(turned, Mono(), BANDS, np.ones((1, *size)), Exact())
    assert model.taps.shape[1:3] == size
    np.testing.assert_allclose(image_of(model, (10, 10), 1), image_of(still, (10, 10), 1), atol=1.5e-3)
    np.testing.assert_allclose(model.taps.sum((3, 4)), 1, rtol=1e-5)
    image = image_of(model, (10, 16), 1)
    y, _ = np.indices(image.shape)
    assert (image * y).sum() / image.sum() == pytest.approx(10 + 6 * np.sin(np.radians(3)), abs=0.02)


# --- what H may believe -----------------------------------------------------------------------------------------


def test_h_that_assumes_the_cameras_own_curve_is_h_with_own_shifts():
    masks = np.ones((1, 6, 8))
    cam = CameraConfig()
    own, assumed = (physical_model(cam, Mono(), BANDS, masks, k) for k in (OwnShifts(), Assumed(cam.dispersion)))
    np.testing.assert_array_equal(own.taps, assumed.taps)
    np.testing.assert_array_equal(own.first_column, assumed.first_column)


def test_h_that_assumes_another_curve_puts_bands_where_the_curve_does():
    cam = CameraConfig()
    linear = CenterTable(centers_nm=tuple(np.linspace(455.0, 665.0, 24)))
    model = physical_model(cam, Mono(), BANDS, np.ones((1, 6, 8)), Assumed(linear))
    centroid = model.first_column + (model.taps * np.arange(model.taps.shape[1])).sum(1)
    photons = (2 / 3) * (BANDS.upper**3 - BANDS.lower**3) / (BANDS.upper**2 - BANDS.lower**2)
    np.testing.assert_allclose(centroid, linear.position_px(photons)[0], atol=2e-3)


def test_assumed_offset_along_rows_moves_the_centroid_of_the_taps():
    cam, masks = CameraConfig(), np.ones((1, 6, 8))
    zero, moved = (physical_model(cam, Mono(), BANDS, masks, Assumed(offset_x_px=d)) for d in (0.0, 0.35))

    def centroid(model):
        return model.first_column + (model.taps * np.arange(model.taps.shape[1])).sum(1)

    np.testing.assert_allclose(centroid(moved) - centroid(zero), 0.35, atol=2e-4)  # exact for mirrors of 1 px; these have 0.99985


@pytest.mark.parametrize(
    "registration", [{"offset_y_px": 0.25}, {"rotation_deg": 1.5}, {"scale": 1.02}, {"offset_x_px": -0.5, "rotation_deg": -2.0}]
)
def test_assumed_registration_moves_each_mirrors_image_as_the_plane_turns_and_grows(registration):
    cam, size = CameraConfig().ideal(), (15, 17)
    still, model = (physical_model(cam, Mono(), BANDS, np.ones((1, *size)), k) for k in (OwnShifts(), Assumed(**registration)))
    turn, scale = np.radians(registration.get("rotation_deg", 0.0)), registration.get("scale", 1.0)
    for m, n in ((3, 4), (7, 8), (11, 12)):
        images = [image_of(a, (m, n), 1) for a in (still, model)]
        y, x = np.indices(images[0].shape)
        (y0, x0), (y1, x1) = ([(i * v).sum() / i.sum() for v in (y, x)] for i in images)
        X, Y = n - 8, m - 7
        moved_x = scale * (np.cos(turn) * X - np.sin(turn) * Y) + registration.get("offset_x_px", 0.0) - X
        moved_y = scale * (np.sin(turn) * X + np.cos(turn) * Y) + registration.get("offset_y_px", 0.0) - Y
        assert x1 - x0 == pytest.approx(moved_x, abs=1e-3 + (scale - 1) / 2)  # exact for mirrors of 1 px
        assert y1 - y0 == pytest.approx(moved_y, abs=1e-3 + (scale - 1) / 2)


@pytest.mark.parametrize(
    ("field", "make"),
    [
        ("offset_x_px", lambda: Assumed(offset_x_px=2e3)),
        ("scale", lambda: Assumed(scale=0.0)),
        ("rotation_deg", lambda: Assumed(rotation_deg=float("nan"))),
        ("error", lambda: Exact(error=0.5)),
    ],
)
def test_beliefs_out_of_range_are_refused_by_name(field, make):
    with pytest.raises(InputError) as refused:
        make()
    assert refused.value.field == field


def test_unit_shifts_know_nothing_of_the_camera():
    model = physical_model(CameraConfig(), Mono(), BANDS, np.ones((1, 4, 5)), UnitShift())
    assert model.first_column.tolist() == list(range(BANDS.count))
    assert model.mirrors is None
    assert model.gain is None


def test_P5_mirrors_whose_light_the_prism_loses_have_weight_0_and_the_others_keep_theirs():
    from optsim.camera.field_paths import Field
    from optsim.camera.field_spread import field_taps

    def place(wavelength, X, Y):
        x, y, valid = np.broadcast_arrays(X + 0.01 * (wavelength - 500), Y + 0 * wavelength, X < 2)
        return x, y, valid

    for otf in (None, lambda wavelength, fy, fx: np.exp(-0.5 * (fx**2 + fy**2))):
        landing = field_taps(Field(place, (6, 9), 1.0), np.array([480.0]), np.array([520.0]), 0.01, otf=otf)
        light = landing.taps.sum((3, 4))
        np.testing.assert_allclose(light[0, :, :6], 1, rtol=1e-5)
        assert (light[0, :, 6:] == 0).all()
        assert np.isfinite(landing.taps).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1)])
def test_single_mirrors_rows_and_columns_have_their_h(size):
    facts = camera(relay={"diffraction": True}, dmd={"rotation_deg": 2.0, "offset_y_px": 0.1})
    for knowledge in (OwnShifts(), Assumed(rotation_deg=3.0), Exact()):
        h = physical_model(facts, Mono(), BANDS, np.ones((1, *size)), knowledge).operator(np.float64)
        cube = np.random.default_rng(0).random((*size, BANDS.count))
        assert np.isfinite(h.forward(cube)).all()
        assert h.forward(cube).max() > 0


def test_D2_closed_mirrors_of_a_camera_that_leaks_still_send_light():
    cam = camera(dmd={"leak": 0.001})
    closed, opened = (physical_model(cam, Mono(), BANDS, np.full((1, 6, 7), v), Exact()).operator(np.float64) for v in (0, 1))
    cube = np.random.default_rng(0).random((6, 7, BANDS.count))
    np.testing.assert_allclose(closed.forward(cube), 0.001 * opened.forward(cube), rtol=1e-12)


def test_D6_gray_masks_pass_only_when_allowed_and_scale_the_light():
    masks = np.full((1, 6, 7), 0.25)
    with pytest.raises(InputError, match="masks"):
        physical_model(camera(), Mono(), BANDS, masks)
    gray, full = (physical_model(camera(), Mono(), BANDS, m, gray=True).operator(np.float64) for m in (masks, np.ones((1, 6, 7))))
    cube = np.random.default_rng(0).random((6, 7, BANDS.count))
    np.testing.assert_allclose(gray.forward(cube), 0.25 * full.forward(cube), rtol=1e-13)

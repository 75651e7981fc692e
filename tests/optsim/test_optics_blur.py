"""Diffraction and defocus against Airy, Strehl, Bessel, a Fourier transform of the pupil, and the disc's moments."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0, j1

from optsim.camera import CameraConfig
from optsim.camera.psf import WAVE_LIMIT_RAD, airy_otf, defocus_phase_rad, disc_otf
from optsim.camera.pupil import rings
from optsim.errors import InputError

NM = 550.0
N = 5.0
CUTOFF = 1 / (NM * 1e-6 * N)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(160)


def spread(radius_mm, defocus_mm=0.0):
    """Return the point spread at a radius: the Hankel transform of the OTF."""
    f, w = (NODES + 1) / 2 * CUTOFF, WEIGHTS / 2 * CUTOFF
    otf = airy_otf(f, NM, N, defocus_mm)
    return 2 * math.pi * (w * otf * f) @ j0(2 * math.pi * np.outer(f, np.atleast_1d(radius_mm)))


def defocus_of(phase_rad):
    return phase_rad / defocus_phase_rad(NM, N, 1.0)


def test_the_point_spread_is_airy_s_with_its_first_dark_ring_at_1_22_lambda_n():
    r = np.linspace(1e-4, 0.02, 60)
    v = math.pi * r / (NM * 1e-6 * N)
    assert np.allclose(spread(r) / spread(1e-9), (2 * j1(v) / v) ** 2, rtol=0, atol=2e-6)
    assert abs(spread(1.2196698912665 * NM * 1e-6 * N) / spread(1e-9)) < 2e-6


def test_the_otf_is_the_lens_formula_with_a_sharp_cutoff():
    s = np.linspace(0, 1.3, 40)
    formula = np.where(s < 1, 2 / math.pi * (np.arccos(np.minimum(s, 1)) - s * np.sqrt(np.maximum(1 - s * s, 0))), 0.0)
    assert np.allclose(airy_otf(s * CUTOFF, NM, N), formula, rtol=0, atol=1e-12)


@pytest.mark.parametrize("phase", [0.3, 1.0, 3.0, 2 * math.pi, 20.0])
def test_defocus_dims_the_middle_by_strehl_s_closed_form(phase):
    expected = np.sinc(phase / 2 / math.pi) ** 2  # Born and Wolf, 8.8.3
    assert spread(0.0, defocus_of(phase)) / spread(0.0) == pytest.approx(expected, abs=1e-5)


def test_the_defocused_otf_is_the_autocorrelation_of_the_pupil():
    phase, size, half = 4.0, 1024, 200
    y, x = (np.arange(size) - size // 2)[:, None] / half, (np.arange(size) - size // 2) / half
    square = x**2 + y**2
    pupil = (square <= 1) * np.exp(1j * phase * square)
    otf = np.fft.ifft2(np.abs(np.fft.fft2(pupil)) ** 2)[0, : 2 * half + 1 : 20]
    s = np.arange(0, 2 * half + 1, 20) / half
    assert np.abs(otf.imag).max() < 1e-9 * abs(otf[0])
    assert np.allclose(airy_otf(s / 2 * CUTOFF, NM, N, defocus_of(phase)), (otf / otf[0]).real, rtol=0, atol=5e-3)


def test_a_large_defocus_becomes_the_geometrical_disc():
    frequency = np.linspace(0, 3 * N, 50)
    wave = airy_otf(frequency, NM, N, 1.0)
    assert np.abs(wave - disc_otf(frequency, 1.0 / N)).max() < 0.02
    limit = defocus_of(WAVE_LIMIT_RAD)
    f = np.linspace(0, CUTOFF, 500)
    assert np.abs(airy_otf(f, NM, N, limit * 0.999999) - airy_otf(f, NM, N, limit * 1.000001)).max() < 4e-3


def test_the_disc_s_otf_is_its_fourier_transform():
    diameter, f = 0.2, 7.0
    value = quad(lambda x: 2 * math.sqrt(max(0.0, diameter**2 / 4 - x * x)) * math.cos(2 * math.pi * f * x), -diameter / 2, diameter / 2)[0]
    assert float(disc_otf(f, diameter)) == pytest.approx(value / (math.pi * diameter**2 / 4), abs=1e-7)
    assert disc_otf(0.0, diameter) == 1


@pytest.mark.parametrize("defocus", [0.0, 0.05, -0.4])
def test_a_large_picture_s_otf_is_that_of_its_frequencies_one_by_one(defocus):
    f = np.linspace(0, 1.1 * CUTOFF, 9000)
    together = airy_otf(f, NM, N, defocus)
    alone = np.concatenate([airy_otf(part, NM, N, defocus) for part in np.array_split(f, 9)])
    assert np.abs(together - alone).max() < 1e-9
    assert together[0] == pytest.approx(1, abs=1e-14)
    assert (np.abs(together) <= 1 + 1e-12).all()


def test_focus_and_defocus_blur_alike():
    f = np.linspace(0, CUTOFF, 30)
    assert np.array_equal(airy_otf(f, NM, N, 0.07), airy_otf(f, NM, N, -0.07))


# --- the camera's blur -----------------------------------------------------------------------------------------


def test_the_camera_s_airy_disc_has_the_sensor_side_f_number():
    optics = CameraConfig().optics
    cutoff_px = 0.0099 / (600e-6 * 8 * 100 / 138.2)
    assert optics.otf(600.0, 0.0, cutoff_px * 1.0001) == 0
    assert optics.otf(600.0, cutoff_px * 0.99, 0.0) > 0
    assert np.array_equal(optics.otf(600.0, 0.3, 0.4), optics.otf(600.0, 0.5, 0.0))
    assert optics.has_blur


def test_a_camera_without_diffraction_or_defocus_does_not_blur():
    optics = CameraConfig(relay={"diffraction": False}).optics
    assert not optics.has_blur
    assert (optics.otf(550.0, np.linspace(0, 1.5, 4)[:, None], np.linspace(0, 1.5, 5)) == 1).all()


def test_without_diffraction_the_defocus_disc_is_left():
    optics = CameraConfig(relay={"diffraction": False, "defocus_mm": 0.2}).optics
    x = math.pi * 0.2 / optics.f_number * 0.25 / 0.0099
    assert optics.has_blur
    assert float(optics.otf(550.0, 0.0, 0.25)) == pytest.approx(2 * j1(x) / x, abs=1e-12)


def test_pupil_rays_carry_the_defocus_and_leave_diffraction_to_the_otf():
    camera = CameraConfig(dmd={"tilt_deg": 24.0}, relay={"scheimpflug": False, "defocus_mm": 0.2})
    f = np.linspace(0, 1.5, 7)
    assert np.array_equal(camera.optics.otf(500.0, 0.0, f), CameraConfig().optics.otf(500.0, 0.0, f))
    still = CameraConfig(dmd={"tilt_deg": 24.0}, relay={"scheimpflug": False, "diffraction": False})
    assert not still.optics.has_blur
    assert still.optics.pupil() is not None


def test_scheimpflug_leaves_a_defocus_that_grows_with_the_distance_from_the_design_wavelength():
    optics = CameraConfig(dmd={"tilt_deg": 24.0}, relay={"diffraction": False}).optics
    points = rings(400).points
    assert optics.defocus_mm(550.0) == 0
    for wavelength in (455.0, 660.0):
        x, y, _ = optics.position_px(wavelength, 0.4, 0.9, points)
        stretch = 1 + (100 / 138.2 * math.tan(math.radians(24))) ** 2  # the tilted sensor cuts the cone obliquely
        disc = 0.0099 * 4 * math.sqrt((np.var(x) + np.var(y)) / (1 + stretch))  # a disc of diameter D has variance D^2 / 16 along each axis
        assert abs(optics.defocus_mm(wavelength)) / optics.f_number == pytest.approx(disc, rel=0.02)
    assert optics.has_blur


def test_a_tilted_sensor_sees_the_spread_longer_across_the_tilt_s_axis():
    optics = CameraConfig(dmd={"tilt_deg": 24.0}).optics
    upright = CameraConfig().optics
    stretch = math.hypot(1, 100 / 138.2 * math.tan(math.radians(24)))
    along = optics.otf(550.0, 0.5, 0.5)
    across = optics.otf(550.0, -0.5, 0.5)
    assert along == pytest.approx(float(upright.otf(550.0, 0.5, 0.5)), abs=1e-12)
    assert across == pytest.approx(float(upright.otf(550.0, -0.5 * stretch, 0.5 * stretch)), abs=1e-12)


# --- the pupil -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 4, 5, 32, 33, 100, 4096])
def test_pupil_points_have_the_disc_s_area_centroid_and_second_moments(count):
    points, weights = rings(count)
    assert len(points) >= count
    assert weights.sum() == pytest.approx(1, abs=1e-13)
    assert np.allclose(weights @ points, 0, atol=1e-13)
    assert np.allclose(points.T @ (points * weights[:, None]), np.eye(2) / 4, atol=1e-13)
    assert (np.hypot(*points.T) < 1).all()


def test_pupil_points_tend_to_the_disc():
    points, weights = rings(1024)
    r = np.hypot(*points.T)
    for radius in (0.25, 0.5, 0.8):
        assert weights[r < radius].sum() == pytest.approx(radius**2, abs=0.03)


def spot(optics, X, Y, count):
    """Return the image of a pixel-sized mirror on 25 x 25 pixels, ray by ray."""
    points, weights = rings(count)
    x, y, _ = optics.position_px(550.0, X, Y, points)
    x0, y0, _ = optics.position_px(550.0, X, Y)
    place = np.arange(-12, 13)
    along, across = (np.clip(1 - np.abs(place - (a - np.round(a0))[:, None]), 0, 1) for a, a0 in ((x, x0), (y, y0)))
    return np.einsum("p,py,px->yx", weights, across, along)


@pytest.mark.parametrize(
    ("camera", "wrong"),
    [
        ({"dmd": {"tilt_deg": 24.0}, "relay": {"scheimpflug": False}}, (0.139, 0.052, 0.0129)),
        ({"relay": {"converging": True}}, (0.0076, 0.0044, 0.0015)),
    ],
    ids=["tilted", "converging"],
)
def test_the_share_of_light_on_wrong_pixels_falls_with_the_number_of_rays_as_the_theory_says(camera, wrong):
    optics = CameraConfig(**camera).optics
    fine = spot(optics, 1.75, -1.75, 4096)
    assert fine.sum() == pytest.approx(1, abs=1e-12)
    found = [np.abs(spot(optics, 1.75, -1.75, count) - fine).sum() / 2 for count in (32, 64, 256)]
    assert found == pytest.approx(wrong, rel=0.05)


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("wavelength_nm", (0.1, math.nan, 8.0, 0.0)),
        ("wavelength_nm", (0.1, 0.0, 8.0, 0.0)),
        ("f_number", (0.1, 550.0, 0.0, 0.0)),
        ("defocus_mm", (0.1, 550.0, 8.0, math.inf)),
        ("frequency_per_mm", ([0.1, math.nan], 550.0, 8.0, 0.0)),
    ],
)
def test_an_otf_of_no_wavelength_cone_or_frequency_is_refused(field, values):
    with pytest.raises(InputError, match=field):
        airy_otf(*values)

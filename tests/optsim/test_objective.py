"""The objective against closed forms, SciPy's integrals and an account of light."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from optsim.camera import CameraConfig
from optsim.camera.objective import blur_kernel, cos4, through_objective
from optsim.cube import Bands, bands_of, make_cube
from optsim.errors import InputError

BANDS = Bands.from_edges([450.0, 500.0, 530.0, 600.0])


def picture(rows=24, columns=36, seed=1, dtype=np.float64, stderr=True):
    rng = np.random.default_rng(seed)
    radiance = rng.uniform(0, 2, (rows, columns, 3)).astype(dtype)
    return make_cube(radiance, BANDS, 0.1 * radiance if stderr else None)


def camera(**objective):
    return CameraConfig(objective=objective)


def light(cube):
    return float((cube["radiance"].values.astype(np.float64) @ bands_of(cube).width).sum())


def test_an_ideal_lens_s_picture_is_the_truth():
    cube = picture()
    assert through_objective(cube, CameraConfig()) is cube
    assert through_objective(cube, camera(focal_mm=30.0, cos4=False)) is cube


def test_an_even_field_falls_as_cos4_of_the_field_angle():
    ones = make_cube(np.ones((8, 12, 3)), BANDS)
    got = through_objective(ones, camera(focal_mm=0.2), samples=2)["radiance"].values
    for i, j in ((0, 0), (3, 5), (7, 2)):
        x, y = (j - 5.5) * 0.00684, (i - 3.5) * 0.00684
        angle = math.atan(math.hypot(x, y) / 0.2)
        assert got[i, j] == pytest.approx(np.full(3, math.cos(angle) ** 4), rel=1e-12)
    assert cos4(1, 1, 1.0, 1.0) == 1


@pytest.mark.parametrize("sigma", [0.05, 0.4, 1.0, 3.7])
def test_the_kernel_is_a_gaussian_between_pixel_means(sigma):
    kernel = blur_kernel(sigma)
    middle = kernel.size // 2

    def overlap(t, d):
        return (1 - abs(t)) * norm.pdf(t + d, scale=sigma)

    for d in range(4):
        if middle + d < kernel.size:
            points = sorted({-1.0, 0.0, 1.0, float(np.clip(-d, -1, 1)), *np.clip([-d - sigma, -d + sigma], -1, 1).tolist()})
            value = sum(quad(overlap, a, b, args=(d,))[0] for a, b in itertools.pairwise(points))
            assert kernel[middle + d] == pytest.approx(value, abs=1e-8)
    place = np.arange(kernel.size) - middle
    assert kernel.sum() == pytest.approx(1, abs=1e-14)
    if sigma >= 1:
        assert (kernel * place**2).sum() == pytest.approx(sigma**2 + 1 / 6, rel=1e-7)  # two pixel boxes of variance 1/12
    assert np.array_equal(kernel, kernel[::-1])
    assert (kernel >= 0).all()


def test_no_blur_is_the_identity_kernel():
    assert np.array_equal(blur_kernel(0.0), [1.0])
    assert blur_kernel(1e-6).max() == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("objective", [{"psf_um": 20.0}, {"focal_mm": 0.5}, {"focal_mm": 0.5, "psf_um": 9.0}, {"psf_um": 900.0}])
def test_light_sent_is_light_that_arrives_plus_the_listed_losses(objective):
    cube = picture()
    got = through_objective(cube, camera(**objective))
    listed = got.attrs["objective_lost_cos4"] + got.attrs["objective_lost_outside"]
    assert light(got) / light(cube) + listed == pytest.approx(1, abs=1e-12)
    assert 0 <= got.attrs["objective_lost_outside"] < 1
    assert (got["radiance"].values >= 0).all()


def test_a_point_is_blurred_to_the_stated_width_whatever_the_samples():
    for samples in (1, 3):
        point = np.zeros((99, 99, 3))
        point[49, 49] = 1
        got = through_objective(make_cube(point, BANDS), camera(psf_um=30.0), samples=samples)["radiance"].values[:, :, 0]
        place = (np.arange(99) - 49) * 13.68 / samples
        variance = (got.sum(0) * place**2).sum() / got.sum()
        assert variance == pytest.approx(30.0**2 + (13.68 / samples) ** 2 / 6, rel=1e-6)


def test_standard_errors_are_those_of_blurred_independent_noise():
    rng = np.random.default_rng(4)
    shape, sigma = (30, 30, 3), 0.3
    lens = camera(psf_um=12.0, focal_mm=1.0)
    draws = [
        through_objective(make_cube(10 + sigma * rng.standard_normal(shape), BANDS), lens)["radiance"].values[15, 15:18] for _ in range(800)
    ]
    told = through_objective(make_cube(np.full(shape, 10.0), BANDS, np.full(shape, sigma)), lens)["stderr"].values[15, 15:18]
    assert np.std(draws, axis=0) == pytest.approx(told, rel=0.1)


def test_the_type_and_grid_stay():
    got = through_objective(picture(dtype=np.float32), camera(psf_um=5.0))
    assert got["radiance"].dtype == np.float32
    assert got["stderr"].dtype == np.float32
    assert bands_of(got).same_as(BANDS)


def test_a_dark_picture_stays_dark():
    got = through_objective(make_cube(np.zeros((4, 4, 3)), BANDS), camera(psf_um=5.0, focal_mm=1.0))
    assert (got["radiance"].values == 0).all()
    assert got.attrs["objective_lost_cos4"] == 0


@pytest.mark.parametrize("samples", [0, 5, -1])
def test_samples_that_do_not_divide_the_picture_are_refused(samples):
    with pytest.raises(InputError, match="samples"):
        through_objective(picture(), camera(psf_um=5.0), samples=samples)

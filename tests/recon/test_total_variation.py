"""Total variation judged by closed forms, by brute force and by scikit-image."""

import numpy as np
import pytest
from scipy.optimize import minimize
from skimage.restoration import denoise_tv_chambolle

from recon import Admm, BasisPursuit, InputError, reconstruct, threads
from recon.coded_aperture import empty_cube
from recon.spectral_basis import Cosine, learned
from recon.total_variation import SpectralTotalVariation, TotalVariation


def banded(cube: np.ndarray, dtype: type = np.float64) -> np.ndarray:
    out = empty_cube(cube.shape, dtype)
    out[...] = cube
    return out


def random_cube(shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    return np.random.Generator(np.random.Philox(seed)).standard_normal(shape)


def variation(picture: np.ndarray) -> float:
    down, across = np.zeros_like(picture), np.zeros_like(picture)
    down[:-1], across[:, :-1] = np.diff(picture, axis=0), np.diff(picture, axis=1)
    return float(np.hypot(down, across).sum())


def exact(prior: type, **more: object) -> object:
    return prior(accuracy=1e-12, sweeps=20000, **more)


@pytest.mark.parametrize("shape", [(6, 5, 2), (1, 9, 1), (9, 1, 1), (2, 2, 3)])
def test_the_value_is_the_sum_over_pictures_of_the_length_of_the_gradient(shape):
    cube, library = random_cube(shape), learned(np.abs(random_cube((9, shape[2]), 1)))
    bands = [variation(cube[:, :, k]) for k in range(shape[2])]
    assert TotalVariation().bind(shape, np.float64).value(banded(cube)) == pytest.approx(sum(bands), rel=1e-12)
    weights = tuple(1.0 + q for q in range(shape[2]))
    pictures = cube @ library.matrix(shape[2], np.float64).T
    expected = sum(w * variation(pictures[:, :, q]) for q, w in enumerate(weights))
    prior = SpectralTotalVariation(spectral=library, weights=weights)
    assert prior.bind(shape, np.float64).value(banded(cube)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("threshold", [0.05, 0.4])
def test_the_proximal_map_is_the_minimiser_that_brute_force_finds(threshold):
    shape = (5, 4, 1)
    cube = random_cube(shape)[:, :, 0]

    def objective(u: np.ndarray) -> float:
        u = u.reshape(5, 4)
        down, across = np.zeros_like(u), np.zeros_like(u)
        down[:-1], across[:, :-1] = np.diff(u, axis=0), np.diff(u, axis=1)
        return 0.5 * float(((u - cube) ** 2).sum()) + threshold * float(np.sqrt(down**2 + across**2 + 1e-14).sum())

    judge = minimize(objective, cube.ravel(), method="L-BFGS-B", options={"maxiter": 20000, "maxfun": 10**6, "ftol": 1e-15, "gtol": 1e-10})
    given = banded(cube[:, :, None])
    value = exact(TotalVariation).bind(shape, np.float64).shrink(given, threshold)
    assert objective(given.ravel()) <= judge.fun + 1e-6
    np.testing.assert_allclose(given[:, :, 0], judge.x.reshape(5, 4), atol=2e-3)
    assert value == pytest.approx(variation(given[:, :, 0]), rel=1e-9)


def test_the_proximal_map_equals_scikit_images_denoiser():
    picture = np.kron(random_cube((4, 4, 1))[:, :, 0], np.ones((5, 5))) + 0.3 * random_cube((20, 20, 1), 1)[:, :, 0]
    given = banded(picture[:, :, None])
    exact(TotalVariation).bind(given.shape, np.float64).shrink(given, 0.2)
    judge = denoise_tv_chambolle(picture, weight=0.2, eps=1e-14, max_num_iter=20000)
    np.testing.assert_allclose(given[:, :, 0], judge, atol=2e-4)


def test_a_step_loses_height_by_its_edge_over_its_areas():
    cube = np.zeros((10, 12, 1))
    cube[:, 5:] = 1
    given = banded(cube)
    value = exact(TotalVariation).bind(cube.shape, np.float64).shrink(given, 0.3)
    np.testing.assert_allclose(given[:, :5], 0.3 / 5, atol=1e-5)  # edge of 10 over an area of 5 x 10
    np.testing.assert_allclose(given[:, 5:], 1 - 0.3 / 7, atol=1e-5)
    assert value == pytest.approx(10 * (1 - 0.3 / 7 - 0.3 / 5), rel=1e-4)


def test_a_high_threshold_leaves_the_mean_and_none_leaves_the_picture():
    cube = random_cube((6, 7, 2))
    given = banded(cube)
    assert exact(TotalVariation).bind(cube.shape, np.float64).shrink(given, 100.0) == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(given, np.broadcast_to(cube.mean((0, 1)), cube.shape), atol=1e-8)
    given = banded(cube)
    TotalVariation().bind(cube.shape, np.float64).shrink(given, 0.0)
    np.testing.assert_array_equal(given, cube)


def test_spectral_variation_is_band_variation_of_the_turned_cube():
    cube, library = random_cube((8, 9, 5)), learned(np.abs(random_cube((12, 5), 3)))
    matrix = library.matrix(5, np.float64)
    given, turned = banded(cube), banded(cube @ matrix.T)
    a = exact(SpectralTotalVariation, spectral=library).bind(cube.shape, np.float64).shrink(given, 0.3)
    b = exact(TotalVariation).bind(cube.shape, np.float64).shrink(turned, 0.3)
    assert a == pytest.approx(b, rel=1e-9)
    np.testing.assert_allclose(given @ matrix.T, turned, atol=1e-8)


def test_weights_are_thresholds_of_their_own():
    cube = random_cube((8, 9, 3))
    given = banded(cube)
    exact(SpectralTotalVariation, weights=(1, 2, 5)).bind(cube.shape, np.float64).shrink(given, 0.1)
    dct = Cosine().matrix(3, np.float64)
    for q, w in enumerate((1, 2, 5)):
        alone = banded((cube @ dct[q])[:, :, None])
        exact(TotalVariation).bind(alone.shape, np.float64).shrink(alone, 0.1 * w)
        np.testing.assert_allclose(given @ dct[q], alone[:, :, 0], atol=1e-7)


def test_a_rank_leaves_no_other_coefficients():
    cube = random_cube((8, 9, 4))
    given = banded(cube)
    SpectralTotalVariation(rank=2).bind(cube.shape, np.float64).shrink(given, 0.1)
    assert np.abs(given @ Cosine().matrix(4, np.float64)[2:].T).max() < 1e-14


def test_the_dual_is_kept_so_that_short_calls_add_up():
    cube = random_cube((16, 16, 1))
    best, one = banded(cube), banded(cube)
    exact(TotalVariation).bind(cube.shape, np.float64).shrink(best, 0.5)
    few = TotalVariation(sweeps=4)
    fresh = few.bind(cube.shape, np.float64)
    fresh.shrink(one, 0.5)
    first = np.abs(one - best).max()
    for _ in range(60):
        one = banded(cube)
        fresh.shrink(one, 0.5)
    assert np.abs(one - best).max() < 0.05 * first


def test_float32_and_any_number_of_threads_agree():
    cube, library = random_cube((32, 24, 6)), learned(np.abs(random_cube((12, 6), 3)))
    prior = SpectralTotalVariation(spectral=library, weights=library.weights(6))
    seen = []
    for count in (1, 2, 3):
        with threads.use(count):
            given = banded(cube, np.float32)
            prior.bind(cube.shape, np.float32).shrink(given, 0.2)
            seen.append(given.tobytes())
    assert seen[0] == seen[1] == seen[2]
    double = banded(cube)
    prior.bind(cube.shape, np.float64).shrink(double, 0.2)
    np.testing.assert_allclose(given, double, atol=2e-5)


def test_basis_pursuit_under_total_variation_finds_flat_patches_exactly(camera_of, psnr_of):
    patches = np.random.Generator(np.random.Philox(5)).random((2, 2, 8))
    cube = np.kron(patches, np.ones((16, 16, 1)))
    operator = camera_of("mono", 4, 32, 8)
    found = reconstruct(operator, operator.forward(cube), prior=TotalVariation(), solver=BasisPursuit(tolerance=1e-5, max_iterations=1500))
    assert psnr_of(found.cube, cube) > 60


@pytest.mark.parametrize("factor", [1.0, 100.0, 1e4])
@pytest.mark.parametrize("prior", [TotalVariation(), SpectralTotalVariation(weights=(1, 2, 3, 4))], ids=["bands", "spectral"])
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 4), ("foveon", 1)])
def test_a_tau_far_above_the_data_leaves_one_spectrum_that_fits_best(sensor, shots, prior, factor, camera_of, cube_of):
    operator = camera_of(sensor, shots, 16, 4)
    frames = operator.forward(cube_of(16, 4))
    pictures = np.stack([operator.forward(np.broadcast_to(e, (16, 16, 4))).ravel() for e in np.eye(4)], axis=1)
    spectrum = np.linalg.lstsq(pictures, frames.ravel(), rcond=None)[0]
    best = float(((frames.ravel() - pictures @ spectrum) ** 2).sum())
    tau = factor * 2 * np.abs(operator.adjoint(frames)).max()
    found = reconstruct(operator, frames, prior=prior, tau=tau, solver=Admm(max_iterations=1000))
    assert found.objective == pytest.approx(best, rel=2e-3)
    flat = np.broadcast_to(found.cube.mean((0, 1)), found.cube.shape)
    assert np.abs(found.cube - flat).max() < 1e-3 * found.cube.max()
    if factor > 1:
        np.testing.assert_allclose(found.cube.mean((0, 1)), spectrum, atol=2e-2 * spectrum.max())


def test_priors_that_do_not_fit_are_refused():
    for prior, field in (
        (SpectralTotalVariation(weights=(1, 2)), "weights"),
        (SpectralTotalVariation(rank=4), "rank"),
        (SpectralTotalVariation(spectral=learned(np.eye(2))), "Learned"),
    ):
        with pytest.raises(InputError, match=field):
            prior.bind((4, 4, 3), np.float64)
    for bad in ({"weights": (1, 0)}, {"rank": 0}, {"spectral": "cosine"}, {"sweeps": 0}, {"accuracy": np.nan}):
        with pytest.raises(InputError, match=r"^SpectralTotalVariation\."):
            SpectralTotalVariation(**bad)

"""Any denoiser as a prior: with a denoiser that is a proximal map, plug and play is that prior."""

import numpy as np
import pytest
import pywt
from skimage.restoration import denoise_tv_chambolle

from recon import L1, Admm, BasisPursuit, Cosine, Gap, InputError, Kronecker, PlugAndPlay, SpectralTotalVariation, learned, reconstruct
from recon.coded_aperture import empty_cube


def banded(values: np.ndarray) -> np.ndarray:
    cube = empty_cube(values.shape, np.float64)
    cube[...] = values
    return cube


def chambolle(picture: np.ndarray, sigma: float) -> np.ndarray:
    return denoise_tv_chambolle(picture, weight=sigma, eps=1e-12, max_num_iter=5000)


def test_scikit_images_tv_plugged_in_is_our_total_variation():
    values = 40 * np.random.Generator(np.random.Philox(1)).random((12, 10, 3))
    spectral = learned(np.random.Generator(np.random.Philox(2)).random((9, 3)))
    weights = (1.0, 2.0, 4.0)
    plugged, ours = banded(values), banded(values)
    PlugAndPlay(denoiser=chambolle, spectral=spectral, weights=weights).bind(values.shape, np.float64).shrink(plugged, 1.5)
    prior = SpectralTotalVariation(spectral=spectral, weights=weights, accuracy=1e-11, sweeps=5000)
    prior.bind(values.shape, np.float64).shrink(ours, 1.5)
    np.testing.assert_allclose(plugged, ours, atol=0.02)


def test_a_whole_cube_is_handed_over_with_peak_one_and_sigma_in_the_same_unit():
    seen = []

    def spy(cube: np.ndarray, sigma: float) -> np.ndarray:
        seen.append((cube.shape, np.abs(cube).max(), sigma))
        return cube / 2

    cube = banded(np.full((4, 5, 3), -8.0))
    assert PlugAndPlay(denoiser=spy, whole=True, strength=3).bind(cube.shape, np.float64).shrink(cube, 2.0) == 0
    assert seen == [((4, 5, 3), 1.0, 0.75)]
    np.testing.assert_allclose(cube, -4)


@pytest.mark.parametrize("solver", [Gap(max_iterations=40), BasisPursuit(max_iterations=40)])
def test_it_solves_like_the_prior_that_its_denoiser_is(camera_of, cube_of, solver):
    truth = cube_of(16, 4)
    operator = camera_of("mono", 2, 16, 4)
    frames = operator.forward(truth)
    a = reconstruct(operator, frames, prior=PlugAndPlay(denoiser=haar, spectral=Cosine()), solver=solver)
    b = reconstruct(operator, frames, prior=L1(basis=Kronecker(wavelet="haar", level=3)), solver=solver)
    np.testing.assert_allclose(a.cube, b.cube, atol=1e-8)


def haar(picture: np.ndarray, sigma: float) -> np.ndarray:
    """Soft threshold in a Haar basis by PyWavelets."""
    parts, where = pywt.coeffs_to_array(pywt.wavedec2(picture, "haar", "periodization", level=3))
    parts = np.sign(parts) * np.maximum(np.abs(parts) - sigma, 0)
    return pywt.waverec2(pywt.array_to_coeffs(parts, where, output_format="wavedec2"), "haar", "periodization")


@pytest.mark.parametrize(
    "solver", [Gap(max_iterations=40), BasisPursuit(max_iterations=40), Admm(max_iterations=40)], ids=lambda s: type(s).__name__
)
@pytest.mark.parametrize("spectral", [None, Cosine()], ids=["bands", "cosines"])
def test_a_whole_cube_handed_over_is_solved_as_its_pictures_are_when_the_denoiser_takes_them_one_by_one(
    camera_of, cube_of, solver, spectral
):
    seen = set()

    def every(cube: np.ndarray, sigma: float) -> np.ndarray:
        seen.add(cube.shape)
        return np.stack([haar(cube[:, :, k], sigma) for k in range(cube.shape[2])], axis=2)

    operator = camera_of("foveon", 1, 16, 4)
    frames = operator.forward(cube_of(16, 4))
    tau = 0.02 if solver.needs_tau else None
    at_once = PlugAndPlay(denoiser=every, spectral=spectral, strength=0.7, whole=True)
    one_by_one = PlugAndPlay(denoiser=haar, spectral=spectral, strength=0.7)
    a, b = (reconstruct(operator, frames, prior=prior, solver=solver, tau=tau) for prior in (at_once, one_by_one))
    assert seen == {(16, 16, 4)}
    assert a.iterations == b.iterations
    assert a.cube.any()
    np.testing.assert_allclose(a.cube, b.cube, atol=1e-12)


@pytest.mark.parametrize("scale", [1e-30, 1e-12, 1e-3, 1e12, 1e30])
@pytest.mark.parametrize("whole", [False, True])
def test_X8_the_answer_scales_with_the_frames(camera_of, cube_of, scale, whole):
    """The denoiser bends pictures and not only their size, so that it would show a unit that leaked into it."""

    def bent(picture: np.ndarray, sigma: float) -> np.ndarray:
        return picture / (1 + sigma * picture**2)

    operator = camera_of("mono", 2, 16, 4)
    frames = operator.forward(cube_of(16, 4))
    prior = PlugAndPlay(denoiser=bent, whole=whole)
    for solver, tau in ((Gap(max_iterations=40), None), (BasisPursuit(max_iterations=40), None), (Admm(max_iterations=40), 0.02)):
        plain = reconstruct(operator, frames, prior=prior, solver=solver, tau=tau)
        scaled = reconstruct(operator, frames * scale, prior=prior, solver=solver, tau=None if tau is None else tau * scale)
        np.testing.assert_allclose(scaled.cube, plain.cube * scale, rtol=1e-6, atol=1e-9 * scale)
        assert scaled.iterations == plain.iterations


def test_denoisers_that_break_the_contract_are_named():
    cube = banded(np.ones((4, 5, 3)))
    for bad in (lambda p, s: p[1:], lambda p, s: p * np.nan):
        with pytest.raises(InputError, match=r"^PlugAndPlay\.denoiser: must be a function that returns finite pictures"):
            PlugAndPlay(denoiser=bad).bind(cube.shape, np.float64).shrink(cube, 0.1)
    for bad in ({"denoiser": 3}, {"denoiser": chambolle, "weights": (0.0,)}, {"denoiser": chambolle, "spectral": 1}):
        with pytest.raises(InputError, match=r"^PlugAndPlay\."):
            PlugAndPlay(**bad)
    with pytest.raises(InputError, match=r"^PlugAndPlay\.weights: must be None with whole=True.*take strength, got \(1\.0, 2\.0\)"):
        PlugAndPlay(denoiser=chambolle, whole=True, weights=(1.0, 2.0))
    with pytest.raises(InputError, match="as many numbers as bands"):
        PlugAndPlay(denoiser=chambolle, weights=(1.0,)).bind((4, 4, 2), np.float64)

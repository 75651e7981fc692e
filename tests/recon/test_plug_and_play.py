"""Any denoiser as a prior: with a denoiser that is a proximal map, plug and play is that prior."""

import numpy as np
import pytest
import pywt
from skimage.restoration import denoise_tv_chambolle

from recon import L1, BasisPursuit, Cosine, Gap, InputError, Kronecker, PlugAndPlay, SpectralTotalVariation, learned, reconstruct
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

    def denoise(picture: np.ndarray, sigma: float) -> np.ndarray:
        """Soft threshold in a Haar basis by PyWavelets."""
        parts, where = pywt.coeffs_to_array(pywt.wavedec2(picture, "haar", "periodization", level=3))
        parts = np.sign(parts) * np.maximum(np.abs(parts) - sigma, 0)
        return pywt.waverec2(pywt.array_to_coeffs(parts, where, output_format="wavedec2"), "haar", "periodization")

    a = reconstruct(operator, frames, prior=PlugAndPlay(denoiser=denoise, spectral=Cosine()), solver=solver)
    b = reconstruct(operator, frames, prior=L1(basis=Kronecker(wavelet="haar", level=3)), solver=solver)
    np.testing.assert_allclose(a.cube, b.cube, atol=1e-8)


def test_denoisers_that_break_the_contract_are_named():
    cube = banded(np.ones((4, 5, 3)))
    for bad in (lambda p, s: p[1:], lambda p, s: p * np.nan):
        with pytest.raises(InputError, match=r"^PlugAndPlay\.denoiser: must be to return finite pictures"):
            PlugAndPlay(denoiser=bad).bind(cube.shape, np.float64).shrink(cube, 0.1)
    for bad in ({"denoiser": 3}, {"denoiser": chambolle, "weights": (0.0,)}, {"denoiser": chambolle, "spectral": 1}):
        with pytest.raises(InputError, match=r"^PlugAndPlay\."):
            PlugAndPlay(**bad)
    with pytest.raises(InputError, match=r"^PlugAndPlay\.weights: must be None with whole=True.*take strength, got \(1\.0, 2\.0\)"):
        PlugAndPlay(denoiser=chambolle, whole=True, weights=(1.0, 2.0))
    with pytest.raises(InputError, match="as many numbers as bands"):
        PlugAndPlay(denoiser=chambolle, weights=(1.0,)).bind((4, 4, 2), np.float64)

"""The Kronecker basis judged by PyWavelets and scipy.fft."""

import warnings

import numpy as np
import pytest
import pywt
import scipy.fft

from recon import Admm, BasisPursuit, Gpsr, reconstruct, threads
from recon.basis import DEFAULT_LEVEL, Kronecker, largest_level
from recon.coded_aperture import empty_cube
from recon.errors import InputError
from recon.l1 import L1
from recon.spectral_basis import Cosine, cosine_matrix, learned

SHAPES = [((16, 32, 5), 3), ((8, 8, 24), 3), ((6, 5, 4), 0), ((64, 64, 1), 5), ((40, 24, 7), 2)]


def judge(cube: np.ndarray, wavelet: str, level: int) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "level too high" is advice: periodised filters stay orthonormal
        parts = pywt.wavedec2(cube, wavelet, "periodization", level=level, axes=(0, 1)) if level else [cube]
    return scipy.fft.dct(pywt.coeffs_to_array(parts, axes=(0, 1))[0], axis=2, norm="ortho")


@pytest.mark.parametrize(("shape", "level"), SHAPES)
@pytest.mark.parametrize("wavelet", ["haar", "db2", "db4", "sym8", "coif2", "db3"])
def test_coefficients_equal_pywavelets_and_scipy(wavelet, shape, level):
    cube = np.random.Generator(np.random.Philox(1)).standard_normal(shape)
    basis = Kronecker(wavelet=wavelet, level=level)
    expected = judge(cube, wavelet, level)
    theta = basis.analysis(cube)
    np.testing.assert_allclose(theta, expected, atol=1e-10)
    np.testing.assert_allclose(basis.synthesis(theta), cube, atol=1e-10)
    single = basis.analysis(cube.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, atol=2e-5)


@pytest.mark.parametrize("wavelet", ["haar", "db4", "sym8"])
def test_X11_the_synthesis_is_the_adjoint_of_the_analysis(wavelet):
    draw = np.random.Generator(np.random.Philox(2))
    basis = Kronecker(wavelet=wavelet, level=4)
    x, y = draw.standard_normal((2, 32, 48, 6))
    gap = np.vdot(basis.analysis(x), y) - np.vdot(x, basis.synthesis(y))
    assert abs(gap) < 1e-15 * np.linalg.norm(x) * np.linalg.norm(y)
    assert np.linalg.norm(basis.analysis(x)) == pytest.approx(np.linalg.norm(x), rel=1e-11)


@pytest.mark.parametrize("wavelet", ["bior4.4", "no-such", "dmey", "gaus1"])
def test_X11_wavelets_that_are_not_orthonormal_are_refused(wavelet):
    with pytest.raises(InputError, match=r"^basis\.wavelet: must be"):
        Kronecker(wavelet=wavelet)


def test_X12_sizes_that_cannot_be_halved_name_the_largest_valid_level():
    for shape, level, deepest in [((15, 15, 3), 1, 0), ((250, 254, 3), 2, 1), ((256, 256, 2), 9, 8), ((1, 1, 4), 1, 0)]:
        with pytest.raises(InputError, match=rf"^basis\.level: must be at most {deepest} "):
            Kronecker(level=level).analysis(np.zeros(shape))
        assert largest_level(shape) == deepest
    with pytest.raises(InputError, match=r"^Kronecker\.level"):
        Kronecker(level=-1)


def test_X13_a_constant_cube_has_one_coefficient_below_full_depth():
    theta = Kronecker(wavelet="db4", level=5).analysis(np.full((32, 32, 6), 2.0))
    assert theta[0, 0, 0] == pytest.approx(2 * np.sqrt(32 * 32 * 6))
    theta[0, 0, 0] = 0
    assert np.abs(theta).max() < 1e-10


def test_level_0_is_the_cosine_transform_alone_and_one_band_is_left_as_it_is():
    cube = np.random.Generator(np.random.Philox(3)).standard_normal((5, 7, 9))
    np.testing.assert_allclose(Kronecker(level=0).analysis(cube), scipy.fft.dct(cube, axis=2, norm="ortho"), atol=1e-13)
    np.testing.assert_array_equal(Kronecker(level=0).analysis(cube[:, :, :1]), cube[:, :, :1])


@pytest.mark.parametrize("bands", [1, 2, 3, 24, 25])
def test_cosine_matrix_is_scipys_dct_and_orthonormal(bands):
    matrix = cosine_matrix(bands, np.float64)
    np.testing.assert_allclose(matrix, scipy.fft.dct(np.eye(bands), axis=0, norm="ortho"), atol=1e-14)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(bands), atol=1e-14)


@pytest.mark.parametrize("bands", [1, 4, 7, 24])
def test_the_fused_shrink_equals_analysis_soft_threshold_synthesis(bands):
    basis = Kronecker(wavelet="db2", level=3)
    cube = empty_cube((24, 16, bands), np.float64)
    cube[...] = np.random.Generator(np.random.Philox(4)).standard_normal(cube.shape)
    theta = judge(cube, "db2", 3)
    soft = np.sign(theta) * np.maximum(np.abs(theta) - 0.4, 0)
    expected = basis.synthesis(soft)
    assert L1(basis=basis).bind(cube.shape, cube.dtype).shrink(cube, 0.4) == pytest.approx(np.abs(soft).sum(), rel=1e-12)
    np.testing.assert_allclose(cube, expected, atol=1e-12)


def test_bytes_of_a_transform_do_not_depend_on_the_number_of_threads():
    cube = np.random.Generator(np.random.Philox(5)).standard_normal((64, 32, 9)).astype(np.float32)
    seen = []
    for count in (1, 2, 3):
        with threads.use(count):
            seen.append(Kronecker(level=4).analysis(cube).tobytes())
    assert seen[0] == seen[1] == seen[2]


def test_given_outputs_must_be_band_major():
    with pytest.raises(InputError, match=r"^out: must be"):
        Kronecker(level=1).analysis(np.zeros((4, 4, 3)), np.zeros((4, 4, 3)))
    with pytest.raises(InputError, match=r"^cube: must be"):
        Kronecker(level=1).analysis(np.zeros((4, 4)))


PADDED = [((250, 254, 2), 5, (256, 256, 2)), ((15, 15, 3), 3, (16, 16, 3)), ((33, 64, 4), 5, (64, 64, 4)), ((1, 7, 2), 0, (1, 7, 2))]


@pytest.mark.parametrize(("shape", "level", "longer"), PADDED)
def test_X12_odd_sizes_get_full_depth_by_padding_inside_psi_only(shape, level, longer):
    basis = Kronecker.for_shape(shape)
    assert basis.level == level
    assert basis.theta_shape(shape) == longer
    draw = np.random.Generator(np.random.Philox(6))
    cube, theta = draw.standard_normal(shape), draw.standard_normal(longer)
    found = basis.analysis(cube)
    assert found.shape == longer
    np.testing.assert_allclose(basis.synthesis(found), cube, atol=1e-11)  # Psi Psi^T = I on the cube
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(cube), rel=1e-12)
    gap = np.vdot(found, theta) - np.vdot(cube, basis.synthesis(theta))
    assert abs(gap) < 1e-12 * np.linalg.norm(cube) * np.linalg.norm(theta)


def test_X12_the_padded_transform_is_that_of_the_cube_continued_by_zeros():
    cube = np.random.Generator(np.random.Philox(7)).standard_normal((13, 10, 3))
    basis = Kronecker.for_shape(cube.shape)
    whole = np.zeros((16, 16, 3))
    whole[:13, :10] = cube
    np.testing.assert_allclose(basis.analysis(cube), judge(whole, "db2", 3), atol=1e-12)
    np.testing.assert_allclose(basis.analysis(whole), judge(whole, "db2", 3), atol=1e-12)  # the longer cube: as it is
    out = empty_cube(whole.shape, np.float64)
    np.testing.assert_allclose(basis.synthesis(basis.analysis(whole), out), whole, atol=1e-12)


def test_sides_that_can_be_halved_are_not_padded():
    for shape, level in (((64, 96, 2), DEFAULT_LEVEL), ((32, 32, 2), 5), ((16, 48, 2), 4), ((8, 8, 1), 3)):
        basis = Kronecker.for_shape(shape)
        assert (basis.level, basis.picture, basis.theta_shape(shape)) == (level, None, shape)


@pytest.mark.parametrize("bands", [1, 5, 24])
def test_a_learned_spectral_basis_takes_the_place_of_the_cosines(bands):
    draw = np.random.Generator(np.random.Philox(8))
    spectral = learned(draw.random((9, bands)))
    basis = Kronecker(wavelet="db2", level=3, spectral=spectral)
    cube = draw.standard_normal((16, 24, bands))
    plain = scipy.fft.idct(judge(cube, "db2", 3), axis=2, norm="ortho")  # wavelet alone
    theta = basis.analysis(cube)
    np.testing.assert_allclose(theta, plain @ spectral.matrix(bands, np.float64).T, atol=1e-12)
    np.testing.assert_allclose(basis.synthesis(theta), cube, atol=1e-12)


@pytest.mark.parametrize("spectral", [Cosine(), learned(np.random.Generator(np.random.Philox(9)).random((9, 6)))])
def test_weights_scale_the_threshold_of_each_spectral_coefficient(spectral):
    basis = Kronecker(wavelet="db2", level=2, spectral=spectral)
    cube = empty_cube((24, 16, 6), np.float64)
    cube[...] = np.random.Generator(np.random.Philox(4)).standard_normal(cube.shape)
    weights = np.array([1.0, 1.5, 2, 2.5, 0.5, 9])
    theta = basis.analysis(cube)
    soft = np.sign(theta) * np.maximum(np.abs(theta) - 0.2 * weights, 0)
    assert basis.shrink(cube, 0.2, weights) == pytest.approx(np.abs(soft * weights).sum(), rel=1e-12)
    np.testing.assert_allclose(cube, basis.synthesis(soft), atol=1e-12)


def test_a_spectral_basis_needs_a_matrix():
    with pytest.raises(InputError, match=r"^basis\.spectral: must be"):
        Kronecker(spectral="dct")


def test_X12_basis_pursuit_and_gpsr_and_admm_take_odd_sizes(camera_of, cube_of):
    camera = camera_of("mono", 3, 31, 4)
    operator = camera.replace(masks=camera.masks[:, :27], mosaic=None)
    truth = cube_of(31, 4)[:27]
    frames = operator.forward(truth)
    exact = reconstruct(operator, frames, solver=BasisPursuit(tolerance=1e-5, max_iterations=2000))
    assert exact.cube.shape == truth.shape
    assert exact.residual < 1e-5
    prior = L1(basis=Kronecker.for_shape(truth.shape, wavelet="haar"))
    tau = 1e-2
    last = {}
    for solver in (Admm(tolerance=1e-7, max_iterations=4000), Gpsr(tolerance=1e-9, max_iterations=20000)):
        name = type(solver).__name__
        reconstruct(
            operator, frames, prior=prior, tau=tau, solver=solver, on_iteration=lambda i, value, name=name: last.update({name: value})
        )
    assert last["Admm"] == pytest.approx(last["Gpsr"], rel=1e-5)

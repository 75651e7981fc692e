"""Mask design: the differentiable band camera against the dense H, the expected error against dense linear algebra."""

import numpy as np
import pytest

from optsim.camera.arrays import kernels
from optsim.camera.design import BandCamera, ExpectedError, GaussianPrior, MaskDesign
from optsim.camera.design.prior import subbands
from optsim.errors import InputError
from recon import CodedAperture, Kronecker

pytestmark = pytest.mark.skipif(kernels() is None, reason="no usable libLLVM")


def aperture(mosaic=False, channels=1, shots=2, rows=4, columns=4, bands=3):
    rng = np.random.default_rng(5)
    taps = rng.random((bands, 2))
    pattern = rng.integers(0, channels, (rows, columns + bands)) if mosaic else None
    return CodedAperture(
        rng.random((shots, rows, columns)),
        rng.random((channels, bands)),
        np.arange(bands),
        taps,
        mosaic=pattern,
        gray=True,
        dtype=np.float64,
    )


def prior(shape=(4, 4, 3)):
    rng = np.random.default_rng(6)
    return GaussianPrior(Kronecker(wavelet="haar", level=1), rng.random(shape) ** 4)


@pytest.mark.parametrize(("mosaic", "channels"), [(False, 1), (False, 3), (True, 3)])
def test_the_differentiable_band_camera_is_h_and_its_derivatives_are_those_of_a_bilinear_map(mosaic, channels):
    h = aperture(mosaic, channels)
    camera, k = BandCamera(h), kernels()
    rng = np.random.default_rng(1)
    cube, u = rng.random(h.in_shape), rng.random(h.out_shape)
    masks, tensor = k.backend.TensorXf64(h.masks.copy()), k.backend.TensorXf64(cube)
    k.dr.enable_grad(masks, tensor)
    frames = camera.frames(masks, tensor)
    assert np.abs(np.array(frames) - h.forward(cube)).max() < 1e-14
    k.dr.backward(k.dr.sum(frames * k.backend.TensorXf64(u), axis=None))
    assert np.abs(np.array(k.dr.grad(tensor)) - h.adjoint(u)).max() < 1e-14
    for place in np.ndindex(h.masks.shape):
        one = np.zeros(h.masks.shape)
        one[place] = 1
        expected = float((h.replace(masks=one).forward(cube) * u).sum())
        assert np.array(k.dr.grad(masks))[place] == pytest.approx(expected, rel=1e-12)


def test_the_forward_derivative_of_the_band_camera_is_the_product_rule():
    h, k = aperture(), kernels()
    rng = np.random.default_rng(2)
    cube, d_cube, d_masks = rng.random(h.in_shape), rng.random(h.in_shape), rng.random(h.masks.shape)
    masks, tensor = k.backend.TensorXf64(h.masks.copy()), k.backend.TensorXf64(cube)
    k.dr.enable_grad(masks, tensor)
    frames = BandCamera(h).frames(masks, tensor)
    k.dr.set_grad(masks, k.backend.TensorXf64(d_masks))
    k.dr.set_grad(tensor, k.backend.TensorXf64(d_cube))
    found = np.array(k.dr.forward_to(frames))
    expected = h.forward(d_cube) + h.replace(masks=d_masks).forward(cube)
    assert np.abs(found - expected).max() < 1e-13


def dense_error(h, prior_, variance):
    """tr(Sigma) / tr(C) from explicit matrices."""
    size = int(np.prod(h.in_shape))
    eye = np.eye(size).reshape(size, *h.in_shape)
    c = np.stack([prior_.apply(e).ravel() for e in eye])
    matrix = np.stack([h.forward(e).ravel() for e in eye]).T
    s = matrix @ c @ matrix.T + variance * np.eye(len(matrix))
    return float(np.trace(c - c @ matrix.T @ np.linalg.solve(s, matrix @ c)) / np.trace(c))


def units(shape):
    size = int(np.prod(shape))
    return np.sqrt(size) * np.eye(size).reshape(size, *shape)


def test_along_all_unit_vectors_the_error_and_its_derivative_are_those_of_dense_linear_algebra():
    h, prior_ = aperture(), prior()
    objective = ExpectedError(h, prior_, noise=0.1, iterations=300, tolerance=1e-11)
    found = objective.along(h.masks, units(h.in_shape))
    assert found.value == pytest.approx(dense_error(objective.aperture, prior_, objective.variance), rel=1e-9)
    for place in list(np.ndindex(h.masks.shape))[::5]:
        sides = []
        for sign in (1, -1):
            masks = h.masks.copy()
            masks[place] += sign * 1e-5
            sides.append(dense_error(objective.aperture.replace(masks=masks), prior_, objective.variance))
        assert found.by_masks[place] == pytest.approx((sides[0] - sides[1]) / 2e-5, rel=1e-5, abs=1e-9)


def test_random_signs_estimate_the_error_without_bias():
    h, prior_ = aperture(), prior()
    objective = ExpectedError(h, prior_, noise=0.1)
    values = [objective.estimate(h.masks, np.random.default_rng(s), 1).value for s in range(40)]
    exact = dense_error(objective.aperture, prior_, objective.variance)
    assert abs(np.mean(values) - exact) < 4 * np.std(values, ddof=1) / np.sqrt(len(values))


def test_a_design_lowers_the_dense_error_is_binary_and_has_the_same_bits_again():
    rng = np.random.default_rng(9)
    start = (rng.random((2, 4, 8)) < 0.5).astype(np.uint8)
    h = CodedAperture(start, np.ones((1, 3)), np.arange(3), np.ones((3, 1)))
    prior_ = GaussianPrior(Kronecker(wavelet="haar", level=2), np.broadcast_to(1 / (1.0 + np.arange(3)) ** 2, (4, 8, 3)).copy())
    objective = ExpectedError(h, prior_, noise=0.05)
    first, second = (MaskDesign(steps=30, probes=2).run(objective, start, seed=1) for _ in range(2))
    assert first.masks.tobytes() == second.masks.tobytes()
    assert set(np.unique(first.masks)) <= {0, 1}
    before, after = (dense_error(objective.aperture.replace(masks=m), prior_, objective.variance) for m in (start, first.masks))
    assert after < before


def test_learned_variances_are_those_of_the_groups_of_coefficients():
    """White noise has the same variance everywhere; the total is the cubes' mean energy."""
    cubes = [np.random.default_rng(s).standard_normal((16, 16, 4)) for s in range(8)]
    found = GaussianPrior.learned(cubes, Kronecker(wavelet="db2", level=2))
    assert np.abs(found.variance - 1).max() < 0.5
    assert found.trace == pytest.approx(16 * 16 * 4)
    label = subbands((16, 16), 2)
    assert sorted(np.bincount(label.ravel()).tolist()) == [16, 16, 16, 16, 64, 64, 64]


def test_designs_without_sense_are_refused():
    h = aperture()
    with pytest.raises(InputError, match="noise"):
        ExpectedError(h, prior(), noise=0)
    with pytest.raises(InputError, match="prior"):
        ExpectedError(h, GaussianPrior(Kronecker(wavelet="haar", level=1), np.ones((4, 4, 5))))
    with pytest.raises(InputError, match="sharpness"):
        MaskDesign(sharpness=(3.0, 1.0))
    with pytest.raises(InputError, match="cubes"):
        GaussianPrior.learned([np.zeros((4, 4, 2))])
    with pytest.raises(InputError, match="masks"):
        BandCamera(h).frames(np.ones((1, 4, 4)), np.ones(h.in_shape))

"""Generalised alternating projection, judged by dense projections written out here."""

import numpy as np
import pytest

from recon import L1, Gap, InputError, Kronecker, TotalVariation, reconstruct


def soft(values: np.ndarray, limit: float) -> np.ndarray:
    return np.sign(values) * np.maximum(np.abs(values) - limit, 0)


def test_an_iteration_is_a_projection_after_a_denoising_step(camera_of, cube_of):
    truth = cube_of(8, 3)
    operator = camera_of("foveon", 1, 8, 3)
    dense = operator.dense()
    frames = operator.forward(truth)
    flat = frames.transpose(0, 1, 3, 2).reshape(-1)
    inverse = np.linalg.pinv(dense, rcond=1e-6)
    cube = inverse @ flat
    rms = np.sqrt((cube**2).mean())
    for i in range(5):
        limit = max(0.01, 0.7 * 0.8**i) * rms
        denoised = soft(cube, limit)
        cube = denoised + inverse @ (flat - dense @ denoised)
    identity = L1(basis=_Identity())
    found = reconstruct(operator, frames, prior=identity, solver=Gap(start=0.7, end=0.01, decay=0.8, max_iterations=5))
    np.testing.assert_allclose(found.cube, cube.reshape(3, 8, 8).transpose(2, 1, 0), atol=1e-6)
    assert not found.stop.converged


class _Identity:
    def analysis(self, cube: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        return np.array(cube)

    def synthesis(self, theta: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        return np.array(theta)


def test_gap_tv_ends_at_a_cube_that_explains_the_frames_and_beats_l1_on_flat_patches(camera_of, cube_of, psnr_of):
    patches = np.random.Generator(np.random.Philox(5)).random((4, 4, 8))
    cube = np.kron(patches, np.ones((8, 8, 1)))
    operator = camera_of("mono", 4, 32, 8)
    frames = operator.forward(cube)
    found = reconstruct(operator, frames, prior=TotalVariation(), solver=Gap())
    assert found.stop.converged
    assert found.tau is None
    assert found.residual < 1e-6
    assert psnr_of(found.cube, cube) > psnr_of(reconstruct(operator, frames).cube, cube) + 5


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_X8_the_answer_scales_with_the_frames(camera_of, cube_of, scale):
    operator = camera_of("bayer", 1, 16, 4)
    frames = operator.forward(cube_of(16, 4))
    plain, scaled = (
        reconstruct(operator, frames * c, prior=L1(basis=Kronecker(level=2)), solver=Gap(max_iterations=20)).cube for c in (1.0, scale)
    )
    np.testing.assert_allclose(scaled / scale, plain, rtol=1e-6, atol=1e-9)


def test_X5_dark_frames_give_zero_at_once(camera_of):
    operator = camera_of("bayer", 1, 16, 4)
    found = reconstruct(operator, np.zeros(operator.out_shape), prior=TotalVariation(), solver=Gap())
    assert found.iterations == 0
    assert found.stop.converged
    assert not found.cube.any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_X6_frames_that_are_not_finite_are_refused_with_count_and_place(value, camera_of):
    operator = camera_of("foveon", 2, 16, 4)
    frames = np.ones(operator.out_shape)
    frames[1, 2, 3, 4] = frames[1, 2, 5, 6] = value
    with pytest.raises(InputError, match=r"^frames: must be finite; 2 values are not, first .* is \(1, 2, 3, 4\)"):
        reconstruct(operator, frames, solver=Gap())


def test_it_takes_no_tau_and_refuses_settings_without_sense(camera_of):
    operator = camera_of("mono", 1, 8, 2)
    with pytest.raises(InputError, match=r"^tau: must be absent with Gap"):
        reconstruct(operator, operator.forward(np.ones((8, 8, 2))), solver=Gap(), tau=0.1)
    first = reconstruct(operator, operator.forward(np.ones((8, 8, 2))), solver=Gap(max_iterations=0))
    assert not first.cube.any()
    for bad in ({"decay": 0}, {"decay": 1.1}, {"start": 0}, {"end": -1}):
        with pytest.raises(InputError, match=r"^Gap\."):
            Gap(**bad)

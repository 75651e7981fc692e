"""The exact data step against dense linear algebra, for every structure of camera."""

import numpy as np
import pytest

from recon import threads
from recon.banded import BandedStep
from recon.coded_aperture import CodedAperture
from recon.data_step import BlockStep, ConjugateStep, data_step, largest_eigenvalue, project


def dense_step(operator: CodedAperture, frames: np.ndarray, cube: np.ndarray, rho: float) -> np.ndarray:
    """z + H^T (H H^T + rho I)^+ (g - H z) by NumPy's own pseudo-inverse."""
    h = operator.dense()
    z, g = cube.transpose(2, 1, 0).ravel(), frames.transpose(0, 1, 3, 2).ravel()
    inverse = np.linalg.pinv(h @ h.T + rho * np.eye(g.size), rcond=1e-9, hermitian=True)
    return (z + h.T @ (inverse @ (g - h @ z))).reshape(cube.shape[::-1]).transpose(2, 1, 0)


@pytest.mark.parametrize("repeated", [False, True])
@pytest.mark.parametrize(("rho", "mixed"), [(0.0, False), (0.0, True), (0.3, False)])
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 3), ("bayer", 2), ("foveon", 2)])
def test_block_step_equals_the_dense_pseudo_inverse(sensor, shots, rho, mixed, repeated, camera_of):
    operator = camera_of(sensor, shots, 7, 5, repeated=repeated)
    draw = np.random.Generator(np.random.Philox(1))
    frames = operator.forward(draw.standard_normal(operator.in_shape))
    if not mixed:
        frames += draw.standard_normal(operator.out_shape)  # frames that contradict each other: least squares
    cube = draw.standard_normal(operator.in_shape)
    step = data_step(operator, frames, rho, mixed=mixed)
    assert isinstance(step, BlockStep)
    np.testing.assert_allclose(project(step, cube), dense_step(operator, frames, cube, rho), atol=1e-10)


@pytest.mark.parametrize(("sensor", "shots"), [("mono", 2), ("bayer", 2), ("foveon", 1)])
def test_banded_step_equals_the_dense_solution(sensor, shots, camera_of):
    operator = camera_of(sensor, shots, 19, 5, spread=True)
    draw = np.random.Generator(np.random.Philox(2))
    frames, cube = draw.standard_normal(operator.out_shape), draw.standard_normal(operator.in_shape)
    step = data_step(operator, frames, 0.2)
    assert isinstance(step, BandedStep)
    np.testing.assert_allclose(project(step, cube), dense_step(operator, frames, cube, 0.2), atol=1e-12)


@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
def test_banded_projection_explains_consistent_frames(sensor, camera_of):
    operator = camera_of(sensor, 2, 24, 6, spread=True)
    truth = np.random.Generator(np.random.Philox(3)).random(operator.in_shape)
    frames = operator.forward(truth)
    step = data_step(operator, frames, 0.0, mixed=True)
    cube = project(step, project(step, np.zeros(operator.in_shape)))
    assert np.linalg.norm(operator.forward(cube) - frames) < 1e-5 * np.linalg.norm(frames)


def test_conjugate_gradients_equal_the_dense_step_for_an_operator_without_structure(camera_of):
    operator = camera_of("foveon", 1, 6, 5)
    draw = np.random.Generator(np.random.Philox(4))
    frames, cube = draw.standard_normal(operator.out_shape), draw.standard_normal(operator.in_shape)
    step = ConjugateStep(operator, frames, 0.1, tolerance=1e-12, iterations=500)
    np.testing.assert_allclose(project(step, cube), dense_step(operator, frames, cube, 0.1), atol=1e-9)


@pytest.mark.parametrize("spread", [False, True])
def test_advance_relaxes_projects_reflects_and_measures(spread, camera_of):
    operator = camera_of("mono", 2, 8, 5, spread=spread)
    draw = np.random.Generator(np.random.Philox(5))
    frames = draw.standard_normal(operator.out_shape)
    z, w, x = draw.standard_normal((3, 5, 8, 8))
    moved = (z + 1.7 * (w - x)).transpose(1, 2, 0)
    target = dense_step(operator, frames, moved, 0.4).transpose(2, 0, 1)
    moved = moved.transpose(2, 0, 1)
    expected = [((w - x) ** 2).sum(), ((target - x) ** 2).sum(), (target**2).sum(), ((target - moved) ** 2).sum()]
    sums = data_step(operator, frames, 0.4).advance(z, w, x, 1.7, 0.5)
    np.testing.assert_allclose(x, target, atol=1e-11)
    np.testing.assert_allclose(z, target + 0.5 * (moved - target), atol=1e-11)
    np.testing.assert_allclose(w, 2 * x - z, atol=1e-11)
    np.testing.assert_allclose(sums, expected, rtol=1e-10)


@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
def test_largest_eigenvalue_is_the_dense_norm_squared(sensor, camera_of):
    operator = camera_of(sensor, 2, 6, 5)
    expected = np.linalg.norm(operator.dense(), 2) ** 2
    assert largest_eigenvalue(operator) == pytest.approx(expected, rel=1e-12)
    spread = camera_of(sensor, 2, 6, 5, spread=True)
    bound = largest_eigenvalue(spread) / np.linalg.norm(spread.dense(), 2) ** 2
    assert 1 < bound < 1.06


@pytest.mark.parametrize("spread", [False, True])
def test_bytes_of_a_step_do_not_depend_on_the_number_of_threads(spread, camera_of):
    operator = camera_of("foveon", 2, 40, 6, spread=spread, dtype=np.float32)
    cube = np.random.Generator(np.random.Philox(6)).random(operator.in_shape).astype(np.float32)
    frames = operator.forward(cube).astype(np.float64)
    seen = []
    for count in (1, 2, 3):
        with threads.use(count):
            seen.append(project(data_step(operator, frames, 0.0, mixed=True), np.zeros_like(cube)).tobytes())
    assert seen[0] == seen[1] == seen[2]

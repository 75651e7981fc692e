"""Solving for spectral coefficients gives what solving for bands gives; its operator and penalty are judged by dense matrices."""

import numpy as np
import pytest

from recon import L1, Admm, BasisPursuit, Fista, Kronecker, coordinates, learned, reconstruct
from recon.coded_aperture import empty_cube
from recon.errors import InputError
from recon.operator import adjoint_error
from recon.spectral_basis import cosine_matrix
from recon.turning import halves, turn

BANDS = 6
SOLVERS = [(BasisPursuit(max_iterations=30), None), (Fista(max_iterations=30), 0.01), (Admm(max_iterations=30), 0.01)]


def basis(kind: str) -> Kronecker:
    draw = np.random.Generator(np.random.Philox(2))
    spectral = None if kind == "cosine" else learned(draw.random((20, BANDS)))
    return Kronecker.for_shape((16, 16, BANDS), spectral=spectral)


@pytest.mark.parametrize(("sensor", "spread"), [("mono", False), ("bayer", False), ("foveon", True)])
@pytest.mark.parametrize(
    ("solver", "tau"), [(BasisPursuit(max_iterations=30), None), (Fista(max_iterations=30), 0.01), (Admm(max_iterations=30), 0.01)]
)
def test_the_answer_does_not_depend_on_the_coordinates(monkeypatch, camera_of, cube_of, sensor, spread, solver, tau):
    camera = camera_of(sensor, 2, 16, BANDS, spread=spread)
    frames = camera.forward(cube_of(16, BANDS))
    noise = np.random.Generator(np.random.Philox(1)).uniform(0.5, 2, frames.shape)
    for prior in (L1(basis=basis("cosine")), L1(basis=basis("learned"), weights=(1, 1, 2, 2, 3, 3))):
        arguments = {"prior": prior, "solver": solver, "tau": tau, "noise": noise, "start": cube_of(16, BANDS) / 2}
        found = reconstruct(camera, frames, **arguments)
        with monkeypatch.context() as patch:
            patch.setattr(coordinates, "shared_matrix", lambda problem: None)
            expected = reconstruct(camera, frames, **arguments)
        np.testing.assert_allclose(found.cube, expected.cube, atol=1e-9)
        assert found.objective == pytest.approx(expected.objective, rel=1e-10)
        assert (found.iterations, found.tau) == (expected.iterations, expected.tau)
        assert found.tau_max == (None if expected.tau_max is None else pytest.approx(expected.tau_max, rel=1e-12))


@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
@pytest.mark.parametrize("learnt", [False, True])
def test_the_operator_of_coefficients_is_H_after_the_inverse_transform(camera_of, sensor, learnt):
    camera = camera_of(sensor, 2, 16, BANDS, spread=True)
    matrix = basis("learned" if learnt else "cosine").spectral.matrix(BANDS, np.float64)
    inner = camera.replace(spectral=matrix)
    u = np.random.Generator(np.random.Philox(3)).standard_normal(camera.in_shape)
    voxels = (u @ matrix).transpose(2, 1, 0).ravel()
    expected = (camera.dense() @ voxels).reshape(*camera.out_shape[:2], camera.width, 16).transpose(0, 1, 3, 2)
    np.testing.assert_allclose(inner.forward(u), expected, atol=1e-12)
    assert adjoint_error(inner) < 1e-14
    with pytest.raises(InputError, match=r"^sparse"):
        inner.sparse()


def test_a_matrix_that_is_not_orthonormal_is_refused(camera_of):
    with pytest.raises(InputError, match=r"^spectral: must be an orthonormal"):
        camera_of("mono", 1, 16, BANDS).replace(spectral=2 * np.eye(BANDS))


@pytest.mark.parametrize("bands", [1, 2, 5, 24])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_turning_equals_the_matrix_product(bands, dtype):
    draw = np.random.Generator(np.random.Philox(4))
    cosines, any_ = cosine_matrix(bands, np.dtype(dtype).name), draw.standard_normal((bands, bands)).astype(dtype)
    assert halves(cosines)[1].size == (bands // 2) ** 2
    for matrix in (cosines, cosines.T, any_, any_[: (bands + 1) // 2]):
        cube = empty_cube((9, 31, bands), dtype)
        cube[...] = draw.standard_normal(cube.shape)
        out = empty_cube((9, 31, len(matrix)), dtype)
        expected = cube.astype(np.float64) @ matrix.T.astype(np.float64)
        turn(matrix, cube.transpose(2, 0, 1), out.transpose(2, 0, 1))
        np.testing.assert_allclose(out, expected, atol=1e-5 if dtype == np.float32 else 1e-13)
        if len(matrix) == bands:
            turn(matrix, cube.transpose(2, 0, 1), cube.transpose(2, 0, 1))
            np.testing.assert_array_equal(cube, out)

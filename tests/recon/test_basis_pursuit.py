"""Basis pursuit: judged by a linear programme, and what it must not depend on."""

import numpy as np
import pytest
from scipy.optimize import linprog

from recon.basis import Kronecker
from recon.basis_pursuit import BasisPursuit
from recon.coded_aperture import CodedAperture
from recon.l1 import L1
from recon.solve import reconstruct

TIGHT = BasisPursuit(tolerance=1e-6, max_iterations=3000)


def dense_basis(basis: Kronecker, shape: tuple[int, int, int]) -> np.ndarray:
    """Columns: Psi of every unit coefficient, in the order of CodedAperture.dense."""
    columns = []
    for index in range(int(np.prod(shape))):
        unit = np.zeros(shape)
        unit.ravel()[index] = 1
        columns.append(basis.synthesis(unit).transpose(2, 1, 0).ravel())
    return np.stack(columns, axis=1)


@pytest.mark.parametrize(("sensor", "shots"), [("mono", 2), ("bayer", 2), ("foveon", 1)])
def test_a_linear_programme_finds_no_smaller_norm(sensor, shots, camera_of, cube_of):
    operator = camera_of(sensor, shots, 8, 4)
    basis = Kronecker(wavelet="haar", level=2)
    frames = operator.forward(cube_of(8, 4))
    a = operator.dense() @ dense_basis(basis, operator.in_shape)
    b = frames.transpose(0, 1, 3, 2).ravel()
    answer = linprog(np.ones(2 * a.shape[1]), A_eq=np.hstack([a, -a]), b_eq=b, method="highs")
    assert answer.status == 0
    solution = reconstruct(operator, frames, prior=L1(basis=basis), solver=TIGHT)
    assert solution.residual < 1e-12
    assert answer.fun * (1 - 1e-9) <= solution.objective <= answer.fun * (1 + 1e-4)


@pytest.mark.parametrize("spread", [False, True])
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 3), ("bayer", 1), ("foveon", 1)])
def test_the_answer_explains_the_frames_to_1e_4(sensor, shots, spread, camera_of, cube_of):
    operator = camera_of(sensor, shots, 64, 24, dtype=np.float32, spread=spread)
    frames = operator.astype(np.float64).forward(cube_of(64, 24))
    solution = reconstruct(operator, frames)
    assert solution.stop.converged
    seen = operator.astype(np.float64).forward(solution.cube.astype(np.float64))
    gap = np.linalg.norm(seen - frames) / np.linalg.norm(frames)
    assert gap < 1e-4
    assert solution.residual == pytest.approx(gap, rel=0.5, abs=1e-6)


def test_the_default_tolerance_is_within_0_05_db_of_convergence(camera_of, cube_of, psnr_of):
    truth = cube_of(64, 24)
    for sensor, shots in [("mono", 3), ("bayer", 1), ("foveon", 2)]:
        operator = camera_of(sensor, shots, 64, 24, dtype=np.float32)
        frames = operator.astype(np.float64).forward(truth)
        rough = reconstruct(operator, frames)
        fine = reconstruct(operator, frames, solver=BasisPursuit(tolerance=5e-5, max_iterations=3000))
        assert rough.iterations < 400
        assert psnr_of(rough.cube, truth) == pytest.approx(psnr_of(fine.cube, truth), abs=0.05)


def test_mixing_the_layers_or_rescaling_the_response_changes_nothing(camera_of, cube_of, psnr_of):
    truth = cube_of(64, 24)
    operator = camera_of("foveon", 1, 64, 24, dtype=np.float32)
    mix = np.array([[1.0, -0.6, 0.1], [0.2, 1.0, 0.4], [-0.3, 0.1, 0.7]])
    plain = psnr_of(reconstruct(operator, operator.astype(np.float64).forward(truth)).cube, truth)
    for changed in (operator.replace(response=mix @ operator.response), operator.replace(response=1e7 * operator.response)):
        frames = changed.astype(np.float64).forward(truth)
        assert psnr_of(reconstruct(changed, frames).cube, truth) == pytest.approx(plain, abs=0.05)
    bayer = camera_of("bayer", 1, 64, 24, dtype=np.float32)
    plain = psnr_of(reconstruct(bayer, bayer.astype(np.float64).forward(truth)).cube, truth)
    scaled = bayer.replace(response=np.array([[3.0], [0.01], [1.0]]) * bayer.response)
    assert psnr_of(reconstruct(scaled, scaled.astype(np.float64).forward(truth)).cube, truth) == pytest.approx(plain, abs=0.05)


def test_the_answer_does_not_depend_on_gamma(camera_of, cube_of, psnr_of):
    truth = cube_of(32, 8)
    operator = camera_of("bayer", 2, 32, 8)
    frames = operator.forward(truth)
    solver = BasisPursuit(tolerance=3e-5, max_iterations=8000)
    answers = [reconstruct(operator, frames, solver=solver.model_copy(update={"gamma": gamma})) for gamma in (0.5, 1.0, 2.0)]
    assert all(answer.stop.converged for answer in answers)
    for answer in answers[1:]:
        assert answer.objective == pytest.approx(answers[0].objective, rel=1e-4)
        assert psnr_of(answer.cube, truth) == pytest.approx(psnr_of(answers[0].cube, truth), abs=0.05)


@pytest.mark.parametrize("scale", [1e-12, 1e-3, 1e12, 1e30])
def test_X8_the_answer_scales_with_the_light(scale, camera_of, cube_of):
    operator = camera_of("foveon", 1, 32, 8, dtype=np.float32)
    frames = operator.astype(np.float64).forward(cube_of(32, 8))
    plain = reconstruct(operator, frames)
    bright = reconstruct(operator, scale * frames)
    assert np.isfinite(bright.cube).all()
    np.testing.assert_allclose(bright.cube.astype(np.float64) / scale, plain.cube, atol=1e-6 * np.abs(plain.cube).max())
    assert bright.objective == pytest.approx(scale * plain.objective, rel=1e-6)


def test_D10_repeated_masks_add_no_rank_and_the_solver_says_so(camera_of, cube_of):
    operator = camera_of("mono", 3, 32, 8, repeated=True)
    once = operator.replace(masks=operator.masks[:1])
    assert np.linalg.matrix_rank(operator.gram()[5, :, :, 20]) == 1
    truth = cube_of(32, 8)
    solution = reconstruct(operator, operator.forward(truth))
    assert "rank of H does not grow" in str(solution)
    single = reconstruct(once, once.forward(truth))
    np.testing.assert_allclose(solution.cube, single.cube, atol=1e-9)
    assert single.notes == ()


def test_distinct_masks_beat_repeated_ones(camera_of, cube_of, psnr_of):
    truth = cube_of(64, 24)
    scores = []
    for repeated in (False, True):
        operator = camera_of("mono", 3, 64, 24, repeated=repeated, dtype=np.float32)
        scores.append(psnr_of(reconstruct(operator, operator.astype(np.float64).forward(truth)).cube, truth))
    assert scores[0] > scores[1] + 1


@pytest.mark.parametrize("spread", [False, True])
def test_bytes_of_the_estimate_do_not_depend_on_the_number_of_threads(spread, camera_of, cube_of):
    operator = camera_of("foveon", 2, 32, 8, dtype=np.float32, spread=spread)
    frames = operator.astype(np.float64).forward(cube_of(32, 8))
    answers = {reconstruct(operator, frames, threads=count).cube.tobytes() for count in (1, 2, 3)}
    assert len(answers) == 1


def test_a_warm_start_at_the_answer_stops_sooner(camera_of, cube_of):
    operator = camera_of("mono", 3, 32, 8)
    frames = operator.forward(cube_of(32, 8))
    cold = reconstruct(operator, frames)
    warm = reconstruct(operator, frames, start=cold.cube)
    np.testing.assert_allclose(warm.objective, cold.objective, rtol=1e-3)


def test_odd_sides_one_band_and_more_bands_than_columns_are_solved():
    draw = np.random.Generator(np.random.Philox(8))
    for rows, columns, bands in [(15, 13, 5), (16, 8, 24), (12, 20, 1), (1, 1, 3)]:
        masks = draw.integers(0, 2, (2, rows, columns))
        masks[0] |= 1 - masks[1]
        operator = CodedAperture(masks, np.ones((1, bands)), np.arange(bands), np.ones((bands, 1)), dtype=np.float64)
        truth = 1 + 0.1 * draw.random(operator.in_shape)
        solution = reconstruct(operator, operator.forward(truth))
        assert solution.residual < 1e-6
        assert np.abs(solution.cube - truth).max() < (1e-10 if bands == 1 else 2)

"""GPSR judged by SciPy, dense algebra and its own invariants."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.sparse.linalg import lsqr

from recon import L1, Admm, CodedAperture, Fista, Gpsr, InputError, Kronecker, RowWeighted, reconstruct

SENSORS = ("mono", "bayer", "foveon")


def camera(sensor, shape=(8, 8, 4), shots=2, dtype=np.float64, seed=0):
    rng = np.random.Generator(np.random.Philox(seed))
    rows, columns, bands = shape
    masks = (rng.random((shots, rows, columns)) < 0.5).astype(float)
    curves = 1 if sensor == "mono" else 3
    response = rng.uniform(0.2, 1, (curves, bands))
    width = columns + bands - 1
    y, x = np.mgrid[:rows, :width]
    mosaic = np.where((y + x) % 2 == 1, 1, np.where(y % 2 == 0, 0, 2)) if sensor == "bayer" else None
    return CodedAperture(masks, response, np.arange(bands), np.ones((bands, 1)), mosaic=mosaic, width=width, dtype=dtype)


def scene(shape=(8, 8, 4), seed=1):
    rng = np.random.Generator(np.random.Philox(seed))
    return np.kron(rng.uniform(0, 1, (shape[0] // 2, shape[1] // 2, 1)), np.ones((2, 2, shape[2]))) * np.linspace(0.5, 1, shape[2])


def dense(operator, basis):
    """A = H Psi, column by column."""
    unit = np.eye(int(np.prod(operator.in_shape)))
    return np.stack([operator.forward(basis.synthesis(e.reshape(operator.in_shape))).ravel() for e in unit], axis=1)


def eq4(a, g, tau, theta):
    return np.sum((g.ravel() - a @ theta) ** 2) + tau * np.abs(theta).sum()


def problem(sensor, fraction, seed=0):
    operator, basis = camera(sensor, seed=seed), Kronecker(wavelet="db2", level=2)
    noise = np.random.Generator(np.random.Philox(seed + 50)).normal(0, 0.01, operator.out_shape)
    frames = operator.forward(scene()) + noise
    a = dense(operator, basis)
    return operator, basis, frames, a, fraction * 2 * np.abs(a.T @ frames.ravel()).max()


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("solver", [{}, {"monotone": False}, {"barzilai_borwein": False}, {"continuation_steps": 1}])
def test_objective_equals_that_of_a_bound_constrained_quasi_newton_method(sensor, solver):
    operator, basis, frames, a, tau = problem(sensor, 0.01)
    ours = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr(tolerance=1e-9, max_iterations=20000, **solver))
    n = a.shape[1]

    def value_and_slope(z):
        r = a @ (z[:n] - z[n:]) - frames.ravel()
        slope = 2 * a.T @ r
        return r @ r + tau * z.sum(), np.concatenate([slope + tau, tau - slope])

    options = {"maxiter": 50000, "maxfun": 100000, "ftol": 1e-15, "gtol": 1e-10}
    judge = minimize(value_and_slope, np.zeros(2 * n), jac=True, method="L-BFGS-B", bounds=[(0, None)] * (2 * n), options=options)
    theta = basis.analysis(ours.cube).ravel()
    assert ours.objective == pytest.approx(eq4(a, frames, tau, theta), rel=1e-9)
    assert ours.objective == pytest.approx(judge.fun, rel=1e-5)
    assert ours.stop.converged


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("fraction", [0.3, 0.03, 0.003])
def test_solution_meets_the_optimality_conditions_of_the_objective_without_a_half(sensor, fraction):
    operator, basis, frames, a, tau = problem(sensor, fraction)
    solution = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr(tolerance=1e-13, max_iterations=50000))
    theta = basis.analysis(solution.cube).ravel()
    slope = 2 * a.T @ (frames.ravel() - a @ theta)
    live = np.abs(theta) > 1e-9 * np.abs(theta).max()
    assert live.any()
    assert not live.all()
    np.testing.assert_allclose(slope[live], tau * np.sign(theta[live]), atol=1e-4 * tau)
    assert np.abs(slope[~live]).max() <= tau * (1 + 1e-4)


@pytest.mark.parametrize("sensor", SENSORS)
def test_debiased_solution_is_least_squares_on_its_support(sensor):
    operator, basis, frames, a, tau = problem(sensor, 0.1)
    config = {"tolerance": 1e-11, "max_iterations": 20000}
    plain = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr(**config))
    debiased = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr(debias=True, **config))
    theta = basis.analysis(plain.cube).ravel()
    support = np.abs(theta) > 1e-9 * np.abs(theta).max()
    expected = np.zeros_like(theta)
    expected[support] = np.linalg.lstsq(a[:, support], frames.ravel(), rcond=None)[0]
    assert support.sum() < frames.size
    np.testing.assert_allclose(basis.analysis(debiased.cube).ravel(), expected, atol=1e-7 * np.abs(expected).max())
    assert debiased.residual < plain.residual
    assert "debiased on" in debiased.stop.reason


def test_debiasing_with_more_coefficients_than_measurements_is_skipped_and_said():
    operator, basis, frames, _, tau = problem("bayer", 1e-7)
    few = CodedAperture(operator.masks[:1], operator.response, operator.first_column, operator.taps, mosaic=operator.mosaic, width=11)
    solution = reconstruct(
        few, frames[:1], prior=L1(basis=basis), tau=tau, solver=Gpsr(debias=True, max_iterations=5, continuation_steps=1)
    )
    assert "not debiased" in solution.stop.reason


def test_X2_an_invertible_system_gives_the_truth():
    operator = CodedAperture(np.ones((1, 8, 8)), np.ones((1, 1)), np.zeros(1, int), np.ones((1, 1)), dtype=np.float64)
    truth = scene((8, 8, 1))
    solution = reconstruct(operator, operator.forward(truth), tau=0, solver=Gpsr(tolerance=1e-12))
    np.testing.assert_allclose(solution.cube, truth, atol=1e-8)


@pytest.mark.parametrize("sensor", SENSORS)
def test_X3_tau_zero_is_the_least_squares_solution_of_lsqr(sensor):
    operator, basis, frames, a, _ = problem(sensor, 0.1)
    solution = reconstruct(operator, frames, prior=L1(basis=basis), tau=0, solver=Gpsr(tolerance=1e-13, max_iterations=5000))
    judge = lsqr(a, frames.ravel(), atol=1e-14, btol=1e-14, iter_lim=20000)[0]
    np.testing.assert_allclose(basis.analysis(solution.cube).ravel(), judge, atol=1e-8 * np.abs(judge).max())
    assert "unregularised" in solution.stop.reason
    assert solution.tau == 0


@pytest.mark.parametrize("tau", [-1e-9, float("nan"), float("inf")])
def test_X3_a_tau_that_is_no_weight_is_refused(tau):
    operator = camera("mono")
    with pytest.raises(InputError, match=r"^tau: must be"):
        reconstruct(operator, np.ones(operator.out_shape), tau=tau, solver=Gpsr())


@pytest.mark.parametrize("factor", [1 + 1e-12, 2, 1e20])
def test_X4_tau_at_or_above_twice_the_largest_correlation_gives_exactly_zero(factor):
    operator, basis, frames, _, tau_max = problem("foveon", 1.0)
    solution = reconstruct(operator, frames, prior=L1(basis=basis), tau=factor * tau_max, solver=Gpsr())
    assert not solution.cube.any()
    assert solution.iterations == 0
    assert solution.stop.converged
    assert "tau_max" in solution.stop.reason
    assert solution.tau_max == pytest.approx(tau_max, rel=1e-12)


def test_X4_tau_just_below_gives_one_coefficient():
    operator, basis, frames, a, tau_max = problem("foveon", 1.0)
    solution = reconstruct(operator, frames, prior=L1(basis=basis), tau=0.999 * tau_max, solver=Gpsr(tolerance=1e-12))
    theta = basis.analysis(solution.cube).ravel()
    assert np.flatnonzero(np.abs(theta) > 1e-12).tolist() == [int(np.abs(a.T @ frames.ravel()).argmax())]


def test_X5_dark_frames_give_a_dark_cube_without_iterating():
    operator = camera("mono")
    solution = reconstruct(operator, np.zeros(operator.out_shape), tau=0.1, solver=Gpsr())
    assert not solution.cube.any()
    assert solution.iterations <= 1


def test_X6_a_value_that_is_not_finite_is_refused_with_its_place():
    operator = camera("bayer")
    frames = np.ones(operator.out_shape)
    frames[1, 0, 3, 2] = np.nan
    with pytest.raises(InputError, match=r"\(1, 0, 3, 2\)"):
        reconstruct(operator, frames, tau=0.1, solver=Gpsr())


@pytest.mark.parametrize("scale", [1e-30, 1e-12, 1e-3, 1e12, 1e30])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_X8_frames_and_tau_scaled_scale_the_cube(scale, dtype):
    operator, basis, frames, _, tau = problem("foveon", 0.01)
    operator = operator.astype(dtype)
    plain = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr())
    scaled = reconstruct(operator, frames * scale, prior=L1(basis=basis), tau=tau * scale, solver=Gpsr())
    np.testing.assert_allclose(scaled.cube / scale, plain.cube, atol=1e-6 * np.abs(plain.cube).max())
    assert scaled.objective == pytest.approx(plain.objective * scale**2, rel=1e-5)
    assert scaled.iterations == plain.iterations


@pytest.mark.parametrize("basic", [False, True])
def test_X9_no_step_ever_raises_the_objective(basic):
    operator, basis, frames, _, tau = problem("mono", 0.001)
    seen = []
    solver = Gpsr(continuation_steps=1, barzilai_borwein=not basic, tolerance=1e-8)
    solution = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=solver, on_iteration=lambda i, f: seen.append((i, f)))
    values = [f for _, f in seen]
    assert [i for i, _ in seen] == list(range(1, solution.iterations + 1))
    assert all(b <= a * (1 + 1e-12) for a, b in pairwise(values))
    assert values[-1] == pytest.approx(solution.objective, rel=1e-10)


def test_X10_an_ill_conditioned_least_squares_problem_is_never_silent():
    response = np.array([[1.0, 1e-9]])
    operator = CodedAperture(np.ones((1, 8, 8)), response, np.array([0, 0]), np.ones((2, 1)), dtype=np.float64)
    stacked = CodedAperture(
        np.ones((1, 8, 8)), np.array([[1.0, 1.0], [1.0, 1.0 + 1e-9]]), np.array([0, 0]), np.ones((2, 1)), dtype=np.float64
    )
    frames = np.random.Generator(np.random.Philox(4)).uniform(0, 1, stacked.out_shape)
    solution = reconstruct(stacked, frames, tau=0, solver=Gpsr(tolerance=1e-14))
    assert not solution.stop.converged
    assert "condition at least" in solution.stop.reason
    assert "tau > 0" in solution.stop.reason
    assert reconstruct(operator, operator.forward(scene((8, 8, 2))), tau=0, solver=Gpsr()).stop.converged


def test_X14_no_iteration_returns_the_start_flagged():
    operator, basis, frames, _, tau = problem("mono", 0.01)
    start = scene()
    solution = reconstruct(operator, frames, prior=L1(basis=basis), start=start, tau=tau, solver=Gpsr(max_iterations=0))
    np.testing.assert_allclose(solution.cube, start, atol=1e-12)
    assert not solution.stop.converged
    assert "max_iterations" in solution.stop.reason
    assert not reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr(max_iterations=0)).cube.any()


def test_X14_a_million_iterations_end_by_tolerance_and_a_few_end_flagged():
    operator, basis, frames, _, tau = problem("mono", 0.01)
    many = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr(max_iterations=10**6))
    few = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr(max_iterations=12))
    assert many.stop.converged
    assert many.iterations < 10**4
    assert few.iterations == 12
    assert not few.stop.converged
    assert few.objective >= many.objective


def test_X14_full_steps_return_their_best_iterate():
    operator, basis, frames, _, tau = problem("foveon", 0.001)
    seen = []
    solver = Gpsr(monotone=False, continuation_steps=1, max_iterations=25)
    solution = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=solver, on_iteration=lambda i, f: seen.append(f))
    assert max(np.diff(seen)) > 0
    assert solution.objective == pytest.approx(min(seen), rel=1e-10)


@pytest.mark.parametrize("copies", [2, 3])
def test_X15_repeated_shots_with_tau_scaled_alike_leave_the_minimiser(copies):
    operator, basis, frames, _, tau = problem("mono", 0.02)
    more = operator.replace(masks=np.tile(operator.masks, (copies, 1, 1)))
    settings = {"tolerance": 1e-13, "max_iterations": 50000}
    once = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr(**settings))
    again = reconstruct(more, np.tile(frames, (copies, 1, 1, 1)), prior=L1(basis=basis), tau=copies * tau, solver=Gpsr(**settings))
    np.testing.assert_allclose(again.cube, once.cube, atol=2e-6 * np.abs(once.cube).max())
    assert again.objective == pytest.approx(copies * once.objective, rel=1e-10)


def test_X16_single_precision_costs_under_a_hundredth_of_a_decibel():
    from recon.metrics import psnr

    truth = scene((32, 32, 8))
    operator = camera("foveon", truth.shape, shots=1)
    frames = operator.forward(truth)
    levels = [psnr(reconstruct(operator.astype(t), frames, tau=0.02, solver=Gpsr()).cube, truth) for t in (np.float32, np.float64)]
    assert levels[0] == pytest.approx(levels[1], abs=0.01)


@pytest.mark.parametrize("shots", [1, 9])
def test_X18_fewer_measurements_than_voxels_and_more_are_both_solved(shots):
    operator = camera("mono", shots=shots)
    truth = scene()
    frames = operator.forward(truth)
    assert (frames.size < truth.size) == (shots == 1)
    solution = reconstruct(operator, frames, prior=L1(basis=Kronecker(wavelet="haar", level=2)), tau=1e-4, solver=Gpsr(tolerance=1e-8))
    assert solution.residual < 1e-3


@pytest.mark.parametrize("solver", [{}, {"barzilai_borwein": False}, {"debias": True}, {"monotone": False}])
def test_bytes_of_the_answer_do_not_depend_on_the_number_of_threads(solver):
    truth = scene((64, 64, 12))
    operator = camera("bayer", truth.shape, dtype=np.float32)
    frames = operator.forward(truth)
    config = Gpsr(max_iterations=40, **solver)
    cubes = [reconstruct(operator, frames, tau=0.05, solver=config, threads=n).cube.tobytes() for n in (1, 2, 3)]
    assert cubes[0] == cubes[1] == cubes[2]


def test_bytes_of_the_answer_do_not_depend_on_where_the_arrays_lie():
    operator, basis, frames, _, tau = problem("mono", 0.01)
    rng, elsewhere, answers = np.random.Generator(np.random.Philox(9)), [], set()
    for _ in range(60):
        elsewhere.append(np.empty(int(rng.integers(1, 5000)), np.uint8))
        answers.add(reconstruct(operator, frames.copy(), prior=L1(basis=basis), tau=tau, solver=Gpsr(max_iterations=30)).cube.tobytes())
    assert len(answers) == 1


def test_a_measurement_of_weight_zero_changes_nothing():
    operator, basis, frames, _, tau = problem("mono", 0.01)
    weights = np.ones(frames.shape)
    weights[:, :, 2, 3] = 0
    wrong = frames.copy()
    wrong[:, :, 2, 3] = 0.5 * frames.max()
    one, other = (
        reconstruct(RowWeighted(operator, weights), f * weights, prior=L1(basis=basis), tau=tau, solver=Gpsr()) for f in (frames, wrong)
    )
    np.testing.assert_array_equal(one.cube, other.cube)


def test_a_start_at_the_solution_stays_there():
    operator, basis, frames, _, tau = problem("foveon", 0.01)
    solution = reconstruct(operator, frames, prior=L1(basis=basis), tau=tau, solver=Gpsr(tolerance=1e-10, max_iterations=20000))
    again = reconstruct(operator, frames, prior=L1(basis=basis), start=solution.cube, tau=tau, solver=Gpsr(tolerance=1e-6))
    assert again.iterations <= 12
    assert again.objective == pytest.approx(solution.objective, rel=1e-9)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("fraction", [1e-2, 1e-3, 1e-4])
def test_objective_equals_that_of_fista_and_admm_to_a_thousandth(sensor, fraction):
    truth = scene((32, 32, 8))
    operator = camera(sensor, truth.shape, shots=2, dtype=np.float32)
    frames = operator.forward(truth)
    tau = fraction * reconstruct(operator, frames, tau=1e9, solver=Gpsr()).tau_max
    ours = reconstruct(operator, frames, tau=tau, solver=Gpsr())
    assert ours.stop.converged
    for other in (Fista(tolerance=1e-6, max_iterations=5000), Admm()):
        assert ours.objective == pytest.approx(reconstruct(operator, frames, tau=tau, solver=other).objective, rel=1e-3)


def test_X14_a_time_limit_returns_the_best_so_far_flagged():
    truth = scene((64, 64, 12))
    operator = camera("mono", truth.shape, dtype=np.float32)
    frames = operator.forward(truth)
    hasty = reconstruct(operator, frames, tau=1e-4, solver=Gpsr(time_limit_s=1e-9))
    assert not hasty.stop.converged
    assert "time limit" in hasty.stop.reason
    assert hasty.iterations == 0
    some = reconstruct(operator, frames, tau=1e-4, solver=Gpsr(time_limit_s=0.2, tolerance=1e-12, max_iterations=10**6))
    assert "time limit" in some.stop.reason
    assert some.objective <= hasty.objective

"""The one verb: what it refuses, what it answers at the edges, and that it says why it stopped."""

import numpy as np
import pytest
from scipy.sparse.linalg import LinearOperator as ScipyOperator

from recon.admm import Admm
from recon.basis import Kronecker
from recon.basis_pursuit import BasisPursuit
from recon.coded_aperture import CodedAperture
from recon.errors import InputError
from recon.fista import Fista
from recon.gap import Gap
from recon.gpsr import Gpsr
from recon.l1 import L1
from recon.operator import LinearOperator
from recon.solve import reconstruct
from recon.warm import warm_up

SOLVERS = [(BasisPursuit(), None), (Admm(), 0.05), (Fista(), 0.05)]
NAMES = ["basis-pursuit", "admm", "fista"]
EVERY, EVERY_NAME = [*SOLVERS, (Gap(), None), (Gpsr(), 0.05)], [*NAMES, "gap", "gpsr"]


class Plain:
    """Another operator of the protocol, by SciPy's sparse matrix: solvers must not need a CodedAperture."""

    def __init__(self, camera: CodedAperture) -> None:
        self.in_shape, self.out_shape, self.dtype = camera.in_shape, camera.out_shape, camera.dtype
        self.matrix = camera.sparse()

    def forward(self, x: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        shots, channels, rows, width = self.out_shape
        frames = (self.matrix @ x.transpose(2, 1, 0).ravel()).reshape(shots, channels, width, rows).transpose(0, 1, 3, 2)
        return self._into(frames, out)

    def adjoint(self, y: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        cube = (self.matrix.T @ y.transpose(0, 1, 3, 2).ravel()).reshape(self.in_shape[::-1]).transpose(2, 1, 0)
        return self._into(cube, out)

    def _into(self, value: np.ndarray, out: np.ndarray | None) -> np.ndarray:
        if out is None:
            return np.ascontiguousarray(value, self.dtype)
        out[...] = value
        return out


def test_X1_one_band_an_open_mask_and_no_noise_give_the_identity(cube_of):
    truth = cube_of(32, 1)
    operator = CodedAperture(np.ones((1, 32, 32)), np.ones((1, 1)), np.zeros(1, int), np.ones((1, 1)))
    np.testing.assert_allclose(operator.forward(truth)[0, 0], truth[:, :, 0], atol=0)
    for solver, tau in ((BasisPursuit(), None), (Admm(), 0)):
        np.testing.assert_allclose(reconstruct(operator, operator.forward(truth), tau=tau, solver=solver).cube, truth, atol=1e-12)


def test_X2_an_invertible_tiny_system_returns_the_truth_as_dense_lstsq_does():
    draw = np.random.Generator(np.random.Philox(4))
    masks = np.stack([np.ones((4, 3)), draw.integers(0, 2, (4, 3)), 1 - np.eye(4, 3), np.eye(4, 3)])
    response = draw.random((3, 4)) + 0.1
    operator = CodedAperture(masks, response, np.array([0, 1, 2, 3]), np.ones((4, 1)), dtype=np.float64)
    truth = draw.random(operator.in_shape)
    frames = operator.forward(truth)
    dense = operator.dense()
    assert np.linalg.matrix_rank(dense) == truth.size
    expected = np.linalg.lstsq(dense, frames.transpose(0, 1, 3, 2).ravel(), rcond=None)[0]
    for solver, tau in ((BasisPursuit(), None), (Admm(), 0)):
        cube = reconstruct(operator, frames, tau=tau, solver=solver).cube
        np.testing.assert_allclose(cube, truth, atol=1e-8)
        np.testing.assert_allclose(cube.transpose(2, 1, 0).ravel(), expected, atol=1e-8)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("solver", [Admm(), Fista(), Gpsr()], ids=["admm", "fista", "gpsr"])
def test_X4_the_tau_max_that_a_solution_tells_gives_exactly_zero_when_asked_for(solver, dtype, camera_of, cube_of):
    for seed in range(24):
        operator = camera_of(("mono", "bayer", "foveon")[seed % 3], 1 + seed % 2, 8, 4, seed=seed, dtype=dtype)
        operator = operator.replace(response=operator.response * (0.37 + seed))
        frames = operator.forward(cube_of(8, 4, seed)) * 1.3**seed
        top = reconstruct(operator, frames, tau=1e30, solver=solver).tau_max
        for tau in (top, np.nextafter(top, 0), np.nextafter(top, np.inf), 1.01 * top):
            found = reconstruct(operator, frames, tau=tau, solver=solver)
            assert not found.cube.any()
            assert found.stop.converged
            assert "tau_max" in str(found.stop)
        assert reconstruct(operator, frames, tau=0.99 * top, solver=solver).cube.any()


@pytest.mark.parametrize("scale", [1e-308, 1e-200, 1e-170, 1e-155, 1e99])
@pytest.mark.parametrize(
    "solver", [Admm(max_iterations=20), Fista(max_iterations=20), Gpsr(max_iterations=20)], ids=["admm", "fista", "gpsr"]
)
def test_X8_frames_whose_square_is_no_number_any_more_are_solved_as_any_others(solver, scale, camera_of, cube_of):
    operator = camera_of("bayer", 1, 16, 6)
    frames = operator.forward(cube_of(16, 6))
    plain = reconstruct(operator, frames, tau=0.01, solver=solver)
    scaled = reconstruct(operator, frames * scale, tau=0.01 * scale, solver=solver)
    np.testing.assert_allclose(scaled.cube / scale, plain.cube, rtol=1e-6, atol=1e-9)
    assert scaled.tau == pytest.approx(0.01 * scale, rel=1e-9)
    assert scaled.tau_max / scale == pytest.approx(plain.tau_max, rel=1e-9)
    assert not reconstruct(operator, frames * scale, tau=1e300, solver=solver).cube.any()
    assert np.isfinite(reconstruct(operator, frames * min(scale, 1e-30), tau=1e300, solver=solver).objective)


def test_weights_whose_product_is_no_number_any_more_are_refused(camera_of):
    operator = camera_of("mono", 1, 8, 3)
    tiny = operator.replace(response=operator.response * 1e-200, taps=operator.taps * 1e-200)
    with pytest.raises(InputError, match=r"^frames: must be such that frames / response is a finite number; .* weight is 0"):
        reconstruct(tiny, np.ones(operator.out_shape))


@pytest.mark.parametrize(("solver", "tau"), EVERY, ids=EVERY_NAME)
def test_X5_dark_frames_give_zero_at_once(solver, tau, camera_of):
    operator = camera_of("bayer", 1, 16, 6)
    solution = reconstruct(operator, np.zeros(operator.out_shape), tau=tau, solver=solver)
    assert solution.iterations == 0
    assert solution.stop.converged
    assert not solution.cube.any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("solver", "tau"), EVERY, ids=EVERY_NAME)
def test_X6_frames_that_are_not_finite_are_refused_with_count_and_place(solver, tau, value, camera_of):
    operator = camera_of("foveon", 2, 16, 6)
    frames = np.ones(operator.out_shape)
    frames[1, 2, 3, 4] = frames[1, 2, 5, 6] = value
    with pytest.raises(InputError, match=r"^frames: must be finite; 2 values are not, first .* is \(1, 2, 3, 4\)"):
        reconstruct(operator, frames, tau=tau, solver=solver)


def test_frames_start_and_threads_of_the_wrong_kind_are_refused(camera_of):
    operator = camera_of("mono", 1, 16, 6)
    frames = np.ones(operator.out_shape)
    with pytest.raises(InputError, match=r"^frames: must be of the operator's shape"):
        reconstruct(operator, frames[0])
    with pytest.raises(InputError, match=r"^frames: must be real"):
        reconstruct(operator, frames + 1j)
    with pytest.raises(InputError, match=r"^frames: must be at most"):
        reconstruct(operator, frames * 1e200)
    with pytest.raises(InputError, match=r"^start: must be a finite cube"):
        reconstruct(operator, frames, start=np.ones((2, 2, 2)))
    with pytest.raises(InputError, match=r"^threads: must be"):
        reconstruct(operator, frames, threads=0)
    with pytest.raises(InputError, match=r"^basis\.level: must be at most 4"):
        reconstruct(operator, frames, prior=L1(basis=Kronecker(level=6)))


@pytest.mark.parametrize(("solver", "tau"), SOLVERS, ids=NAMES)
def test_X14_iterations_and_time_are_limited_and_the_answer_is_flagged(solver, tau, camera_of, cube_of):
    operator = camera_of("bayer", 1, 32, 12)
    truth = cube_of(32, 12)
    frames = operator.forward(truth)
    none = reconstruct(operator, frames, tau=tau, solver=solver.model_copy(update={"max_iterations": 0}), start=truth)
    np.testing.assert_allclose(none.cube, truth, atol=1e-14)
    assert not none.stop.converged
    few = reconstruct(operator, frames, tau=tau, solver=solver.model_copy(update={"max_iterations": 3}))
    assert few.iterations == 3
    assert not few.stop.converged
    assert "raise max_iterations" in str(few.stop)
    many = reconstruct(operator, frames, tau=tau, solver=solver.model_copy(update={"max_iterations": 10**6}))
    assert many.stop.converged
    hasty = reconstruct(operator, frames, tau=tau, solver=solver.model_copy(update={"time_limit_s": 1e-9}))
    assert "time limit" in str(hasty.stop)
    assert not hasty.stop.converged
    assert np.isfinite(hasty.cube).all()


@pytest.mark.parametrize(("solver", "tau"), SOLVERS, ids=NAMES)
def test_X16_float32_loses_less_than_0_01_db(solver, tau, camera_of, cube_of, psnr_of):
    truth = cube_of(64, 12)
    double = camera_of("foveon", 2, 64, 12)
    frames = double.forward(truth)
    tight = solver.model_copy(update={"tolerance": 1e-7 if isinstance(solver, Fista) else 1e-4})  # compare precisions, not stops
    scores = [psnr_of(reconstruct(operator, frames, tau=tau, solver=tight).cube, truth) for operator in (double, double.astype(np.float32))]
    assert scores[0] == pytest.approx(scores[1], abs=0.01)


def test_X18_fewer_and_more_measurements_than_voxels_are_both_solved(camera_of, cube_of):
    truth = cube_of(32, 4)
    for shots in (1, 8):  # R = 1/4 and 2
        operator = camera_of("mono", shots, 32, 4)
        solution = reconstruct(operator, operator.forward(truth))
        assert solution.stop.converged
        assert solution.residual < 1e-8


@pytest.mark.parametrize("solver", [Admm(), Gpsr(tolerance=1e-8)], ids=["admm", "gpsr"])
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 8), ("bayer", 8), ("foveon", 4)])
def test_X18_more_measurements_than_voxels_leave_a_residual_at_noise_level(sensor, shots, solver, camera_of, cube_of):
    """The least-squares residual is chi^2 with measurements - rank degrees of freedom; the rank is that of each row, by itself."""
    operator = camera_of(sensor, shots, 32, 4)
    noise = 0.01 * np.random.Generator(np.random.Philox(9)).standard_normal(operator.out_shape)
    noisy = operator.forward(cube_of(32, 4)) + noise
    left = noisy - operator.forward(reconstruct(operator, noisy, tau=0, solver=solver).cube)
    mosaic = operator.mosaic
    rows = [
        operator.replace(masks=operator.masks[:, [m]], mosaic=None if mosaic is None else mosaic[[m]]).dense()
        for m in range(len(noisy[0, 0]))
    ]
    freedom = noisy.size - sum(np.linalg.matrix_rank(row) for row in rows)
    assert freedom > 1000
    assert abs((left**2).sum() / (1e-4 * freedom) - 1) < 3 / np.sqrt(freedom)


@pytest.mark.parametrize(
    "solver",
    [Admm(tolerance=1e-7, max_iterations=20000), Fista(tolerance=1e-11, max_iterations=20000), Gpsr(tolerance=1e-9, max_iterations=20000)],
    ids=["admm", "fista", "gpsr"],
)
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 2), ("foveon", 1)])
def test_X15_shots_taken_n_times_with_n_tau_have_the_same_minimiser(sensor, shots, solver, camera_of, cube_of):
    once = camera_of(sensor, shots, 16, 6)
    thrice = once.replace(masks=np.tile(once.masks, (3, 1, 1)))
    frames = once.forward(cube_of(16, 6))
    frames += 0.02 * np.random.Generator(np.random.Philox(2)).standard_normal(frames.shape)
    one = reconstruct(once, frames, tau=0.05, solver=solver)
    three = reconstruct(thrice, np.tile(frames, (3, 1, 1, 1)), tau=0.15, solver=solver)
    assert three.objective == pytest.approx(3 * one.objective, rel=1e-6)
    assert np.linalg.norm(three.cube - one.cube) < 2e-3 * np.linalg.norm(one.cube)
    assert three.tau_max == pytest.approx(3 * one.tau_max, rel=1e-9)


def test_X10_an_ill_conditioned_operator_is_reported_never_silent(camera_of, cube_of):
    operator = camera_of("foveon", 1, 16, 8)
    twin = operator.response.copy()
    twin[1] = twin[0] + 1e-9 * twin[1]
    solution = reconstruct(operator.replace(response=twin), operator.replace(response=twin).forward(cube_of(16, 8)))
    assert "condition" in str(solution)
    assert any("nearly dependent (condition" in note for note in solution.notes)
    faint = CodedAperture(np.ones((2, 4, 4)) * [[[1]], [[1 - 1e-5]]], np.ones((1, 3)), np.arange(3), np.ones((3, 1)), gray=True)
    faint = faint.replace(masks=faint.masks * (1 - 1e-5 * np.random.Generator(np.random.Philox(1)).random((2, 4, 4))))
    assert any("ill-conditioned" in note for note in reconstruct(faint, faint.forward(np.ones((4, 4, 3)))).notes)


@pytest.mark.parametrize(("solver", "tau"), SOLVERS, ids=NAMES)
def test_any_operator_of_the_protocol_gives_the_same_answer(solver, tau, camera_of, cube_of):
    camera = camera_of("bayer", 2, 16, 6)
    plain = Plain(camera)
    assert isinstance(plain, LinearOperator)
    frames = camera.forward(cube_of(16, 6))
    tight = solver.model_copy(update={"tolerance": 1e-6 if not isinstance(solver, Fista) else 1e-9, "max_iterations": 5000})
    ours, theirs = reconstruct(camera, frames, tau=tau, solver=tight), reconstruct(plain, frames, tau=tau, solver=tight)
    assert theirs.objective == pytest.approx(ours.objective, rel=1e-4)


def test_an_open_mask_is_called_uncoded_and_the_solution_explains_itself(camera_of, cube_of):
    operator = camera_of("mono", 1, 16, 6)
    operator = operator.replace(masks=np.ones_like(operator.masks))
    text = str(reconstruct(operator, operator.forward(cube_of(16, 6))))
    assert "not coded" in text
    assert "16 x 16 x 6 cube by basis pursuit" in text
    assert "relative residual" in text
    frames = operator.forward(cube_of(16, 6))
    assert "of tau_max)" in str(reconstruct(operator, frames, tau=0.05, solver=Admm()))
    for (solver, tau), name in zip(
        EVERY, ("basis pursuit", "ADMM with tau = 0.05", "FISTA with tau = 0.05", "GAP", "GPSR with tau = 0.05")
    ):
        for data in (frames, 0 * frames):
            found = reconstruct(operator, data, tau=tau, solver=solver)
            assert found.solver == type(solver).__name__
            assert f"16 x 16 x 6 cube by {name}" in str(found)


def test_every_public_name_of_recon_can_be_imported():
    import recon

    for name in recon.__all__:
        assert getattr(recon, name).__name__ == name
    assert ScipyOperator is not LinearOperator


def test_warming_up_compiles_what_a_solve_needs():
    from recon import step_kernels, wavelet_kernels

    warm_up()
    for kernel in (step_kernels.advance_rows, wavelet_kernels.analysis_bands, wavelet_kernels.shrink_bands):
        assert any("float32" in str(signature) for signature in kernel.signatures)

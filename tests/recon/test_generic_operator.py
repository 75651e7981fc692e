"""Operators that are not ours: what they must have, what they may know, and that the answer is the same."""

import numpy as np
import pytest

from recon import (
    L1,
    Admm,
    BasisPursuit,
    CodedAperture,
    Fista,
    Gap,
    Gpsr,
    GramBands,
    GramBlocks,
    InputError,
    Kronecker,
    RowWeighted,
    adjoint_error,
    reconstruct,
)
from recon.adapted import Adapted, adapted
from recon.data_step import data_step, project
from recon.operator_step import ConjugateStep, OperatorStep, ProjectionStep
from recon.tau import AutoTau, TauPath


class Matrix:
    """A dense matrix as an operator: forward and adjoint only, no dtype, no out; frames of any shape."""

    def __init__(self, matrix, in_shape, out_shape, gram=None):
        self.matrix, self.in_shape, self.out_shape, self._gram = matrix, in_shape, out_shape, gram

    def forward(self, x):
        return (self.matrix @ x.ravel()).reshape(self.out_shape)

    def adjoint(self, y):
        return (self.matrix.T @ y.ravel()).reshape(self.in_shape)


class Knowing(Matrix):
    def gram_blocks(self):
        return self._gram


def drawn(out_shape, in_shape=(8, 8, 3), seed=0):
    matrix = np.random.Generator(np.random.Philox(seed)).standard_normal((int(np.prod(out_shape)), int(np.prod(in_shape))))
    return Matrix(matrix, in_shape, out_shape)


def scene(shape=(8, 8, 3)):
    cube = np.full(shape, 0.2)
    cube[2:6, 2:6] = np.linspace(0.4, 1, shape[2])
    return cube


def blocks_of(camera):
    """H H^T of a one-tap camera by its sensor pixels, from the dense matrix."""
    h = dense_c_order(camera)
    shots, channels, rows, width = camera.out_shape
    index = np.arange(h.shape[0]).reshape(shots * channels, rows * width).T
    gram = h @ h.T
    return h, GramBlocks(index, gram[index[:, :, None], index[:, None, :]])


def bands_of(camera, reach):
    h = dense_c_order(camera)
    shots, channels, rows, width = camera.out_shape
    size = shots * channels
    index = np.arange(h.shape[0]).reshape(size, rows, width).transpose(1, 2, 0).reshape(rows, width * size)
    gram, half = h @ h.T, size * reach
    bands = np.zeros((rows, width * size, half))
    for d in range(half):
        bands[:, d:, d] = gram[index[:, d:], index[:, : width * size - d]]
    return h, GramBands(index, bands)


def dense_c_order(camera):
    unit = np.eye(int(np.prod(camera.in_shape)))
    return np.stack([camera.forward(e.reshape(camera.in_shape)).ravel() for e in unit], axis=1)


@pytest.mark.parametrize("out_shape", [(120,), (12, 10), (2, 6, 10), (2, 3, 5, 4), (2, 1, 3, 4, 5)])
def test_frames_may_have_any_rank(out_shape):
    operator = drawn(out_shape)
    frames = operator.forward(scene())
    basis = Kronecker(wavelet="haar", level=2)
    answers = [reconstruct(operator, frames, prior=L1(basis=basis), tau=0.05, solver=s) for s in (Admm(tolerance=1e-5), Gpsr(), Fista())]
    assert {a.cube.shape for a in answers} == {(8, 8, 3)}
    assert all(a.cube.dtype == np.float32 for a in answers)
    best = min(a.objective for a in answers)
    for answer in answers:
        theta = basis.analysis(answer.cube.astype(float))
        assert answer.objective == pytest.approx(
            ((frames - operator.forward(answer.cube)) ** 2).sum() + 0.05 * np.abs(theta).sum(), rel=1e-3
        )
        assert answer.objective == pytest.approx(best, rel=2e-3)


@pytest.mark.parametrize(
    "solver",
    [Admm(tolerance=1e-7, max_iterations=20000), Fista(tolerance=1e-12, max_iterations=50000), Gpsr(tolerance=1e-12, max_iterations=50000)],
)
def test_double_precision_is_taken_where_the_operator_has_it_and_objectives_agree_to_1e_5(solver):
    operator = drawn((100,))
    operator.dtype = np.float64
    frames = operator.forward(scene()) + 0.1 * np.random.Generator(np.random.Philox(3)).standard_normal(100)
    basis = Kronecker(wavelet="db2", level=2)
    answer = reconstruct(operator, frames, prior=L1(basis=basis), tau=5.0, solver=solver)
    a = operator.matrix @ np.stack([basis.synthesis(e.reshape(8, 8, 3)).ravel() for e in np.eye(192)], axis=1)
    theta, step = np.zeros(192), 1 / np.linalg.norm(a, 2) ** 2
    for _ in range(20000):  # plain proximal gradient: the judge
        theta = theta + step * a.T @ (frames - a @ theta)
        theta = np.sign(theta) * np.maximum(np.abs(theta) - 2.5 * step, 0)
    best = ((frames - a @ theta) ** 2).sum() + 5.0 * np.abs(theta).sum()
    assert answer.cube.dtype == np.float64
    assert answer.objective == pytest.approx(best, rel=1e-5)


@pytest.mark.parametrize("rho", [0.0, 0.3])
@pytest.mark.parametrize(
    ("sensor", "shots", "spread"), [("mono", 2, False), ("bayer", 2, False), ("foveon", 1, False), ("foveon", 1, True)]
)
def test_an_operator_that_knows_its_gram_gets_the_exact_step(sensor, shots, spread, rho, camera_of):
    camera = camera_of(sensor, shots, 6, 4, spread=spread)
    h, gram = bands_of(camera, 3) if spread else blocks_of(camera)
    operator = Adapted(Knowing(h, camera.in_shape, camera.out_shape, gram), np.float64)
    draw = np.random.Generator(np.random.Philox(5))
    frames, cube = operator.forward(draw.standard_normal(camera.in_shape)), draw.standard_normal(camera.in_shape)
    step = data_step(operator, frames, rho)
    assert type(step) is OperatorStep
    inverse = np.linalg.pinv(h @ h.T + rho * np.eye(h.shape[0]), rcond=1e-9, hermitian=True)
    expected = cube.ravel() + h.T @ (inverse @ (frames.ravel() - h @ cube.ravel()))
    np.testing.assert_allclose(project(step, cube).ravel(), expected, atol=1e-9 if rho else 1e-4 if spread else 1e-8)
    strong, size = Adapted(
        Knowing(1e6 * h, camera.in_shape, camera.out_shape, gram.scaled(np.full(h.shape[0], 1e6))), np.float64
    ).normalised()
    np.testing.assert_allclose(
        project(data_step(strong, frames * 1e6 / size, 0.0), cube).ravel(),
        project(data_step(operator, frames, 0.0), cube).ravel(),
        atol=1e-4,
    )
    knowing = reconstruct(operator.operator, frames, solver=BasisPursuit(max_iterations=5))
    assert knowing.residual < 1e-4


def test_what_knows_no_gram_falls_back_to_conjugate_gradients_with_the_same_answer(camera_of, cube_of):
    camera = camera_of("bayer", 2, 8, 4)
    h, gram = blocks_of(camera)
    frames = camera.forward(cube_of(8, 4))
    plain, none, knowing = (
        Matrix(h, camera.in_shape, camera.out_shape),
        Knowing(h, camera.in_shape, camera.out_shape),
        Knowing(h, camera.in_shape, camera.out_shape, gram),
    )
    assert isinstance(data_step(adapted(plain), frames, 0.1), ConjugateStep)
    assert isinstance(data_step(adapted(none), frames, 0.1), ConjugateStep)
    for tau, solver in ((None, BasisPursuit(tolerance=1e-5, max_iterations=3000)), (0.01, Admm(tolerance=1e-5, max_iterations=3000))):
        ours = reconstruct(camera, frames, solver=solver, tau=tau).objective
        for operator in (plain, knowing):
            assert reconstruct(operator, frames, solver=solver, tau=tau).objective == pytest.approx(ours, rel=1e-3)


class Foreign:
    """One of our cameras of which only forward and adjoint show."""

    def __init__(self, camera):
        self.in_shape, self.out_shape, self.dtype = camera.in_shape, camera.out_shape, camera.dtype
        self.forward, self.adjoint = lambda x: camera.forward(x), lambda y: camera.adjoint(y)


def double(out_shape, seed=0):
    operator = drawn(out_shape, (4, 4, 4), seed)
    operator.dtype = np.float64
    return operator


def of_condition(condition, seed=0):
    """A square operator of 4 x 4 x 4 voxels whose singular values fall from 1 to 1 / condition."""
    draw = np.random.Generator(np.random.Philox(seed))
    u, v = (np.linalg.qr(draw.standard_normal((64, 64)))[0] for _ in range(2))
    operator = Matrix(u * np.logspace(0, -np.log10(condition), 64) @ v.T, (4, 4, 4), (64,))
    operator.dtype = np.float64
    return operator


@pytest.mark.parametrize("measurements", [160, 40])
@pytest.mark.parametrize(
    ("solver", "near"), [(Admm(), 1e-8), (Fista(tolerance=1e-14, max_iterations=20000), 1e-5), (Gpsr(tolerance=1e-12), 1e-8)]
)
def test_X3_tau_0_is_least_squares_however_much_the_frames_contradict_each_other(solver, near, measurements):
    operator = double((measurements,))
    frames = np.random.Generator(np.random.Philox(7)).standard_normal(measurements)
    judge = np.linalg.lstsq(operator.matrix, frames, rcond=None)[0]
    found = reconstruct(operator, frames, prior=L1(basis=Kronecker(wavelet="haar", level=1)), tau=0, solver=solver)
    assert found.stop.converged
    np.testing.assert_allclose(found.cube.ravel(), judge, atol=near * np.abs(judge).max())  # Fista watches the objective only


def test_X3_tau_0_starts_where_it_is_told_and_confesses_when_its_iterations_are_too_few():
    operator = double((40,))
    start = np.random.Generator(np.random.Philox(8)).standard_normal((4, 4, 4))
    frames = np.random.Generator(np.random.Philox(7)).standard_normal(40)
    found = reconstruct(operator, frames, tau=0, start=start)
    step = np.linalg.pinv(operator.matrix) @ (frames - operator.matrix @ start.ravel())
    np.testing.assert_allclose(found.cube.ravel(), start.ravel() + step, atol=1e-9)
    few = reconstruct(operator, frames, tau=0, solver=Admm(max_iterations=5))
    assert few.iterations == 5
    assert not few.stop.converged
    assert "raise max_iterations" in str(few.stop)
    assert not reconstruct(operator, frames, tau=0, solver=Admm(time_limit_s=1e-9)).stop.converged


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 3), ("mono", 8), ("bayer", 2)])
def test_the_projection_without_a_gram_is_that_of_the_pseudo_inverse(sensor, shots, noise, camera_of):
    camera = camera_of(sensor, shots, 6, 4)
    h = dense_c_order(camera)
    draw = np.random.Generator(np.random.Philox(5))
    frames = camera.forward(draw.standard_normal(camera.in_shape)) + noise * draw.standard_normal(camera.out_shape)
    step = data_step(Adapted(Foreign(camera)), frames, 0.0)
    assert isinstance(step, ProjectionStep)
    for _ in range(3):  # the second and third start from the last
        cube = draw.standard_normal(camera.in_shape)
        expected = cube.ravel() + np.linalg.pinv(h, rcond=1e-9) @ (frames.ravel() - h @ cube.ravel())
        np.testing.assert_allclose(project(step, cube).ravel(), expected, atol=1e-8)
    assert step.notes == ()


@pytest.mark.parametrize("solver", [BasisPursuit(), Gap()], ids=["basis-pursuit", "gap"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("shots", "noise"), [(8, 0.0), (8, 0.01), (3, 0.01)])
def test_a_camera_of_others_is_projected_on_as_ours_under_noise_too(shots, noise, dtype, solver, camera_of, cube_of):
    camera, truth = camera_of("mono", shots, 16, 6), cube_of(16, 6)
    frames = camera.forward(truth) + noise * np.random.Generator(np.random.Philox(3)).standard_normal(camera.out_shape)
    ours = reconstruct(camera, frames, solver=solver)
    theirs = reconstruct(Foreign(camera.astype(dtype)), frames, solver=solver)
    assert theirs.stop.converged
    assert theirs.residual == pytest.approx(ours.residual, rel=1e-3, abs=1e-6)
    errors = [np.linalg.norm(found.cube - truth) / np.linalg.norm(truth) for found in (ours, theirs)]
    assert errors[1] == pytest.approx(errors[0], rel=0.03)


@pytest.mark.parametrize("bound", [False, True])
@pytest.mark.parametrize("solver", [None, Gap(), Admm(), Fista(), Gpsr()], ids=["basis-pursuit", "gap", "admm", "fista", "gpsr"])
def test_X10_no_solver_is_silent_about_a_condition_of_1e9(solver, bound):
    if bound and isinstance(solver, Gpsr):
        pytest.skip("has no bound")
    tau = None if solver is None or isinstance(solver, Gap) else 0
    twins = CodedAperture(
        np.ones((1, 8, 8)), np.array([[1.0, 1.0], [1.0, 1.0 + 1e-9]]), np.zeros(2, int), np.ones((2, 1)), dtype=np.float64
    )
    for operator in (of_condition(1e9), twins):
        frames = operator.forward(np.random.Generator(np.random.Philox(2)).random(operator.in_shape))
        prior = L1(basis=Kronecker(wavelet="haar", level=1))
        found = reconstruct(operator, frames, prior=prior, solver=solver, tau=tau, nonnegative=bound)
        assert any("condition" in note for note in found.notes)
    for operator in (of_condition(10.0), double((40,))):
        frames = operator.forward(np.random.Generator(np.random.Philox(2)).random(operator.in_shape))
        notes = reconstruct(operator, frames, prior=prior, solver=solver, tau=tau, nonnegative=bound).notes
        assert not any("condition" in note for note in notes)


def test_a_rule_for_tau_and_weights_serve_operators_of_others_too():
    operator = drawn((2, 9, 10))
    frames = operator.forward(scene()) + np.random.Generator(np.random.Philox(8)).standard_normal((2, 9, 10))
    found = reconstruct(operator, frames, tau=AutoTau(path=TauPath(fractions=(1e-1, 1e-2, 1e-3))))
    assert found.tau in [pytest.approx(f * found.tau_max, rel=1e-5) for f in (1e-1, 1e-2, 1e-3)]
    assert any("held-out" in note for note in found.notes)
    weighted = RowWeighted(operator, np.ones((9, 10)))
    assert adjoint_error(weighted) < 1e-6
    same = reconstruct(weighted, frames, tau=1.0)
    assert same.objective == pytest.approx(reconstruct(operator, frames, tau=1.0).objective, rel=1e-4)


@pytest.mark.parametrize("scale", [1e-30, 1e-12, 1e12, 1e30])
def test_X8_an_operator_scaled_by_any_factor_gives_the_same_cube(scale):
    operator = drawn((80,))
    strong = Matrix(operator.matrix * scale, operator.in_shape, operator.out_shape)
    frames = operator.forward(scene())
    plain, scaled = reconstruct(operator, frames, tau=1.0).cube, reconstruct(strong, frames * scale, tau=scale**2).cube
    np.testing.assert_allclose(scaled, plain, atol=1e-5)
    both = reconstruct(operator, frames * scale, tau=scale).cube.astype(float) / scale
    np.testing.assert_allclose(both, plain, atol=1e-6)


def test_X7_an_operator_that_sees_nothing_or_gives_nan_is_refused():
    zero = Matrix(np.zeros((80, 192)), (8, 8, 3), (80,))
    with pytest.raises(InputError, match="sees nothing"):
        reconstruct(zero, np.ones(80))
    broken = Matrix(np.full((80, 192), np.nan), (8, 8, 3), (80,))
    with pytest.raises(InputError, match=r"^operator\.forward: must be finite"):
        reconstruct(broken, np.ones(80))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"in_shape": (8, 8)}, r"^operator\.in_shape: must be three sides"),
        ({"in_shape": "8"}, r"^operator\.in_shape"),
        ({"out_shape": (0,)}, r"^operator\.out_shape"),
        ({"forward": lambda x: np.ones(3)}, r"^operator\.forward: must be a real array of shape \(80,\)"),
        ({"adjoint": lambda y: np.ones((8, 8))}, r"^operator\.adjoint: must be a real array"),
        ({"forward": lambda x: np.ones(80) * 1j}, r"^operator\.forward: must be a real array"),
    ],
)
def test_an_operator_of_wrong_shapes_is_refused_by_name(change, message):
    operator = drawn((80,))
    for name, value in change.items():
        setattr(operator, name, value)
    with pytest.raises(InputError, match=message):
        reconstruct(operator, np.ones(80), tau=1.0)


def test_an_object_without_an_adjoint_is_refused():
    with pytest.raises(InputError, match=r"^operator: must be an object with in_shape.* adjoint missing"):
        reconstruct(type("Half", (), {"in_shape": (2, 2, 2), "out_shape": (3,), "forward": None})(), np.ones(3))


def test_a_wrong_adjoint_is_told():
    operator = drawn((80,))
    operator.adjoint = lambda y: np.roll((operator.matrix.T @ y.ravel()).reshape(8, 8, 3), 1, 0)
    notes = reconstruct(operator, drawn((80,)).forward(scene()), tau=1.0).notes
    assert any("not the transpose" in note for note in notes)
    assert reconstruct(drawn((80,)), drawn((80,)).forward(scene()), tau=1.0).notes == ()


def test_gram_blocks_that_cannot_be_are_refused(camera_of):
    camera = camera_of("mono", 1, 4, 2)
    h, gram = blocks_of(camera)
    for wrong, field in [
        (GramBlocks(gram.index[:-1], gram.matrix[:-1]), "index"),
        (GramBlocks(gram.index, gram.matrix[:, :, :0]), "matrix"),
        (GramBands(gram.index, np.ones((1, 2, 3))), "bands"),
        ("blocks", "gram_blocks"),
    ]:
        with pytest.raises(InputError, match=field):
            reconstruct(Knowing(h, camera.in_shape, camera.out_shape, wrong), np.ones(camera.out_shape))

"""Every solver on operators with field-dependent and two-dimensional weights; their data steps against dense linear algebra."""

import numpy as np
import pytest

from recon import L1, Admm, BasisPursuit, FieldAperture, Fista, Gpsr, Kronecker, Readout, Spread, reconstruct
from recon.banded import RowInverse
from recon.data_step import ConjugateStep, data_step, reduced
from recon.operator import LinearOperator

ROWS, COLUMNS, BANDS = 12, 13, 5


def camera(kind, *, sensor="mono", shots=3, gain=True, dtype=np.float64, repeated=False):
    """``smile``: columns that depend on the row; ``blur``: light on three rows."""
    draw = np.random.Generator(np.random.Philox(7))
    shift = np.arange(BANDS)[:, None, None] + 0.004 * (np.arange(ROWS)[:, None] - 5.5) ** 2 + 0.01 * np.arange(COLUMNS)
    first = np.floor(shift).astype(int)
    part = shift - first
    across = np.stack([(1 - part) / 2, np.full_like(part, 0.5), part / 2], -1)
    down = np.array([0.1, 0.8, 0.1]) if kind == "blur" else np.ones(1)
    taps = down[:, None] * across[..., None, :]
    spread = Spread(np.full((BANDS, 1, 1), -1 if kind == "blur" else 0), first, taps)
    width = COLUMNS + BANDS + 2
    position = np.linspace(0, 1, BANDS)
    response = np.ones((1, BANDS)) if sensor == "mono" else np.stack([np.exp(-(((position - c) / 0.4) ** 2)) for c in (0.8, 0.5, 0.2)])
    mosaic = np.array([[0, 1], [1, 2]])[np.arange(ROWS)[:, None] % 2, np.arange(width) % 2] if sensor == "bayer" else None
    masks = 0.01 + 0.99 * draw.integers(0, 2, (shots, ROWS, COLUMNS))
    if repeated:
        masks[1:] = masks[0]
    readout = Readout(1 + 0.05 * draw.standard_normal((ROWS, width))) if gain else None
    return FieldAperture(masks, response, spread, mosaic=mosaic, readout=readout, width=width, dtype=dtype)


def advanced(step, z):
    """The data step of a cube (M, N, K)."""
    moved = np.ascontiguousarray(z.transpose(2, 0, 1))
    x = moved.copy()
    step.advance(moved, x.copy(), x, 0.0)
    return x.transpose(1, 2, 0)


def flat(cube):
    return cube.transpose(2, 1, 0).ravel()


@pytest.mark.parametrize("repeated", [False, True])
@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
@pytest.mark.parametrize("kind", ["smile", "blur"])
def test_data_step_of_a_field_operator_is_the_dense_formula(kind, sensor, repeated):
    h = camera(kind, sensor=sensor, repeated=repeated)
    draw = np.random.default_rng(0)
    z, g = draw.standard_normal(h.in_shape), draw.standard_normal(h.out_shape)
    dense, rho = h.dense(), 0.7
    inner = np.linalg.solve(dense @ dense.T + rho * np.eye(len(dense)), g.transpose(0, 1, 3, 2).ravel() - dense @ flat(z))
    step = data_step(h, g, rho)
    if kind == "blur":  # solved by iterations: to the end
        less, merged, _ = reduced(h, g, None, [], False)
        step = ConjugateStep(less, merged, rho, RowInverse.near(less, rho), tolerance=1e-13, iterations=1000)
    np.testing.assert_allclose(flat(advanced(step, z)), flat(z) + dense.T @ inner, atol=1e-9)


@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
def test_projection_of_a_smiling_camera_explains_the_frames_whatever_the_pixels_gains(sensor):
    draw = np.random.default_rng(0)
    for gain in (True, False):
        h = camera("smile", sensor=sensor, gain=gain, shots=1)
        g = h.forward(draw.random(h.in_shape))
        x = advanced(data_step(h, g, 0.0, mixed=True), draw.random(h.in_shape))
        assert np.abs(h.forward(x) - g).max() < 1e-4 * g.max()


def test_dead_pixels_are_left_out_of_the_projection():
    h = camera("smile", shots=1)
    gain = h.readout.gain.copy()
    gain[3, 4] = 0
    h = h.replace(readout=Readout(gain))
    g = h.forward(np.random.default_rng(0).random(h.in_shape))
    x = advanced(data_step(h, g, 0.0, mixed=True), np.zeros(h.in_shape))
    assert np.isfinite(x).all()
    assert np.abs(h.forward(x) - g).max() < 1e-4 * g.max()


def test_the_nearest_camera_without_coupling_shortens_the_iterations():
    h = camera("blur", shots=2, gain=False)
    g = h.forward(np.random.default_rng(0).random(h.in_shape))
    counts = []
    for step in (data_step(h, g, 0.3), ConjugateStep(h, g, 0.3, tolerance=1e-4)):
        calls = []
        normal = step._normal
        step._normal = lambda y, normal=normal, calls=calls: (calls.append(1), normal(y))[1]
        advanced(step, np.zeros(h.in_shape))
        counts.append(len(calls))
    assert counts[0] < 0.7 * counts[1]


@pytest.mark.parametrize("kind", ["smile", "blur"])
@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
def test_every_solver_finds_the_same_minimum_of_eq_4_through_a_field_operator(kind, sensor):
    h = camera(kind, sensor=sensor, shots=2)
    truth = np.ones(h.in_shape)
    truth[3:9, 2:7] = np.linspace(0.2, 1, BANDS)
    frames = h.forward(truth)
    basis = Kronecker.for_shape(h.in_shape, wavelet="haar", level=0)  # not padded: the objective is written out below
    tau = 1e-2 * 2 * np.abs(basis.analysis(h.adjoint(frames))).max()
    dense, g = h.dense(), frames.transpose(0, 1, 3, 2).ravel()
    values = []
    for solver in (
        Admm(tolerance=1e-6, max_iterations=3000),
        Fista(tolerance=1e-9, max_iterations=6000),
        Gpsr(tolerance=1e-10, max_iterations=10000),
    ):
        cube = reconstruct(h, frames, prior=L1(basis=basis), tau=tau, solver=solver).cube
        values.append(((g - dense @ flat(cube)) ** 2).sum() + tau * np.abs(basis.analysis(cube)).sum())
    np.testing.assert_allclose(values, min(values), rtol=1e-5)


@pytest.mark.parametrize("kind", ["smile", "blur"])
def test_basis_pursuit_explains_the_frames_of_a_field_operator(kind):
    h = camera(kind, sensor="foveon", shots=1)
    truth = np.ones(h.in_shape)
    truth[3:9, 2:7] = np.linspace(0.2, 1, BANDS)
    frames = h.forward(truth)
    found = reconstruct(h, frames, solver=BasisPursuit(max_iterations=150))
    assert found.residual < (1e-4 if kind == "smile" else 2e-3)
    assert any("rows couple: 0.001 of H H^T's largest entry was added" in note for note in found.notes) == (kind == "blur")
    again = frames.transpose(0, 1, 3, 2).ravel() - h.dense() @ flat(found.cube)
    assert np.linalg.norm(again) / np.linalg.norm(frames) == pytest.approx(found.residual, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("shots", [1, 3, 6])
def test_X3_tau_0_is_least_squares_where_rows_couple(shots, noise):
    draw = np.random.Generator(np.random.Philox(5))
    masks, taps = draw.integers(0, 2, (shots, 7, 6)).astype(float), draw.uniform(0.1, 1, (3, 1, 1, 3, 2))
    h = FieldAperture(
        masks, draw.uniform(0.2, 1, (3, 3)), Spread(np.full((3, 1, 1), -1), np.arange(3)[:, None, None], taps), dtype=np.float64
    )
    frames = h.forward(draw.random(h.in_shape)) + noise * draw.standard_normal(h.out_shape)
    judge = np.linalg.lstsq(h.dense(), frames.transpose(0, 1, 3, 2).ravel(), rcond=1e-10)[0]
    found = reconstruct(h, frames, tau=0)
    assert found.stop.converged
    np.testing.assert_allclose(flat(found.cube), judge, atol=1e-8 * np.abs(judge).max())
    variance = draw.uniform(0.5, 2, frames.shape)
    root = (1 / np.sqrt(variance)).transpose(0, 1, 3, 2).ravel()
    judge = np.linalg.lstsq(root[:, None] * h.dense(), root * frames.transpose(0, 1, 3, 2).ravel(), rcond=1e-10)[0]
    np.testing.assert_allclose(flat(reconstruct(h, frames, tau=0, noise=variance).cube), judge, atol=1e-7 * np.abs(judge).max())


def test_least_squares_of_a_nearly_singular_blur_confesses_that_it_is_not_there():
    h = camera("blur", shots=2)
    frames = h.forward(np.ones(h.in_shape)) + 0.02 * np.random.Generator(np.random.Philox(6)).standard_normal(h.out_shape)
    found = reconstruct(h, frames, tau=0, solver=Admm(max_iterations=100))
    assert not found.stop.converged
    assert "condition at least" in str(found.stop)
    assert "raise max_iterations" in str(found.stop)


def test_solutions_do_not_depend_on_the_unit_of_the_frames():
    h = camera("blur", shots=3)
    truth = np.random.default_rng(0).random(h.in_shape)
    frames = h.forward(truth)
    strong = h.replace(response=h.response * 2.0**23)
    one, other = (reconstruct(o, f, solver=BasisPursuit(max_iterations=20)) for o, f in ((h, frames), (strong, frames * 2.0**23)))
    assert isinstance(h, LinearOperator)
    np.testing.assert_array_equal(one.cube, other.cube)

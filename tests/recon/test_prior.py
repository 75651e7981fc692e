"""Priors: proximal maps against brute force, whole solves against linear programmes, SciPy and primal-dual iterations."""

import numpy as np
import pytest
from scipy.optimize import linprog, minimize, nnls

from recon import L1, Admm, BasisPursuit, Fista, Gpsr, GroupL1, InputError, Kronecker, reconstruct
from recon.nonnegative import NonNegative
from recon.tau import AutoTau, Given, TauFraction, TauPath, tau_max

SHAPE = (8, 8, 4)
BASIS = Kronecker(wavelet="db2", level=2)
PRIORS = {
    "l1": L1(basis=BASIS),
    "l1-weighted": L1(basis=BASIS, weights=(0.5, 1.0, 2.0, 4.0)),
    "group": GroupL1(basis=BASIS),
    "l1-padded": L1(basis=Kronecker.for_shape((7, 6, 4), wavelet="db2")),
}


def band_major(cube):
    return np.ascontiguousarray(cube.transpose(2, 0, 1)).transpose(1, 2, 0)


def drawn(shape=SHAPE, seed=0):
    return band_major(np.random.Generator(np.random.Philox(seed)).standard_normal(shape))


def columns(basis, shape, theta_shape):
    """Psi as a dense matrix: rows in C order of the cube, columns in C order of the coefficients."""
    return np.stack([basis.synthesis(e.reshape(theta_shape)).ravel() for e in np.eye(int(np.prod(theta_shape)))], axis=1)


def synthesis_value(name, psi, bands):
    """R as a function of coefficients, and its subgradient away from 0."""
    if name == "group":
        return lambda theta: np.linalg.norm(theta.reshape(-1, bands), axis=1).sum()
    weights = np.tile(PRIORS[name].weights or np.ones(bands), psi.shape[1] // bands)
    return lambda theta: (weights * np.abs(theta)).sum()


@pytest.mark.parametrize("threshold", [0.0, 0.3, 3.0])
@pytest.mark.parametrize("name", ["l1", "l1-weighted", "group"])
def test_the_proximal_map_is_the_minimum_that_brute_force_finds(name, threshold):
    cube = drawn()
    penalty = PRIORS[name].bind(SHAPE, np.float64)
    u = cube.copy(order="K")
    value = penalty.shrink(u, threshold)
    psi = columns(BASIS, SHAPE, SHAPE)
    r = synthesis_value(name, psi, 4)

    def objective(theta):
        return 0.5 * ((theta - psi.T @ cube.ravel()) ** 2).sum() + threshold * r(theta)

    theta = psi.T @ u.ravel()
    assert value == pytest.approx(r(theta), rel=1e-12, abs=1e-12)
    assert penalty.value(u) == pytest.approx(value, rel=1e-9, abs=1e-9)
    least = objective(theta)
    draw = np.random.Generator(np.random.Philox(1))
    for size in (1e-3, 1e-2, 1e-1):
        for _ in range(200):
            assert objective(theta + size * draw.standard_normal(theta.size) * (draw.random(theta.size) < 0.1)) >= least - 1e-12
    smooth = minimize(objective, psi.T @ cube.ravel(), method="L-BFGS-B", options={"maxiter": 200})
    assert least <= smooth.fun + 1e-9


def test_the_padded_proximal_map_is_that_of_the_synthesis_form():
    shape, prior = (7, 6, 2), L1(basis=Kronecker(wavelet="haar", level=2, picture=(7, 6)))
    cube, penalty = drawn(shape), prior.bind(shape, np.float64)
    for _ in range(500):  # the margin settles over calls with the same cube
        u = cube.copy(order="K")
        value = penalty.shrink(u, 0.4)
    theta_shape = prior.basis.theta_shape(shape)
    psi = columns(prior.basis, shape, theta_shape)
    n = psi.shape[1]

    def value_and_slope(z):
        gap = psi @ (z[:n] - z[n:]) - cube.ravel()
        slope = psi.T @ gap
        return 0.5 * gap @ gap + 0.4 * z.sum(), np.concatenate([slope + 0.4, 0.4 - slope])

    options = {"maxiter": 20000, "maxfun": 50000, "ftol": 1e-15, "gtol": 1e-11}
    judge = minimize(value_and_slope, np.zeros(2 * n), jac=True, method="L-BFGS-B", bounds=[(0, None)] * (2 * n), options=options)
    assert n > cube.size
    assert 0.5 * ((u - cube) ** 2).sum() + 0.4 * value == pytest.approx(judge.fun, rel=1e-6)
    np.testing.assert_allclose(u.ravel(), psi @ (judge.x[:n] - judge.x[n:]), atol=1e-4)


@pytest.mark.parametrize("name", PRIORS)
def test_priors_scale_with_their_argument(name):
    shape = (7, 6, 4) if name == "l1-padded" else SHAPE
    cube = drawn(shape)
    for factor in (1e-12, 3.0, 1e12):
        one, other = (PRIORS[name].bind(shape, np.float64) for _ in range(2))
        u, v = cube.copy(order="K"), factor * cube
        values = one.shrink(u, 0.3), other.shrink(v, factor * 0.3)
        np.testing.assert_allclose(v, factor * u, atol=1e-12 * factor)
        assert values[1] == pytest.approx(factor * values[0], rel=1e-9)


@pytest.mark.parametrize(
    "solver",
    [Admm(tolerance=1e-7, max_iterations=20000), pytest.param(Fista(tolerance=1e-11, max_iterations=50000), marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("name", PRIORS)
def test_solves_meet_the_optimality_conditions_of_their_prior(name, solver, camera_of, cube_of):
    shape = (7, 6, 4) if name == "l1-padded" else SHAPE
    camera = camera_of("foveon", 1, 8, 4)
    camera = camera.replace(masks=camera.masks[:, : shape[0], : shape[1]])
    frames = camera.forward(cube_of(8, 4)[: shape[0], : shape[1]])
    prior = PRIORS[name]
    theta_shape = prior.basis.theta_shape(shape)
    psi = columns(prior.basis, shape, theta_shape)
    a = np.stack([camera.forward(column.reshape(shape)).ravel() for column in psi.T], axis=1)
    r, tau = synthesis_value(name, psi, 4), 0.1
    found = reconstruct(camera, frames, prior=prior, tau=tau, solver=solver)
    theta, step = np.zeros(psi.shape[1]), 1 / np.linalg.norm(a, 2) ** 2
    momentum, ahead = 1.0, theta
    weights = np.ones(psi.shape[1]) if name == "group" else np.tile(prior.weights or np.ones(4), psi.shape[1] // 4)
    for _ in range(4000):  # the judge: FISTA on dense coefficients
        z = ahead + step * a.T @ (frames.ravel() - a @ ahead)
        if name == "group":
            length = np.linalg.norm(z.reshape(-1, 4), axis=1, keepdims=True)
            new = (z.reshape(-1, 4) * np.maximum(1 - tau * step / 2 / np.maximum(length, 1e-300), 0)).ravel()
        else:
            new = np.sign(z) * np.maximum(np.abs(z) - tau * step / 2 * weights, 0)
        grown = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        if (ahead - new) @ (new - theta) > 0:
            grown = 1.0
        ahead, theta, momentum = new + (momentum - 1) / grown * (new - theta) * (grown > 1), new, grown
    best = ((frames.ravel() - a @ theta) ** 2).sum() + tau * r(theta)
    assert found.objective == pytest.approx(best, rel=1e-5)


@pytest.mark.parametrize("name", ["l1", "l1-weighted", "group"])
def test_X4_zero_is_the_answer_from_tau_max_on_and_not_below(name, camera_of, cube_of):
    camera = camera_of("bayer", 2, 8, 4)
    frames = camera.forward(cube_of(8, 4))
    top = tau_max(camera, frames, Given(prior=PRIORS[name]))
    above = reconstruct(camera, frames, prior=PRIORS[name], tau=top * (1 + 1e-9))
    assert not above.cube.any()
    assert above.iterations == 0
    below = reconstruct(camera, frames, prior=PRIORS[name], tau=top * 0.99, solver=Fista(tolerance=1e-10))
    assert below.cube.any()
    assert below.objective < (frames**2).sum()


def test_weights_of_one_change_nothing_and_gpsr_leaves_what_it_cannot_solve_to_others(camera_of, cube_of):
    camera = camera_of("mono", 2, 8, 4)
    frames = camera.forward(cube_of(8, 4))
    plain, ones = (reconstruct(camera, frames, prior=L1(basis=BASIS, weights=w), tau=0.05) for w in (None, (1.0,) * 4))
    assert ones.objective == pytest.approx(plain.objective, rel=1e-5)
    for prior, bound in ((PRIORS["l1-weighted"], False), (PRIORS["group"], False), (PRIORS["l1"], True)):
        with pytest.raises(InputError, match=r"^nonnegative: must be False" if bound else r"^prior: must be L1 without weights"):
            reconstruct(camera, frames, prior=prior, tau=0.05, solver=Gpsr(), nonnegative=bound)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: L1(basis="db2"), r"^L1\.basis: must be an object with analysis"),
        (lambda: GroupL1(basis=3), r"^GroupL1\.basis"),
        (lambda: L1(weights=(1.0, 0.0)), r"^L1\.weights: must be positive"),
        (lambda: L1(weights=(1.0, float("nan"))), r"^L1\.weights"),
        (lambda: L1(weights=(1.0, 1.0)).bind(SHAPE, np.float64), r"^L1\.weights: must be as many numbers as bands, 4"),
    ],
)
def test_priors_that_cannot_be_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("tau", [TauFraction(fraction=0.01), AutoTau(path=TauPath(fractions=(1e-1, 1e-2)))])
@pytest.mark.parametrize("prior", [GroupL1(), L1(weights=(1.0, 1.0, 2.0, 3.0))])
def test_rules_find_a_tau_for_every_prior(prior, tau, camera_of, cube_of):
    camera = camera_of("foveon", 1, 16, 4)
    frames = camera.forward(cube_of(16, 4))
    found = reconstruct(camera, frames, prior=prior, tau=tau, nonnegative=True, noise=1.0)
    assert 0 < found.tau < found.tau_max
    assert any("tau_max" in note for note in found.notes)
    assert found.cube.min() >= 0


def test_a_tau_for_basis_pursuit_and_rules_of_the_wrong_kind_are_refused(camera_of):
    camera = camera_of("mono", 1, 8, 3)
    frames = np.ones(camera.out_shape)
    with pytest.raises(InputError, match=r"^tau: must be absent with BasisPursuit"):
        reconstruct(camera, frames, tau=0.1, solver=BasisPursuit())
    for wrong in ("auto", True, -0.5, np.inf):
        with pytest.raises(InputError, match=r"^tau: must be a finite number"):
            reconstruct(camera, frames, tau=wrong, solver=Admm())


# -- f >= 0


def positive_case(camera_of, cube_of, sensor, shots):
    truth = np.maximum(cube_of(8, 4) - 0.3, 0)
    camera, basis = camera_of(sensor, shots, 8, 4), Kronecker(wavelet="haar", level=2)
    psi = columns(basis, SHAPE, SHAPE)
    h = np.stack([camera.forward(e.reshape(SHAPE)).ravel() for e in np.eye(256)], axis=1)
    return camera, basis, psi, h, camera.forward(truth)


@pytest.mark.parametrize("prior", ["l1", "group"])
def test_X17_the_bounded_proximal_map_is_the_minimum_over_cubes_that_are_not_negative(prior):
    cube, inner = drawn(seed=3), PRIORS[prior].bind(SHAPE, np.float64)
    penalty = NonNegative(inner)
    for _ in range(200):
        u = cube.copy(order="K")
        penalty.shrink(u, 0.3)
    assert u.min() == 0
    # with the multiplier p >= 0, p u = 0, the free map of f + p is u: the optimality conditions
    p, free = penalty._multiplier, cube + penalty._multiplier
    inner.shrink(free, 0.3)
    assert p.min() >= 0
    np.testing.assert_allclose(free, u, atol=1e-7)
    assert np.abs(p * u).max() < 1e-7


@pytest.mark.parametrize(("sensor", "shots"), [("bayer", 1), ("foveon", 1)])
def test_X17_bounded_basis_pursuit_agrees_with_a_linear_programme(sensor, shots, camera_of, cube_of):
    camera, basis, psi, h, frames = positive_case(camera_of, cube_of, sensor, shots)
    a = h @ psi
    bound = {"A_ub": np.hstack([-psi, psi]), "b_ub": np.zeros(256)}
    judge = linprog(np.ones(512), A_eq=np.hstack([a, -a]), b_eq=frames.ravel(), **bound, method="highs")
    assert judge.status == 0
    solver = BasisPursuit(tolerance=1e-7, max_iterations=5000)
    found = reconstruct(camera, frames, prior=L1(basis=basis), solver=solver, nonnegative=True)
    free = reconstruct(camera, frames, prior=L1(basis=basis), solver=solver)
    assert found.cube.min() >= 0 > free.cube.min()
    assert found.residual < 1e-5
    assert found.objective == pytest.approx(judge.fun, rel=1e-6)


@pytest.mark.parametrize("solver", [Admm(tolerance=1e-7, max_iterations=5000), Fista(tolerance=1e-10, max_iterations=5000)])
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 2), ("foveon", 1)])
def test_X17_bounded_eq4_agrees_with_a_primal_dual_iteration(sensor, shots, solver, camera_of, cube_of):
    camera, basis, psi, h, frames = positive_case(camera_of, cube_of, sensor, shots)
    tau, f, y, g = 0.02, np.zeros(256), np.zeros(256), frames.ravel()
    step = 1 / (np.linalg.norm(h, 2) ** 2 + 1)
    for _ in range(6000):  # Condat and Vu
        new = np.maximum(f - step * (2 * h.T @ (h @ f - g) + psi @ y), 0)
        y, f = np.clip(y + psi.T @ (2 * new - f), -tau, tau), new
    best = ((g - h @ f) ** 2).sum() + tau * np.abs(psi.T @ f).sum()
    found = reconstruct(camera, frames, prior=L1(basis=basis), tau=tau, solver=solver, nonnegative=True)
    assert found.stop.converged
    assert found.cube.min() >= 0
    assert found.objective == pytest.approx(best, rel=1e-5)


@pytest.mark.parametrize("solver", [Admm(tolerance=1e-7, max_iterations=5000), Fista(tolerance=1e-11, max_iterations=20000)])
@pytest.mark.parametrize(("sensor", "shots"), [("mono", 2), ("mono", 6), ("foveon", 1)])
def test_X17_bounded_least_squares_agrees_with_nnls(sensor, shots, solver, camera_of, cube_of):
    camera, _, _, h, frames = positive_case(camera_of, cube_of, sensor, shots)
    frames = frames + 0.05 * np.random.Generator(np.random.Philox(1)).standard_normal(frames.shape)
    norm = nnls(h, frames.ravel())[1]
    found = reconstruct(camera, frames, tau=0, solver=solver, nonnegative=True)
    assert found.cube.min() >= 0
    assert found.objective == pytest.approx(norm**2, rel=1e-9)
    assert "unregularised" in str(found.stop)


@pytest.mark.parametrize("solver", [BasisPursuit(max_iterations=3), Admm(max_iterations=3), Fista(max_iterations=3)])
def test_X17_every_iterate_that_is_handed_back_is_exactly_non_negative(solver, camera_of, cube_of):
    camera = camera_of("foveon", 2, 16, 6, dtype=np.float32)
    frames = camera.astype(np.float64).forward(cube_of(16, 6)) - 0.5
    found = reconstruct(camera, frames, solver=solver, nonnegative=True, tau=0.01 if solver.needs_tau else None)
    assert found.cube.min() == 0
    assert not np.signbit(found.cube).any()

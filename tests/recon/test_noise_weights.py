"""Known noise as weights: the exact steps against dense algebra, the minimum against SciPy, and what tau means then."""

import numpy as np
import pytest
from scipy.optimize import minimize

from recon import L1, Admm, BasisPursuit, FieldAperture, Fista, Gpsr, InputError, Kronecker, Readout, RowWeighted, Spread, reconstruct
from recon.banded import RowInverse
from recon.data_step import data_step, largest_eigenvalue, project
from recon.operator_step import ConjugateStep
from recon.problem import root_weights

CAMERAS = [("mono", 3, False), ("bayer", 2, False), ("foveon", 2, False), ("foveon", 2, True), ("bayer", 2, True)]
SOLVERS = [
    Admm(tolerance=1e-7, max_iterations=20000),
    Fista(tolerance=1e-11, max_iterations=50000),
    Gpsr(tolerance=1e-11, max_iterations=50000),
]


def flat(frames):
    """In the order of CodedAperture.dense."""
    return frames.transpose(0, 1, 3, 2).ravel()


def weighted_case(camera_of, sensor, shots, spread, repeated=False, seed=0):
    operator = camera_of(sensor, shots, 7, 4, spread=spread, repeated=repeated)
    draw = np.random.Generator(np.random.Philox(seed))
    d = draw.uniform(0.2, 3, operator.out_shape)
    d[:, :, 2, 3] = 0  # a dead pixel
    d[0, 0, 4] = 0  # and a dead line of one shot
    return operator, d, draw


def dense_step(operator, d, frames, cube, rho):
    a = flat(d)[:, None] * operator.dense()
    z = cube.transpose(2, 1, 0).ravel()
    inverse = np.linalg.pinv(a @ a.T + rho * np.eye(len(a)), rcond=1e-9, hermitian=True)
    return (z + a.T @ (inverse @ (flat(d * frames) - a @ z))).reshape(cube.shape[::-1]).transpose(2, 1, 0)


@pytest.mark.parametrize("rho", [0.0, 0.3])
@pytest.mark.parametrize("repeated", [False, True])
@pytest.mark.parametrize(
    ("sensor", "shots", "spread"), [("mono", 3, False), ("bayer", 2, False), ("foveon", 2, False), ("foveon", 2, True), ("bayer", 2, True)]
)
def test_a_weighted_camera_has_the_dense_data_step(sensor, shots, spread, repeated, rho, camera_of):
    operator, d, draw = weighted_case(camera_of, sensor, shots, spread, repeated)
    frames, cube = draw.standard_normal(operator.out_shape), draw.standard_normal(operator.in_shape)
    if rho == 0 and (repeated or spread):
        frames = operator.forward(draw.standard_normal(operator.in_shape))
    weighted = RowWeighted(operator, d)
    step = data_step(weighted, d * frames, rho)
    assert type(step).__name__ == ("BandedStep" if spread else "BlockStep")
    exact = dense_step(operator, d, frames, cube, rho)
    if spread and rho == 0:
        seen = d * (operator.forward(project(step, project(step, cube))) - frames)
        assert np.linalg.norm(seen) < 1e-5 * np.linalg.norm(d * frames)
    else:
        np.testing.assert_allclose(project(step, cube), exact, atol=1e-8)
    twice = data_step(RowWeighted(RowWeighted(operator, np.sqrt(d)), np.sqrt(d)), d * frames, rho)
    np.testing.assert_allclose(project(twice, cube), project(step, cube), atol=1e-9)


@pytest.mark.parametrize("weights", ["pixel", "measurement"])
def test_mixed_channels_with_weights_project_on_the_same_constraint(weights, camera_of):
    operator, d, draw = weighted_case(camera_of, "foveon", 2, False)
    if weights == "pixel":
        d = np.broadcast_to(d[:, :1], d.shape).copy()
    frames, cube = operator.forward(draw.standard_normal(operator.in_shape)), draw.standard_normal(operator.in_shape)
    step = data_step(RowWeighted(operator, d), d * frames, 0.0, mixed=True)
    np.testing.assert_allclose(project(step, cube), dense_step(operator, d, frames, cube, 0.0), atol=1e-7)


@pytest.mark.parametrize("blur", [False, True])
def test_a_weighted_field_camera_has_the_dense_data_step(blur):
    draw = np.random.Generator(np.random.Philox(2))
    masks = draw.integers(0, 2, (2, 7, 6)).astype(float)
    taps = draw.uniform(0.1, 1, (3, 1, 1, 3 if blur else 1, 2))
    spread = Spread(taps=taps, first_row=np.full((3, 1, 1), -1 if blur else 0), first_column=np.arange(3)[:, None, None])
    operator = FieldAperture(
        masks, draw.uniform(0.2, 1, (3, 3)), spread, readout=Readout(gain=draw.uniform(0.5, 1, (7, 9))), dtype=np.float64
    )
    d = draw.uniform(0.2, 2, operator.out_shape)
    d[:, :, 3, 3] = 0
    frames, cube = draw.standard_normal(operator.out_shape), draw.standard_normal(operator.in_shape)
    weighted = RowWeighted(operator, d)
    step = data_step(weighted, d * frames, 0.5)
    assert isinstance(step, ConjugateStep) == blur
    if blur:  # the same preconditioner, to the end
        step = ConjugateStep(weighted, d * frames, 0.5, RowInverse.near(operator, 0.5, d), tolerance=1e-11, iterations=200)
    np.testing.assert_allclose(project(step, cube), dense_step(operator, d, frames, cube, 0.5), atol=1e-9)


@pytest.mark.parametrize(("sensor", "shots"), [("mono", 2), ("bayer", 2), ("foveon", 1)])
def test_the_largest_eigenvalue_of_a_weighted_camera_is_exact(sensor, shots, camera_of):
    operator, d, _ = weighted_case(camera_of, sensor, shots, False)
    expected = np.linalg.norm(flat(d)[:, None] * operator.dense(), 2) ** 2
    assert largest_eigenvalue(RowWeighted(operator, d)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("spread", [False, True])
@pytest.mark.parametrize(
    "solver",
    [Admm(tolerance=1e-7, max_iterations=20000), Fista(tolerance=1e-11, max_iterations=50000), Gpsr(tolerance=1e-11, max_iterations=50000)],
)
def test_every_solver_finds_the_weighted_minimum(solver, spread, camera_of, cube_of):
    operator = camera_of("foveon", 1, 8, 4, spread=spread)
    draw = np.random.Generator(np.random.Philox(7))
    variance = draw.uniform(0.1, 4, operator.out_shape) * 1e-4
    frames = operator.forward(cube_of(8, 4)) + np.sqrt(variance) * draw.standard_normal(operator.out_shape)
    basis, tau = Kronecker(wavelet="haar", level=2), 0.05
    ours = reconstruct(operator, frames, prior=L1(basis=basis), noise=variance, tau=tau, solver=solver)
    weight = 1 / variance
    weight /= weight.mean()
    a = np.stack([operator.forward(basis.synthesis(e.reshape(8, 8, 4))).ravel() for e in np.eye(256)], axis=1)
    n, w, g = 256, weight.ravel(), frames.ravel()

    def value_and_slope(z):
        r = a @ (z[:n] - z[n:]) - g
        slope = 2 * a.T @ (w * r)
        return r @ (w * r) + tau * z.sum(), np.concatenate([slope + tau, tau - slope])

    options = {"maxiter": 50000, "maxfun": 100000, "ftol": 1e-15, "gtol": 1e-10}
    judge = minimize(value_and_slope, np.zeros(2 * n), jac=True, method="L-BFGS-B", bounds=[(0, None)] * (2 * n), options=options)
    assert ours.objective == pytest.approx(judge.fun, rel=1e-5)
    gap = frames - operator.forward(ours.cube)
    assert ours.objective == pytest.approx((weight * gap**2).sum() + tau * np.abs(basis.analysis(ours.cube)).sum(), rel=1e-8)
    assert ours.tau_max == pytest.approx(2 * np.abs(a.T @ (w * g)).max(), rel=1e-9)


def test_equal_variances_change_nothing_whatever_their_unit(camera_of, cube_of):
    operator = camera_of("bayer", 1, 16, 6)
    frames = operator.forward(cube_of(16, 6))
    plain = reconstruct(operator, frames, tau=0.01)
    for variance in (1.0, 1e-20, 1e20, np.full(operator.out_shape, 3.0), np.full((16, 1), 7.0)):
        same = reconstruct(operator, frames, tau=0.01, noise=variance)
        np.testing.assert_allclose(same.cube, plain.cube, atol=1e-9)
        assert same.objective == pytest.approx(plain.objective, rel=1e-9)


def test_an_infinite_variance_leaves_the_measurement_out_and_basis_pursuit_keeps_the_others(camera_of, cube_of):
    operator = camera_of("foveon", 1, 16, 6)
    frames = operator.forward(cube_of(16, 6))
    spoiled, noise = frames.copy(), np.ones(frames.shape)
    spoiled[:, :, 5, 6], noise[:, :, 5, 6] = 1e6, np.inf
    for solver, tau in ((BasisPursuit(), None), (Admm(), 0.01), (Fista(), 0.01)):
        found = reconstruct(operator, spoiled, noise=noise, solver=solver, tau=tau)
        kept = np.where(np.isinf(noise), 0, frames)
        other = reconstruct(operator, kept, noise=noise, solver=solver, tau=tau)
        np.testing.assert_allclose(found.cube, other.cube, atol=1e-9)
        assert np.abs(found.cube).max() < 2
    assert np.abs(operator.forward(found.cube) - frames)[noise == 1].max() < 0.3


def test_weighting_noise_of_unequal_strength_lowers_the_error(camera_of, cube_of, psnr_of):
    operator, truth = camera_of("mono", 6, 32, 6), cube_of(32, 6)
    draw = np.random.Generator(np.random.Philox(4))
    sigma = np.where(draw.random(operator.out_shape) < 0.5, 0.3, 0.01)
    frames = operator.forward(truth) + sigma * draw.standard_normal(operator.out_shape)
    scores = {}
    for name, noise in (("plain", None), ("weighted", sigma**2)):
        cubes = [reconstruct(operator, frames, tau=tau, noise=noise).cube for tau in (0.01, 0.03, 0.1, 0.3, 1.0)]
        scores[name] = max(psnr_of(cube, truth) for cube in cubes)
    assert scores["weighted"] > scores["plain"] + 3


@pytest.mark.parametrize("noise", [0.0, -1.0, np.nan, np.inf, np.ones((3, 3)), [1.0, -2.0]])
def test_variances_that_cannot_be_are_refused(noise, camera_of):
    operator = camera_of("mono", 1, 8, 3)
    with pytest.raises(InputError, match=r"^noise: must be"):
        reconstruct(operator, np.ones(operator.out_shape), noise=np.asarray(noise))


@pytest.mark.parametrize("scale", [1e-300, 1e-30, 1.0, 1e30, 1e300])
def test_weights_have_mean_one_over_what_counts_at_any_scale(scale):
    root = root_weights(np.array([1.0, 4.0, np.inf, 1.0]) * scale, (4,))
    np.testing.assert_allclose(root**2, np.array([4, 1, 0, 4]) / 3)


@pytest.mark.parametrize("kind", ["coded", "field", "foreign"])
def test_X7_variances_that_leave_no_measurement_with_light_are_refused(kind, camera_of):
    camera = camera_of("mono", 2, 8, 3)
    camera = camera.replace(masks=camera.masks * (np.arange(8) < 3))  # the detector's right side is dark
    operator = camera
    if kind == "field":
        spread = Spread(taps=np.ones((3, 1, 1, 1, 1)), first_row=np.zeros((3, 1, 1), int), first_column=np.arange(3)[:, None, None])
        operator = FieldAperture(camera.masks, camera.response, spread, width=camera.width, dtype=np.float64)
    elif kind == "foreign":
        shapes = {"in_shape": camera.in_shape, "out_shape": camera.out_shape, "dtype": camera.dtype}
        operator = type("Foreign", (), {**shapes, "forward": staticmethod(camera.forward), "adjoint": staticmethod(camera.adjoint)})()
    lit = camera.dense().any(1).reshape(2, 1, -1, 8).transpose(0, 1, 3, 2)
    noise = np.where(lit, np.inf, 1.0)
    for value in (1.0, 0.0):  # of the pixels that count
        frames = np.where(lit, 1.0, value)
        with pytest.raises(InputError, match=rf"^noise: must be finite at measurements that see light.*{(~lit).sum()} of 160"):
            reconstruct(operator, frames, noise=noise)
    noise[tuple(np.argwhere(lit)[5])] = 1.0
    assert reconstruct(operator, np.ones(camera.out_shape), noise=noise).cube.any()
    with pytest.raises(InputError, match=r"^operator: must be different from 0.*sees nothing"):
        reconstruct(RowWeighted(operator, ~lit), np.ones(camera.out_shape))


def test_X7_closed_shots_are_listed_in_the_notes(camera_of, cube_of):
    camera = camera_of("bayer", 4, 8, 3)
    masks = camera.masks.copy()
    masks[[1, 3]] = 0
    some = camera.replace(masks=masks)
    notes = reconstruct(some, some.forward(cube_of(8, 3))).notes
    assert any(note.startswith("2 of 4 shots have a mask that is closed everywhere") and note.endswith(": 1, 3") for note in notes)
    assert not any("closed" in note for note in reconstruct(camera, camera.forward(cube_of(8, 3))).notes)

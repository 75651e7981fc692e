"""Tau without ground truth: the grid, the held-out pixels and the warm-started path against brute force."""

import numpy as np
import pytest

from recon import L1, Admm, CodedAperture, Fista, Gpsr, InputError, Kronecker, reconstruct
from recon.metrics import psnr
from recon.tau import AutoTau, Given, TauFraction, TauPath, tau_max, tune

SHAPE = (32, 32, 6)
BASIS = Kronecker(wavelet="db2", level=3)
SOLVER = Gpsr(max_iterations=80, tolerance=1e-4)
FRACTIONS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)


def scene():
    rng = np.random.Generator(np.random.Philox(1))
    patches = np.kron(rng.uniform(0.05, 1, (4, 4, SHAPE[2])), np.ones((8, 8, 1)))
    return patches * np.linspace(0.7, 1, 32)[:, None, None]


def chart(side=64, bands=12):
    """Patches of smooth spectra on a dark frame under shaded light."""
    rng = np.random.Generator(np.random.Philox(6))
    centre, width, floor = rng.uniform(0, bands, (16, 1)), rng.uniform(2, 6, (16, 1)), rng.uniform(0.05, 0.4, (16, 1))
    spectra = floor + 0.6 * np.exp(-(((np.arange(bands) - centre) / width) ** 2))
    cube = np.full((side, side, bands), 0.03)
    patch = side // 5
    for i, spectrum in enumerate(spectra):
        y, x = 3 + i // 4 * (patch + 3), 3 + i % 4 * (patch + 3)
        cube[y : y + patch, x : x + patch] = spectrum
    return cube * np.linspace(0.7, 1, side)[:, None, None]


def camera(sensor, shots=1, dtype=np.float32, shape=SHAPE):
    rng = np.random.Generator(np.random.Philox(3))
    rows, columns, bands = shape
    masks = (rng.random((shots, rows, columns)) < 0.5).astype(float)
    peaks = bands * (np.array([[0.5]]) if sensor == "mono" else np.array([[0.85], [0.5], [0.15]]))
    response = np.exp(-(((np.arange(bands) - peaks) / bands / (1.5 if sensor == "mono" else 0.4)) ** 2))
    y, x = np.mgrid[:rows, : columns + bands - 1]
    mosaic = np.where((y + x) % 2 == 1, 1, np.where(y % 2 == 0, 0, 2)) if sensor == "bayer" else None
    return CodedAperture(masks, response, np.arange(bands), np.ones((bands, 1)), mosaic=mosaic, dtype=dtype)


def measured(operator, noise, seed=0, truth=None):
    frames = operator.forward(scene() if truth is None else truth).astype(float)
    return frames + noise * frames.max() * np.random.Generator(np.random.Philox(seed)).standard_normal(frames.shape)


@pytest.mark.parametrize("sensor", ["mono", "bayer", "foveon"])
@pytest.mark.parametrize("noise", [0.0, 0.003, 0.02])
def test_automatic_tau_costs_under_three_tenths_of_a_decibel_against_the_oracle_of_its_grid(sensor, noise):
    truth = chart()
    operator = camera(sensor, shots=3 if sensor == "mono" else 1, shape=truth.shape)
    path = TauPath(fractions=(1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5), solver=SOLVER)
    report = tune(operator, measured(operator, noise, truth=truth), auto=AutoTau(path=path), score=lambda cube: psnr(cube, truth))
    assert report.scores[report.oracle] == max(report.scores)
    assert report.scores[report.automatic] > max(report.scores) - 0.3
    assert report.oracle_at_edge == (report.oracle in (0, 5))
    assert report.choice.tau == pytest.approx(report.solutions[report.automatic].tau, rel=1e-6)


def test_more_noise_asks_for_a_larger_tau():
    operator = camera("mono", shots=3)
    rule = AutoTau(path=TauPath(fractions=(1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4), solver=SOLVER))
    chosen = [rule.choose(operator, measured(operator, noise), Given(prior=L1(basis=BASIS))).fraction for noise in (0.01, 0.1, 0.3)]
    assert chosen == sorted(chosen)
    assert chosen[0] < chosen[1]


def test_held_out_error_equals_that_of_a_solve_which_never_saw_the_pixels():
    operator = camera("foveon", dtype=np.float64)
    frames = measured(operator, 0.01)
    rule = AutoTau(path=TauPath(fractions=(1e-2,), solver=Gpsr(tolerance=1e-9)), share=0.1, seed=4)
    choice = rule.choose(operator, frames, Given(prior=L1(basis=BASIS)))
    held = rule.held_out(operator.out_shape)
    spoiled = frames.copy()
    spoiled[:, :, held] = 7 * frames.max()

    class Blind:
        in_shape, out_shape, dtype = operator.in_shape, operator.out_shape, operator.dtype

        def forward(self, x, out=None):
            y = operator.forward(x)
            y[:, :, held] = 0
            if out is None:
                return y
            out[...] = y
            return out

        def adjoint(self, y, out=None):
            z = y.copy()
            z[:, :, held] = 0
            return operator.adjoint(z, out)

    solution = reconstruct(Blind(), np.where(held, 0, spoiled), prior=L1(basis=BASIS), tau=choice.tau, solver=Gpsr(tolerance=1e-9))
    gap = (frames - operator.forward(solution.cube))[:, :, held]
    assert choice.errors[0] == pytest.approx(np.sum(gap**2) / np.sum(frames[:, :, held] ** 2), rel=1e-4)
    np.testing.assert_allclose(choice.start, solution.cube, atol=1e-5)


def test_the_choice_is_the_smallest_tau_within_the_slack_and_one_standard_error_of_the_least_error():
    # Three values of tau, four pixels: totals 40, 42 and 43 (5 and 7.5 % above the least).
    squares = np.array([[10.0, 10, 10, 10], [8.5, 12.5, 10.5, 10.5], [10.7, 10.8, 10.7, 10.8]])
    chance = [2 * np.std(row - squares[0], ddof=1) for row in squares]
    assert chance[1] > 2
    assert chance[2] < 3
    assert AutoTau(slack=0.1).smallest_good(squares) == 1
    assert AutoTau(slack=0.04).smallest_good(squares) == 0
    assert AutoTau(slack=0.0).smallest_good(squares) == 0
    assert AutoTau(slack=0.1).smallest_good(squares[:, :1]) == 1


def test_the_choice_at_an_end_of_the_path_is_flagged():
    operator = camera("bayer")
    frames = measured(operator, 0.05)
    for fractions, edge in (((1e-1, 1e-2, 1e-3, 1e-4, 1e-5), False), ((1e-5, 1e-6), True), ((0.9, 0.8), True)):
        choice = AutoTau(path=TauPath(fractions=fractions)).choose(operator, frames, Given(prior=L1(basis=BASIS)))
        assert choice.at_edge == edge
        assert ("better still" in choice.reason) == edge


@pytest.mark.parametrize("solver", [Fista(max_iterations=100), Admm(max_iterations=60)])
def test_any_solver_of_the_objective_may_walk_the_path(solver):
    operator = camera("foveon")
    frames = measured(operator, 0.02)
    rules = [AutoTau(path=TauPath(fractions=(1e-1, 1e-2, 1e-3), solver=s)) for s in (SOLVER, solver)]
    one, other = (rule.choose(operator, frames, Given(prior=L1(basis=BASIS))) for rule in rules)
    assert other.errors == pytest.approx(one.errors, rel=0.05)


def test_held_out_pixels_are_the_share_asked_for_and_follow_the_seed():
    draws = [AutoTau(share=0.05, seed=seed).held_out((3, 1, 40, 50)) for seed in (0, 0, 1)]
    assert all(d.sum() == 100 for d in draws)
    np.testing.assert_array_equal(draws[0], draws[1])
    assert (draws[0] != draws[2]).any()
    assert AutoTau().held_out((1, 1, 1, 2)).sum() == 1
    with pytest.raises(InputError, match="detector pixels"):
        AutoTau().held_out((4, 3, 1, 1))


@pytest.mark.parametrize("scale", [1e-12, 1e30])
def test_X8_the_automatic_choice_does_not_depend_on_the_unit(scale):
    operator = camera("bayer")
    frames = measured(operator, 0.02)
    rule = AutoTau(path=TauPath(fractions=FRACTIONS))
    plain, scaled = (rule.choose(operator, f, Given(prior=L1(basis=BASIS))) for f in (frames, frames * scale))
    assert scaled.fraction == plain.fraction
    assert scaled.tau == pytest.approx(plain.tau * scale, rel=1e-5)
    assert scaled.errors == pytest.approx(plain.errors, rel=1e-3)
    brighter = rule.choose(operator.replace(response=operator.response * scale), frames, Given(prior=L1(basis=BASIS)))
    assert brighter.fraction == plain.fraction
    assert brighter.tau == pytest.approx(plain.tau * scale, rel=1e-5)


def test_the_choice_is_the_same_for_any_number_of_threads():
    operator = camera("mono", shots=2)
    frames = measured(operator, 0.02)
    rule = AutoTau(path=TauPath(fractions=FRACTIONS, solver=SOLVER))
    one, two = (rule.choose(operator, frames, Given(prior=L1(basis=BASIS), threads=n)) for n in (1, 2))
    assert one.errors == two.errors
    assert one.start.tobytes() == two.start.tobytes()


def test_a_fraction_resolves_to_that_part_of_twice_the_largest_correlation():
    operator = camera("foveon", dtype=np.float64)
    frames = measured(operator, 0)
    expected = 2 * np.abs(BASIS.analysis(operator.adjoint(frames))).max()
    assert tau_max(operator, frames, Given(prior=L1(basis=BASIS))) == pytest.approx(expected, rel=1e-12)
    choice = TauFraction(fraction=0.25).choose(operator, frames, Given(prior=L1(basis=BASIS)))
    assert choice.tau == pytest.approx(expected / 4, rel=1e-12)
    assert reconstruct(operator, frames, prior=L1(basis=BASIS), tau=choice.tau, solver=Gpsr()).tau_max == pytest.approx(expected, rel=1e-12)


def test_X5_dark_frames_need_no_tau():
    operator = camera("mono")
    dark = np.zeros(operator.out_shape)
    assert tau_max(operator, dark) == 0
    assert AutoTau().choose(operator, dark).tau == 0
    with pytest.raises(InputError, match="light"):
        tune(operator, dark)


def test_X6_a_value_that_is_not_finite_is_refused():
    operator = camera("mono")
    frames = measured(operator, 0)
    frames[0, 0, 1, 2] = np.inf
    for rule in (AutoTau(), TauFraction(fraction=0.1)):
        with pytest.raises(InputError, match="frames"):
            rule.choose(operator, frames)


def test_every_point_of_a_path_is_the_minimum_for_its_tau():
    operator = camera("bayer")
    frames = measured(operator, 0.01)
    path = TauPath(fractions=(1e-1, 1e-2, 1e-3), solver=Gpsr(tolerance=1e-6))
    seen = []
    solutions = path.follow(operator, frames, Given(prior=L1(basis=BASIS)), on_point=lambda i, s: seen.append((i, s.tau)))
    assert [i for i, _ in seen] == [0, 1, 2]
    for fraction, solution in zip(path.fractions, solutions):
        assert solution.tau == pytest.approx(fraction * solution.tau_max, rel=1e-6)
        alone = reconstruct(operator, frames, prior=L1(basis=BASIS), tau=solution.tau, solver=Gpsr(tolerance=1e-6))
        assert solution.objective == pytest.approx(alone.objective, rel=1e-3)


def test_a_path_says_where_its_iterations_ended_it():
    operator = camera("mono")
    solver = Gpsr(max_iterations=3)
    solutions = TauPath(fractions=(1e-2, 1e-4), solver=solver).follow(operator, measured(operator, 0), Given(prior=L1(basis=BASIS)))
    assert not any(s.stop.converged for s in solutions)
    assert all("max_iterations = 3" in s.stop.reason for s in solutions)


@pytest.mark.parametrize("fractions", [(), (0.1, 0.1), (0.01, 0.1), (1.0, 0.1), (0.1, 0.0), (float("nan"),)])
def test_a_path_that_does_not_fall_inside_0_to_1_is_refused(fractions):
    with pytest.raises(InputError, match="fractions"):
        TauPath(fractions=fractions)


def test_other_misuse_is_refused_by_name():
    operator = camera("mono")
    frames = measured(operator, 0)
    with pytest.raises(InputError, match="solver"):
        TauPath(solver=Kronecker())
    with pytest.raises(InputError, match="guide"):
        TauPath(fractions=(0.1, 0.01)).follow(operator, frames, guide=(scene(),))
    for share in (0, 0.51, float("nan")):
        with pytest.raises(InputError, match="share"):
            AutoTau(share=share)
    with pytest.raises(InputError, match="fraction"):
        TauFraction(fraction=-0.1)

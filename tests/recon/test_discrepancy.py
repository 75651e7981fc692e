"""Tau from known noise, where soft thresholding gives every number in closed form."""

import numpy as np
import pytest
from scipy.optimize import brentq

from recon import L1, Admm, CodedAperture, InputError, Kronecker, reconstruct
from recon.tau import AutoTau, Discrepancy, Given, TauPath, tau_max

SIDE, SIGMA = 32, 0.05
BASIS = Kronecker(wavelet="db2", level=3)
FINE = TauPath(fractions=tuple(np.geomspace(0.5, 1e-3, 30)), solver=Admm(tolerance=1e-6))


def window():
    """A camera that sees everything: H is the identity, so that Eq. 4 is soft thresholding."""
    return CodedAperture(np.ones((1, SIDE, SIDE)), np.ones((1, 1)), np.arange(1), np.ones((1, 1)), dtype=np.float64)


def picture(sigma=SIGMA):
    rng = np.random.Generator(np.random.Philox(2))
    flat = np.kron(rng.uniform(0.2, 1, (4, 4)), np.ones((8, 8)))
    return (flat + sigma * rng.standard_normal(flat.shape))[None, None]


def closed_form(frames, counted):
    """Return the tau at which the misfit of soft thresholding is sigma^2 (n - degrees of freedom), or sigma^2 n."""
    theta = BASIS.analysis(np.moveaxis(frames[0], 0, 2))

    def excess(tau):
        left = np.minimum(np.abs(theta), tau / 2)
        freedom = (np.abs(theta) > tau / 2).sum() if counted else 0
        return (left**2).sum() - SIGMA**2 * (theta.size - freedom)

    grid = np.geomspace(2 * np.abs(theta).max(), 1e-4, 4000)
    first = next(i for i, tau in enumerate(grid) if excess(tau) <= 0)
    return brentq(excess, grid[first], grid[first - 1]) if first else grid[0]


@pytest.mark.parametrize("probes", [0, 6])
def test_the_rule_finds_the_threshold_that_the_closed_form_gives(probes):
    frames = picture()
    rule = Discrepancy(path=FINE, probes=probes)
    choice = rule.choose(window(), frames, Given(prior=L1(basis=BASIS), noise=np.full(frames.shape, SIGMA**2)))
    assert choice.tau == pytest.approx(closed_form(frames, counted=probes > 0), rel=0.02 if probes == 0 else 0.1)
    assert not choice.at_edge
    assert choice.fraction == pytest.approx(choice.tau / tau_max(window(), frames, Given(prior=L1(basis=BASIS))))


def test_without_probes_the_answer_leaves_what_the_noise_is():
    frames = picture()
    choice = Discrepancy(path=FINE, probes=0).choose(window(), frames, Given(prior=L1(basis=BASIS), noise=np.array(SIGMA**2)))
    solution = reconstruct(window(), frames, prior=L1(basis=BASIS), tau=choice.tau)
    assert np.mean((np.moveaxis(frames[0], 0, 2) - solution.cube) ** 2) == pytest.approx(SIGMA**2, rel=0.01)


def test_counting_the_degrees_of_freedom_smooths_less():
    frames = picture()
    taus = [
        Discrepancy(path=FINE, probes=n).choose(window(), frames, Given(prior=L1(basis=BASIS), noise=np.array(SIGMA**2))).tau
        for n in (0, 4)
    ]
    assert taus[1] < 0.9 * taus[0]


def test_unequal_noise_is_weighed():
    variance = np.full((1, 1, SIDE, SIDE), SIGMA**2)
    variance[..., ::2] *= 9
    rng = np.random.Generator(np.random.Philox(5))
    frames = picture(0.0) + np.sqrt(variance) * rng.standard_normal(variance.shape)
    choice = Discrepancy(path=FINE, probes=0).choose(window(), frames, Given(prior=L1(basis=BASIS), noise=variance))
    solution = reconstruct(window(), frames, prior=L1(basis=BASIS), tau=choice.tau, noise=variance)
    assert np.mean((frames[0, 0] - solution.cube[..., 0]) ** 2 / variance) == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize("scale", [1e-12, 1e20])
def test_X8_the_choice_does_not_depend_on_the_unit(scale):
    frames, variance = picture(), np.full((1, 1, SIDE, SIDE), SIGMA**2)
    plain = Discrepancy().choose(window(), frames, Given(prior=L1(basis=BASIS), noise=variance))
    scaled = Discrepancy().choose(window(), scale * frames, Given(prior=L1(basis=BASIS), noise=scale**2 * variance))
    assert scaled.tau == pytest.approx(scale * plain.tau, rel=1e-3)
    assert scaled.errors == pytest.approx(plain.errors, rel=1e-3)


def test_measurements_of_infinite_variance_do_not_count():
    frames, variance = picture(), np.full((1, 1, SIDE, SIDE), SIGMA**2)
    variance[..., 5:9] = np.inf
    spoiled = frames.copy()
    spoiled[..., 5:9] = 3.0
    taus = [Discrepancy().choose(window(), f, Given(prior=L1(basis=BASIS), noise=variance)).tau for f in (frames, spoiled)]
    assert taus[0] == pytest.approx(taus[1], rel=1e-3)


def test_a_noise_that_the_path_does_not_reach_is_flagged():
    frames = picture()
    short = TauPath(fractions=(0.3, 0.2))
    low, high = (Discrepancy(path=short).choose(window(), frames, Given(noise=np.array(v))) for v in (1e-8, 1e2))
    assert low.at_edge
    assert low.fraction == 0.2
    assert low.reason.startswith("even the smallest tau of the path, 0.2 of tau_max, leaves ")
    assert "variances are wrong" in low.reason
    assert high.at_edge
    assert high.fraction == 0.3
    assert high.reason.startswith("the largest tau of the path, 0.3 of tau_max, leaves no more of the frames than what the noise should (")
    assert "larger values" in high.reason


def test_a_rule_for_known_noise_asks_for_it():
    with pytest.raises(InputError, match="noise"):
        Discrepancy().choose(window(), picture())
    with pytest.raises(InputError, match="noise"):
        Discrepancy().choose(window(), picture(), Given(noise=np.array(-1.0)))
    with pytest.raises(InputError, match="probes"):
        Discrepancy(probes=-1)


def test_X5_dark_frames_need_no_tau():
    assert Discrepancy().choose(window(), np.zeros((1, 1, SIDE, SIDE)), Given(noise=np.array(1.0))).tau == 0


def test_a_rule_serves_reconstruct():
    frames = picture()
    solution = reconstruct(window(), frames, prior=L1(basis=BASIS), solver=Admm(), tau=Discrepancy(), noise=np.array(SIGMA**2))
    assert solution.tau == pytest.approx(Discrepancy().choose(window(), frames, Given(prior=L1(basis=BASIS), noise=np.array(SIGMA**2))).tau)
    assert any("noise should leave" in note for note in solution.notes)


@pytest.mark.parametrize("shape", [(50,), (5, 10), (2, 5, 10)])
def test_frames_of_any_shape_have_pixels_to_hold_out(shape):
    rng = np.random.Generator(np.random.Philox(3))
    matrix = rng.standard_normal((int(np.prod(shape)), 4 * 4 * 2)) / 8

    class Plain:
        in_shape, out_shape, dtype = (4, 4, 2), shape, np.float64

        def forward(self, cube):
            return (matrix @ np.asarray(cube).ravel()).reshape(shape)

        def adjoint(self, frames):
            return (matrix.T @ np.asarray(frames).ravel()).reshape(4, 4, 2)

    frames = Plain().forward(rng.standard_normal((4, 4, 2)))
    assert AutoTau(share=0.2).choose(Plain(), frames).tau > 0
    choice = Discrepancy().choose(Plain(), frames + 0.01 * rng.standard_normal(shape), Given(noise=np.full(shape, 1e-4)))
    assert choice.tau > 0


def test_left_out_measurements_do_not_reach_the_answer():
    frames, held = picture(), np.zeros((SIDE, SIDE), bool)
    held[::3] = True
    given = Given(prior=L1(basis=BASIS)).without(held, frames.shape)
    answers = [reconstruct(window(), np.where(held, f, frames), prior=given.prior, tau=0.05, noise=given.noise).cube for f in (0.0, 9.0)]
    np.testing.assert_allclose(answers[0], answers[1], atol=1e-6)

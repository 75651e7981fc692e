"""The quality mode: what it is made of, that it beats l1, and the choice between priors by held-out pixels."""

import numpy as np
import pytest

from recon import (
    L1,
    Admm,
    AutoTau,
    BasisPursuit,
    InputError,
    Kronecker,
    Quality,
    SpectralTotalVariation,
    TotalVariation,
    learned,
    reconstruct,
)
from recon.coded_aperture import empty_cube
from recon.quality import choose_prior, never_below
from recon.tau import Given


def spectra(bands: int) -> np.ndarray:
    """Smooth spectra that are none of those of ``cube_of``."""
    draw = np.random.Generator(np.random.Philox(77))
    position = np.linspace(0, 1, bands)
    centers, widths = draw.random((2, 60, 1))
    return draw.uniform(0.05, 0.5, (60, 1)) + np.exp(-(((position - centers) / (0.15 + 0.5 * widths)) ** 2))


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_its_value_is_the_weighted_sum_of_total_variation_and_l1(share):
    spectral = learned(spectra(6))
    weights = spectral.weights(6, 0.7)
    values = np.random.Generator(np.random.Philox(1)).random((16, 24, 6))
    cube = empty_cube(values.shape, np.float64)
    cube[...] = values
    tv = SpectralTotalVariation(spectral=spectral, weights=weights).bind(values.shape, np.float64).value(cube)
    l1 = L1(basis=Kronecker.for_shape(values.shape, spectral=spectral), weights=weights).bind(values.shape, np.float64).value(cube)
    found = Quality(spectral=spectral, power=0.7, share=share).bind(values.shape, np.float64).value(cube)
    assert found == pytest.approx(share * tv + (1 - share) * l1, rel=1e-12)


@pytest.mark.parametrize(("sensor", "shots"), [("mono", 3), ("bayer", 1), ("foveon", 1)])
def test_it_beats_converged_l1_by_far_on_patches(camera_of, cube_of, psnr_of, sensor, shots):
    truth = cube_of(64, 12)
    operator = camera_of(sensor, shots, 64, 12, dtype=np.float32)
    frames = operator.forward(truth.astype(np.float32))
    paper = reconstruct(operator, frames, solver=BasisPursuit(tolerance=2e-4, max_iterations=1000))
    best = reconstruct(operator, frames, prior=Quality(spectral=learned(spectra(12))))
    assert best.stop.converged
    assert best.residual < 1e-3
    assert psnr_of(best.cube, truth) > psnr_of(paper.cube, truth) + 3


@pytest.mark.parametrize("scale", [1e-30, 1e-12, 1e-3, 1e12, 1e30])
def test_X8_the_answer_scales_with_the_frames(camera_of, cube_of, scale):
    truth = cube_of(32, 6)
    operator = camera_of("mono", 2, 32, 6)
    frames = operator.forward(truth)
    plain, scaled = (reconstruct(operator, frames * c, prior=Quality()) for c in (1.0, scale))
    np.testing.assert_allclose(scaled.cube, plain.cube * scale, rtol=1e-6, atol=1e-9 * scale)
    few = Admm(max_iterations=30)
    plain, scaled = (reconstruct(operator, frames * c, prior=Quality(), solver=few, tau=0.01 * c) for c in (1.0, scale))
    np.testing.assert_allclose(scaled.cube, plain.cube * scale, rtol=1e-6, atol=1e-9 * scale)


def test_the_answer_does_not_depend_on_the_unit_of_the_prior(camera_of, cube_of):
    """Basis pursuit minimises R whatever its unit: half of all weights, another path, the same minimum of R."""
    truth = cube_of(32, 6)
    operator = camera_of("foveon", 1, 32, 6)
    frames = operator.forward(truth)
    whole = Quality(spectral=learned(spectra(6)))
    values = []
    for gamma in (1.0, 0.5):
        found = reconstruct(operator, frames, prior=whole, solver=BasisPursuit(tolerance=1e-6, max_iterations=6000, gamma=gamma))
        cube = empty_cube(found.cube.shape, np.float64)
        cube[...] = found.cube
        values.append(whole.bind(cube.shape, np.float64).value(cube))
    assert values[0] == pytest.approx(values[1], rel=2e-4)


def test_admm_and_basis_pursuit_agree_where_tau_vanishes(camera_of, cube_of):
    truth = cube_of(32, 6)
    operator = camera_of("mono", 3, 32, 6)
    frames = operator.forward(truth)
    prior = Quality(share=0.4)
    limit = reconstruct(operator, frames, prior=prior, solver=BasisPursuit(tolerance=1e-6, max_iterations=6000))
    near = reconstruct(operator, frames, prior=prior, solver=Admm(tolerance=1e-6, max_iterations=6000), tau=1e-6)
    np.testing.assert_allclose(near.cube, limit.cube, atol=5e-3)


def test_held_out_pixels_prefer_the_prior_that_fits_the_scene(camera_of, cube_of):
    truth = cube_of(32, 8)
    operator = camera_of("mono", 3, 32, 8)
    frames = operator.forward(truth)
    wrong = L1(basis=Kronecker(level=0))
    choice = choose_prior(operator, frames, (wrong, Quality()))
    assert isinstance(choice.prior, Quality)
    assert choice.errors[1] < choice.errors[0]
    assert "held-out" in choice.reason


def test_never_below_falls_back_where_the_rival_predicts_better(camera_of):
    operator = camera_of("mono", 3, 32, 8)
    chess = (np.indices((32, 32)).sum(0) % 2 + 0.1)[:, :, None] * np.ones(8)
    frames = operator.forward(chess)
    found = never_below(operator, frames, TotalVariation())
    plain = reconstruct(operator, frames)
    np.testing.assert_array_equal(found.cube, plain.cube)
    assert any("held-out" in note for note in found.notes)


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_dead_pixels_of_infinite_variance_do_not_decide_between_priors(camera_of, cube_of, share):
    """The error is that of (S.66) over what counts, recomputed with a dense H from solves that don't see the drawn pixels."""
    operator = camera_of("mono", 3, 16, 4)
    frames = operator.forward(cube_of(16, 4))
    noise = np.random.Generator(np.random.Philox(5)).uniform(1, 4, frames.shape)
    drawn = AutoTau(share=share).held_out(frames.shape)
    dead = tuple(np.argwhere(drawn)[2])
    noise[(..., *dead)] = np.inf
    noise[1, 0, 9, 4] = np.inf  # and one measurement of a pixel that counts otherwise
    priors = (TotalVariation(), L1(basis=Kronecker.for_shape(operator.in_shape)))
    plain = choose_prior(operator, frames, priors, noise=noise, share=share)
    spoiled = frames.copy()
    spoiled[np.isinf(noise)] = 1e3
    choice = choose_prior(operator, spoiled, priors, noise=noise, share=share)
    assert type(choice.prior) is type(plain.prior)
    np.testing.assert_allclose(choice.errors, plain.errors, rtol=1e-6)
    held = AutoTau(share=share).held_out(frames.shape, np.isfinite(noise))
    assert not held[dead]
    blind = np.where(np.broadcast_to(held, frames.shape), np.inf, noise)
    for prior, error in zip(priors, choice.errors):
        cube = reconstruct(operator, frames, prior=prior, noise=blind).cube
        seen = (operator.dense() @ cube.transpose(2, 1, 0).ravel()).reshape(3, 1, -1, 16).transpose(0, 1, 3, 2)
        use = np.broadcast_to(held, frames.shape) & np.isfinite(noise)
        expected = ((frames - seen)[use] ** 2 / noise[use]).sum() / (frames[use] ** 2 / noise[use]).sum()
        assert error == pytest.approx(expected, rel=1e-6)
    assert f"on {int(use.sum())} held-out measurements" in choice.reason


def test_a_rule_for_tau_holds_out_other_pixels_than_the_choice_of_priors(camera_of, cube_of):
    """The same seed drew the same pixels: the rule then saw errors of 0 everywhere and always took the smallest tau."""
    operator = camera_of("mono", 3, 16, 4)
    clean = operator.forward(cube_of(16, 4))
    frames = clean + 0.2 * np.random.Generator(np.random.Philox(9)).standard_normal(clean.shape)
    rule = AutoTau()
    first = rule.held_out(frames.shape)
    blind = Given().without(first, frames.shape)
    choice = rule.choose(operator, frames, blind)
    assert min(choice.errors) > 1e-3
    assert not choice.at_edge
    assert not (first & rule.held_out(frames.shape, np.broadcast_to(~first, frames.shape))).any()
    with pytest.raises(InputError, match=r"^noise: must be finite at 2 of the 304 detector pixels or more.*finite at 1"):
        rule.choose(operator, frames, Given(noise=np.where(np.arange(clean.size).reshape(clean.shape) == 7, 1.0, np.inf)))


def test_the_choice_between_priors_keeps_to_cubes_without_negative_values(camera_of, cube_of):
    operator = camera_of("mono", 2, 16, 4)
    clean = operator.forward(cube_of(16, 4))
    frames = clean + 0.05 * np.random.Generator(np.random.Philox(3)).standard_normal(clean.shape)
    free = never_below(operator, frames, TotalVariation(), tau=0.05)
    bound = never_below(operator, frames, TotalVariation(), tau=0.05, nonnegative=True)
    assert free.cube.min() < 0
    assert bound.cube.min() >= 0
    assert bound.notes[-1] != free.notes[-1]


def test_it_takes_noise_and_a_rule_for_tau(camera_of, cube_of, psnr_of):
    from recon import Discrepancy

    truth = cube_of(32, 8)
    operator = camera_of("mono", 3, 32, 8)
    clean = operator.forward(truth)
    frames = clean + 0.02 * np.random.Generator(np.random.Philox(9)).standard_normal(clean.shape)
    variance = np.full(clean.shape, 0.02**2)
    best = reconstruct(operator, frames, prior=Quality(), noise=variance, tau=Discrepancy())
    paper = reconstruct(operator, frames, noise=variance, tau=Discrepancy())
    assert psnr_of(best.cube, truth) > psnr_of(paper.cube, truth) + 1


def test_settings_that_make_no_sense_are_refused():
    for bad in ({"share": 1.1}, {"power": -1}, {"spectral": "pca"}, {"wavelet": "bior4.4"}):
        with pytest.raises(InputError, match=r"Quality|basis"):
            Quality(**bad).bind((8, 8, 4), np.float64)
    operator = None
    with pytest.raises(InputError, match=r"^priors: must be"):
        choose_prior(operator, np.zeros(3), ())
    with pytest.raises(InputError, match="12 bands"):
        Quality(spectral=learned(spectra(12))).bind((8, 8, 4), np.float64)

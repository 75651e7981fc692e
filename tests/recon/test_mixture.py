"""Sums of priors judged by brute force and by closed forms."""

import numpy as np
import pytest
from scipy.optimize import minimize

from recon import L1, GroupL1, InputError, Kronecker, Mixture, SpectralTotalVariation, TotalVariation
from recon.coded_aperture import empty_cube
from recon.spectral_basis import cosine_matrix


def banded(values: np.ndarray) -> np.ndarray:
    cube = empty_cube(values.shape, np.float64)
    cube[...] = values
    return cube


def random_cube(shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    return np.random.Generator(np.random.Philox(seed)).standard_normal(shape)


def test_the_proximal_map_is_the_minimiser_that_brute_force_finds():
    values = random_cube((4, 4, 2))
    dct = cosine_matrix(2, np.float64)
    basis = Kronecker(wavelet="haar", level=1)
    prior = Mixture(
        parts=(TotalVariation(accuracy=1e-13, sweeps=200), L1(basis=basis, weights=(1, 2))), shares=(0.7, 0.4), rounds=1000, accuracy=1e-11
    )

    def objective(u: np.ndarray) -> float:
        u = u.reshape(values.shape)
        down, across = np.zeros_like(u), np.zeros_like(u)
        down[:-1], across[:, :-1] = np.diff(u, axis=0), np.diff(u, axis=1)
        a, b, c, d = u[0::2, 0::2], u[0::2, 1::2], u[1::2, 0::2], u[1::2, 1::2]
        haar = np.stack([a + b + c + d, a + b - c - d, a - b + c - d, a - b - c + d]) / 2
        theta = haar @ dct.T * [1, 2]
        penalty = 0.7 * np.sqrt(down**2 + across**2 + 1e-13).sum() + 0.4 * np.sqrt(theta**2 + 1e-13).sum()
        return 0.5 * float(((u - values) ** 2).sum()) + 0.3 * float(penalty)

    given = banded(values)
    prior.bind(values.shape, np.float64).shrink(given, 0.3)
    options = {"maxiter": 300, "maxfun": 10**6, "ftol": 1e-16, "gtol": 1e-9}
    for start in (values, given):  # strictly convex: nothing lower anywhere means that this is the minimiser
        judge = minimize(objective, start.ravel(), method="L-BFGS-B", options=options)
        assert objective(given.ravel()) <= judge.fun + 1e-6


def test_one_part_is_that_part_with_its_threshold_and_twice_a_half_is_the_whole():
    values, basis = random_cube((8, 8, 3)), Kronecker(wavelet="db2", level=1)
    alone, single, twice = (banded(values) for _ in range(3))
    expected = L1(basis=basis).bind(values.shape, np.float64).shrink(alone, 0.3)
    part = Mixture(parts=(L1(basis=basis),), shares=(0.5,)).bind(values.shape, np.float64)
    assert part.shrink(single, 0.6) == pytest.approx(0.5 * expected)
    np.testing.assert_allclose(single, alone, atol=1e-14)
    assert part.tau_max(values) == pytest.approx(2 * L1(basis=basis).bind(values.shape, np.float64).tau_max(values))
    both = Mixture(parts=(L1(basis=basis), L1(basis=basis)), shares=(0.5, 0.5), rounds=500, accuracy=1e-13)
    assert both.bind(values.shape, np.float64).shrink(twice, 0.3) == pytest.approx(expected, rel=1e-6)
    np.testing.assert_allclose(twice, alone, atol=1e-9)


def test_calls_of_one_round_add_up_to_the_exact_map():
    values = random_cube((12, 12, 4))
    parts = (SpectralTotalVariation(sweeps=50), GroupL1(basis=Kronecker(level=2)), L1(basis=Kronecker(level=2)))
    exact, turns = banded(values), banded(values)
    Mixture(parts=parts, rounds=2000, accuracy=1e-12).bind(values.shape, np.float64).shrink(exact, 0.2)
    penalty = Mixture(parts=parts).bind(values.shape, np.float64)
    for _ in range(300):
        turns = banded(values)
        penalty.shrink(turns, 0.2)
    np.testing.assert_allclose(turns, exact, atol=1e-4)


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_the_map_scales_with_cube_and_threshold(scale):
    values = random_cube((8, 8, 3))
    prior = Mixture(parts=(TotalVariation(), L1(basis=Kronecker(level=1))), rounds=5)
    plain, scaled = banded(values), banded(values * scale)
    a = prior.bind(values.shape, np.float64).shrink(plain, 0.2)
    b = prior.bind(values.shape, np.float64).shrink(scaled, 0.2 * scale)
    assert b == pytest.approx(a * scale, rel=1e-9)
    np.testing.assert_allclose(scaled, plain * scale, rtol=1e-6, atol=1e-9 * scale)


def test_mixtures_that_make_no_sense_are_refused():
    for bad in ({"parts": ()}, {"parts": (1,)}, {"parts": (L1(),), "shares": (0.0,)}, {"parts": (L1(),), "shares": (-1.0,)}):
        with pytest.raises(InputError, match=r"^Mixture\."):
            Mixture(**bad)
    with pytest.raises(InputError, match="as many numbers as parts"):
        Mixture(parts=(L1(),), shares=(1, 2)).bind((8, 8, 2), np.float64)

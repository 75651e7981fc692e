"""Facts about piecewise linear spectra, judged by scipy's adaptive quadrature and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from scenes.errors import InputError
from scenes.library import line
from scenes.spectrum import Spectrum

RNG = np.random.Generator(np.random.Philox(7))


def rough(n: int = 30, seed: int = 0) -> Spectrum:
    rng = np.random.Generator(np.random.Philox(seed))
    return Spectrum(np.sort(rng.uniform(400, 700, n)), rng.uniform(0, 1, n), "rough")


def quad_mean(f, low, high, breaks):
    inside = [b for b in breaks if low < b < high]
    cuts = [low, *inside, high]
    return sum(quad(f, a, b, epsabs=1e-11, epsrel=1e-11)[0] for a, b in pairwise(cuts)) / (high - low)


def test_band_mean_is_the_exact_integral_of_the_piecewise_linear_curve():
    s = rough()
    low, high = s.range_nm
    edges = RNG.uniform(low, high, (40, 2))
    lower, upper = edges.min(1), edges.max(1)
    expected = [quad_mean(lambda x: np.interp(x, s.wavelength_nm, s.value), a, b, s.wavelength_nm) for a, b in zip(lower, upper)]
    np.testing.assert_allclose(s.band_mean(lower, upper), expected, rtol=1e-12)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10_000), st.integers(2, 12), st.integers(2, 9))
def test_hat_weights_integrate_the_product_of_two_piecewise_linear_curves_exactly(seed, n, nodes_n):
    s = rough(n + 1, seed)
    rng = np.random.Generator(np.random.Philox(seed + 1))
    low, high = s.range_nm
    nodes = np.linspace(low, high, nodes_n)
    t = rng.uniform(-1, 1, nodes_n)
    edges = np.linspace(low, high, 6)
    got = s.hat_weights(nodes, edges[:-1], edges[1:]) @ t
    breaks = np.union1d(nodes, s.wavelength_nm)

    def product(x):
        return np.interp(x, s.wavelength_nm, s.value) * np.interp(x, nodes, t)

    expected = [quad_mean(product, a, b, breaks) for a, b in pairwise(edges)]
    np.testing.assert_allclose(got, expected, atol=1e-12)


def test_hat_weights_sum_to_the_band_mean_for_any_number_of_bands():
    s = rough()
    low, high = s.range_nm
    for count in (1, 24, 1000):
        edges = np.linspace(low, high, count + 1)
        weights = s.hat_weights(np.linspace(low, high, 17), edges[:-1], edges[1:])
        np.testing.assert_allclose(weights.sum(1), s.band_mean(edges[:-1], edges[1:]), rtol=1e-12)


def test_band_means_of_a_partition_add_up_to_the_whole():
    s = rough()
    edges = np.linspace(*s.range_nm, 38)
    parts = s.band_mean(edges[:-1], edges[1:]) * np.diff(edges)
    assert parts.sum() == pytest.approx(np.trapezoid(s.value, s.wavelength_nm), rel=1e-13)


def test_overlapping_and_unordered_bands_are_each_averaged_alone():
    s = rough()
    one = [float(s.band_mean(a, b)) for a, b in ((600, 650), (500, 620), (450, 460))]
    np.testing.assert_allclose(s.band_mean([600, 500, 450], [650, 620, 460]), one, rtol=1e-14)


def test_R16_an_unsorted_grid_is_refused_with_its_index():
    with pytest.raises(InputError, match="index 2 is below the one before") as e:
        Spectrum(np.array([400.0, 500.0, 450.0]), np.zeros(3))
    assert e.value.field == "spectrum.wavelength_nm"


def test_R16_a_repeated_wavelength_is_refused_with_its_index():
    with pytest.raises(InputError, match="index 1 repeats"):
        Spectrum(np.array([400.0, 400.0, 450.0]), np.zeros(3))


def test_R16_one_node_is_refused():
    with pytest.raises(InputError, match="at least 2 nodes"):
        Spectrum(np.array([400.0]), np.zeros(1))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_value_that_is_not_finite_is_refused_with_its_index(bad):
    with pytest.raises(InputError, match="index 1"):
        Spectrum(np.array([400.0, 500.0]), np.array([0.0, bad]))
    with pytest.raises(InputError, match="index 1"):
        Spectrum(np.array([400.0, bad]), np.array([0.0, 1.0]))


def test_R17_a_band_without_width_is_refused_and_a_picometre_band_has_the_value_at_its_centre():
    s = rough()
    with pytest.raises(InputError, match="above 0 nm"):
        s.band_mean(500.0, 500.0)
    assert s.band_mean(549.9995, 550.0005) == pytest.approx(float(s.at(550.0)), abs=1e-6)


@pytest.mark.parametrize("center", [450.0, 507.3, 510.0, 669.9])
def test_R18_a_narrow_line_keeps_its_energy_on_coarse_bands(center):
    edges = np.linspace(440, 680, 25)
    for width in (0.02, 1.0, 8.0):
        power = line(center, width).band_mean(edges[:-1], edges[1:]) * np.diff(edges)
        assert power.sum() == pytest.approx(1.0, rel=1e-12)


def test_a_wavelength_outside_the_data_is_an_error_not_zero():
    s = Spectrum(np.array([400.0, 700.0]), np.array([1.0, 2.0]), "lamp")
    for bad in (399.0, 701.0, np.nan):
        with pytest.raises(InputError, match="'lamp'"):
            s.at(bad)
        with pytest.raises(InputError, match="400 to 700 nm"):
            s.band_mean(450.0, bad)


def test_interpolation_meets_the_nodes_and_the_middle_between_them():
    s = rough()
    np.testing.assert_array_equal(s.at(s.wavelength_nm), s.value)
    middle = (s.wavelength_nm[1:] + s.wavelength_nm[:-1]) / 2
    np.testing.assert_allclose(s.at(middle), (s.value[1:] + s.value[:-1]) / 2, rtol=1e-10)


def test_a_constant_spectrum_is_constant_and_a_peak_normalised_one_peaks_at_exactly_one():
    assert np.all(Spectrum.constant(0.3, 400, 800).band_mean([410, 500], [500, 800]) == 0.3)
    s = rough().scaled(3e-7).peak_normalised()
    assert s.maximum == 1.0
    with pytest.raises(InputError):
        Spectrum.constant(0.0).peak_normalised()


def test_a_spectrum_cannot_be_changed_after_it_is_made():
    grid = np.array([400.0, 500.0])
    s = Spectrum(grid, np.array([1.0, 2.0]))
    grid[0] = 1.0
    assert s.wavelength_nm[0] == 400.0
    with pytest.raises(ValueError, match="read-only"):
        s.value[0] = 5.0


def test_equal_data_make_equal_spectra_whatever_the_name():
    a, b = rough(), Spectrum(rough().wavelength_nm, rough().value, "other")
    assert a == b
    assert hash(a) == hash(b)
    assert a != a.scaled(2)

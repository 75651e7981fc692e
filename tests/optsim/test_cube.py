"""Bands and the cube contract."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optsim.cube import PAPER_CENTERS_NM, Bands, band_mean, block_mean, check_cube, make_cube, require_same_bands, require_watts
from optsim.errors import InputError


def test_paper_bands_touch_and_span_452p5_to_668p5_nm():
    bands = Bands.paper()
    assert bands.count == 24
    assert bands.contiguous
    assert (bands.lower[0], bands.upper[-1]) == (452.5, 668.5)
    np.testing.assert_array_equal(bands.center, PAPER_CENTERS_NM)


def test_parsed_bands_have_the_stated_outer_edges():
    bands = Bands.parse("380:730:35")
    np.testing.assert_allclose(bands.width, 10, rtol=1e-12)
    assert (bands.lower[0], bands.upper[-1], bands.count) == (380, 730, 35)


@pytest.mark.parametrize("text", ["", "450:670", "450:670:0", "670:450:24", "450:nan:3", "450:inf:3", "a:b:c", "0:10:2", "450:670:2.5"])
def test_unreadable_bands_are_refused_by_name(text):
    with pytest.raises(InputError, match="--bands"):
        Bands.parse(text)


def test_R17_zero_width_is_refused_and_a_thousandth_of_a_nanometre_is_not():
    with pytest.raises(InputError, match="width"):
        Bands(np.array([550.0]), np.array([550.0]), np.array([550.0]))
    assert Bands(np.array([550.0]), np.array([550.001]), np.array([550.0005])).count == 1


def test_P15_one_band_is_valid_and_two_equal_wavelengths_are_not():
    assert Bands.parse("500:510:1").count == 1
    with pytest.raises(InputError, match="strictly increasing"):
        Bands(np.array([500.0, 500]), np.array([510.0, 510]), np.array([505.0, 505]))


@given(st.integers(1, 20), st.sampled_from([None, (450.0, 670.0), (440.0, 668.5)]))
def test_subdivision_keeps_every_edge_and_covers_what_was_asked(n, cover):
    bands = Bands.paper()
    fine = bands.subdivide(n, cover)
    low, high = cover or (452.5, 668.5)
    assert fine.contiguous
    assert fine.lower[0] == pytest.approx(low)
    assert fine.upper[-1] == pytest.approx(high)
    for edge in bands.lower:
        assert np.min(np.abs(fine.lower - edge)) < 1e-9


def test_band_means_of_a_linear_spectrum_are_its_values_at_mid_band():
    bands = Bands.paper()
    fine = bands.subdivide(10, (450, 670))
    cube = make_cube(np.broadcast_to(3 * fine.center + 1, (2, 3, fine.count)), fine)
    coarse = band_mean(cube, bands)
    np.testing.assert_allclose(coarse["radiance"].values[1, 2], 3 * (bands.lower + bands.upper) / 2 + 1, rtol=1e-13)


def test_band_mean_refuses_bands_that_the_fine_cube_does_not_cover():
    cube = make_cube(np.ones((1, 1, 10)), Bands.parse("500:600:10"))
    with pytest.raises(InputError, match="covered"):
        band_mean(cube, Bands.parse("490:600:11"))


def test_block_mean_keeps_the_total_and_shrinks_independent_errors_by_n():
    rng = np.random.default_rng(0)
    bands = Bands.parse("500:600:3")
    cube = make_cube(rng.random((6, 4, 3)), bands, np.full((6, 4, 3), 0.1))
    small = block_mean(cube, 2)
    assert small["radiance"].shape == (3, 2, 3)
    np.testing.assert_allclose(small["radiance"].values.mean(), cube["radiance"].values.mean(), rtol=1e-14)
    np.testing.assert_allclose(small["stderr"].values, 0.05, rtol=1e-14)
    with pytest.raises(InputError, match="divisor"):
        block_mean(cube, 4)


def test_a_cube_with_one_nan_is_refused_with_its_place():
    values = np.ones((4, 5, 3))
    values[2, 3, 1] = np.nan
    with pytest.raises(InputError, match=r"\(2, 3, 1\)"):
        make_cube(values, Bands.parse("500:600:3"))


def test_M11_grids_a_ten_thousandth_of_a_nanometre_apart_are_the_same_and_five_are_not():
    a = Bands.parse("500:600:10")
    b = Bands(a.lower + 1e-4, a.upper + 1e-4, a.center + 1e-4)
    require_same_bands(a, b, "estimate")
    with pytest.raises(InputError, match=r"505.*510"):
        require_same_bands(a, Bands(a.lower + 5, a.upper + 5, a.center + 5), "estimate")


def test_a_cube_in_other_units_or_order_is_refused():
    cube = make_cube(np.ones((2, 2, 3)), Bands.parse("500:600:3"))
    with pytest.raises(InputError, match=r"radiance\.dims"):
        check_cube(cube.transpose("wavelength", "y", "x"))
    wrong = cube.copy()
    wrong["radiance"].attrs["units"] = "W"
    with pytest.raises(InputError, match=r"radiance\.units"):
        check_cube(wrong)


def test_averages_keep_the_unit_of_a_cube_and_photons_are_counted_in_watts_only():
    bands = Bands.parse("500:600:4")
    relative = make_cube(np.ones((4, 4, 4)), bands, units="DN / response")
    assert block_mean(relative, 2)["radiance"].attrs["units"] == "DN / response"
    assert band_mean(relative, Bands.parse("500:600:2"))["radiance"].attrs["units"] == "DN / response"
    require_watts(make_cube(np.ones((2, 2, 4)), bands))
    with pytest.raises(InputError, match=r"radiance\.units: must be 'W m-2 sr-1 nm-1'.*got 'DN / response'"):
        require_watts(relative)

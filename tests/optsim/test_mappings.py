"""Every way to map wavelengths to the sensor: closed forms, orders of convergence, and what all of them share."""

import math

import numpy as np
import pytest

from optsim.camera import CenterTable, Dispersion, DoubleAmici, PrismStack, glass
from optsim.camera.field_maps import MAPPINGS, FieldPolynomial, ParaxialMap, WholePixel
from optsim.camera.mappings import CauchyMap, LinearMap, PolynomialMap, SplineMap
from optsim.cube import Bands
from optsim.errors import InputError

RANGE = (450.0, 670.0)
GRID = np.linspace(*RANGE, 1501)
PRISM = DoubleAmici.default()


class Curve:
    """A dispersion given by a formula, without smile."""

    magnification_px = 73.0

    def __init__(self, formula):
        self.formula = formula

    def position_px(self, wavelength_nm, X_mm=0.0, Y_mm=0.0):
        x, y = np.broadcast_arrays(self.formula(np.asarray(wavelength_nm, float)) + 73.0 * np.asarray(X_mm), 73.0 * np.asarray(Y_mm))
        return x, y, np.ones(x.shape, bool)

    def transmission(self, wavelength_nm, X_mm=0.0, Y_mm=0.0):
        return np.full(np.shape(wavelength_nm), 0.5)


def error(mapping, dispersion=PRISM):
    return np.abs(mapping.position_px(GRID)[0] - dispersion.position_px(GRID)[0]).max()


# --- each by itself ----------------------------------------------------------------------------------------------


def test_the_linear_map_is_the_regression_line():
    x = PRISM.position_px(np.linspace(*RANGE, 441))[0]
    wavelength = np.linspace(*RANGE, 441)
    slope = np.sum((wavelength - wavelength.mean()) * (x - x.mean())) / np.sum((wavelength - wavelength.mean()) ** 2)
    mapping = LinearMap.fit(PRISM, RANGE)
    assert mapping.slope_px == pytest.approx(slope, rel=1e-12)
    assert mapping.position_px(560.0)[0] == pytest.approx(x.mean(), abs=1e-11)


def test_a_polynomial_dispersion_is_its_own_polynomial_map():
    curve = Curve(lambda w: 3 - 0.2 * (w - 500) + 1e-3 * (w - 500) ** 2 - 2e-6 * (w - 500) ** 3)
    assert error(PolynomialMap.fit(curve, RANGE, 3), curve) < 1e-11
    assert error(PolynomialMap.fit(curve, RANGE, 2), curve) > 0.1


def test_cauchys_formula_is_its_own_cauchy_map():
    curve = Curve(lambda w: 40 - 3e7 / w**2 + 1e12 / w**4)
    assert error(CauchyMap.fit(curve, RANGE, 2), curve) < 1e-11


@pytest.mark.parametrize(("kind", "degrees"), [(PolynomialMap, (1, 2, 3, 4, 5, 6, 7)), (CauchyMap, (1, 2, 4, 5, 7))])
def test_higher_degrees_are_closer(kind, degrees):
    errors = [error(kind.fit(PRISM, RANGE, degree)) for degree in degrees]
    assert (np.diff(errors) < 0).all()
    assert errors[-1] < 2e-4


def test_the_splines_error_falls_as_the_fourth_power_of_the_knots():
    knots = np.array([17, 33, 65, 129])
    errors = [error(SplineMap.fit(PRISM, RANGE, int(k))) for k in knots]
    slope = np.polyfit(np.log(knots - 1), np.log(errors), 1)[0]
    assert slope == pytest.approx(-4, abs=0.25)


def test_the_wedge_formula_is_the_thin_double_amici_times_one_constant():
    mapping = ParaxialMap.fit(PRISM, RANGE)
    n1, n2 = glass("N-FK5").index(GRID), glass("F5").index(GRID)
    bend = 2 * (n1 - 1) * PRISM.apex_outer_rad - (n2 - 1) * PRISM.apex_inner_rad
    slope, offset = np.polyfit(bend, mapping.position_px(GRID)[0], 1)
    np.testing.assert_allclose(mapping.position_px(GRID)[0], slope * bend + offset, atol=1e-11)
    assert slope == pytest.approx(mapping.scale_px, rel=1e-10)
    assert mapping.position_px(550.0)[0] == pytest.approx(14.5451, abs=1e-12)
    assert error(mapping) < 0.0011


def test_the_wedge_formulas_constant_tends_to_focal_length_over_pitch_as_the_square_of_the_apex():
    excess = []
    for shrink in (1.0, 0.5, 0.25):
        prism = PrismStack(glasses=PRISM.stack.glasses, face_tilt_rad=tuple(t * shrink for t in PRISM.stack.face_tilt_rad))
        excess.append(ParaxialMap.fit(prism, RANGE).scale_px / (100 / 0.0099) - 1)
    assert np.log2(excess[0] / excess[1]) == pytest.approx(2, abs=0.05)
    assert np.log2(excess[1] / excess[2]) == pytest.approx(2, abs=0.05)


def test_whole_pixels_are_whole_and_within_half_a_pixel():
    x = WholePixel.fit(PRISM, RANGE).position_px(GRID)[0]
    assert (x == np.round(x)).all()
    assert np.abs(x - PRISM.position_px(GRID)[0]).max() <= 0.5
    assert (np.diff(x) >= 0).all()


def test_a_table_of_a_prism_has_the_prisms_wavelengths_at_whole_pixels():
    table = CenterTable.fit(PRISM, RANGE)
    assert len(table.centers_nm) == 24
    np.testing.assert_allclose(PRISM.position_px(table.centers_nm)[0], np.arange(24), atol=1e-9)


def test_the_field_polynomial_holds_smile_and_keystone_that_axial_maps_miss():
    field = np.linspace(-3.5, 3.5, 15)
    exact = PRISM.position_px(GRID[::100, None, None], field[:, None], field)
    fitted = FieldPolynomial.fit(PRISM, RANGE).position_px(GRID[::100, None, None], field[:, None], field)
    axial = PolynomialMap.fit(PRISM, RANGE, 7).position_px(GRID[::100, None, None], field[:, None], field)
    assert max(np.abs(exact[i] - fitted[i]).max() for i in (0, 1)) < 0.0025
    assert np.abs(exact[0] - axial[0]).max() > 0.05


# --- what all share ----------------------------------------------------------------------------------------------

ERRORS_PX = (3.7, 0.0042, 0.0066, 9e-5, 0.0011, 0.0024, 0.04, 0.5)  # of the default settings on the default prism, 450-670 nm


@pytest.mark.parametrize(("kind", "limit"), [*zip(MAPPINGS, ERRORS_PX, strict=True)], ids=lambda v: getattr(v, "__name__", ""))
def test_every_mapping_keeps_the_documented_error_and_the_protocol(kind, limit):
    mapping = kind.fit(PRISM, RANGE)
    assert isinstance(mapping, Dispersion)
    assert 0.5 * limit < error(mapping) <= limit
    assert mapping.magnification_px == pytest.approx(PRISM.magnification_px, rel=1e-12)
    pixels = np.linspace(4, 20, 47)
    found = mapping.wavelength_at(pixels)
    judge = PRISM if kind is WholePixel else mapping
    np.testing.assert_allclose(judge.position_px(found)[0], pixels, atol=1e-8)
    x, y, valid = mapping.position_px(550.0, 1.0, -2.0)
    assert valid.all()
    assert x - mapping.position_px(550.0)[0] == pytest.approx(PRISM.magnification_px, rel=2e-3)
    assert y == pytest.approx(-2 * PRISM.magnification_px, rel=2e-3)


@pytest.mark.parametrize("kind", MAPPINGS)
def test_every_mapping_passes_the_light_that_its_prism_passes_on_the_axis(kind):
    mapping = kind.fit(PRISM, RANGE)
    np.testing.assert_allclose(mapping.transmission(GRID), PRISM.transmission(GRID), atol=1e-5)
    assert mapping.transmission(GRID[:5, None], np.zeros(3)).shape == (5, 3)


@pytest.mark.parametrize("kind", [k for k in MAPPINGS if k not in (CenterTable, WholePixel)])
def test_P3_every_fitted_curve_refuses_wavelengths_outside_its_range(kind):
    mapping = kind.fit(PRISM, RANGE)
    for bad in (449.9, 671.0, 0.55, -500.0, np.nan):
        with pytest.raises(InputError, match="nm, the range") as caught:
            mapping.position_px([500.0, bad])
        assert caught.value.field == "wavelength_nm"


@pytest.mark.parametrize("kind", [k for k in MAPPINGS if k not in (CenterTable, WholePixel)])
def test_P5_a_prism_that_loses_part_of_the_range_has_no_map(kind):
    steep = DoubleAmici(
        outer=glass("N-SF66"), inner=glass("N-SF66"), apex_outer_rad=0.37, apex_inner_rad=0.0, design_nm=670.0, design_position_px=0.0
    )
    with pytest.raises(InputError, match="loses"):
        kind.fit(steep, RANGE)


def test_misuse_is_refused_by_name():
    for degree in (0, 13):
        with pytest.raises(InputError, match="degree"):
            PolynomialMap.fit(PRISM, RANGE, degree)
    with pytest.raises(InputError, match="knots"):
        SplineMap.fit(PRISM, RANGE, 3)
    for bad in ((670.0, 450.0), (0.0, 500.0), (450.0, math.inf)):
        with pytest.raises(InputError, match="range_nm"):
            LinearMap.fit(PRISM, bad)
    with pytest.raises(InputError, match="glasses and angles"):
        ParaxialMap.fit(CenterTable(), RANGE)
    with pytest.raises(InputError, match="Y_mm"):
        FieldPolynomial.fit(PRISM, RANGE).position_px(500.0, 0.0, 4.0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, [3.0, np.nan]])
def test_positions_that_are_not_finite_have_no_wavelength(bad):
    with pytest.raises(InputError, match="position_px"):
        DoubleAmici.default().wavelength_at(bad)


def test_no_positions_have_no_wavelengths():
    assert DoubleAmici.default().wavelength_at([]).shape == (0,)


def test_degrees_knots_and_pixels_are_whole_numbers():
    with pytest.raises(InputError, match="degree"):
        PolynomialMap.fit(DoubleAmici.default(), (450, 670), 2.5)
    with pytest.raises(InputError, match="knots"):
        SplineMap.fit(DoubleAmici.default(), (450, 670), 8.5)
    with pytest.raises(InputError, match="pixels"):
        Bands.from_prism(DoubleAmici.default(), 2.5)

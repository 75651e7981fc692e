"""Glass: catalogue values, and refusal of every wavelength that a Sellmeier formula answers with a plausible wrong number."""

from importlib import resources

import numpy as np
import pytest

from optsim.camera import glass, glass_names
from optsim.camera.glass import Glass
from optsim.errors import InputError

CATALOGUE = {  # n_d and V_d as printed in SCHOTT's catalogue
    "N-BK7": (1.51680, 64.17),
    "F2": (1.62004, 36.37),
    "N-FK5": (1.48749, 70.41),
    "F5": (1.60342, 38.03),
    "N-SK2": (1.60738, 56.65),
    "N-SF4": (1.75513, 27.38),
    "SF4": (1.75520, 27.58),
    "N-SF11": (1.78472, 25.68),
    "N-LASF40": (1.83404, 37.30),
    "N-KZFS8": (1.72047, 34.70),
    "N-SK16": (1.62041, 60.32),
    "N-SF66": (1.92286, 20.88),
    "N-SF10": (1.72828, 28.53),
    "SF10": (1.72825, 28.41),
    "N-SF1": (1.71736, 29.62),
    "N-SF5": (1.67271, 32.25),
    "N-SF6": (1.80518, 25.36),
    "N-SF57": (1.84666, 23.78),
    "SF11": (1.78472, 25.76),
    "N-F2": (1.62005, 36.43),
    "LF5": (1.58144, 40.85),
    "LLF1": (1.54814, 45.75),
    "N-BAK4": (1.56883, 55.98),
    "N-BAF10": (1.67003, 47.11),
    "N-K5": (1.52249, 59.48),
    "N-KF9": (1.52346, 51.54),
    "N-LAK22": (1.65113, 55.89),
    "N-PSK53A": (1.61800, 63.39),
    "N-BALF4": (1.57956, 53.87),
    "N-KZFS4": (1.61336, 44.49),
    "N-PK52A": (1.49700, 81.61),
}


def test_every_glass_is_compared_with_the_catalogue():
    assert set(glass_names()) == set(CATALOGUE)


@pytest.mark.parametrize("name", CATALOGUE)
def test_index_and_abbe_number_are_those_of_the_printed_catalogue(name):
    index, abbe = CATALOGUE[name]
    assert glass(name).index(587.5618) == pytest.approx(index, abs=6e-6)
    assert glass(name).abbe == pytest.approx(abbe, abs=6e-3)


def test_P1_bk7_at_the_d_line_is_1_51680():
    assert glass("N-BK7").index(587.56) == pytest.approx(1.51680, abs=5e-7)


@pytest.mark.parametrize("name", ["N-BK7", "N-SF66"])
@pytest.mark.parametrize("wavelength", [0.0, -550.0, 0.55, 77.5, 250.0, 1e4, np.nan, np.inf])
def test_P2_P3_wavelengths_outside_the_fit_are_refused_with_the_range(name, wavelength):
    with pytest.raises(InputError, match="nm, the range of") as caught:
        glass(name).index([550.0, wavelength])
    assert caught.value.field == "wavelength_nm"


@pytest.mark.parametrize("name", glass_names())
def test_the_rational_form_is_the_sellmeier_sum(name):
    low, high = glass(name).range_nm
    wavelength = np.linspace(low, high, 50)
    rational = glass(name).rational.excess((wavelength / 1000) ** 2)
    np.testing.assert_allclose(rational, glass(name).index(wavelength) ** 2 - 1, rtol=1e-12)
    np.testing.assert_allclose(glass(name).rational_nm.excess(wavelength**2), rational, rtol=1e-12)


def test_an_unknown_glass_is_refused_with_a_suggestion():
    with pytest.raises(InputError, match="did you mean 'N-SF4'"):
        glass("NSF4")


def test_a_range_upside_down_is_refused():
    with pytest.raises(InputError, match="range_nm"):
        Glass(name="x", sellmeier_b=(1, 0, 0), sellmeier_c_um2=(0, 0, 0), range_nm=(700, 400))


def test_indices_agree_with_optiland_to_the_last_bits():
    materials = pytest.importorskip("optiland.materials", reason="judge optiland is not installed")
    wavelength = np.linspace(450, 670, 23)
    folder = resources.files("optiland.database") / "data-nk" / "glass" / "schott"
    for name in glass_names():
        judge = np.ravel(materials.MaterialFile(str(folder / f"{name}.yml")).n(wavelength / 1000))
        np.testing.assert_allclose(glass(name).index(wavelength), judge, rtol=4e-16)

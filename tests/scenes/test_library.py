"""The cached curves against colour-science; black bodies against their limits."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.constants import Stefan_Boltzmann, Wien, physical_constants
from scipy.integrate import quad

from scenes import library
from scenes.errors import InputError


def fresh_tables():
    path = Path(library.DATA) / "make_cache.py"
    spec = importlib.util.spec_from_file_location("make_cache", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.tables()


def test_the_cached_curves_equal_colour_science_bit_for_bit():
    pytest.importorskip("colour")
    for file, (grid, columns) in fresh_tables().items():
        cached = library.read_table(file)
        assert list(cached) == list(columns)
        for name, values in columns.items():
            assert cached[name].wavelength_nm.tobytes() == grid.tobytes()
            assert cached[name].value.tobytes() == values.tobytes()


def test_the_default_curves_are_read_without_importing_colour_science():
    code = (
        "import sys; from scenes import library as l; l.illuminant('xenon'); l.reflectance('red'); l.sensor_curves('nikon-5100');"
        "assert not {'colour', 'trimesh', 'mitsuba', 'xarray'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_chart_has_24_patches_within_zero_and_one():
    names = library.reflectances()
    assert len(names) == 24
    assert names[0] == "dark skin"
    for name in names:
        curve = library.reflectance(name)
        assert 0 < curve.minimum < curve.maximum < 1
        assert curve.range_nm == (380.0, 730.0)


def test_an_unknown_name_is_answered_with_the_nearest_one():
    with pytest.raises(InputError, match="did you mean 'moderate red'"):
        library.reflectance("moderat red")
    with pytest.raises(InputError, match="did you mean 'xenon'"):
        library.illuminant("xenom")
    with pytest.raises(InputError, match="did you mean 'nikon-5100'"):
        library.sensor_curves("nikon-5200")


def test_any_illuminant_of_colour_science_is_known_by_its_name():
    colour = pytest.importorskip("colour")
    for name in ("D50", "FL2", "Mercury"):
        source = colour.SDS_ILLUMINANTS if name in colour.SDS_ILLUMINANTS else colour.SDS_LIGHT_SOURCES
        np.testing.assert_array_equal(library.illuminant(name).value, source[name].values)


def test_sensor_curves_have_three_channels_peaking_at_one_in_the_order_of_wavelength():
    for name in ("nikon-5100", "sigma-sd-merrill"):
        curves = library.sensor_curves(name)
        assert tuple(curves) == ("red", "green", "blue")
        assert all(curve.maximum == 1.0 and curve.minimum >= 0 for curve in curves.values())
        peaks = [curve.wavelength_nm[np.argmax(curve.value)] for curve in curves.values()]
        assert peaks[0] > peaks[1] > peaks[2]
    assert np.all(library.sensor_curves("flat")["mono"].at([300.0, 1000.0]) == 1.0)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, 1e13])
def test_R19_a_blackbody_needs_a_temperature_above_zero(bad):
    with pytest.raises(InputError, match=r"temperature_K: must be in \(0"):
        library.blackbody(bad, [400, 500])


def test_R19_one_kelvin_underflows_to_exactly_zero_without_a_warning():
    with np.errstate(all="raise"):
        np.testing.assert_array_equal(library.blackbody(1.0, [400, 550, 700]).value, 0.0)


def test_R19_a_blackbody_peaks_where_wien_says():
    grid = np.linspace(440, 451, 11001)
    curve = library.blackbody(6504.0, grid)
    assert grid[np.argmax(curve.value)] == pytest.approx(Wien / 6504.0 * 1e9, abs=2e-3)
    assert grid[np.argmax(curve.value)] == pytest.approx(445.5, abs=0.1)


def test_R19_a_gigakelvin_blackbody_follows_rayleigh_and_jeans():
    grid = np.linspace(400, 700, 31)
    expected = 2e-9 * library.LIGHT_C * library.BOLTZMANN_K * 1e9 / (grid * 1e-9) ** 4
    x = library.PLANCK_H * library.LIGHT_C / (grid * 1e-9 * library.BOLTZMANN_K * 1e9)
    got = library.blackbody(1e9, grid).value
    np.testing.assert_allclose(got, expected * (1 - x / 2), rtol=1e-9)
    np.testing.assert_allclose(got, expected, rtol=2e-5)


def test_the_whole_blackbody_radiates_what_stefan_and_boltzmann_say():
    def radiance(nm):
        return library.blackbody(3000.0, [nm, nm * 2]).value[0]

    total = quad(radiance, 80, 4000, limit=200)[0] + quad(radiance, 4000, 1e6, limit=400)[0]
    assert total == pytest.approx(Stefan_Boltzmann * 3000.0**4 / np.pi, rel=1e-5)


def test_a_blackbody_agrees_with_colour_science():
    colour = pytest.importorskip("colour")
    grid = np.linspace(380, 780, 41)
    c1, c2 = (physical_constants[f"{which} radiation constant"][0] for which in ("first", "second"))
    expected = colour.colorimetry.planck_law(grid * 1e-9, 6504.0, c1, c2) * 1e-9
    np.testing.assert_allclose(library.blackbody(6504.0, grid).value, expected, rtol=1e-8)


def test_a_line_has_unit_area_and_its_width_at_half_maximum():
    curve = library.line(550.0, 2.0)
    assert np.trapezoid(curve.value, curve.wavelength_nm) == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_allclose(curve.at([549.0, 551.0]), curve.maximum / 2, rtol=1e-12)
    for bad in (0.0, np.nan, 101.0):
        with pytest.raises(InputError, match="width_nm"):
            library.line(550.0, bad)
    with pytest.raises(InputError, match="center_nm"):
        library.line(100.0, 1.0)

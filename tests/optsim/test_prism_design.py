"""Prism design: fits that return what they were given, derivatives judged by complex steps, results judged by the traced stack."""

import math
import tomllib

import numpy as np
import pytest
from scipy.optimize import least_squares

from optsim.camera import CameraConfig, DoubleAmici, glass
from optsim.camera.arrays import kernels
from optsim.camera.design import PrismDesign, WantedDispersion
from optsim.camera.design.levenberg import fit
from optsim.camera.design.prism_design import AMICI, _Residuals
from optsim.errors import InputError

GLASSES = [glass(name) for name in ("N-BK7", "F2", "N-SF11", "N-SK2")]


def test_equal_widths_ask_for_a_straight_line_and_equal_resolving_power_for_a_logarithm():
    equal, proportional = WantedDispersion.equal(450, 670, 24), WantedDispersion.proportional(450, 670, 24)
    assert np.allclose(equal.position_px, (equal.wavelength_nm - 450) / 220 * 24, atol=1e-12)
    assert np.allclose(proportional.position_px, 24 * np.log(proportional.wavelength_nm / 450) / math.log(670 / 450), atol=1e-6)
    assert np.allclose(proportional.nm_per_px / proportional.wavelength_nm, math.log(670 / 450) / 24)
    assert proportional.pixels == pytest.approx(24, abs=1e-6)


def test_the_fit_ends_where_scipy_ends_inside_and_at_the_border_of_the_box():
    def curve(p):
        return np.array([10 * (p[1] - p[0] ** 2), 1 - p[0], 0.3 * p[1]])

    def with_slopes(p):
        return curve(p), np.array([[-20 * p[0], 10], [-1, 0], [0, 0.3]])

    for limit in (2.0, 0.6):
        found = fit(with_slopes, np.array([-0.5, 0.4]), limit, steps=500, tolerance=1e-16)
        expected = least_squares(curve, [-0.5, 0.4], bounds=(-limit, limit), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        assert np.allclose(found.parameters, expected, atol=1e-6)
        assert all(b < a for a, b in zip(found.history, found.history[1:]))


def test_a_fit_refuses_steps_that_lose_light_and_says_when_there_is_none_at_the_start():
    def lossy(p):
        return None if p[0] > 0.5 else (np.array([p[0] - 1.0]), np.ones((1, 1)))

    assert fit(lossy, np.array([0.0]), 2.0).parameters[0] == pytest.approx(0.5, abs=1e-3)
    assert fit(lossy, np.array([0.9]), 2.0) is None


def test_the_thin_formula_s_angles_are_those_of_plain_least_squares():
    design, wanted = PrismDesign(per_degree_px=0.0, limit_deg=85), WantedDispersion.equal()
    apexes, rms = design.thin(*GLASSES[:2], wanted)
    n1, n2 = (g.index(wanted.wavelength_nm) for g in GLASSES[:2])
    matrix = np.stack([2 * (n1 - 1), -(n2 - 1), np.ones_like(n1)], 1) * [100 / 0.0099, 100 / 0.0099, 1]
    expected, *_ = np.linalg.lstsq(matrix, wanted.position_px, rcond=None)
    if np.abs(expected[:2]).max() < math.radians(170):
        assert np.allclose(apexes, expected[:2], rtol=1e-6)
    assert rms >= np.sqrt(np.mean((matrix @ expected - wanted.position_px) ** 2)) - 1e-9


def test_derivatives_by_the_tilts_are_those_of_complex_steps():
    if kernels() is None:
        pytest.skip("no usable libLLVM")
    design, wanted = PrismDesign(), WantedDispersion.equal()
    tilts = AMICI @ np.array([0.14, 0.23]) + 0.01
    residuals = _Residuals(design, design._optics((GLASSES[0], GLASSES[1], GLASSES[0])), wanted, np.eye(4))
    (x, by_jit), (x_steps, by_steps) = residuals._traced(tilts), residuals._stepped(residuals.values(tilts))
    assert np.abs(x - x_steps).max() < 1e-9
    assert np.abs(by_jit - by_steps).max() < 1e-11 * np.abs(by_steps).max()


def test_a_prism_designed_for_another_prism_s_dispersion_is_that_prism():
    amici = DoubleAmici.default()
    wavelength = np.linspace(450, 670, 45)
    position = amici.position_px(wavelength)[0]
    wanted = WantedDispersion(wavelength, position, np.gradient(wavelength, position))
    start = AMICI @ np.array([amici.apex_outer_rad * 1.1, amici.apex_inner_rad * 0.9])
    found = PrismDesign(symmetric=True, field_mm=0).refined((amici.outer, amici.inner, amici.outer), start, wanted)
    assert found.rms_px < 1e-6
    assert found.start_rms_px > 1
    assert np.allclose(found.face_tilt_rad, amici.stack.face_tilt_rad, atol=1e-7)
    assert abs(found.deviation_deg) < 1e-6


def test_the_search_s_figures_are_those_of_the_traced_stack_and_of_the_camera_file_that_it_writes():
    wanted = WantedDispersion.equal()
    results = PrismDesign(refine=2, symmetric=True).run(wanted, GLASSES)
    assert [r.rms_px for r in results] == sorted(r.rms_px for r in results)
    best = results[0]
    camera = CameraConfig(**tomllib.loads(best.to_toml()))
    for prism in (best.stack(), camera.dispersion):
        field = np.array([[-1.75], [0.0], [1.75]])
        error = prism.position_px(wanted.wavelength_nm, field)[0] - wanted.position_px - field * 100 / 138.2 / 0.0099
        error -= error.mean()
        assert error[1].std() == pytest.approx(best.axis_rms_px, rel=1e-4)
        assert np.sqrt(np.mean(error**2)) == pytest.approx(best.rms_px, rel=1e-4)
        assert np.abs(error).max() == pytest.approx(best.worst_px, rel=1e-4)
    assert best.rms_px < best.start_rms_px


def test_letting_the_light_leave_at_an_angle_buys_equal_widths():
    wanted = WantedDispersion.equal()
    straight, free = (
        PrismDesign(refine=1, symmetric=True, field_mm=0, per_degree_px=weight).run(wanted, GLASSES)[0] for weight in (3.0, 0.01)
    )
    assert abs(straight.deviation_deg) < 0.1 < abs(free.deviation_deg)
    assert free.rms_px < straight.rms_px


def test_the_field_s_ends_keep_the_prism_from_stretching_the_picture():
    """On the axis alone equal widths are cheap: unequal outer faces magnify one direction, wavelength by wavelength."""
    wanted, glasses = WantedDispersion.equal(), [glass("N-KZFS4"), glass("N-BAF10")]
    stretch = []
    for field_mm in (0.0, 1.75):
        best = PrismDesign(refine=1, field_mm=field_mm).run(wanted, glasses)[0].stack()
        x = best.position_px(550.0, np.array([-0.01, 0.01]))[0]
        stretch.append(abs((x[1] - x[0]) / 0.02 / best.magnification_px - 1))
    assert stretch[0] > 0.3
    assert stretch[1] < 0.02


def test_searches_without_sense_are_refused():
    with pytest.raises(InputError, match="glasses"):
        PrismDesign().run(WantedDispersion.equal(), GLASSES[:1])
    with pytest.raises(InputError, match="nm_per_px"):
        WantedDispersion.from_function(lambda w: w - 500, 450, 670)
    with pytest.raises(InputError, match="limit_deg"):
        PrismDesign(limit_deg=90)

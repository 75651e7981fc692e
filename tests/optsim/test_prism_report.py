"""The report on the default prism against the residuals of an independent fit, and its figure."""

import json

import numpy as np
import pytest

from optsim.camera import CameraConfig, CenterTable, DoubleAmici, glass, plot_prism, prism_report
from optsim.camera.prism_report import chief_rays
from optsim.errors import InputError

RESIDUAL_NM = [  # model - table of N-FK5/F5 at f = 100 mm, from a separate optimisation in another program
    1.07, 0.67, 0.47, 0.47, -0.30, -0.84, -1.11, -1.11, -0.81, -0.18, 0.80, 1.17,
    0.96, 0.21, -0.02, -0.68, -0.71, -1.03, -0.55, -0.17, 0.25, 0.85, -0.16, 0.47,
]  # fmt: skip


def test_the_default_prism_misses_the_papers_centres_by_the_published_residuals():
    residual = np.array(prism_report()["residual_to_paper_nm"])
    np.testing.assert_allclose(residual, RESIDUAL_NM, atol=0.0051)
    assert np.abs(residual).max() == pytest.approx(1.17, abs=0.005)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(0.72, abs=0.005)


def test_the_default_prism_spreads_450_to_670_nm_over_24_pixels():
    report = prism_report()
    assert len(report["band_center_nm"]) == 24
    assert len(report["band_edge_nm"]) == 25
    assert report["band_edge_nm"][0] == pytest.approx(453.8, abs=0.05)
    assert report["band_edge_nm"][-1] == pytest.approx(670.0, abs=0.05)
    steps = np.interp([455, 512, 555, 612, 660], report["wavelength_nm"], report["nm_per_px"])
    np.testing.assert_allclose(steps, [4.5, 7.1, 9.7, 14.0, 18.5], atol=0.05)
    assert json.loads(json.dumps(report)) == report


def test_band_edges_and_centres_lie_on_half_and_whole_pixels():
    report, prism = prism_report(), DoubleAmici.default()
    np.testing.assert_allclose(prism.position_px(report["band_center_nm"])[0], np.arange(24), atol=1e-9)
    np.testing.assert_allclose(prism.position_px(report["band_edge_nm"])[0], np.arange(25) - 0.5, atol=1e-9)


def test_nm_per_px_is_the_slope_of_the_curve():
    report = prism_report(wavelength_nm=np.arange(450, 670.01, 0.1))
    slope = np.gradient(report["wavelength_nm"], report["position_px"])
    np.testing.assert_allclose(report["nm_per_px"][1:-1], slope[1:-1], rtol=1e-5)


def test_the_table_has_no_residual_to_itself():
    assert np.abs(prism_report(CenterTable())["residual_to_paper_nm"]).max() < 1e-9


def test_P15_one_wavelength_is_valid_and_equal_wavelengths_are_refused():
    assert len(prism_report(wavelength_nm=[550.0])["position_px"]) == 1
    for bad in ([550.0, 550.0], [600.0, 500.0]):
        with pytest.raises(InputError, match="strictly increasing"):
            prism_report(wavelength_nm=bad)


def test_P13_a_folded_dispersion_says_so_and_has_no_bands():
    flat = DoubleAmici(outer=glass("N-BK7"), inner=glass("N-BK7"), apex_outer_rad=0.0, apex_inner_rad=0.0)
    report = prism_report(flat)
    assert report["folds"]
    assert (report["band_center_nm"], report["band_edge_nm"], report["residual_to_paper_nm"]) == ([], [], [])
    assert set(report["nm_per_px"]) == {None}
    json.dumps(report, allow_nan=False)


def test_a_weak_prism_has_as_many_bands_as_pixels_that_the_band_pass_fills():
    report = prism_report(CameraConfig.parse_toml("[prism]\napex_inner_deg = 3.0").dispersion)
    assert not report["folds"]
    assert 3 <= len(report["band_center_nm"]) < 10
    assert len(report["band_edge_nm"]) == len(report["band_center_nm"]) + 1
    assert report["band_edge_nm"][0] > 449
    assert report["band_edge_nm"][-1] < 671.5
    assert report["residual_to_paper_nm"] == []


def test_a_prism_that_lays_red_to_the_left_has_bands_from_blue_to_red():
    report = prism_report(CameraConfig.parse_toml("[prism]\napex_inner_deg = -13.1019").dispersion)
    assert np.all(np.diff(report["band_px"]) == -1)
    assert np.all(np.diff(report["band_center_nm"]) > 0)
    assert np.all(np.diff(report["band_edge_nm"]) > 0)


ANCHOR = "\ndesign_nm = 650.0\ndesign_position_px = 0.0"
USERS = """
[prism]
glasses = ["N-SK2", "N-SF10", "N-SK2"]
face_tilt_deg = [5.1, -24.138, 23.722, -5.516]
[relay]
collimator_mm = 50.0
focal_mm = 50.0
[sensor]
pitch_um = 9.9
"""


def test_chief_rays_are_snells_law_face_by_face():
    camera = CameraConfig.parse_toml(USERS)
    rays = chief_rays(camera.dispersion, [450, 520, 650], camera.sensor.pitch_um)
    for k, nm in enumerate((450.0, 520.0, 650.0)):
        direction, before = 0.0, 1.0
        for tilt, name in zip((5.1, -24.138, 23.722, -5.516), ("N-SK2", "N-SF10", "N-SK2", None)):
            after = 1.0 if name is None else float(glass(name).index(nm))
            normal = np.radians(tilt)
            direction = normal + np.arcsin(np.sin(direction - normal) * before / after)
            before = after
        assert rays["position_mm"][k] == pytest.approx(50 * np.tan(direction), abs=1e-12)
        assert rays["position_px"][k] == rays["position_mm"][k] / 0.0099
    assert rays["transmitted"] == [True] * 3
    assert set(rays) == {"wavelength_nm", "position_mm", "position_px", "transmitted"}


def test_P5_chief_rays_that_are_lost_have_no_position():
    camera = CameraConfig.parse_toml(
        '[prism]\nglasses = ["N-SF10"]\nface_tilt_deg = [0.0, 34.9]\ndesign_nm = 650.0\ndesign_position_px = 0.0'
    )
    rays = chief_rays(camera.dispersion, [400.0, 650.0], camera.sensor.pitch_um)
    assert rays["transmitted"] == [False, True]
    assert rays["position_mm"][0] is None
    assert rays["position_px"][0] is None
    with pytest.raises(InputError, match="no optical axis"):
        chief_rays(CameraConfig.parse_toml("[table]").optics, [500.0], 9.9)


def test_the_figure_has_units_on_its_axes(tmp_path):
    from matplotlib.image import imread

    plot_prism(prism_report(), tmp_path / "prism.svg")
    text = (tmp_path / "prism.svg").read_text()
    plot_prism(prism_report(), tmp_path / "prism.png")
    assert imread(tmp_path / "prism.png").std() > 0.05
    assert "<svg" in text

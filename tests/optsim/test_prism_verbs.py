"""The verbs prism, calibrate and camera: what they print, write and refuse."""

import json

import numpy as np
import pytest

from optsim.camera import CameraConfig
from optsim.cli.app import main

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


def optsim(*words):
    with pytest.raises(SystemExit) as leaving:
        main([str(word) for word in words])
    return leaving.value.code


def test_chief_rays_of_a_users_camera_are_printed_unrounded_and_nothing_else(tmp_path, capsys):
    (tmp_path / "camera.toml").write_text(USERS)
    assert optsim("prism", "--camera", tmp_path / "camera.toml", "--at", "450,520,650", "--json") == 0
    rays = json.loads(capsys.readouterr().out)
    assert list(rays) == ["wavelength_nm", "position_mm", "position_px", "transmitted"]
    position = CameraConfig.parse_toml(USERS).dispersion.chief(np.array([450.0, 520, 650])).position_mm
    assert rays["position_mm"] == position.tolist()
    assert rays["position_px"] == [p / (9.9 / 1000) for p in position]
    assert rays["transmitted"] == [True, True, True]
    assert optsim("prism", "--at", "550") == 0
    assert "550.000" in capsys.readouterr().out


def test_the_study_of_a_users_camera_and_of_a_table_is_printed(tmp_path, capsys):
    (tmp_path / "camera.toml").write_text(USERS)
    (tmp_path / "table.toml").write_text("[table]")
    assert optsim("prism", "--camera", tmp_path / "camera.toml", "--draws", 200, "--plot", tmp_path / "p.png") == 0
    text = capsys.readouterr().out
    for word in ("apex_2_deg", "smile", "as built", "cannot tell apart"):
        assert word in text
    assert (tmp_path / "p.png").stat().st_size > 10_000
    assert optsim("prism", "--camera", tmp_path / "table.toml", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["tolerance"] is None
    assert len(report["band_center_nm"]) == 24


def test_a_calibration_is_written_as_a_camera_that_calibrates_to_itself(tmp_path, capsys):
    files = {name: tmp_path / name for name in ("fitted.toml", "spots.csv", "c.png")}
    words = ("-o", files["fitted.toml"], "--save-spots", files["spots.csv"], "--plot", files["c.png"], "--seed", 4)
    assert optsim("calibrate", *words) == 0
    text = capsys.readouterr().out
    assert "true curve missed" in text
    assert "collimator_mm" in text
    assert all(path.stat().st_size > 1000 for path in files.values())
    assert optsim("calibrate", files["spots.csv"], "--camera", files["fitted.toml"], "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert again["p_value"] > 1e-3
    drawn = {row["name"]: (row["drawn"], row["fitted"], row["sigma"]) for row in again["parameters"]}
    for name in ("offset_x_px", "offset_y_px", "rotation_deg", "scale"):
        before, after, sigma = drawn[name]
        assert after == pytest.approx(before, abs=sigma)
    assert {"curve", "registration", "parameters", "identifiable", "combinations"} <= set(again)


def test_the_printed_camera_is_the_default_one_and_reads_back(tmp_path, capsys):
    assert optsim("camera") == 0
    text = capsys.readouterr().out
    assert CameraConfig.parse_toml(text) == CameraConfig()
    (tmp_path / "camera.toml").write_text(USERS)
    assert optsim("camera", tmp_path / "camera.toml") == 0
    assert CameraConfig.parse_toml(capsys.readouterr().out) == CameraConfig.parse_toml(USERS)


@pytest.mark.parametrize(
    ("words", "field"),
    [
        (("prism", "--at", "blue"), "--at"),
        (("prism", "--at", "100"), "wavelength_nm"),
        (("prism", "--draws", "3"), "--draws"),
        (("prism", "--plot", "prism.bmp"), "--plot"),
        (("prism", "--quick"), "--quick"),
        (("prism", "--camera", "none.toml"), "--camera"),
        (("calibrate", "none.csv"), "SPOTS"),
        (("calibrate", "--noise", "-1"), "--noise"),
        (("calibrate", "--wavelengths", "1"), "--wavelengths"),
        (("calibrate", "-o", "fitted.json"), "-o"),
        (("calibrate", "-o", "nowhere/fitted.toml"), "-o"),
        (("calibrate", "--save-spots", "spots.txt"), "--save-spots"),
        (("calibrate", "--plot", "c.bmp"), "--plot"),
        (("camera", "none.toml"), "--camera"),
    ],
)
def test_misuse_exits_with_2_and_names_the_field(words, field, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert optsim(*words) == 2
    assert field in capsys.readouterr().err

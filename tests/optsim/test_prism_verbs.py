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


def test_a_prism_in_a_converging_beam_is_studied_in_that_beam(tmp_path, capsys):
    """What the verb prints is where the camera's own path lays light, not the collimated curve of the same glass."""
    (tmp_path / "camera.toml").write_text("[relay]\nconverging = true\n[dmd]\noffset_x_px = 3.0\nrotation_deg = 1.0\n")
    assert optsim("prism", "--camera", tmp_path / "camera.toml", "--at", "455,660", "--json") == 0
    first, last = json.loads(capsys.readouterr().out)["position_px"]
    x, _, _ = CameraConfig.from_toml(tmp_path / "camera.toml").optics.position_px([455.0, 660.0])
    assert last - first == pytest.approx(x[1] - x[0], abs=1e-9)
    straight, _, _ = CameraConfig().optics.position_px([455.0, 660.0])
    assert abs((last - first) - (straight[1] - straight[0])) > 0.5
    assert optsim("prism", "--camera", tmp_path / "camera.toml", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    place = report["wavelength_nm"].index(455.0), report["wavelength_nm"].index(660.0)
    assert report["position_px"][place[1]] - report["position_px"][place[0]] == pytest.approx(x[1] - x[0], abs=1e-9)
    assert report["tolerance"] is None
    assert optsim("prism", "--camera", tmp_path / "camera.toml") == 0
    assert "in collimated light" in capsys.readouterr().out


def test_faces_without_glass_disperse_nothing(tmp_path, capsys):
    (tmp_path / "camera.toml").write_text('[prism]\nglasses = ["air"]\nface_tilt_deg = [10.0, -10.0]\n')
    assert optsim("prism", "--camera", tmp_path / "camera.toml", "--at", "450,650", "--json") == 0
    assert json.loads(capsys.readouterr().out)["position_mm"] == [0.0, 0.0]
    assert optsim("prism", "--camera", tmp_path / "camera.toml", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["folds"]
    assert set(report["nm_per_px"]) == {None}


def test_a_long_list_of_bands_says_what_it_leaves_out(tmp_path, capsys):
    (tmp_path / "camera.toml").write_text(USERS)
    assert optsim("prism", "--camera", tmp_path / "camera.toml", "--draws", 100) == 0
    lines = capsys.readouterr().out.splitlines()
    left_out = next(line for line in lines if "..." in line)
    shown = [line for line in lines if line[:4].strip().isdigit() and line.count(".") >= 4]
    assert len(shown) + int(left_out.split()[1]) == int(shown[-1].split()[0]) + 1

"""What effects cost a reconstruction: only those that an H can hold are priced, and none at nothing."""

import json
import math

import numpy as np
import pytest

from optsim.camera import CameraConfig, Mono, effect_named, glass
from optsim.camera.optics_config import DmdConfig, SensorConfig
from optsim.camera.relay import Relay
from optsim.cli.app import _code
from optsim.study.effect_cost import EffectCostConfig, effect_costs, effect_sizes


def test_sizes_alone_rank_the_default_cameras_effects(tmp_path, capsys):
    assert _code(["explain", "--camera", "default", "--no-db", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    here = [row["name"] for row in report["effects"] if row["present"]]
    assert here == ["diffraction", "fresnel", "smile", "prnu", "leak"]
    assert report["required"] == ["diffraction", "fresnel", "smile"]
    assert all(row["loss_db"] == {} for row in report["effects"])


def test_a_camera_file_is_ranked_and_a_looser_error_requires_less(tmp_path, capsys):
    path = tmp_path / "camera.toml"
    path.write_text(CameraConfig(dmd=DmdConfig(offset_x_px=0.3)).to_toml())
    counts = []
    for error in (0.001, 0.1, 1.0):
        assert _code(["explain", "--camera", str(path), "--no-db", "--json", "--error", str(error)]) == 0
        report = json.loads(capsys.readouterr().out)
        counts.append(len(report["required"]))
    assert counts[0] > counts[1] > counts[2] == 0


def test_P13_explain_tells_where_a_dispersion_turns_back(tmp_path, capsys):
    path = tmp_path / "camera.toml"
    slope = [float(np.diff(glass(name).index([549.99, 550.01]))[0]) for name in ("N-BK7", "F2")]
    second = math.degrees(0.2 * slope[0] / slope[1])
    path.write_text(f'[prism]\nglasses = ["N-BK7", "F2"]\nface_tilt_deg = [{math.degrees(0.2)}, 0.0, {second}]\ndesign_position_px = 0.0\n')
    assert _code(["explain", "--camera", str(path), "--no-db"]) == 0
    assert "turns back at" in capsys.readouterr().out
    assert _code(["explain", "--camera", str(path), "--no-db", "--json"]) == 0
    (turn,) = json.loads(capsys.readouterr().out)["folds_nm"]
    assert abs(turn - 550) < 25


@pytest.mark.parametrize(("option", "value"), [("--size", "20"), ("--size", "0"), ("--size", "264"), ("--seeds", "0"), ("--seeds", "101")])
def test_reconstructions_of_an_impossible_size_or_number_are_refused_by_option(capsys, option, value):
    assert _code(["explain", "--camera", "default", option, value]) == 2
    said = capsys.readouterr().err
    assert f"optsim: {option}: must be" in said
    assert value in said


def test_explain_without_scene_or_camera_is_bad_usage(capsys):
    assert _code(["explain"]) == 2
    assert "--camera" in capsys.readouterr().err


def test_effects_before_the_mirrors_and_noise_have_no_price_and_say_why():
    camera = CameraConfig(sensor=SensorConfig(dsnu_e=20))
    notes = {cost.effect.name: cost.note for cost in effect_sizes(camera, 0.01) if cost.present}
    assert "noise" in notes["dsnu"]
    assert notes["leak"] == ""


@pytest.mark.slow
def test_a_displaced_mask_costs_decibels_and_is_drawn(tmp_path):
    from optsim.report.figures_cost import draw_effects

    camera = CameraConfig(dmd=DmdConfig(offset_x_px=0.5, leak=1e-6), relay=Relay(diffraction=False), sensor=SensorConfig(prnu=0.0))
    config = EffectCostConfig(size=16, seeds=2)
    costs = {c.effect.name: c for c in effect_costs(camera, 0.01, config=config, chosen=[Mono()], quiet=True)}
    lost = costs["registration"]
    assert lost.required
    assert lost.loss_db["mono"].mean > 0.3
    assert lost.frames_change > 0.05
    assert abs(costs["leak"].loss_db["mono"].mean) < 0.05
    assert costs["diffraction"].loss_db == {}
    report = {"error": 0.01, "size": 16, "effects": [c.as_dict() for c in costs.values()]}
    draw_effects(report, tmp_path / "effects.png")
    assert (tmp_path / "effects.png").stat().st_size > 10_000
    assert effect_named("registration").present(camera)

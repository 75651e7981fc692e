"""docs/scenes.md alone leads to a picture of a scene with a mesh and a measured reflectance."""

import re
import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest

from optsim.cli.app import _code
from optsim.files import read_cube
from scenes.errors import InputError
from scenes.file_shapes import FORMS
from scenes.files import FORMAT, LIGHT_KINDS, MATERIAL_KINDS, SHAPE_KINDS, VIEWPOINT_KINDS, read_scene, scene_from_data

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```$", TEXT, re.DOTALL | re.MULTILINE)


SCENE, TEXTURE = blocks("toml")
(CSV,), (OBJ,), (PROGRAM,) = blocks("csv"), blocks("obj"), blocks("python")
FILES = {"still-life.toml": SCENE, "leaf.csv": CSV, "obelisk.obj": OBJ}
COMMANDS = [shlex.split(line) for line in re.findall(r"^    optsim (.*)$", TEXT, re.MULTILINE) if not line.startswith(("optsim:", ":"))]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder that holds what the document says to save, and nothing else."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_example_is_the_document():
    for name, text in FILES.items():
        assert (ROOT / "examples" / "own_scene" / name).read_text(encoding="utf-8") == text


def test_the_printed_commands_lead_from_the_printed_files_to_a_picture(folder):
    assert [words[0] for words in COMMANDS] == ["explain", "render", "show"]
    quick = {"64": "16", "128": "16"}
    for words in COMMANDS:
        assert _code([quick.get(word, word) for word in words]) == 0
    cube = read_cube(folder / "cube.nc")
    assert cube["radiance"].shape == (16, 16, 24)
    assert (folder / "cube.png").stat().st_size > 10_000


def test_the_printed_program_runs(folder, capsys):
    exec(PROGRAM, {})
    assert "(32, 32, 31)" in capsys.readouterr().out


def test_the_printed_refusal_is_what_is_said(folder, capsys):
    (folder / "leaf.csv").write_text(CSV.replace("555,0.18", "555,1.2"))
    assert _code(["explain", "still-life.toml"]) == 2
    assert f"    {capsys.readouterr().err.strip()}\n" in TEXT


def test_the_mesh_stands_where_the_file_says(folder):
    scene = read_scene("still-life.toml")
    mesh = next(shape for shape in scene.shapes if shape.name == "obelisk")
    low, high = np.array(mesh.bounds())
    assert FORMAT in SCENE
    np.testing.assert_allclose((low[2], high[2]), (0, 0.11), atol=1e-12)
    np.testing.assert_allclose((low + high)[:2] / 2, (0, 0.05), atol=1e-12)
    corner = 0.015 * np.hypot(1, 1) * np.cos(np.deg2rad(45 - 25))
    np.testing.assert_allclose(high[:2] - (0, 0.05), corner, rtol=1e-12)
    assert len(mesh.faces) == 14, "quadrilaterals are cut in two"
    assert scene.materials["leaf"].reflectance.at(555.0) == pytest.approx(0.18)


def test_a_turn_goes_about_x_then_y_then_z(folder):
    from scipy.spatial.transform import Rotation

    data = tomllib.loads(SCENE)
    (shape,) = (s for s in data["shapes"] if s["name"] == "obelisk")
    plain = scene_from_data({**data, "shapes": [shape | {"rotation_deg": [0, 0, 0], "position": [0, 0, 0]}]}, folder).shapes[0]
    turned = scene_from_data({**data, "shapes": [shape | {"rotation_deg": [20, -35, 110], "position": [1, 2, 3]}]}, folder).shapes[0]
    turn = Rotation.from_euler("xyz", [20, -35, 110], degrees=True)
    wanted = turn.apply(np.array(plain.vertices)) + np.array([1, 2, 3])
    np.testing.assert_allclose(np.asarray(turned.vertices), wanted, atol=1e-12)


@pytest.mark.parametrize("name", ["rotation_deg", "position"])
@pytest.mark.parametrize("value", [[1, 2], "up", [0, 0, float("nan")]])
def test_a_place_that_is_none_is_refused_by_name(folder, name, value):
    data = tomllib.loads(SCENE)
    next(s for s in data["shapes"] if s["name"] == "obelisk")[name] = value
    with pytest.raises(InputError, match=rf"shapes\.obelisk\.{name}"):
        scene_from_data(data, folder)


def test_the_printed_texture_is_one():
    viewpoint = {"kind": "orthographic", "origin": [0, 0, 1], "target": [0, 0, 0], "half_height": 1}
    data = tomllib.loads(TEXTURE) | {"name": "s", "viewpoint": viewpoint}
    data["materials"]["poster"] |= {"weights": [[[1, 0, 0], [0, 1, 0]]], "basis": ["red", "cie224-40", 0.5]}
    assert scene_from_data(data).materials["poster"].size == (1, 2)


def test_the_document_names_every_kind():
    for name in (*MATERIAL_KINDS, *SHAPE_KINDS, *FORMS, *LIGHT_KINDS, *VIEWPOINT_KINDS):
        assert f"`{name}`" in TEXT

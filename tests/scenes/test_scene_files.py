"""Scene files: every scene reads back as it was; what is wrong is named; nothing outside the folder is reached."""

import contextlib
import json
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import scenes
from scenes import library
from scenes.errors import InputError
from scenes.files import MAX_BYTES, read_scene, scene_from_data, scene_to_data, write_scene
from scenes.scene import Conductor, Dielectric, DirectionalLight, Orthographic, PointLight, RoughPlastic, Scene, Sphere

TEXT = """
name = "mine"
[viewpoint]
kind = "perspective"
origin = [0, 0, 3]
target = [0, 0, 0]
fov_deg = 30
[materials.red]
kind = "diffuse"
reflectance = "red"
[materials.own]
kind = "diffuse"
reflectance = {csv = "own.csv"}
[[shapes]]
name = "floor"
kind = "rectangle"
material = "red"
center = [0, 0, 0]
half_u = [1, 0, 0]
half_v = [0, 1, 0]
[[lights]]
kind = "sky"
radiance = {blackbody_K = 3000, scale = 1e-6}
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "own.csv").write_text("wavelength_nm,a,b\n300,0.5,0.1\n900,0.6,0.2\n")
    (tmp_path / "outside.csv").write_text("wavelength_nm,a\n300,1\n900,1\n")
    home = tmp_path / "home"
    home.mkdir()
    (home / "own.csv").write_text((tmp_path / "own.csv").read_text())
    return home


def put(folder, old="", new="", name="s.toml"):
    assert old in TEXT
    path = folder / name
    path.write_text(TEXT.replace(old, new, 1) if old else TEXT)
    return path


@pytest.mark.parametrize("recipe", scenes.SCENES, ids=lambda r: r.name)
@pytest.mark.parametrize("kind", ["toml", "json"])
def test_every_scene_reads_back_equal_from_its_file(tmp_path, recipe, kind):
    scene = recipe.build()
    path = tmp_path / f"a scene é.{kind}"
    write_scene(scene, path)
    assert read_scene(path) == scene
    first = path.read_bytes()
    write_scene(read_scene(path), path)
    assert path.read_bytes() == first


def test_every_kind_of_material_light_and_view_reads_back_equal(tmp_path):
    scene = Scene(
        name='odd "name"\n',
        shapes=[Sphere(name=f"s{i}", material=m, center=(i, 0.1, -1e-7), radius=1 / 3) for i, m in enumerate("abcd")],
        materials={
            "a": Dielectric(index=1.5),
            "b": Dielectric(index=1.6, abbe=36.4),
            "c": RoughPlastic(reflectance=library.reflectance("cyan")),
            "d": Conductor(eta=0.2, k=3),
        },
        lights=[DirectionalLight(direction=(0, 0.1, -1), irradiance=1e-40), PointLight(position=(1, 2, 3), intensity=1e30)],
        viewpoint=Orthographic(origin=(0, 0, 1), target=(0, 0, 0), half_height=0.1),
    )
    for kind in ("toml", "json"):
        write_scene(scene, tmp_path / f"s.{kind}")
        assert read_scene(tmp_path / f"s.{kind}") == scene


def test_spectra_come_by_name_formula_table_and_csv(folder):
    scene = read_scene(put(folder))
    assert scene.materials["red"].reflectance == library.reflectance("red")
    np.testing.assert_allclose(scene.materials["own"].reflectance.at(600), 0.55)
    expected = library.blackbody(3000, [550.0, 560.0]).value[0] * 1e-6
    assert scene.lights[0].radiance.at(550.0) == pytest.approx(expected, rel=1e-12)
    second = read_scene(put(folder, '"own.csv"', '"own.csv", column = "b"'))
    np.testing.assert_allclose(second.materials["own"].reflectance.at(600), 0.15)
    lit = read_scene(put(folder, "{blackbody_K = 3000, scale = 1e-6}", '{illuminant = "D65", scale = 2}'))
    assert lit.lights[0].radiance == library.illuminant("D65").scaled(2)
    assert read_scene(put(folder, "{blackbody_K = 3000, scale = 1e-6}", '"xenon"')).lights[0].radiance == library.illuminant("xenon")
    assert read_scene(put(folder, '"red"', "0.25")).materials["red"].reflectance.maximum == 0.25
    narrow = read_scene(put(folder, "{blackbody_K = 3000, scale = 1e-6}", "{line_nm = 550, width_nm = 2}")).lights[0].radiance
    assert narrow == library.line(550, 2)


@pytest.mark.parametrize(
    ("old", "new", "field", "match"),
    [
        ('"red"', "1.5", "materials.red.reflectance", r"\[0, 1\]"),
        ('"red"', "nan", "materials.red.reflectance", "finite"),
        ('"red"', '"rde"', "materials.red.reflectance", "did you mean 'red'"),
        ('reflectance = "red"', 'reflectanc = "red"', "materials.red.reflectanc", "did you mean 'reflectance'"),
        ('{csv = "own.csv"}', "{wavelength_nm = [500, 400], value = [0, 1]}", "materials.own.reflectance.wavelength_nm", "increasing"),
        ('{csv = "own.csv"}', "{wavelength_nm = [400, 500], value = [0, inf]}", "materials.own.reflectance.value", "finite"),
        ('{csv = "own.csv"}', '{csvv = "own.csv"}', "materials.own.reflectance", "exactly one of"),
        ('{csv = "own.csv"}', '{csv = "own.csv", colum = "b"}', "materials.own.reflectance.colum", "did you mean 'column'"),
        ('{csv = "own.csv"}', "true", "materials.own.reflectance", "a number, a name"),
        ("= 3000", "= 0", "lights[0].radiance", "K"),
        ("scale = 1e-6", "scale = inf", "lights[0].radiance", "finite"),
        ("scale = 1e-6", "scale = 1e40", "lights[0].radiance", r"\[0, 1e\+30\]"),
        ('kind = "sky"', 'kind = "skies"', "lights[0].kind", "area, directional, point, sky"),
        ("[[shapes]]", "[[shape]]", "shape", "did you mean 'shapes'"),
        ("fov_deg = 30", "fov_deg = 180", "viewpoint.fov_deg", "degrees"),
        ("target = [0, 0, 0]", "target = [0, 0, 3]", "viewpoint.look_at", "not the origin"),
        ('material = "red"', 'material = "rde"', "shapes.floor.material", "did you mean 'red'"),
        ("half_u = [1, 0, 0]", "half_u = [1, 0]", "shapes.floor.half_u", "three numbers"),
        ('name = "mine"', 'name = ""', "name", "at least 1 character"),
        ('name = "mine"', 'format = "optsim-scene-9"\nname = "mine"', "format", "optsim-scene-1"),
        ("[viewpoint]", "[view]", "view", "did you mean 'viewpoint'"),
        ("[materials.own]", "[materials.red]", "scene", "readable TOML"),
    ],
)
def test_I12_a_fault_in_a_scene_file_is_named_by_its_place(folder, old, new, field, match):
    with pytest.raises(InputError, match=match) as error:
        read_scene(put(folder, old, new))
    assert error.value.field == field


@pytest.mark.parametrize(
    "name", ["../outside.csv", "/etc/passwd", "", "a/../../outside.csv", "link.csv", "door/outside.csv", "~/x\\u0000.csv"]
)
def test_a_scene_file_reaches_no_file_outside_its_folder(folder, name):
    (folder / "link.csv").symlink_to(folder.parent / "outside.csv")
    (folder / "door").symlink_to(folder.parent)
    with pytest.raises(InputError, match="inside the scene file's own folder") as error:
        read_scene(put(folder, '"own.csv"', f'"{name}"'))
    assert error.value.field == "materials.own.reflectance.csv"


def test_a_link_inside_the_folder_and_a_folder_below_are_fine(folder):
    (folder / "below").mkdir()
    (folder / "below" / "real.csv").write_text((folder / "own.csv").read_text())
    (folder / "link.csv").symlink_to("below/real.csv")
    for name in ("link.csv", "below/real.csv"):
        assert read_scene(put(folder, "own.csv", name)).materials["own"].reflectance.at(300) == 0.5


@pytest.mark.parametrize(
    "text",
    [
        "",
        "wavelength_nm\n400\n",
        "nm,a\n400,1\n",
        "wavelength_nm,a\n400,x\n",
        "wavelength_nm,a\n400\n",
        "wavelength_nm,a\n400,1\n",
        "\xff\xfe",
    ],
)
def test_a_csv_that_is_no_spectrum_is_refused(folder, text):
    (folder / "own.csv").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match="reflectance"):
        read_scene(put(folder))


def test_I10_a_scene_file_must_be_a_regular_file_of_a_known_type_and_at_most_a_mebibyte(folder):
    (folder / "big.toml").write_text(TEXT + "#" * MAX_BYTES)
    os.mkfifo(folder / "pipe.toml")
    (folder / "zero.json").symlink_to("/dev/zero")
    (folder / "s.py").write_text("print()")
    for name, match in (("big.toml", "at most 1048576 bytes"), ("pipe.toml", "regular"), ("zero.json", "regular"), ("s.py", "toml")):
        with pytest.raises(InputError, match=match):
            read_scene(folder / name)


def test_I12_json_with_repeated_keys_nan_or_endless_nesting_is_refused(tmp_path):
    good = json.dumps(scene_to_data(scenes.scene_by_name("color-checker").build()))
    for text, match in (
        ('{"name": "a", "name": "b"}', "repeated keys"),
        (good.replace('"half_height": 0.125', '"half_height": NaN'), "finite"),
        (good.replace('"half_height": 0.125', '"half_height": 1e999'), "half_height"),
        ("[" * 100_000, "readable JSON"),
        ("[]", "table"),
        ("\x00", "readable JSON"),
    ):
        path = tmp_path / "s.json"
        path.write_text(text)
        with pytest.raises(InputError, match=match):
            read_scene(path)


def test_a_mesh_file_beside_the_scene_file_is_read_in_its_own_unit(folder):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((100, 100, 100)).export(folder / "box.ply")
    new = '[[shapes]]\nname = "box"\nkind = "mesh"\nmaterial = "red"\nfile = "box.ply"\nmetres_per_unit = 0.001\n[[shapes]]'
    scene = read_scene(put(folder, "[[shapes]]", new))
    np.testing.assert_allclose(scene.shapes[0].bounds(), [[-0.05] * 3, [0.05] * 3])
    for bad, match in (("../box.ply", "own folder"), ("box.zip", "can be read|of type"), ("none.ply", "can be read")):
        with pytest.raises(InputError, match=match) as error:
            read_scene(put(folder, "[[shapes]]", new.replace("box.ply", bad)))
        assert error.value.field.startswith("shapes.box")


def test_data_without_a_folder_may_name_no_files():
    data = {"name": "s", "viewpoint": {"kind": "orthographic", "origin": [0, 0, 1], "target": [0, 0, 0], "half_height": 1}}
    assert scene_from_data(data).shapes == ()
    data["materials"] = {"m": {"kind": "diffuse", "reflectance": {"csv": "x.csv"}}}
    with pytest.raises(InputError, match="no folder"):
        scene_from_data(data)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(max_size=5) | st.sampled_from(["diffuse", "sphere", "area"]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["kind", "name", "radius", "reflectance", "x"]), inner, max_size=4)
    ),
    max_leaves=12,
)
KEYS = st.sampled_from(["name", "viewpoint", "materials", "lights", "shapes", "format", "junk"])


@settings(deadline=None, max_examples=300)
@given(st.dictionaries(KEYS, JSON, max_size=6))
def test_any_data_at_all_is_a_scene_or_an_input_error(data):
    with contextlib.suppress(InputError):
        assert isinstance(scene_from_data(data), Scene)

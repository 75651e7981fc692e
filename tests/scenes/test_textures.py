"""Textures, thin lenses, gradient skies and lamps of many lines: what they are, and how scene files write them."""

import numpy as np
import pytest
from PIL import Image

from scenes.errors import InputError
from scenes.files import read_scene, scene_to_data, write_scene
from scenes.library import line, lines, reflectance
from scenes.lights import GradientSky
from scenes.scene import Diffuse, Orthographic, Rectangle, Scene, Sphere
from scenes.textures import Textured
from scenes.viewpoint import Perspective, ThinLens

WEIGHTS = np.array([[[1, 0], [0, 1]], [[0.25, 0.5], [0, 0]]], np.float32)
PAIR = (reflectance("red"), reflectance("green"))
BOARD = {"center": (0, 0, 0), "half_u": (1, 0, 0), "half_v": (0, 1, 0)}
VIEW = Orthographic(origin=(0, 0, 1), target=(0, 0, 0), half_height=1)


def test_a_texel_is_the_mixture_of_the_basis_that_its_weights_say_and_row_0_is_on_top():
    texture = Textured(basis=PAIR, weights=WEIGHTS)
    nm = np.array([480.0, 550.0, 620.0])
    red, green = (s.at(nm) for s in PAIR)
    found = texture.at([0.2, 0.9, 0.4, 0.6], [0.8, 0.51, 0.1, 0.49], nm)
    np.testing.assert_allclose(found, [red, green, 0.25 * red + 0.5 * green, 0 * red], atol=1e-15)
    np.testing.assert_allclose(texture.mean().at(nm), found.mean(0), atol=1e-15)
    assert found.max() <= texture.largest <= 1


@pytest.mark.parametrize(
    ("change", "field", "match"),
    [
        ({"weights": WEIGHTS * 2}, "material.weights", "row, column"),
        ({"weights": -WEIGHTS}, "material.weights", "at least 0"),
        ({"weights": WEIGHTS * np.nan}, "material.weights", "finite"),
        ({"weights": WEIGHTS[0]}, "material.weights", "rows, columns, basis"),
        ({"weights": WEIGHTS[..., :1]}, "material.weights", "2 spectra"),
        ({"basis": ()}, "material.basis", "at least 1"),
        ({"basis": (1.5, 0.5)}, "material.basis", "[0, 1]"),
    ],
)
def test_what_is_no_reflectance_is_refused(change, field, match):
    with pytest.raises(InputError, match=match.replace("[", r"\[")) as caught:
        Textured(**({"basis": PAIR, "weights": WEIGHTS} | change))
    assert caught.value.field.startswith(field)


def test_a_texture_lies_on_rectangles_only():
    with pytest.raises(InputError, match="rectangles only"):
        Scene(
            name="ball",
            shapes=(Sphere(name="ball", material="print", center=(0, 0, 0), radius=1),),
            materials={"print": Textured(basis=PAIR, weights=WEIGHTS)},
            lights=(),
            viewpoint=VIEW,
        )


def scene_file(folder, weights, basis='["red", {reflectance = "green"}]'):
    path = folder / "scene.toml"
    path.write_text(
        f"""
name = "print"
viewpoint = {{kind = "thin-lens", origin = [0, 0, 1], target = [0, 0, 0], fov_deg = 40.0, aperture_m = 0.01}}
materials.print = {{kind = "textured", basis = {basis}, weights = {weights}}}
shapes = [{{kind = "rectangle", name = "board", material = "print", center = [0, 0, 0], half_u = [1, 0, 0], half_v = [0, 1, 0]}}]
lights = [
  {{kind = "gradient-sky", radiance = {{lines_nm = [486.1, 656.3], power = [1.0, 2.0], width_nm = 0.02}}, zenith = 1.0, horizon = 0.2}},
]
"""
    )
    return path


def test_weights_come_inline_from_a_png_and_from_an_npy_file(tmp_path):
    inline = read_scene(scene_file(tmp_path, WEIGHTS.tolist()))
    np.save(tmp_path / "w.npy", WEIGHTS)
    assert read_scene(scene_file(tmp_path, '"w.npy"')) == inline
    levels = np.array([[[255, 0, 0], [0, 255, 0]], [[51, 102, 51], [0, 0, 0]]], np.uint8)
    Image.fromarray(levels).save(tmp_path / "w.png")
    found = read_scene(scene_file(tmp_path, '"w.png"', '["red", "green", "blue"]')).materials["print"]
    np.testing.assert_allclose(found.weights, levels / 255, atol=1e-7)


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_a_scene_with_texture_lens_sky_and_lines_reads_back_equal(tmp_path, suffix):
    scene = read_scene(scene_file(tmp_path, WEIGHTS.tolist()))
    write_scene(scene, tmp_path / f"again{suffix}")
    again = read_scene(tmp_path / f"again{suffix}")
    assert again == scene
    assert scene_to_data(again) == scene_to_data(scene)


@pytest.mark.parametrize(
    "make",
    [
        lambda f: (f / "w.npy").write_bytes(b"\x93NUMPY\x01\x00" + b"{" * 50),
        lambda f: np.save(f / "w.npy", np.array([[{}]], object), allow_pickle=True),
        lambda f: (f / "w.npy").write_bytes(_npy_header((60000, 60000, 2))),
        lambda f: (f / "w.npy").write_bytes(b""),
        lambda f: np.save(f / "w.npy", np.ones((2, 2, 2), complex)),
        lambda f: np.save(f / "w.npy", np.ones(4)),
    ],
    ids=["garbled", "objects", "claims too much", "empty", "complex", "flat"],
)
def test_an_npy_file_that_is_no_table_of_weights_is_refused(tmp_path, make):
    make(tmp_path)
    with pytest.raises(InputError, match="weights"):
        read_scene(scene_file(tmp_path, '"w.npy"'))


def _npy_header(shape):
    import io

    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return stream.getvalue()


@pytest.mark.parametrize("name", ["../w.npy", "/etc/passwd", "w.txt", "missing.png", ""])
def test_weights_outside_the_folder_or_of_another_type_are_refused(tmp_path, name):
    with pytest.raises(InputError, match="weights"):
        read_scene(scene_file(tmp_path, f'"{name}"'))


def test_rays_through_all_of_a_thin_lens_meet_in_the_sharp_plane_and_its_middle_is_a_pinhole():
    view = {"origin": (0.3, -1, 2), "target": (0, 0.5, 0), "up": (0, 0, 1), "fov_deg": 35}
    lens, pinhole = ThinLens(**view, aperture_m=0.2, focus_m=1.5), Perspective(**view)
    across, down = np.array([0.1, 0.8]), np.array([0.7, 0.2])
    np.testing.assert_allclose(lens.rays(across, down, 1.5)[1], pinhole.rays(across, down, 1.5)[1], atol=1e-15)
    forward = lens.axes()[2]
    meet = []
    for x, y in ((0.0, 0.0), (1.0, 0.0), (-0.3, 0.8)):
        start, d = lens.lens_rays(across, down, np.full(2, x), np.full(2, y), 1.5)
        assert np.allclose(np.linalg.norm(start - lens.origin, axis=-1), 0.2 * np.hypot(x, y))
        far = (1.5 - (start - lens.origin) @ forward) / (d @ forward)
        meet.append(start + far[:, None] * d)
    np.testing.assert_allclose(meet, np.broadcast_to(meet[0], np.shape(meet)), atol=1e-13)


def test_a_gradient_sky_goes_with_the_sine_of_the_elevation():
    sky = GradientSky(radiance=1.0, horizon=0.2, zenith=1.0, up=(0, 2, 0))
    np.testing.assert_allclose(sky.share([(1, 0, 0), (0, 3, 0), (1, 1, 0), (0, -1, 0)]), [0.2, 1, 0.2 + 0.8 / np.sqrt(2), 0.2], atol=1e-15)


def test_a_lamp_of_many_lines_keeps_each_lines_power():
    lamp = lines([435.8, 546.1, 546.11], [1.0, 3.0, 2.0], 0.02)
    assert lamp.band_mean(430, 440) * 10 == pytest.approx(1, rel=1e-12)
    assert lamp.band_mean(540, 550) * 10 == pytest.approx(5, rel=1e-12)
    assert lamp.at(546.1) == pytest.approx(3 * line(546.1, 0.02).at(546.1) + 2 * line(546.11, 0.02).at(546.1))
    for bad in ({"power": [1, -1]}, {"power": [1]}, {"center_nm": []}, {"power": [1, np.nan]}):
        with pytest.raises(InputError):
            lines(**({"center_nm": [450, 500], "power": [1, 1]} | bad))


def test_diffuse_and_textured_tell_their_curves_and_their_largest_reflectance():
    plain = Diffuse(reflectance=PAIR[0])
    assert plain.curves == (PAIR[0],)
    assert plain.largest == PAIR[0].maximum
    board = Rectangle(name="b", material="m", **BOARD)
    scene = Scene(name="s", shapes=(board,), materials={"m": Textured(basis=PAIR, weights=WEIGHTS)}, lights=(), viewpoint=VIEW)
    from scenes.visibility import is_diffuse, largest_albedo

    assert is_diffuse(scene)
    assert largest_albedo(scene) == pytest.approx(max(s.maximum for s in PAIR))


@pytest.mark.parametrize(
    ("text", "volume"),
    [
        ('kind = "cylinder"\nradius = 0.5\nheight = 2.0\nsections = 64', 64 / 2 * np.sin(2 * np.pi / 64) * 0.25 * 2),
        ('kind = "cone"\nradius = 0.5\nheight = 2.0\nsections = 64', 64 / 2 * np.sin(2 * np.pi / 64) * 0.25 * 2 / 3),
        ('kind = "torus"\nring = 1.0\ntube = 0.25\nsections = 128', 2 * np.pi**2 * 0.25**2),
        ('kind = "icosphere"\nradius = 1.0\nsubdivisions = 5', 4 / 3 * np.pi),
    ],
)
def test_a_scene_file_describes_solids_by_what_they_are(tmp_path, text, volume):
    (tmp_path / "s.toml").write_text(
        'name = "s"\nviewpoint = {kind = "orthographic", origin = [0, 0, 5], target = [0, 0, 0], half_height = 1.0}\n'
        'materials.red = {kind = "diffuse", reflectance = "red"}\n'
        f'[[shapes]]\nname = "solid"\nmaterial = "red"\ncenter = [1, 2, 3]\naxis = [1, 1, 0]\n{text}\n'
    )
    (mesh,) = read_scene(tmp_path / "s.toml").shapes
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - np.array([1, 2, 3]) for k in range(3))
    found = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6  # positive when faces look outwards
    assert found == pytest.approx(volume, rel=5e-3)


def test_a_catalogue_glass_bends_as_the_cameras_own_formula_says(tmp_path):
    from optsim.camera.glass import glass, glass_names
    from scenes.glasses import glass_names as scene_glasses
    from scenes.materials import Dielectric

    nm = np.linspace(380, 780, 9)
    assert scene_glasses() == glass_names()
    for name in ("N-BK7", "F2", "N-SF10"):
        found = Dielectric(glass=name)
        np.testing.assert_allclose(found.index_at(nm), glass(name).index(nm), rtol=1e-14)
        assert found.abbe == pytest.approx(glass(name).abbe, rel=1e-12)
    assert Dielectric(glass="N-BK7").index == pytest.approx(1.5168, abs=1e-5)
    assert Dielectric(**Dielectric(glass="F2").model_dump()) == Dielectric(glass="F2")
    with pytest.raises(InputError, match="did you mean 'N-BK7'"):
        Dielectric(glass="N-BK8")
    with pytest.raises(InputError, match=r"material\.index"):
        Dielectric(glass="N-BK7", index=1.6)
    with pytest.raises(InputError, match="300 to 2500"):
        Dielectric(glass="N-BK7").index_at(200)


@pytest.mark.parametrize(("kind", "more"), [("orthographic", ""), ("perspective", ""), ("thin-lens", "aperture_m = 0.02\n")])
def test_a_view_square_on_a_rectangle_has_its_corners_in_the_pictures_corners(tmp_path, kind, more):
    c, s = np.cos(0.4), np.sin(0.4)
    (tmp_path / "s.toml").write_text(
        f'name = "s"\n[viewpoint]\nkind = "{kind}"\nsquare_on = "card"\ndistance = 3.0\n{more}'
        '[materials]\nred = {kind = "diffuse", reflectance = "red"}\n'
        '[[shapes]]\nkind = "rectangle"\nname = "card"\nmaterial = "red"\n'
        f"center = [1, 2, 3]\nhalf_u = [{1.5 * c}, 0, {1.5 * s}]\nhalf_v = [0, 1, 0]\n"
    )
    scene = read_scene(tmp_path / "s.toml")
    (card,) = scene.shapes
    origins, d = scene.viewpoint.rays(np.array([0.0, 1, 1, 0]), np.array([1.0, 1, 0, 0]), 1.5)
    far = ((np.asarray(card.center) - origins) @ card.normal) / (d @ card.normal)
    np.testing.assert_allclose(origins + far[:, None] * d, card.corners(), atol=1e-12)
    for bad in ('square_on = "cart"', "distance = -1.0"):
        text = (tmp_path / "s.toml").read_text()
        (tmp_path / "bad.toml").write_text(text.replace('square_on = "card"' if "cart" in bad else "distance = 3.0", bad))
        with pytest.raises(InputError, match="viewpoint"):
            read_scene(tmp_path / "bad.toml")

"""The two targets: where everything lies, and the lamp's irradiance judged by integration over the lamp."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import dblquad

import scenes
from scenes.checker_bars import CheckerBars
from scenes.color_checker import ColorChecker
from scenes.errors import InputError
from scenes.library import line, reflectances
from scenes.materials import Diffuse
from scenes.spectrum import Spectrum


def picture_box(view, shape):
    """Project a rectangle's corners to picture fractions, by solving with the view's own corner rays."""
    (o00, o10, o01), _ = view.rays(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    across, down = o10 - o00, o01 - o00
    points = shape.corners() - o00
    x, y = points @ across / (across @ across), points @ down / (down @ down)
    return x.min(), y.min(), x.max(), y.max()


@pytest.mark.parametrize("recipe", [ColorChecker(), CheckerBars(), ColorChecker(side_m=0.3)])
def test_the_board_fills_the_picture_and_each_patch_lies_where_it_is_said_to(recipe):
    scene = recipe.build()
    shapes = {shape.name: shape for shape in scene.shapes}
    np.testing.assert_allclose(picture_box(scene.viewpoint, shapes["board"]), (0, 0, 1, 1), atol=1e-12)
    assert list(recipe.patch_boxes()) == list(reflectances())
    for name, box in recipe.patch_boxes().items():
        np.testing.assert_allclose(picture_box(scene.viewpoint, shapes[name]), box, atol=1e-12)
        assert shapes[name].material == name


def test_patch_borders_favour_no_dyadic_grid_and_patches_are_apart():
    boxes = np.array(list(ColorChecker().patch_boxes().values()))
    for size in (64, 128, 256):
        on_a_mirror_border = np.abs(boxes * size - np.round(boxes * size)) < 0.01
        assert on_a_mirror_border.mean() < 0.1
    assert boxes.min() > 0
    assert boxes.max() < 1
    for a in range(24):
        for b in range(a):
            gap_x = max(boxes[a, 0], boxes[b, 0]) - min(boxes[a, 2], boxes[b, 2])
            gap_y = max(boxes[a, 1], boxes[b, 1]) - min(boxes[a, 3], boxes[b, 3])
            assert max(gap_x, gap_y) > 0


def test_the_bars_are_two_and_one_mirrors_wide_with_gaps_as_wide_and_start_on_mirror_borders():
    groups = CheckerBars().bar_columns()
    for name, width in (("wide", 2), ("narrow", 1)):
        group = groups[name]
        columns = np.array(group.columns) * 256
        assert np.all(columns == np.round(columns))
        assert np.all(columns[:, 1] - columns[:, 0] == width)
        assert all(after[0] - before[1] == width for before, after in pairwise(columns))
        assert group.top * 256 == round(group.top * 256)
    assert max(c[1] for c in groups["wide"].columns) < 0.5 < min(c[0] for c in groups["narrow"].columns)
    assert groups["wide"].top > 0.5


def test_the_bars_stand_in_the_scene_exactly_where_they_are_said_to():
    scene = CheckerBars().build()
    shapes = {shape.name: shape for shape in scene.shapes}
    for name, group in CheckerBars().bar_columns().items():
        for i, (left, right) in enumerate(group.columns):
            np.testing.assert_array_equal(picture_box(scene.viewpoint, shapes[f"{name} bar {i}"]), (left, group.top, right, group.bottom))


def test_the_diagonal_lines_are_two_mirrors_wide_and_lie_in_the_upper_half():
    scene = CheckerBars().build()
    lines = [shape for shape in scene.shapes if shape.name.startswith("line ")]
    assert len(lines) >= 4
    for shape in lines:
        mirror = CheckerBars().side_m / 256
        assert 2 * np.linalg.norm(shape.half_v) == pytest.approx(2 * mirror)
        left, top, right, bottom = picture_box(scene.viewpoint, shape)
        assert bottom < 0.5
        assert top > 0
        assert right - left == pytest.approx(bottom - top)


@pytest.mark.parametrize("recipe", [ColorChecker(), CheckerBars()])
def test_every_surface_of_a_target_faces_the_camera_and_is_diffuse(recipe):
    scene = recipe.build()
    for shape in scene.shapes:
        np.testing.assert_array_equal(shape.normal, (0, 0, 1))
        assert isinstance(scene.material_of(shape), Diffuse)
        assert 0 <= shape.center[2] <= 2 * 2**-16 * recipe.side_m


def irradiance_factor(light, point, normal):
    """Integrate cos cos / r^2 over the lamp."""
    u, v, c = (np.asarray(x) for x in (light.half_u, light.half_v, light.center))
    area = np.linalg.norm(np.cross(u, v))

    def density(a, b):
        r = c + a * u + b * v - point
        d = np.linalg.norm(r)
        return area * (r @ normal) * -(r @ light.normal) / d**4

    return dblquad(density, -1, 1, -1, 1, epsabs=1e-12, epsrel=1e-10)[0]


@pytest.mark.parametrize("point", [(0, 0, 0), (0.12, -0.12, 0), (-0.125, 0.1, 1e-5)])
def test_lamberts_polygon_formula_equals_the_integral_over_the_lamp(point):
    light = ColorChecker().build().lights[0]
    n = np.array([0.0, 0.0, 1.0])
    assert light.irradiance_per_radiance(point, n) == pytest.approx(irradiance_factor(light, np.array(point), n), rel=1e-9)
    near = ColorChecker().build().lights[0].model_copy(update={"center": (0.0, 0.0, 0.06), "half_u": (0, 0.05, 0), "half_v": (0.05, 0, 0)})
    assert near.irradiance_per_radiance((0, 0, 0), n) == pytest.approx(irradiance_factor(near, np.zeros(3), n), rel=1e-7)


def test_lamberts_polygon_formula_refuses_a_point_that_the_light_is_behind():
    light = ColorChecker().build().lights[0]
    with pytest.raises(InputError, match="above the surface"):
        light.irradiance_per_radiance((0, 0, 0), (0, 0, -1))


def test_the_lamp_gives_the_irradiance_asked_for_whatever_its_spectrum():
    for lamp in (ColorChecker().lamp, Spectrum.constant(7.0), line(550.0, 5.0)):
        recipe = ColorChecker(lamp=lamp, irradiance=0.02)
        light = recipe.build().lights[0]
        mean = float(light.radiance.band_mean(450.0, 670.0)) * irradiance_factor(light, np.zeros(3), np.array([0.0, 0.0, 1.0]))
        assert mean == pytest.approx(0.02, rel=1e-8)


def test_the_light_falls_by_10_to_20_percent_across_the_board():
    light = ColorChecker().build().lights[0]
    at = np.linspace(-0.125, 0.125, 5)
    level = np.array([[light.irradiance_per_radiance((x, y, 0), (0, 0, 1)) for x in at] for y in at])
    assert 0.10 < (level.max() - level.min()) / level.max() < 0.20


def test_every_scene_is_found_by_its_name_and_an_unknown_one_is_answered_with_the_nearest():
    names = [recipe.name for recipe in scenes.SCENES]
    assert names[:3] == ["color-checker", "color-checker-bars", "relief"]
    assert {*names[3:]} == {"bricks", "cornell", "glass", "glass-dispersive", "metamers", "textured", "dim-bright", "procedural-0"}
    for recipe in scenes.SCENES:
        assert scenes.scene_by_name(recipe.name) is recipe
        assert recipe.build().name == recipe.name
        assert recipe.build() == recipe.build()
    with pytest.raises(InputError, match="did you mean 'color-checker'"):
        scenes.scene_by_name("colour-checker")

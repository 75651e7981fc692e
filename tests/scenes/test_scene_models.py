"""Scenes refuse nonsense, naming the field, the range and the unit."""

import pickle

import numpy as np
import pytest

from scenes.errors import InputError
from scenes.scene import (
    AreaLight,
    Box,
    Conductor,
    ConstantSky,
    Dielectric,
    Diffuse,
    DirectionalLight,
    Mesh,
    Orthographic,
    Perspective,
    PointLight,
    Rectangle,
    RoughPlastic,
    Scene,
    Sphere,
)
from scenes.spectrum import Spectrum

VIEW = Orthographic(origin=(0, 0, 3), target=(0, 0, 0), half_height=1)
FLAT = Rectangle(name="flat", material="grey", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
GREY = {"grey": Diffuse(reflectance=0.5)}


def scene(**changes):
    return Scene(**{"name": "s", "shapes": [FLAT], "materials": GREY, "lights": [], "viewpoint": VIEW} | changes)


def refused(make, field, match=None):
    with pytest.raises(InputError, match=match) as error:
        make()
    assert error.value.field == field
    return error.value


@pytest.mark.parametrize("bad", [1.5, -1.0, float("nan"), float("inf")])
def test_R6_a_reflectance_outside_zero_to_one_is_refused(bad):
    refused(lambda: Diffuse(reflectance=bad), "material.reflectance")
    refused(lambda: RoughPlastic(reflectance=bad), "material.reflectance")


def test_R6_the_message_says_at_which_wavelength_a_reflectance_leaves_its_range():
    curve = Spectrum(np.array([400.0, 500.0, 600.0]), np.array([0.5, 1.25, 0.5]), "odd")
    refused(lambda: Diffuse(reflectance=curve), "material.reflectance", r"in \[0, 1\]; 'odd' leaves it at 500 nm, got 1.25")


@pytest.mark.parametrize("bad", [float("inf"), 1e39, 1.0001e30, -1.0, float("nan")])
def test_R7_a_light_that_is_not_finite_or_above_1e30_is_refused(bad):
    refused(lambda: ConstantSky(radiance=bad), "light.radiance")
    refused(lambda: PointLight(position=(0, 0, 0), intensity=bad), "light.intensity")
    refused(lambda: DirectionalLight(direction=(0, 0, -1), irradiance=bad), "light.irradiance")


@pytest.mark.parametrize("small", [0.0, 1e-40, 1e-300, 1e30])
def test_R8_the_faintest_and_the_strongest_light_are_accepted(small):
    assert ConstantSky(radiance=small).radiance.maximum == small


def test_R13_a_view_from_its_own_target_or_along_up_is_refused():
    refused(lambda: Perspective(origin=(1, 2, 3), target=(1, 2, 3), fov_deg=30), "viewpoint.look_at", "not the origin")
    refused(lambda: Orthographic(origin=(0, 0, 1), target=(0, 0, 0), up=(0, 0, -2), half_height=1), "viewpoint.look_at", "not parallel")
    refused(lambda: Orthographic(origin=(0, 0, 1), target=(0, 0, 0), up=(0, 0, 0), half_height=1), "viewpoint.up", "non-zero")


@pytest.mark.parametrize("bad", [0.0, 180.0, -1.0, float("nan")])
def test_R14_a_field_of_view_is_inside_zero_to_180_degrees(bad):
    refused(lambda: Perspective(origin=(0, 0, 1), target=(0, 0, 0), fov_deg=bad), "viewpoint.fov_deg")


def test_R14_a_millidegree_view_covers_what_geometry_says():
    view = Perspective(origin=(0, 0, 2000), target=(0, 0, 0), fov_deg=1e-3)
    origins, directions = view.rays(np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    ends = origins + directions * (2000 / -directions[:, 2:])
    half = 2000 * np.tan(np.deg2rad(0.5e-3))
    np.testing.assert_allclose(ends, [[-half, half, 0], [half, -half, 0]], rtol=1e-9, atol=1e-9)


def test_pictures_have_their_first_row_on_top_and_x_to_the_right():
    for view in (VIEW, Perspective(origin=(0, 0, 3), target=(0, 0, 0), fov_deg=40)):
        right, up, forward = view.axes()
        np.testing.assert_allclose([right, up, forward], [[1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-15)
        origin, direction = view.rays(0.75, 0.25, aspect=2.0)
        end = origin + direction * (3 / -direction[2])
        half = 1.0 if view is VIEW else 3 * np.tan(np.deg2rad(20))
        np.testing.assert_allclose(end, [half, half / 2, 0], atol=1e-12)


def test_I9_a_mesh_with_a_vertex_number_out_of_range_is_refused_with_the_face():
    faces = [[0, 1, 2], [0, 1, 3], [7, 1, 2]]
    refused(lambda: Mesh(name="m", material="grey", vertices=np.eye(3), faces=faces), "shape.faces", "first bad face is number 1")
    refused(lambda: Mesh(name="m", material="grey", vertices=np.eye(3), faces=[[0, 1, -1]]), "shape.faces", "number 0")


def test_I9_a_mesh_with_a_vertex_that_is_not_finite_is_refused_with_its_number():
    bad = np.eye(3)
    bad[2, 1] = np.nan
    refused(lambda: Mesh(name="m", material="grey", vertices=bad, faces=[[0, 1, 2]]), "shape.vertices", "first bad vertex is number 2")


def test_I9_a_mesh_without_faces_or_without_area_is_refused():
    refused(lambda: Mesh(name="m", material="grey", vertices=np.eye(3), faces=np.zeros((0, 3), int)), "shape.faces", "at least one row")
    refused(lambda: Mesh(name="m", material="grey", vertices=np.eye(3), faces=[[0, 0, 1]]), "shape.faces", "degenerate")


def test_an_unknown_material_is_answered_with_the_nearest_one():
    error = refused(lambda: scene(materials={"gray": Diffuse(reflectance=0.5)}), "shapes.flat.material", "did you mean 'gray'")
    assert error.value == "grey"


def test_two_shapes_of_one_name_two_skies_and_flat_glass_are_refused():
    refused(lambda: scene(shapes=[FLAT, FLAT]), "shapes.flat", "no other shape")
    refused(lambda: scene(lights=[ConstantSky(radiance=1), ConstantSky(radiance=2)]), "lights", "at most one")
    refused(lambda: scene(materials={"grey": Dielectric(index=1.5)}), "shapes.flat.material", "closed shape")


def test_an_unknown_field_is_answered_with_the_nearest_one():
    refused(lambda: Diffuse(reflectanc=0.5), "material.reflectanc", "did you mean 'reflectance'")
    refused(lambda: Sphere(name="b", material="grey", center=(0, 0, 0), radios=1), "shape.radios", "did you mean 'radius'")


def test_sides_that_are_not_perpendicular_or_vanish_are_refused():
    refused(
        lambda: Rectangle(name="r", material="grey", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(1, 1, 0)), "shape.half_v", "perpendicular"
    )
    refused(lambda: AreaLight(center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 0, 0), radiance=1), "light.half_v", "non-zero")
    refused(
        lambda: Box(name="b", material="grey", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0), half_w=(0, 1, 1)),
        "shape.half_w",
        "perpendicular to half_v",
    )


@pytest.mark.parametrize("bad", [0.0, -1.0, float("inf"), 1e10])
def test_lengths_must_be_above_zero_and_finite(bad):
    refused(lambda: Sphere(name="b", material="grey", center=(0, 0, 0), radius=bad), "shape.radius")


@pytest.mark.parametrize("bad", [(0, 0), (0, 0, float("nan")), (0, 0, 1e12), "abc", None])
def test_coordinates_are_three_finite_numbers(bad):
    refused(lambda: Sphere(name="b", material="grey", center=bad, radius=1), "shape.center")


def test_the_faces_of_a_box_point_outwards_and_enclose_its_volume():
    c, s = np.cos(0.3), np.sin(0.3)
    for w in (0.7, -0.7):
        box = Box(name="b", material="grey", center=(1, 2, 3), half_u=(2 * c, 2 * s, 0), half_v=(-s, c, 0), half_w=(0, 0, w))
        volume = 0.0
        for face in box.polygons():
            normal = np.cross(face[1] - face[0], face[2] - face[1])
            assert normal @ (face.mean(0) - np.array([1, 2, 3])) > 0
            volume += normal @ face.mean(0) / 3
        assert volume == pytest.approx(8 * 2 * 1 * 0.7)


def test_cauchys_glass_meets_its_index_and_its_abbe_number():
    glass = Dielectric(index=1.7, abbe=30)
    d, f, c = glass.index_at([587.5618, 486.1327, 656.2725])
    assert d == pytest.approx(1.7, abs=1e-15)
    assert (d - 1) / (f - c) == pytest.approx(30, rel=1e-12)
    assert np.all(Dielectric(index=1.5).index_at([400.0, 700.0]) == 1.5)
    refused(lambda: Dielectric(index=0.9), "material.index")
    refused(lambda: Dielectric(index=1.5, abbe=0), "material.abbe")


def test_a_metal_has_finite_optical_constants_not_below_zero():
    refused(lambda: Conductor(eta=-0.1, k=2), "material.eta")
    refused(lambda: Conductor(eta=0.1, k=float("nan")), "material.k")


def test_a_scene_survives_pickling_and_knows_its_bounds():
    ball = Sphere(name="ball", material="grey", center=(0, 0, 2), radius=0.5)
    s = scene(shapes=[FLAT, ball], lights=[ConstantSky(radiance=1)])
    assert pickle.loads(pickle.dumps(s)) == s
    np.testing.assert_array_equal(s.bounds(), [[-1, -1, 0], [1, 1, 2.5]])
    assert scene(shapes=[]).bounds() is None


def test_a_scene_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        scene().name = "other"
    with pytest.raises(ValueError, match="frozen"):
        FLAT.center = (1, 1, 1)

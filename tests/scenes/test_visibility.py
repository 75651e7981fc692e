"""Who can light whom, judged by brute force over points, and form factors by closed forms."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import scenes
from scenes.meshes import icosphere, torus
from scenes.scene import Box, Dielectric, Diffuse, Mesh, Orthographic, Rectangle, Scene, Sphere
from scenes.visibility import coverage, first_pair_that_sees_each_other

VIEW = Orthographic(origin=(0, 0, 9), target=(0, 0, 0), half_height=1)


def scene(*shapes, rho=0.5, **materials):
    return Scene(name="s", shapes=shapes, materials={"m": Diffuse(reflectance=rho)} | materials, lights=[], viewpoint=VIEW)


def flat(name, center, u, v, material="m"):
    return Rectangle(name=name, material=material, center=center, half_u=u, half_v=v)


FLOOR = flat("floor", (0, 0, 0), (1, 0, 0), (0, 1, 0))


def room(rho=0.5, half=1.0):
    h = half
    walls = [
        ((0, 0, -h), (h, 0, 0), (0, h, 0)),
        ((0, 0, h), (0, h, 0), (h, 0, 0)),
        ((-h, 0, 0), (0, h, 0), (0, 0, h)),
        ((h, 0, 0), (0, 0, h), (0, h, 0)),
        ((0, -h, 0), (0, 0, h), (h, 0, 0)),
        ((0, h, 0), (h, 0, 0), (0, 0, h)),
    ]
    return scene(*(flat(f"wall {i}", *wall) for i, wall in enumerate(walls)), rho=rho)


def test_parallel_surfaces_that_face_the_same_way_never_see_each_other_whatever_their_heights():
    steps = [flat(f"f{i}", (0.1 * i, 0, 0.3 * i), (1, 0, 0), (0, 1, 0)) for i in range(5)]
    assert first_pair_that_sees_each_other(scene(*steps)) is None


def test_a_wall_moved_up_sees_the_floor_and_one_that_faces_away_does_not():
    toward = flat("wall", (1, 0, 0.5), (0, 0, 0.5), (0, 1, 0))
    assert set(first_pair_that_sees_each_other(scene(FLOOR, toward))) == {"floor", "wall"}
    below = flat("wall", (1, 0, -0.5), (0, 0, 0.5), (0, 1, 0))
    assert first_pair_that_sees_each_other(scene(FLOOR, below)) is None
    away = flat("wall", (1, 0, 0.5), (0, 1, 0), (0, 0, 0.5))
    assert first_pair_that_sees_each_other(scene(FLOOR, away)) is None


def test_a_convex_body_alone_does_not_light_itself():
    c, s = np.cos(0.3), np.sin(0.3)
    box = Box(name="box", material="m", center=(1, 2, 3), half_u=(2 * c, 2 * s, 0), half_v=(-s, c, 0), half_w=(0, 0, 0.7))
    assert first_pair_that_sees_each_other(scene(box)) is None
    assert first_pair_that_sees_each_other(scene(Sphere(name="b", material="m", center=(0, 0, 0), radius=1))) is None
    assert first_pair_that_sees_each_other(scene(icosphere("i", "m", 1.0, (0, 0, 0), 2))) is None


def test_a_ring_lights_itself_and_two_bodies_light_each_other():
    assert first_pair_that_sees_each_other(scene(torus("ring", "m", (2.0, 0.5), (0, 0, 0), 12))) == ("ring", "ring")
    balls = [Sphere(name=f"b{i}", material="m", center=(3 * i, 0, 0), radius=1) for i in range(2)]
    assert set(first_pair_that_sees_each_other(scene(*balls))) == {"b0", "b1"}
    boxes = [Box(name=f"x{i}", material="m", center=(3 * i, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0), half_w=(0, 0, 1)) for i in range(2)]
    assert set(first_pair_that_sees_each_other(scene(*boxes))) == {"x0", "x1"}


def test_a_ball_above_the_floor_sees_it_and_one_below_does_not():
    for height, sees in ((0.5, True), (0.0, True), (-0.99, True), (-1.01, False), (-5, False)):
        ball = Sphere(name="ball", material="m", center=(0, 0, height), radius=1 if height < 0.5 else 0.1)
        assert (first_pair_that_sees_each_other(scene(FLOOR, ball)) is not None) == sees


def test_black_surfaces_exchange_nothing_and_glass_lets_light_through():
    wall = flat("wall", (1, 0, 0.5), (0, 0, 0.5), (0, 1, 0), "black")
    assert first_pair_that_sees_each_other(scene(FLOOR, wall, black=Diffuse(reflectance=0.0))) is None
    ball = Sphere(name="lens", material="glass", center=(0, 0, 2), radius=0.5)
    assert first_pair_that_sees_each_other(scene(FLOOR, ball, glass=Dielectric(index=1.5))) == ("lens", "lens")


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_the_answer_does_not_depend_on_the_unit_of_length(scale):
    shapes = [flat(f"f{i}", (0, 0, 1e-5 * i * scale), (scale, 0, 0), (0, scale, 0)) for i in range(3)]
    assert first_pair_that_sees_each_other(scene(*shapes)) is None
    wall = flat("wall", (scale, 0, 1e-3 * scale), (0, 0, 1e-3 * scale), (0, scale, 0))
    assert first_pair_that_sees_each_other(scene(*shapes, wall)) is not None


coordinate = st.integers(-4, 4).map(float)
triangle = st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=3, max_size=3)


@settings(deadline=None, max_examples=200)
@given(triangle, triangle)
def test_two_triangles_see_each_other_if_and_only_if_points_on_them_do(a, b):
    a, b = np.array(a), np.array(b)
    normals = [np.cross(t[1] - t[0], t[2] - t[0]) for t in (a, b)]
    assume(all(np.linalg.norm(n) > 0 for n in normals))
    weights = np.array([(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]) / 8
    p, q = weights @ a, weights @ b
    gap = q[None] - p[:, None]
    seen = np.any((gap @ normals[0] > 1e-9) & (gap @ normals[1] < -1e-9))
    mesh = Mesh(name="two", material="m", vertices=np.concatenate([a, b]), faces=[[0, 1, 2], [3, 4, 5]])
    assert (first_pair_that_sees_each_other(scene(mesh)) is not None) == seen


def test_in_a_closed_room_all_light_lands_on_a_wall_and_the_albedo_comes_back():
    found = coverage(room(0.3))
    assert found.mean == 1.0
    assert found.returned == pytest.approx(0.3)


def test_the_coverage_of_two_facing_squares_is_their_form_factor():
    up = flat("low", (0, 0, 0), (0.5, 0, 0), (0, 0.5, 0))
    down = flat("high", (0, 0, 1), (0, 0.5, 0), (0.5, 0, 0))
    x = 1.0
    inside = np.log(np.sqrt((1 + x * x) ** 2 / (1 + 2 * x * x))) + 2 * x * np.sqrt(1 + x * x) * np.arctan(x / np.sqrt(1 + x * x))
    exact = 2 / (np.pi * x * x) * (inside - 2 * x * np.arctan(x))
    assert exact == pytest.approx(0.19982, abs=1e-5)
    found = coverage(scene(up, down, rho=0.8))
    error = np.sqrt(exact * (1 - exact) / 16384)
    assert found.mean == pytest.approx(exact, abs=5 * error)
    assert found.returned == pytest.approx(0.8 * found.mean, rel=1e-9)


def test_the_coverage_of_a_ball_over_a_square_is_their_form_factor():
    """A Lambertian ball sends to a surface the share that the surface's solid angle is of 4 pi; the way back by reciprocity."""
    half, height, radius = 2.0, 2.0, 1.0
    floor = flat("floor", (0, 0, 0), (half, 0, 0), (0, half, 0))
    solid_angle = 4 * np.arctan(half**2 / (height * np.sqrt(height**2 + 2 * half**2)))
    ball_area, floor_area = 4 * np.pi * radius**2, 4 * half**2
    exact = 2 * ball_area * solid_angle / (4 * np.pi) / (ball_area + floor_area)
    found = coverage(scene(floor, Sphere(name="ball", material="m", center=(0, 0, height), radius=radius)))
    assert found.mean == pytest.approx(exact, abs=5 * np.sqrt(exact * (1 - exact) / 4096))


@pytest.mark.parametrize("name", ["color-checker", "color-checker-bars"])
def test_no_surface_of_a_target_sees_another_nor_does_any_light_come_back(name):
    target = scenes.scene_by_name(name).build()
    assert first_pair_that_sees_each_other(target) is None
    assert coverage(target).mean == 0.0


def test_relief_and_glass_have_light_from_surface_to_surface():
    relief = scenes.scene_by_name("relief").build()
    assert first_pair_that_sees_each_other(relief) is not None
    assert 0.05 < coverage(relief).mean < 0.5
    assert first_pair_that_sees_each_other(scenes.scene_by_name("glass").build()) == ("ball", "ball")

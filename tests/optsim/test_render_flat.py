"""Flat diffuse scenes without samples: closed forms of coverage, light and shadow; and the route with samples as judge."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import ConvexHull

from optsim.cube import Bands
from optsim.render import RenderSettings, render
from optsim.render.cells import crossed_pixels, cut_pixels, join, whole_pixels
from optsim.render.polygons import PolygonSet, clip_to_box
from scenes.catalogue import scene_by_name
from scenes.color_checker import ColorChecker
from scenes.library import illuminant
from scenes.scene import (
    AreaLight,
    Box,
    ConstantSky,
    Diffuse,
    DirectionalLight,
    Mesh,
    Orthographic,
    Perspective,
    PointLight,
    Rectangle,
    Scene,
    Sphere,
    ThinLens,
)
from scenes.spectrum import Spectrum

ONE = Bands(np.array([500.0]), np.array([510.0]), np.array([505.0]))
FLAT = "flat faces without samples"
FINE = RenderSettings(error=1e-5)
UNIT = Spectrum.constant(1.0)
GRAY, WHITE = Diffuse(reflectance=Spectrum.constant(0.5)), Diffuse(reflectance=UNIT)
ABOVE = Orthographic(origin=(0, 0, 5), target=(0, 0, 0), up=(0, 1, 0), half_height=1)
FLOOR = Rectangle(name="floor", material="gray", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))


def world(shapes, lights, view=ABOVE, **materials):
    return Scene(name="flat", shapes=shapes, materials={"gray": GRAY, "white": WHITE} | materials, lights=lights, viewpoint=view)


def picture(scene, size=(8, 8), settings=FINE, bands=ONE, route=FLAT):
    cube = render(scene, bands, size, settings)
    assert cube.attrs["integrator"] == route
    return cube.radiance.values[:, :, 0] if bands is ONE else cube


def test_cells_of_random_polygons_add_up_to_their_areas_and_moments():
    random = np.random.Generator(np.random.Philox(1))
    height, width = 11, 16
    polygons = []
    for _ in range(7):
        points = random.random((8, 2)) * 20 - 2
        polygons.append(clip_to_box(points[ConvexHull(points).vertices], width, height))
    pixel, inside = crossed_pixels(PolygonSet(polygons).segments, height, width)
    rest = np.setdiff1d(np.arange(height * width), pixel)
    cells = join([*cut_pixels(pixel, inside, width), whole_pixels(rest, width)])
    x, y, weight = cells.points(2)
    np.testing.assert_allclose(np.bincount(cells.pixel, weight.sum(1)), 1, atol=1e-12)
    cell, polygon = PolygonSet(polygons).covering(*cells.middle())
    for i, p in enumerate(polygons):
        q = np.roll(p, -1, 0)
        turn = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
        mine = cell[polygon == i]
        assert weight[mine].sum() == pytest.approx(abs(turn.sum()) / 2, rel=1e-12)
        assert (weight * x)[mine].sum() == pytest.approx(abs(np.sum((p[:, 0] + q[:, 0]) * turn)) / 6, rel=1e-11)
        assert (weight * y)[mine].sum() == pytest.approx(abs(np.sum((p[:, 1] + q[:, 1]) * turn)) / 6, rel=1e-11)


def test_directional_light_on_a_tilted_floor_is_E_rho_cos_over_pi():
    lights = (DirectionalLight(direction=(1, 0, -2), irradiance=Spectrum.constant(3.0)),)
    np.testing.assert_allclose(picture(world((FLOOR,), lights)), 3 * 0.5 * 2 / np.sqrt(5) / np.pi, rtol=3e-7)


def test_a_point_light_falls_with_the_square_of_the_distance_and_the_cosine():
    found = picture(world((FLOOR,), (PointLight(position=(0, 0, 0.3), intensity=Spectrum.constant(2.0)),)), (6, 6))
    edges = np.linspace(-1, 1, 7)
    for i, j in ((0, 0), (2, 3), (5, 1)):
        mean = (
            dblquad(lambda y, x: 0.3 / (x * x + y * y + 0.09) ** 1.5, *edges[j : j + 2], *-edges[i : i + 2], epsabs=0, epsrel=1e-9)[0] * -9
        )
        assert found[i, j] == pytest.approx(2 * 0.5 / np.pi * mean, rel=1e-5)


@pytest.mark.parametrize("tilt", [0.0, 0.6, 1.2], ids=["above", "tilted", "partly-below"])
def test_an_area_light_gives_the_double_integral_over_it_even_when_a_part_is_below_the_surface(tilt):
    toward = np.array([np.cos(tilt), 0, np.sin(tilt)])
    normal = np.array([np.sin(tilt), 0, -np.cos(tilt)])
    center = np.array([-0.6, 0.1, 0.25])
    light = AreaLight(center=tuple(center), half_u=tuple(-0.4 * toward), half_v=(0, 0.2, 0), radiance=Spectrum.constant(3.0))
    np.testing.assert_allclose(light.normal, normal, atol=1e-12)
    view = Orthographic(origin=(0.3, 0, 5), target=(0.3, 0, 0), up=(0, 1, 0), half_height=1e-4)
    found = picture(world((FLOOR,), (light,), view), (1, 1))[0, 0]
    point = np.array([0.3, 0, 0])

    def share(v, u):
        away = center - 0.4 * u * toward + np.array([0, 0.2 * v, 0]) - point
        square = away @ away
        return max(away[2], 0) * max(-(away @ normal), 0) / square**2 * 0.08

    total = dblquad(share, -1, 1, -1, 1, epsabs=0, epsrel=1e-7)[0]
    assert found == pytest.approx(3 * 0.5 / np.pi * total, rel=2e-5)


def test_a_small_far_lamp_counts_as_much_as_a_point_of_its_size():
    side = 1e-7
    lamp = AreaLight(center=(3, 0, 4), half_u=(-0.8 * side, 0, 0.6 * side), half_v=(0, side, 0), radiance=Spectrum.constant(1 / side**2))
    assert lamp.normal @ np.array([3, 0, 4]) < 0
    found = picture(world((FLOOR,), (lamp,)))
    assert found.mean() == pytest.approx(
        picture(world((FLOOR,), (PointLight(position=(3, 0, 4), intensity=Spectrum.constant(4.0)),))).mean(), rel=0.1
    )
    point = 0.5 / np.pi * 4 * 4 / 5**3
    view = Orthographic(origin=(0, 0, 5), target=(0, 0, 0), up=(0, 1, 0), half_height=1e-5)
    assert picture(world((FLOOR,), (lamp,), view), (1, 1))[0, 0] == pytest.approx(point, rel=1e-6)


def test_a_pixel_cut_by_slanted_borders_is_the_mean_by_area():
    corners = np.array([[-0.61, -0.37, 1e-3], [0.83, -0.21, 1e-3], [0.17, 0.93, 1e-3]])
    triangle = Mesh(name="triangle", material="white", vertices=corners, faces=[[0, 1, 2]])
    lights = (DirectionalLight(direction=(0, 0, -1), irradiance=UNIT),)
    whole = picture(world((FLOOR, triangle), lights), (1, 1))[0, 0]
    share = abs(np.cross(corners[1] - corners[0], corners[2] - corners[0])[2]) / 2 / 4
    assert whole == pytest.approx((0.5 + 0.5 * share) / np.pi, rel=1e-6)
    fine = picture(world((FLOOR, triangle), lights), (17, 17))
    assert fine.mean() == pytest.approx(whole, rel=1e-6)


@pytest.mark.parametrize("light", ["distant", "point"])
def test_a_screen_throws_the_shadow_that_projection_says(light):
    screen = Rectangle(name="screen", material="white", center=(0.1, 0, 0.5), half_u=(0, 0.2, 0), half_v=(0.2, 0, 0))  # faces down
    screen = screen.model_copy(update={"half_u": (0.2, 0.0, 0.0), "half_v": (0.0, 0.2, 0.0)})
    if light == "distant":
        lights, half, middle = (DirectionalLight(direction=(-1, 0, -1), irradiance=UNIT),), 0.2, 0.1 - 0.5
    else:
        lights, half, middle = (PointLight(position=(0.1, 0, 1), intensity=UNIT),), 0.4, 0.1
    below = Orthographic(origin=(0, 0, 0.4), target=(0, 0, 0), up=(0, 1, 0), half_height=1)  # the view starts under the screen
    n = 13
    lit, dark = picture(world((FLOOR,), lights, below), (n, n)), picture(world((FLOOR, screen), lights, below), (n, n))
    edges = np.linspace(-1, 1, n + 1)
    across = np.clip(np.minimum(edges[1:], middle + half) - np.maximum(edges[:-1], middle - half), 0, None) * n / 2
    down = np.clip(np.minimum(edges[1:], half) - np.maximum(edges[:-1], -half), 0, None) * n / 2
    share = np.outer(down[::-1], across)
    if light == "distant":
        np.testing.assert_allclose(dark / lit, 1 - share, atol=3e-7)
    else:
        inside, outside = share > 1 - 1e-9, share < 1e-9
        assert inside.any()
        assert outside.any()
        np.testing.assert_allclose(dark[inside], 0, atol=2e-6 * lit.max())
        np.testing.assert_allclose(dark[outside], lit[outside], rtol=1e-6)
        partial = ~inside & ~outside
        assert np.all((dark[partial] < lit[partial]) & (dark[partial] > 0))


def test_the_soft_shadow_of_an_edge_has_half_the_light_below_it():
    screen = Rectangle(name="screen", material="white", center=(-0.5, 0, 0.1), half_u=(0.5, 0, 0), half_v=(0, 3, 0))
    lamp = AreaLight(center=(0, 0, 3), half_u=(0.2, 0, 0), half_v=(0, -0.2, 0), radiance=UNIT)
    view = Orthographic(origin=(0.02, 0, 0.05), target=(0.02, 0, 0), up=(0, 1, 0), half_height=0.2)
    lit = picture(world((FLOOR,), (lamp,), view), (9, 9), RenderSettings(error=1e-3))
    dark = picture(world((FLOOR, screen), (lamp,), view), (9, 9), RenderSettings(error=1e-3))
    share = (dark / lit).mean(0)
    np.testing.assert_allclose(share[-4:], 1, atol=1e-6)
    np.testing.assert_allclose(share[:3], 0, atol=1e-6)
    edges = np.linspace(-0.18, 0.22, 10)
    width = 0.2 * 0.1 / 2.9  # half the penumbra; the light grows linearly across it
    cumulative = lambda x: np.where(x > width, x, np.where(x < -width, 0, (x + width) ** 2 / (4 * width)))  # noqa: E731
    np.testing.assert_allclose(share, np.diff(cumulative(edges)) / np.diff(edges), atol=2e-3)


def test_the_back_of_a_face_is_black_lamps_and_sky_shine_and_lights_add():
    back = Rectangle(name="back", material="white", center=(-0.5, 0.5, 0), half_u=(0, 0.5, 0), half_v=(0.5, 0, 0))
    front = Rectangle(name="front", material="white", center=(0.5, 0.5, 0), half_u=(0.5, 0, 0), half_v=(0, 0.5, 0))
    lamp = AreaLight(center=(-0.5, -0.5, 0), half_u=(0.5, 0, 0), half_v=(0, 0.5, 0), radiance=Spectrum.constant(7.0))
    sun, sky = DirectionalLight(direction=(0, 0, -1), irradiance=UNIT), ConstantSky(radiance=Spectrum.constant(0.25))
    found = picture(world((back, front), (lamp, sun, sky)), (2, 2))
    np.testing.assert_allclose(found, [[0, 1 / np.pi + 0.25], [7, 0.25]], rtol=1e-6)
    apart = [picture(world((back, front), (one,)), (2, 2)) for one in (sun, sky)]
    np.testing.assert_allclose(sum(apart)[0], found[0], rtol=1e-6)


def chart_by_intervals(n):
    """Return the chart's radiance at n x n from the overlaps of intervals and the light in the middle of each pixel; no shadows."""
    chart = ColorChecker()
    bands = Bands.paper()
    edges = np.linspace(0, 1, n + 1)

    def overlap(low, high):
        return np.clip(np.minimum(edges[1:], high) - np.maximum(edges[:-1], low), 0, None) * n

    materials, left, found = chart.materials(), np.ones((n, n)), np.zeros((n, n, bands.count))
    boxes = dict(chart.patch_boxes())
    lamp = chart.light()
    fine = np.linspace(bands.lower, bands.upper, 2001)

    def seen(material):
        product = materials[material].reflectance.at(fine) * lamp.radiance.at(fine)
        return np.trapezoid(product, fine, axis=0) / bands.width

    for name, box in boxes.items():
        share = np.outer(overlap(box.top, box.bottom), overlap(box.left, box.right))
        left -= share
        found += share[:, :, None] * seen(name)
    inner = np.outer(overlap(0.0173, 1 - 0.0173), overlap(0.0173, 1 - 0.0173))
    found += (1 - inner)[:, :, None] * seen("frame") + (left - (1 - inner))[:, :, None] * seen("board")
    few, middle = np.linspace(-0.5, 0.5, 13), (edges[1:] + edges[:-1]) / 2 - 0.5
    light = [[lamp.irradiance_per_radiance((x * chart.side_m, -y * chart.side_m, 0), (0, 0, 1)) for x in few] for y in few]
    return found * RectBivariateSpline(few, few, np.array(light))(middle, middle)[:, :, None] / np.pi


@pytest.mark.parametrize("size", [64, 61])
def test_the_chart_is_within_1e_4_of_intervals_and_trapezia(size):
    cube = render(ColorChecker().build(), Bands.paper(), (size, size), RenderSettings(error=1e-4))
    assert cube.attrs["integrator"] == FLAT
    truth = chart_by_intervals(8 * size).reshape(size, 8, size, 8, 24).mean((1, 3))
    off = np.sqrt(np.mean((cube.radiance.values - truth) ** 2, axis=(0, 1))) / truth.mean((0, 1))
    assert np.all(off < 1e-4)  # of which the hair-thin shadows of the patches, not in the judge, make 5e-5
    assert cube.attrs["error"] < 1e-5


PERSPECTIVE = Perspective(origin=(0.8, -1.5, 1.2), target=(0, 0, 0), up=(0, 0, 1), fov_deg=40)
STEP = world(
    (
        Box(name="block", material="white", center=(0, 0, 0), half_u=(0.5, 0.1, 0), half_v=(-0.06, 0.3, 0), half_w=(0, 0, 0.2)),
        Rectangle(name="plate", material="gray", center=(0, 0, 0.25), half_u=(0.1, 0, 0), half_v=(0, 0.1, 0)),
    ),
    (
        AreaLight(center=(-2, -1, 2), half_u=(0, 0.3, 0), half_v=(-0.2, 0, -0.2), radiance=illuminant("xenon")),
        PointLight(position=(1, -2, 1), intensity=illuminant("D65")),
    ),
    PERSPECTIVE,
)


@pytest.mark.parametrize("name", ["color-checker-bars", "metamers", "textured", "step"])
def test_the_route_with_samples_agrees_within_its_noise(name):
    scene = STEP if name == "step" else scene_by_name(name).build()
    size, bands = (24, 24), Bands.paper()
    ours = picture(scene, size, RenderSettings(error=1e-3), bands).radiance.values
    judge = render(scene, bands, size, RenderSettings(samples_per_pixel=2048, seed=3))
    assert judge.attrs["integrator"] != FLAT
    truth, noise = judge.radiance.values, np.sqrt(np.mean(judge.stderr.values.astype(np.float64) ** 2, axis=(0, 1)))
    off = np.sqrt(np.mean((ours - truth) ** 2.0, axis=(0, 1)))
    assert np.all(off < 1.3 * noise + 1e-4 * truth.mean((0, 1)))
    z = (ours - truth).mean((0, 1)) / (noise / 24)
    assert np.all(np.abs(z) < 4.5 + 1e-4 * truth.mean((0, 1)) / (noise / 24))


def test_the_error_told_bounds_the_error_made():
    lamp = AreaLight(center=(0.2, 0, 0.05), half_u=(0.1, 0, 0), half_v=(0, -0.1, 0), radiance=UNIT)
    scene = world((FLOOR,), (lamp,), Perspective(origin=(0, -2, 1), target=(0, 0, 0), up=(0, 0, 1), fov_deg=50))
    truth = picture(scene, (12, 12))
    for error in (0.1, 1e-2, 1e-3):
        cube = render(scene, ONE, (12, 12), RenderSettings(error=error))
        made = np.sqrt(np.mean((cube.radiance.values[:, :, 0] - truth) ** 2)) / truth.mean()
        assert made <= cube.attrs["error"] <= error


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e6])
def test_R20_flat_pictures_do_not_depend_on_the_scale(scale):
    def scaled(vector):
        return tuple(scale * x for x in vector)

    chart = ColorChecker().build()
    light, view = chart.lights[0], chart.viewpoint
    shapes = tuple(s.model_copy(update={k: scaled(getattr(s, k)) for k in ("center", "half_u", "half_v")}) for s in chart.shapes)
    own = chart.model_copy(
        update={
            "shapes": shapes,
            "lights": (light.model_copy(update={k: scaled(getattr(light, k)) for k in ("center", "half_u", "half_v")}),),
            "viewpoint": view.model_copy(update={"origin": scaled(view.origin), "half_height": scale * view.half_height}),
        }
    )
    np.testing.assert_allclose(picture(own, (16, 16)), picture(chart, (16, 16)), rtol=2e-6)


LAMP = AreaLight(center=(0, 0, 3), half_u=(0.2, 0, 0), half_v=(0, -0.2, 0), radiance=UNIT)
PLATE = Rectangle(name="plate", material="white", center=(0, 0, 0.5), half_u=(0.2, 0, 0), half_v=(0, 0.2, 0))
NEEDS_SAMPLES = {
    "a sphere": world((FLOOR, Sphere(name="ball", material="gray", center=(0, 0, -1), radius=0.1)), (LAMP,)),
    "a lens": world((FLOOR,), (LAMP,), ThinLens(origin=(0, 0, 5), target=(0, 0, 0), up=(0, 1, 0), fov_deg=20, aperture_m=0.1, focus_m=2)),
    "a sky that something hides": world((FLOOR, PLATE), (ConstantSky(radiance=UNIT),)),
    "crossing faces": world(
        (FLOOR, FLOOR.model_copy(update={"name": "other", "half_u": (0.9, 0.0, 0.1), "half_v": (0.0, 1.0, 0.0)})), (LAMP,)
    ),
    "faces in one plane": world((FLOOR, PLATE.model_copy(update={"center": (0.0, 0.0, 0.0)})), (LAMP,)),
    "faces that light each other": world(
        (FLOOR, Rectangle(name="wall", material="white", center=(0, 1, 0.5), half_u=(0, 0, 0.5), half_v=(-1, 0, 0))), (LAMP,)
    ),
}


@pytest.mark.parametrize("name", NEEDS_SAMPLES)
def test_what_has_no_closed_form_is_sampled(name):
    cube = render(NEEDS_SAMPLES[name], ONE, (8, 8), RenderSettings(error=0.003))
    assert cube.attrs["integrator"] != FLAT
    assert cube.attrs["samples_per_pixel"] > 0


def test_shadows_too_soft_for_the_error_asked_for_are_sampled():
    under = Orthographic(origin=(0, 0, 2), target=(0, 0, 0), up=(0, 1, 0), half_height=1)
    wide = world((FLOOR, PLATE), (LAMP.model_copy(update={"half_u": (2.0, 0.0, 0.0), "half_v": (0.0, -2.0, 0.0)}),), under)
    assert render(wide, ONE, (8, 8), RenderSettings(error=0.02)).attrs["integrator"] == FLAT
    with pytest.warns(RuntimeWarning, match="stopped at 16 samples"):
        cube = render(wide, ONE, (8, 8), RenderSettings(error=1e-5, max_samples=16))
    assert cube.attrs["integrator"] != FLAT


def test_a_number_of_samples_and_emission_alone_are_sampled():
    for settings in (RenderSettings(samples_per_pixel=4), RenderSettings(max_depth=1)):
        assert render(ColorChecker().build(), ONE, (4, 4), settings).attrs["integrator"] != FLAT


def test_progress_of_a_flat_picture_ends_at_one_and_no_seed_changes_it():
    seen = []
    scene = ColorChecker().build()
    first = render(scene, ONE, (8, 8), RenderSettings(seed=1), progress=lambda done, error: seen.append(done))
    assert seen[-1] == 1
    again = render(scene, ONE, (8, 8), RenderSettings(seed=2))
    assert again.radiance.values.tobytes() == first.radiance.values.tobytes()


def test_a_flat_picture_loads_no_renderer():
    code = (
        "import sys\nfrom optsim.cube import Bands\nfrom optsim.render import render\nfrom scenes.color_checker import ColorChecker\n"
        "render(ColorChecker().build(), Bands.paper(), (8, 8))\nprint([m for m in ('mitsuba', 'drjit', 'colour') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"

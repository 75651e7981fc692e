"""Textures, lenses and skies in the renderer, against closed forms, scenes of plain rectangles and Mitsuba's own film."""

import numpy as np
import pytest

from optsim.cube import Bands
from optsim.errors import InputError
from optsim.render import RenderSettings, render, render_with_film
from optsim.render.textures import taken_apart
from scenes.library import illuminant, reflectance
from scenes.lights import ConstantSky, DirectionalLight, GradientSky
from scenes.scene import Box, Diffuse, Orthographic, Perspective, Rectangle, Scene, Textured, ThinLens

BANDS = Bands.from_edges(np.linspace(450, 670, 9))
RNG = np.random.default_rng(3)
BASIS = (reflectance("red"), reflectance("green"), reflectance("white 9.5 (.05 D)"))
WEIGHTS = RNG.dirichlet(np.ones(3), size=(4, 5)).astype(np.float32)
PRINT = Textured(basis=BASIS, weights=WEIGHTS)
DOWN = Orthographic(origin=(0, 0, 2), target=(0, 0, 0), half_height=1)
BOARD = Rectangle(name="board", material="print", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
SUN = DirectionalLight(direction=(0.3, 0, -1), irradiance=illuminant("xenon"))


def scene_of(*shapes, lights=(SUN,), view=DOWN, **materials):
    known = {"print": PRINT, "grey": Diffuse(reflectance=0.5)} | materials
    return Scene(name="s", shapes=shapes, materials=known, lights=lights, viewpoint=view)


def test_each_texel_sends_back_its_own_mixture_of_the_suns_light():
    wide = BOARD.model_copy(update={"half_u": (1.25, 0, 0)})
    cube = render(scene_of(wide), BANDS, (8, 10), RenderSettings(samples_per_pixel=4))
    cosine = 1 / np.hypot(1, 0.3)
    v, u = ((np.arange(n) + 0.5) / n for n in (8, 10))
    nm = np.arange(450, 670.01, 0.1)
    light = PRINT.at(*np.broadcast_arrays(u, 1 - v[:, None]), nm) * SUN.irradiance.at(nm) * cosine / np.pi
    fine = [light[..., (nm >= low - 1e-6) & (nm <= high + 1e-6)] for low, high in zip(BANDS.lower, BANDS.upper)]
    expected = np.stack([np.trapezoid(part, dx=0.1, axis=-1) / (0.1 * (part.shape[-1] - 1)) for part in fine], axis=-1)
    np.testing.assert_allclose(cube["radiance"].values, expected, rtol=2e-5)


@pytest.mark.parametrize("extra", ["nothing", "glass somewhere"])
def test_a_textured_scene_equals_the_same_scene_of_plain_rectangles(extra):
    wall = Rectangle(name="wall", material="print", center=(0, 1, 0.8), half_u=(1, 0, 0), half_v=(0, 0, 0.8))
    view = Perspective(origin=(0.2, -2.5, 1.5), target=(0, 0, 0.2), up=(0, 0, 1), fov_deg=40)
    block = Box(name="block", material="grey", center=(0, 0.2, 0.2), half_u=(0.2, 0, 0), half_v=(0, 0.2, 0), half_w=(0, 0, 0.2))
    scene = scene_of(BOARD, wall, block, lights=(SUN, ConstantSky(radiance=1.0)), view=view)
    if extra != "nothing":
        from scenes.materials import Dielectric
        from scenes.shapes import Sphere

        ball = Sphere(name="ball", material="glass", center=(0.5, -0.4, 0.2), radius=0.2)
        scene = scene.model_copy(update={"shapes": (*scene.shapes, ball), "materials": scene.materials | {"glass": Dielectric(index=1.5)}})
    settings = RenderSettings(samples_per_pixel=256, max_depth=6)
    one, other = (render(s, BANDS, (24, 24), settings) for s in (scene, taken_apart(scene)))
    # The same random numbers follow the same paths until chance ends them, by a bound that is a texel's own.
    z = ((one["radiance"] - other["radiance"]) / np.hypot(one["stderr"], other["stderr"]).where(one["stderr"] > 0, 1)).values
    assert np.sqrt((z**2).mean()) < 1.2
    np.testing.assert_allclose(one["radiance"].values.mean((0, 1)), other["radiance"].values.mean((0, 1)), rtol=2e-3)


def test_mitsubas_film_agrees_with_a_textured_scene_seen_through_a_lens():
    view = ThinLens(origin=(0, 0, 2), target=(0, 0, 0), fov_deg=50, aperture_m=0.15, focus_m=1.5)
    scene = scene_of(BOARD, view=view)
    settings = RenderSettings(samples_per_pixel=2048, seed=5)
    own, film = render(scene, BANDS, (6, 6), settings), render_with_film(scene, BANDS, (6, 6), settings)
    z = (own["radiance"] - film["radiance"]) / np.hypot(own["stderr"], film["stderr"])
    # 36 pixels x 8 bands, neighbours correlated; stderr itself is from 8 passes
    assert np.sqrt((z.values**2).mean()) < 1.6
    np.testing.assert_allclose(own["radiance"].values.mean((0, 1)), film["radiance"].values.mean((0, 1)), rtol=1e-2)


def test_a_lens_blurs_a_step_by_the_circle_of_confusion():
    bright = Rectangle(name="r", material="grey", center=(0.5, 0, 0), half_u=(0.5, 0, 0), half_v=(0, 1, 0))
    black = Rectangle(name="l", material="black", center=(-0.5, 0, 0), half_u=(0.5, 0, 0), half_v=(0, 1, 0))
    view = ThinLens(origin=(0, 0, 2), target=(0, 0, 0), fov_deg=2 * np.rad2deg(np.arctan(0.8 / 200 / 2)), aperture_m=0.1, focus_m=4.0)
    scene = scene_of(bright, black, view=view, black=Diffuse(reflectance=0.0))
    cube = render(scene, BANDS, (1, 200), RenderSettings(samples_per_pixel=8192))
    step = cube["radiance"].values[0, :, 0]
    step = step / step[-1]
    x = ((np.arange(200) + 0.5) / 200 - 0.5) * 1.6  # metres on the board
    radius = 0.1 * (1 - 2 / 4)  # of the blur on the board: the cone narrows towards the sharp plane
    t = np.clip(x / radius, -1, 1)
    expected = 0.5 + (t * np.sqrt(1 - t**2) + np.arcsin(t)) / np.pi  # share of a disc to one side of a line
    assert np.count_nonzero((expected > 0) & (expected < 1)) > 8
    np.testing.assert_allclose(step, expected, atol=0.005)


def test_a_sharp_plane_at_the_target_is_as_sharp_as_through_a_pinhole():
    views = (
        Perspective(origin=(0, 0, 2), target=(0, 0, 0), fov_deg=50),
        ThinLens(origin=(0, 0, 2), target=(0, 0, 0), fov_deg=50, aperture_m=0.2),
    )
    one, other = (
        render(scene_of(BOARD, view=view), BANDS, (16, 16), RenderSettings(samples_per_pixel=256))["radiance"].values for view in views
    )
    np.testing.assert_allclose(one, other, rtol=0.03, atol=0.01 * one.max())


@pytest.mark.parametrize(("horizon", "zenith"), [(1.0, 1.0), (1.0, 0.0), (0.2, 0.9)])
@pytest.mark.parametrize("with_glass", [False, True])
def test_a_floor_under_a_gradient_sky_has_the_irradiance_of_its_integral(horizon, zenith, with_glass):
    sky = GradientSky(radiance=2.0, horizon=horizon, zenith=zenith)
    floor = Rectangle(name="floor", material="grey", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
    scene = scene_of(floor, lights=(sky,))
    if with_glass:  # the general route
        from scenes.materials import Dielectric
        from scenes.shapes import Sphere

        far = Sphere(name="far", material="glass", center=(0, 0, -50), radius=0.1)
        scene = scene.model_copy(update={"shapes": (floor, far), "materials": scene.materials | {"glass": Dielectric(index=1.5)}})
    cube = render(scene, BANDS, (4, 4), RenderSettings(samples_per_pixel=4096))
    # E = integral of (h + (z - h) sin e) sin e cos e over the hemisphere = pi h + 2 pi (z - h) / 3
    expected = 2.0 * (horizon + 2 / 3 * (zenith - horizon)) * 0.5
    np.testing.assert_allclose(cube["radiance"].values.mean((0, 1)), expected, rtol=3e-3)


def test_a_ray_that_meets_nothing_sees_the_gradient_sky_in_its_own_direction():
    sky = GradientSky(radiance=1.0, horizon=0.3, zenith=0.8, up=(0, 1, 0))
    view = Perspective(origin=(0, 0, 0), target=(0, 0.0, -1), up=(0, 1, 0), fov_deg=60)
    cube = render(scene_of(lights=(sky,), view=view), BANDS, (16, 4), RenderSettings(samples_per_pixel=64))
    _, d = view.rays(*np.meshgrid((np.arange(4) + 0.5) / 4, (np.arange(16) + 0.5) / 16), 0.25)
    np.testing.assert_allclose(cube["radiance"].values[..., 0], sky.share(d), atol=0.01)


def test_two_skies_of_one_colour_add():
    sky = GradientSky(radiance=1.0, horizon=1.0, zenith=0.0)
    floor = Rectangle(name="floor", material="grey", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
    settings = RenderSettings(samples_per_pixel=1024)
    both = render(scene_of(floor, lights=(sky, ConstantSky(radiance=1.0))), BANDS, (4, 4), settings)["radiance"].values
    np.testing.assert_allclose(both.mean(), 0.5 * (1 / 3 + 1), rtol=3e-3)


def test_the_film_refuses_a_sky_that_it_cannot_make():
    with pytest.raises(InputError, match="gradient sky"):
        render_with_film(scene_of(BOARD, lights=(GradientSky(radiance=1.0),)), BANDS, (4, 4))

"""Every decision of ``explain`` is rendered both ways: what is left off changes the cube by less than the error, what is kept by more."""

import json

import numpy as np
import pytest

from optsim.cube import Bands
from optsim.errors import InputError
from optsim.render import RenderSettings, explain, render
from optsim.render.bounds import further_light
from optsim.render.choice import Choices, Physics
from scenes.library import illuminant, line, reflectance
from scenes.scene import (
    AreaLight,
    Box,
    ConstantSky,
    Dielectric,
    Diffuse,
    DirectionalLight,
    GradientSky,
    Orthographic,
    Perspective,
    PointLight,
    Rectangle,
    Scene,
    Sphere,
    ThinLens,
)
from scenes.spectrum import Spectrum

ERROR = 0.01
BANDS = Bands.from_edges(np.linspace(450, 670, 25))
VIEW = Perspective(origin=(0, -4, 3), target=(0, 0, 0.2), up=(0, 0, 1), fov_deg=30)
FLOOR = Rectangle(name="floor", material="red", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
WALL = Rectangle(name="wall", material="grey", center=(0, 1, 0.5), half_u=(0.9, 0, 0), half_v=(0, 0, 0.5))
BALL = Sphere(name="ball", material="grey", center=(0, 0, 0.4), radius=0.4)
GLOBE = Sphere(name="globe", material="glass", center=(0, 0, 0.75), radius=0.7)
STRIPES = tuple(
    Rectangle(name=f"s{i}", material=("black", "white")[i % 2], center=(-1.2 + 0.2 * i, 0, 0.01), half_u=(0.1, 0, 0), half_v=(0, 1.3, 0))
    for i in range(13)
)
SUN = DirectionalLight(direction=(0.2, 0.3, -1), irradiance=illuminant("xenon"))
DAY = ConstantSky(radiance=illuminant("D65"))
LAMP = AreaLight(center=(0, -1, 3), half_u=(0, 0.2, 0), half_v=(0.2, 0, 0), radiance=illuminant("xenon"))
BULB = PointLight(position=(0, -1, 3), intensity=illuminant("A"))


def told(effect, mutant):
    return next(e for e in explain(mutant, ERROR).effects if e.name == effect)


def scene(*shapes, lights=(SUN,), view=VIEW, **materials):
    known = {
        "red": Diffuse(reflectance=reflectance("red")),
        "grey": Diffuse(reflectance=0.5),
        "black": Diffuse(reflectance=0.02),
        "white": Diffuse(reflectance=0.9),
    }
    return Scene(name="mutant", shapes=shapes or (FLOOR,), materials=known | materials, lights=lights, viewpoint=view)


def wall_of(albedo):
    return scene(FLOOR, WALL, red=Diffuse(reflectance=0.6), grey=Diffuse(reflectance=albedo))


def lens(aperture_m, focus_m=None):
    return ThinLens(origin=VIEW.origin, target=VIEW.target, up=VIEW.up, fov_deg=VIEW.fov_deg, aperture_m=aperture_m, focus_m=focus_m)


def globe(index, abbe, **more):
    return scene(*STRIPES, GLOBE, lights=(DAY,), glass=Dielectric(index=index, abbe=abbe), **more)


LOW_WALL = WALL.model_copy(update={"center": (0, 1, -0.5)})
BOX = Box(name="box", material="grey", center=(0, 0, 0.3), half_u=(0.3, 0, 0), half_v=(0, 0.3, 0), half_w=(0, 0, 0.3))
DUSK = GradientSky(radiance=illuminant("A"), horizon=1.0, zenith=0.2)
FAINT = ConstantSky(radiance=illuminant("D65").scaled(1e-12))
TILTED = Spectrum(np.array([400.0, 700.0]), np.array([1.0, 1.05]))
GREY = {"red": Diffuse(reflectance=0.4)}
MUTANTS = {
    Physics.INTERREFLECTION: {
        "a plain floor": (scene(), False),
        "a wall below the floor": (scene(FLOOR, LOW_WALL), False),
        "a wall painted almost black": (wall_of(3e-4), False),
        "a grey wall": (wall_of(0.5), True),
        "a dim wall": (wall_of(0.1), True),
        "a ball on the floor": (scene(FLOOR, BALL, lights=(SUN, DAY)), True),
        "a box on the floor": (scene(FLOOR, BOX, lights=(LAMP,), red=Diffuse(reflectance=0.9)), True),
    },
    Physics.EMITTER_SAMPLING: {
        "a sky": (scene(lights=(DAY,)), False),
        "a gradient sky, a ball": (scene(FLOOR, BALL, lights=(DUSK,)), False),
        "a small lamp": (scene(lights=(LAMP,)), True),
        "a bulb": (scene(lights=(BULB,)), True),
        "the sun": (scene(), True),
    },
    Physics.DISPERSION: {
        "glass of one index": (globe(1.7, None), False),
        "no glass": (scene(FLOOR, BALL), False),
        "flint": (globe(1.75, 25), True),
    },
    Physics.ILLUMINANT_FACTORING: {
        "a flat lamp": (scene(lights=(SUN.model_copy(update={"irradiance": Spectrum.constant(1.0)}),)), False),
        "a lamp a little brighter in the red": (scene(lights=(SUN.model_copy(update={"irradiance": TILTED}),)), False),
        "a xenon sun": (scene(), True),
        "a line": (scene(lights=(SUN.model_copy(update={"irradiance": line(555.0, 0.5)}),)), True),
        "a bulb and a line": (
            scene(
                lights=(
                    BULB.model_copy(update={"intensity": illuminant("A").scaled(1e-3)}),
                    SUN.model_copy(update={"irradiance": line(600.0, 2.0)}),
                )
            ),
            True,
        ),
    },
    Physics.SPECTRAL_NODES: {
        "a grey floor": (scene(**GREY), False),
        "a grey floor and a grey wall": (scene(FLOOR, WALL, **GREY), False),
        "a red floor": (scene(), True),
        "a red floor and a grey wall": (scene(FLOOR, WALL), True),
    },
    Physics.LENS_BLUR: {
        "a pinhole": (scene(*STRIPES), False),
        "a tiny aperture": (scene(FLOOR, view=lens(1e-8)), False),
        "a wide aperture": (scene(*STRIPES, view=lens(0.5)), True),
        "a lens out of focus": (scene(FLOOR, view=lens(0.2, 2.0)), True),
    },
    Physics.SKY: {
        "no sky": (scene(FLOOR, BALL), False),
        "a black sky": (scene(FLOOR, lights=(SUN, ConstantSky(radiance=0.0))), False),
        "starlight beside the sun": (scene(FLOOR, BALL, lights=(SUN, FAINT)), False),
        "the sky of day beside the sun": (scene(FLOOR, BALL, lights=(SUN, DAY)), True),
        "a sky alone": (scene(lights=(FAINT,)), True),
    },
}


def cases():
    """Return the mutants; the first that is off and the first that is on of each effect are quick tests, the others slow ones."""
    for effect, found in MUTANTS.items():
        known = set()
        for name, (mutant, on) in found.items():
            yield pytest.param(effect, mutant, on, id=f"{effect.value}-{name}", marks=[pytest.mark.slow] if on in known else [])
            known.add(on)


def picture(s, seed=4, **choices):
    return render(s, BANDS, (16, 16), RenderSettings(samples_per_pixel=128, seed=seed, **choices))


def change(s, **choices):
    """Return the largest relative RMS change of a band that choices make, free of noise, and the noise with them.

    The mean of the product of the changes seen with two seeds is the square of the change, whatever the noise.
    """
    moved, levels, noise = [], [], 0.0
    for seed in (4, 5):
        own, other = picture(s, seed), picture(s, seed, **choices)
        a, b = (cube["radiance"].values.astype(float) for cube in (own, other))
        moved.append(a - b)
        levels.append(np.maximum(a.mean((0, 1)), b.mean((0, 1))))
        noise = np.sqrt((other["stderr"].values.astype(float) ** 2).mean((0, 1)))
    level = np.mean(levels, axis=0)
    lit = level > 0
    if not lit.any():
        return 0.0, 0.0
    square = (moved[0] * moved[1]).mean((0, 1))
    return float(np.max(np.sqrt(np.maximum(square, 0))[lit] / level[lit])), float(np.max(noise[lit] / level[lit]))


@pytest.mark.parametrize(("effect", "mutant", "on"), list(cases()))
def test_an_effect_is_on_where_leaving_it_out_changes_the_cube_by_more_than_the_error(effect, mutant, on):
    assert told(effect, mutant).on == on, told(effect, mutant).reason
    if not on:
        assert change(mutant, force=(effect,))[0] < ERROR
        return
    off_by, noise = change(mutant, without=(effect,))
    assert max(off_by, noise) > ERROR, "without aiming at lights their light is lost or noisy"
    if effect is not Physics.EMITTER_SAMPLING:
        assert off_by > ERROR


@pytest.mark.parametrize("name", [pytest.param("a flat lamp", marks=pytest.mark.slow), "a lamp a little brighter in the red"])
def test_light_that_is_even_within_bands_may_be_read_at_their_centres(name):
    mutant, _ = MUTANTS[Physics.ILLUMINANT_FACTORING][name]
    assert change(mutant, without=(Physics.ILLUMINANT_FACTORING,))[0] < ERROR / 10


@pytest.mark.parametrize("name", ["a grey floor", pytest.param("a grey floor and a grey wall", marks=pytest.mark.slow)])
def test_grey_surfaces_may_be_rendered_at_one_wavelength(name):
    mutant, _ = MUTANTS[Physics.SPECTRAL_NODES][name]
    assert change(mutant, without=(Physics.SPECTRAL_NODES,))[0] < 1e-5
    assert picture(mutant, without=(Physics.SPECTRAL_NODES,)).attrs["transport_nodes"] == 1


def test_a_cube_tells_every_effect_and_who_decided_it():
    rows = json.loads(picture(wall_of(0.5), without=(Physics.INTERREFLECTION,)).attrs["effects"])
    assert set(rows) == set(Physics)
    assert rows["interreflection"]["decided_by"] == "without"
    assert not rows["interreflection"]["on"]
    assert rows["emitter_sampling"]["on"]
    assert rows["emitter_sampling"]["decided_by"] == "scene"
    assert all(row["reason"] for row in rows.values())


def test_the_error_told_for_light_read_at_the_centres_of_bands_is_a_bound_for_light_reflected_once():
    filled = Orthographic(origin=(0, 0, 5), target=(0, 0, 0), half_height=0.5)
    lit = scene(lights=(SUN.model_copy(update={"irradiance": illuminant("A")}),), view=filled)
    off_by = change(lit, without=(Physics.ILLUMINANT_FACTORING,))[0]
    assert 1e-3 < off_by <= told(Physics.ILLUMINANT_FACTORING, lit).error_without * 1.001


def test_the_bound_of_further_light_holds_for_two_facing_squares_of_any_albedo_and_distance():
    """Against the exact form factor of directly opposed squares, iterated."""
    for albedo in (0.01, 0.3, 0.9):
        for gap in (0.2, 1.0, 5.0, 50.0):
            low = FLOOR.model_copy(update={"material": "grey"})
            high = Rectangle(name="high", material="grey", center=(0, 0, gap), half_u=(0, 1, 0), half_v=(1, 0, 0))
            x = 2 / gap
            f = (
                2
                / (np.pi * x**2)
                * (
                    np.log((1 + x**2) / np.sqrt(1 + 2 * x**2))
                    + 2 * x * np.sqrt(1 + x**2) * np.arctan(x / np.sqrt(1 + x**2))
                    - 2 * x * np.arctan(x)
                )
            )
            bound = further_light(scene(low, high, grey=Diffuse(reflectance=albedo)))
            exact = albedo * f / (1 - albedo * f)
            assert exact <= bound
            assert gap < 5 or bound < 2.5 * exact


def test_the_bound_of_further_light_is_the_geometric_series_in_a_closed_room_and_infinite_for_glass_or_white():
    room = [Box(name="b", material="grey", center=(0, 0, 0.3), half_u=(0.3, 0, 0), half_v=(0, 0.3, 0), half_w=(0, 0, 0.3)), FLOOR]
    dark = scene(*room, grey=Diffuse(reflectance=0.3), red=Diffuse(reflectance=0.3))
    assert further_light(dark) == pytest.approx(0.3 / 0.7, rel=1e-4)
    assert further_light(scene(*room, grey=Diffuse(reflectance=1.0), red=Diffuse(reflectance=1.0))) == np.inf
    assert further_light(globe(1.5, None)) == np.inf
    assert further_light(scene(lights=(SUN,), view=VIEW)) == 0.0


def test_an_effect_cannot_be_forced_and_left_out_at_once_nor_depth_be_chosen_twice():
    with pytest.raises(InputError, match="without"):
        RenderSettings(force=(Physics.SKY,), without=(Physics.SKY,))
    with pytest.raises(InputError, match="max_depth"):
        RenderSettings(force=(Physics.INTERREFLECTION,), max_depth=3)
    with pytest.raises(InputError, match=r"render\.force: .*sky"):
        RenderSettings(force=("moonlight",))


def test_a_choice_by_hand_is_told_with_what_the_scene_says():
    needs = explain(wall_of(0.5), ERROR, Choices(force=frozenset({Physics.SKY}), without=frozenset({Physics.INTERREFLECTION})))
    rows = {e.name: e for e in needs.effects}
    assert rows["interreflection"].decided_by == "without"
    assert not rows["interreflection"].on
    assert "'floor' and 'wall' face each other" in rows["interreflection"].reason
    assert rows["interreflection"].error_without > 0.01
    assert needs.max_depth == 2
    assert rows["sky"].on
    assert rows["sky"].decided_by == "force"
    assert rows["lens_blur"].decided_by == "scene"

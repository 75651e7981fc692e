"""What a scene needs follows from its contents: scenes are mutated one thing at a time."""

import json
import sys

import numpy as np
import pytest

import scenes
from optsim.cube import Bands
from optsim.errors import InputError
from optsim.render.needs import EFFECTS, explain
from optsim.render.reasons import node_error
from scenes.library import illuminant, line, reflectance
from scenes.meshes import icosphere
from scenes.scene import (
    AreaLight,
    ConstantSky,
    Dielectric,
    Diffuse,
    DirectionalLight,
    Orthographic,
    PointLight,
    Rectangle,
    RoughPlastic,
    Scene,
    Sphere,
)
from scenes.spectrum import Spectrum

VIEW = Orthographic(origin=(0, 0, 9), target=(0, 0, 0), half_height=1)
FLOOR = Rectangle(name="floor", material="red", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
WALL = Rectangle(name="wall", material="grey", center=(1, 0, 0.5), half_u=(0, 0, 0.5), half_v=(0, 1, 0))
SUNK = WALL.model_copy(update={"center": (1.0, 0.0, -0.5)})
LAMP = AreaLight(center=(0, 0, 3), half_u=(0, 0.1, 0), half_v=(0.1, 0, 0), radiance=illuminant("xenon"))
MATERIALS = {"red": Diffuse(reflectance=reflectance("red")), "grey": Diffuse(reflectance=0.5)}


def scene(*shapes, lights=(LAMP,), **materials):
    return Scene(name="test", shapes=shapes or (FLOOR,), materials=MATERIALS | materials, lights=lights, viewpoint=VIEW)


def effect(name, *args, error=0.01, **kwargs):
    return next(e for e in explain(scene(*args, **kwargs), error).effects if e.name == name)


@pytest.mark.parametrize("recipe", scenes.SCENES, ids=lambda r: r.name)
def test_every_scene_is_explained_effect_by_effect_in_plain_json(recipe):
    needs = explain(recipe.build(), 0.01)
    data = json.loads(json.dumps(needs.as_dict(), allow_nan=False))
    assert data["scene"] == recipe.name
    assert tuple(e["name"] for e in data["effects"]) == EFFECTS
    for row in data["effects"]:
        assert set(row) == {"name", "on", "reason", "error_without", "decided_by"}
        assert len(row["reason"]) > 10
        assert row["error_without"] >= 0
        assert row["on"] or row["error_without"] < 0.001, "what is left off costs at most a tenth of the error"


def test_explaining_a_scene_does_not_start_the_renderer():
    import subprocess

    code = "import sys, scenes; from optsim.render.needs import explain; explain(scenes.scene_by_name('color-checker').build()).effects;"
    subprocess.run([sys.executable, "-c", code + "assert not {'mitsuba', 'drjit', 'colour'} & set(sys.modules)"], check=True)


def test_the_name_of_a_scene_decides_nothing():
    target = scenes.scene_by_name("color-checker").build()
    renamed = target.model_copy(update={"name": "relief"})
    assert explain(renamed).effects == explain(target).effects


def test_the_two_targets_reflect_light_once_and_need_depth_2():
    for name in ("color-checker", "color-checker-bars"):
        needs = explain(scenes.scene_by_name(name).build())
        assert needs.reflects_once
        assert needs.max_depth == 2
        assert needs.all_diffuse
        assert needs.single_illuminant


def test_moving_a_wall_up_turns_interreflection_on():
    assert not effect("interreflection", FLOOR, SUNK).on
    on = effect("interreflection", FLOOR, WALL)
    assert on.on
    assert "'floor' and 'wall'" in on.reason
    assert 0.01 < on.error_without < 0.5


def test_painting_the_wall_black_turns_interreflection_off():
    assert not effect("interreflection", FLOOR, WALL, grey=Diffuse(reflectance=0.0)).on


def test_a_ball_above_the_floor_turns_interreflection_on_and_alone_it_stays_off():
    ball = Sphere(name="ball", material="grey", center=(0, 0, 0.5), radius=0.2)
    assert not effect("interreflection", ball).on
    assert effect("interreflection", FLOOR, ball).on


def test_depth_grows_with_albedo_and_with_the_error_asked_for():
    def depth(rho, error):
        return explain(scene(FLOOR, WALL, red=Diffuse(reflectance=rho), grey=Diffuse(reflectance=rho)), error).max_depth

    assert depth(0.2, 0.01) < depth(0.5, 0.01) < depth(0.9, 0.01)
    assert depth(0.5, 0.1) < depth(0.5, 1e-4)
    for rho, error in ((0.2, 0.01), (0.5, 0.1), (0.9, 1e-3)):
        assert rho ** depth(rho, error) < error


def room(rho):
    walls = [
        ((0, 0, -1), (1, 0, 0), (0, 1, 0)),
        ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
        ((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((1, 0, 0), (0, 0, 1), (0, 1, 0)),
        ((0, -1, 0), (0, 0, 1), (1, 0, 0)),
        ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
    ]
    shapes = [Rectangle(name=f"w{i}", material="grey", center=c, half_u=u, half_v=v) for i, (c, u, v) in enumerate(walls)]
    return scene(*shapes, grey=Diffuse(reflectance=rho))


def test_R4_a_closed_room_that_keeps_its_light_is_warned_of_with_the_depth_it_needs():
    assert explain(room(0.9)).warnings == ()
    (warning,) = explain(room(0.999999), 0.01).warnings
    needed = int(np.ceil(np.log(0.01) / np.log(0.999999)))
    assert f"depth {needed}" in warning
    assert "more than any depth" in explain(room(1.0)).warnings[0]
    assert explain(room(0.5)).effects[0].error_without == pytest.approx(0.5)


def test_an_abbe_number_turns_dispersion_on():
    ball = Sphere(name="ball", material="glass", center=(0, 0, 0.5), radius=0.2)
    assert not effect("dispersion", FLOOR).on
    assert not effect("dispersion", FLOOR, ball, glass=Dielectric(index=1.7)).on
    on = effect("dispersion", FLOOR, ball, glass=Dielectric(index=1.7, abbe=30))
    assert on.on
    assert on.error_without == pytest.approx(1.43 / 30, rel=0.1)
    assert not effect("dispersion", FLOOR, glass=Dielectric(index=1.7, abbe=30)).on, "glass that no shape is made of"


def test_lights_of_one_spectral_shape_are_factored_and_others_are_grouped():
    twin = DirectionalLight(direction=(0, 0, -1), irradiance=illuminant("xenon").scaled(1e-20))
    other = PointLight(position=(0, 0, 1), intensity=illuminant("A"))
    dark = PointLight(position=(0, 0, 1), intensity=0.0)
    for lights, count in (((LAMP,), 1), ((LAMP, twin, dark), 1), ((LAMP, other), 2), ((dark,), 0), ((), 0)):
        needs = explain(scene(FLOOR, lights=lights))
        assert needs.illuminant_count == count
        assert needs.single_illuminant == (count <= 1)
        assert next(e for e in needs.effects if e.name == "illuminant_factoring").on == (count > 0)


def test_factoring_matters_for_a_narrow_line_and_not_for_a_flat_lamp():
    flat = LAMP.model_copy(update={"radiance": Spectrum.constant(1.0)})
    sharp = LAMP.model_copy(update={"radiance": line(555.0, 0.5)})
    assert effect("illuminant_factoring", FLOOR, lights=(flat,)).error_without == pytest.approx(0, abs=1e-12)
    assert effect("illuminant_factoring", FLOOR, lights=(sharp,)).error_without > 0.9


def test_light_sampling_is_on_for_lamps_points_and_directions_and_off_for_a_sky():
    sky = ConstantSky(radiance=1.0)
    for lights, on in (((LAMP,), True), ((sky,), False), ((), False), ((sky, PointLight(position=(0, 0, 1), intensity=1.0)), True)):
        assert effect("emitter_sampling", FLOOR, lights=lights).on == on
    smaller = LAMP.model_copy(update={"half_u": (0, 0.01, 0)})
    noise = [effect("emitter_sampling", FLOOR, lights=(lamp,)).error_without for lamp in (LAMP, smaller)]
    assert noise[1] > 2 * noise[0]


def test_a_sky_turns_the_sky_on_and_a_pinhole_view_has_no_blur():
    assert effect("sky", FLOOR, lights=(ConstantSky(radiance=1.0),)).on
    assert not effect("sky", FLOOR, lights=(ConstantSky(radiance=0.0),)).on
    assert not effect("sky", FLOOR).on
    assert not effect("lens_blur", FLOOR).on


def test_nodes_of_single_reflections_are_the_reflectances_own_nodes_and_do_not_grow_with_the_bands():
    needs = explain(scene(FLOOR))
    few, many = (needs.nodes_nm(Bands.from_edges(np.linspace(453, 668, n + 1))) for n in (1, 500))
    np.testing.assert_array_equal(few, many)
    inside = few[(few > 453) & (few < 668)]
    np.testing.assert_array_equal(inside, np.arange(460.0, 661.0, 10.0))
    assert few[0] <= 453
    assert few[-1] >= 668


def test_bands_that_a_reflectance_does_not_cover_are_refused_by_its_name():
    with pytest.raises(InputError, match=r"materials\.red\.reflectance"):
        explain(scene(FLOOR)).nodes_nm(Bands.from_edges([300.0, 400.0]))


def test_the_node_error_is_exact_for_two_facing_parallel_mirrors_of_a_furnace_like_room():
    """In a closed room radiosity is E rho / (1 - rho): compare the estimate with the true error of linear interpolation."""
    for low, high in ((0.3, 0.4), (0.1, 0.6), (0.5, 0.52)):
        material = Diffuse(reflectance=Spectrum(np.array([400.0, 700.0]), np.array([low, high])))
        s = room(0.5).model_copy(update={"materials": {"grey": material, "red": material}})
        t = np.linspace(0, 1, 2001)
        rho = low + t * (high - low)
        truth = rho / (1 - rho)
        error = np.max(np.abs(truth - (truth[0] + t * (truth[-1] - truth[0])))) / high
        assert error <= node_error(s, np.array([400.0, 700.0]), 1.0)
        assert node_error(s, np.array([400.0, 700.0]), 1.0) < 4 * error or high - low > 0.2
    assert node_error(room(1.0), np.array([400.0, 700.0]), 1.0) == 0.0, "a flat spectrum has no error"


def test_materials_that_are_not_diffuse_are_noticed():
    needs = explain(scene(FLOOR, red=RoughPlastic(reflectance=reflectance("red"))))
    assert not needs.all_diffuse
    assert not explain(scene(FLOOR, red=RoughPlastic(reflectance=0.5))).dispersive


@pytest.mark.parametrize("bad", [0.0, 1.0, -1.0, float("nan")])
def test_an_error_outside_zero_to_one_is_refused(bad):
    with pytest.raises(InputError, match=r"error: must be in \(0, 1\)"):
        explain(scene(FLOOR), bad)


def test_a_scene_whose_spectra_share_no_wavelength_is_refused():
    odd = Diffuse(reflectance=Spectrum(np.array([800.0, 900.0]), np.array([0.1, 0.2])))
    with pytest.raises(InputError, match="share some wavelengths"):
        _ = explain(scene(FLOOR, red=odd)).effects


def test_an_empty_scene_needs_nothing():
    needs = explain(Scene(name="void", shapes=[], materials={}, lights=[], viewpoint=VIEW))
    assert not any(e.on for e in needs.effects if e.name != "spectral_nodes")


def test_a_mesh_of_too_many_faces_to_compare_is_taken_to_light_itself_and_says_so():
    ball = icosphere("ball", "grey", 1.0, (0, 0, 0), 5)
    on = effect("interreflection", ball)
    assert on.on
    assert "20480 faces are too many to prove" in on.reason
    assert not effect("interreflection", icosphere("ball", "grey", 1.0, (0, 0, 0), 4)).on

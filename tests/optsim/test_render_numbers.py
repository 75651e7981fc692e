"""Rendering at the ends of what may be asked: sizes, scales, seeds, bands, levels of light."""

import numpy as np
import pytest

from optsim.cube import Bands, band_mean, block_mean
from optsim.errors import InputError
from optsim.render import RenderSettings, render
from optsim.render import passes as passes_module
from scenes.catalogue import SCENES, scene_by_name
from scenes.color_checker import ColorChecker
from scenes.library import illuminant, reflectance, reflectances
from scenes.scene import (
    AreaLight,
    Box,
    ConstantSky,
    Diffuse,
    DirectionalLight,
    Orthographic,
    Perspective,
    PointLight,
    Rectangle,
    Scene,
    Sphere,
)
from scenes.spectrum import Spectrum

BANDS = Bands.paper()
FEW = Bands.from_edges([480, 520, 600])
QUICK = RenderSettings(samples_per_pixel=64)


def corner(size: float, level: float | Spectrum = 1.0) -> Scene:
    """A plane with a block that shades it, lit aslant by a lamp and a sky, everything ``size`` metres large."""
    at = lambda *v: tuple(x * size for x in v)  # noqa: E731
    return Scene(
        name="corner",
        shapes=(
            Rectangle(name="floor", material="m", center=(0, 0, 0), half_u=at(1, 0, 0), half_v=at(0, 1, 0)),
            Box(name="block", material="m", center=at(0.1, 0, 0.1), half_u=at(0.1, 0, 0), half_v=at(0, 0.1, 0), half_w=at(0, 0, 0.1)),
        ),
        materials={"m": Diffuse(reflectance=0.6)},
        lights=(AreaLight(center=at(2, 0, 2), half_u=at(0, 0.2, 0), half_v=at(0.15, 0, -0.15), radiance=level),),
        viewpoint=Perspective(origin=at(-1, -1, 1.5), target=(0, 0, 0), up=(0, 0, 1), fov_deg=40),
    )


@pytest.mark.parametrize("size", [1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6])
def test_R20_radiance_does_not_depend_on_the_unit_of_length(size):
    one = render(corner(1.0), FEW, (12, 12), RenderSettings(samples_per_pixel=256)).radiance.values
    other = render(corner(size), FEW, (12, 12), RenderSettings(samples_per_pixel=256)).radiance.values
    np.testing.assert_allclose(other.mean(), one.mean(), rtol=1e-4)
    assert np.sqrt(np.mean((other - one) ** 2)) < 0.01 * one.mean()  # a ray in a thousand may round to another side of an edge


def test_R20_a_point_lamp_scales_with_the_square_of_the_unit():
    view = Orthographic(origin=(0, 0, 1e-3), target=(0, 0, 0), half_height=1e-6)
    plane = Rectangle(name="p", material="m", center=(0, 0, 0), half_u=(1e-3, 0, 0), half_v=(0, 1e-3, 0))
    lamp = PointLight(position=(0, 0, 2e-3), intensity=3.0)
    scene = Scene(name="s", shapes=(plane,), materials={"m": Diffuse(reflectance=1.0)}, lights=(lamp,), viewpoint=view)
    np.testing.assert_allclose(render(scene, FEW, (2, 2), QUICK).radiance.values, 3 / 4e-6 / np.pi, rtol=1e-5)


@pytest.mark.parametrize("factor", [1e-30, 1e-12, 1e12, 1e30])
def test_R8_radiance_is_proportional_to_light_over_sixty_decades(factor):
    one = render(corner(1.0, Spectrum.constant(1.0)), FEW, (6, 6), QUICK)
    scaled = render(corner(1.0, Spectrum.constant(factor)), FEW, (6, 6), QUICK)
    np.testing.assert_allclose(scaled.radiance.values.astype(np.float64) / factor, one.radiance.values, rtol=1e-6)
    np.testing.assert_allclose(scaled.stderr.values.astype(np.float64) / factor, one.stderr.values, rtol=1e-5, atol=1e-12)


def test_R8_a_light_of_1e_minus_40_is_rendered_and_not_flushed_to_zero():
    cube = render(corner(1.0, Spectrum.constant(1e-40)), FEW, (6, 6), QUICK)
    one = render(corner(1.0, Spectrum.constant(1.0)), FEW, (6, 6), QUICK)
    assert cube.radiance.dtype == np.float64
    np.testing.assert_allclose(cube.radiance.values / 1e-40, one.radiance.values, rtol=1e-6)


def test_R7_light_beyond_1e30_or_not_finite_is_refused_by_name():
    for level in (np.inf, 1e39):
        with pytest.raises(ValueError, match=r"radiance.*1e\+30|finite"):
            corner(1.0, level)


@pytest.mark.parametrize(
    ("field", "value", "name"),
    [
        ("samples_per_pixel", 0, "render.spp"),  # R9
        ("samples_per_pixel", 2**24 + 1, "render.spp"),
        ("seed", -1, "render.seed"),  # R11
        ("seed", 2**32, "render.seed"),
        ("oversample", 0, "render.oversample"),
        ("error", 0.0, "render.error"),
        ("error", float("nan"), "render.error"),
        ("max_samples", 3, "render.max_samples"),
        ("max_depth", 0, "render.max_depth"),
        ("spp", 4, "render.spp"),
    ],
)
def test_R9_R11_settings_out_of_range_are_refused_with_field_and_range(field, value, name):
    with pytest.raises(InputError) as caught:
        RenderSettings(**{field: value})
    assert caught.value.field == name
    assert "[" in caught.value.allowed or "fields" in caught.value.allowed


def test_an_error_and_a_number_of_samples_cannot_both_be_asked_for():
    with pytest.raises(InputError, match="not both"):
        RenderSettings(error=0.01, samples_per_pixel=16)


@pytest.mark.parametrize("size", [(0, 0), (0, 4), (4, -1), (40000, 1), (2.5, 2), 7, ("a", "b")])
def test_R12_impossible_film_sizes_are_refused(size):
    with pytest.raises(InputError, match=r"render\.size"):
        render(corner(1.0), FEW, size, QUICK)


def marked() -> Scene:
    """A white mark in the top right corner of the view, on black."""
    mark = Rectangle(name="mark", material="white", center=(0.9, 0.8, 0), half_u=(0.1, 0, 0), half_v=(0, 0.2, 0))
    view = Orthographic(origin=(0, 0, 5), target=(0, 0, 0), half_height=1)
    return Scene(
        name="marked",
        shapes=(mark,),
        materials={"white": Diffuse(reflectance=1.0)},
        lights=(DirectionalLight(direction=(0, 0, -1), irradiance=np.pi),),
        viewpoint=view,
    )


def test_R12_row_0_is_the_top_and_x_grows_to_the_right():
    picture = render(marked(), FEW, (10, 10), QUICK).radiance.values[:, :, 0]
    expected = np.zeros((10, 10))
    expected[0:2, 9] = 1
    np.testing.assert_allclose(picture, expected, atol=1e-6)


def test_R12_a_film_of_3_by_17_keeps_square_pixels_and_does_not_swap_axes():
    cube = render(marked(), FEW, (3, 17), RenderSettings(samples_per_pixel=2**16))
    picture = cube.radiance.values[:, :, 0]
    assert picture.shape == (3, 17)
    side = 2 / 3  # of a pixel; the picture spans 17 of them across, so the mark lies 1.2 to 1.5 pixels right of the middle
    lit = np.argwhere(picture > 1e-6)
    assert lit.tolist() == [[0, 9]]
    assert picture[0, 9] == pytest.approx(0.2 * 0.4 / side**2, rel=0.02)


def test_R12_a_single_pixel_is_the_mean_of_the_picture():
    assert render(marked(), FEW, (1, 1), RenderSettings(samples_per_pixel=2**16)).radiance.values[0, 0, 0] == pytest.approx(0.02, rel=0.02)


def test_oversampled_pictures_average_to_the_plain_one():
    scene = ColorChecker().build()
    coarse = render(scene, BANDS, (16, 16), RenderSettings(samples_per_pixel=1024))
    fine = render(scene, BANDS, (16, 16), RenderSettings(samples_per_pixel=256, oversample=2))
    assert fine.radiance.shape == (32, 32, 24)
    merged = block_mean(fine, 2)
    z = (merged.radiance - coarse.radiance).values / np.hypot(merged.stderr, coarse.stderr).values
    assert np.sqrt(np.mean(z[:, :, 0] ** 2)) < 1.5
    np.testing.assert_allclose(merged.radiance.values, coarse.radiance.values, atol=0.1 * float(coarse.radiance.mean()))


def test_R13_a_camera_inside_a_solid_sees_black():
    ball = Sphere(name="ball", material="m", center=(0, 0, 0), radius=1)
    view = Perspective(origin=(0, 0, 0), target=(0, 0, 1), fov_deg=60)
    scene = Scene(name="s", shapes=(ball,), materials={"m": Diffuse(reflectance=0.9)}, lights=(ConstantSky(radiance=1.0),), viewpoint=view)
    assert np.all(render(scene, FEW, (4, 4), QUICK).radiance.values == 0)


@pytest.mark.parametrize(("fov_deg", "distance"), [(1e-3, 10.0), (1e-3, 1e5), (40.0, 2.0), (170.0, 1.0)])
def test_R14_the_footprint_of_a_field_of_view_is_twice_the_tangent_of_its_half(fov_deg, distance):
    """A disc's share of the picture is its area over the footprint's."""
    footprint = 2 * distance * np.tan(np.deg2rad(fov_deg) / 2)
    square = Rectangle(name="m", material="m", center=(0, 0, 0), half_u=(footprint / 4, 0, 0), half_v=(0, footprint / 8, 0))
    view = Perspective(origin=(0, 0, distance), target=(0, 0, 0), fov_deg=fov_deg)
    scene = Scene(
        name="s",
        shapes=(square,),
        materials={"m": Diffuse(reflectance=1.0)},
        lights=(DirectionalLight(direction=(0, 0, -1), irradiance=np.pi),),
        viewpoint=view,
    )
    picture = render(scene, FEW, (8, 8), QUICK).radiance.values[:, :, 0]
    expected = np.zeros((8, 8))
    expected[3:5, 2:6] = 1
    np.testing.assert_allclose(picture, expected, atol=1e-5)


def test_R17_a_band_of_1e_minus_3_nm_has_the_value_at_its_centre():
    lamp, rho = illuminant("xenon"), reflectance(tuple(reflectances())[14])
    scene = ColorChecker(lamp=lamp, board=rho).build()
    centers = np.array([467.3, 533.3, 601.7])
    narrow = Bands(centers - 5e-4, centers + 5e-4, centers)
    cube = render(scene, narrow, (2, 2), QUICK)
    sky = Scene(
        name="s",
        shapes=(Rectangle(name="p", material="m", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0)),),
        materials={"m": Diffuse(reflectance=rho)},
        lights=(ConstantSky(radiance=lamp),),
        viewpoint=scene.viewpoint,
    )
    values = render(sky, narrow, (2, 2), QUICK).radiance.values
    np.testing.assert_allclose(values, np.broadcast_to(lamp.at(centers) * rho.at(centers), values.shape), rtol=2e-6)
    assert cube.radiance.shape == (2, 2, 3)


def test_R17_bands_far_apart_or_overlapping_are_each_rendered_as_if_alone():
    scene = ColorChecker().build()
    bands = Bands(np.array([400.0, 500, 505]), np.array([401.0, 520, 700]), np.array([400.5, 510, 600]))
    together = render(scene, bands, (8, 8), QUICK).radiance.values
    for k in range(3):
        one = Bands(bands.lower[k : k + 1], bands.upper[k : k + 1], bands.center[k : k + 1])
        np.testing.assert_allclose(render(scene, one, (8, 8), QUICK).radiance.values[:, :, 0], together[:, :, k], rtol=3e-7)


@pytest.mark.parametrize("recipe", [ColorChecker().build, lambda: corner(1.0, illuminant("xenon"))])
def test_fine_bands_average_to_the_coarse_ones_exactly(recipe):
    fine = render(recipe(), BANDS.subdivide(10, (450.0, 670.0)), (8, 8), QUICK)
    coarse = render(recipe(), BANDS, (8, 8), QUICK)
    np.testing.assert_allclose(band_mean(fine, BANDS).radiance.values, coarse.radiance.values, rtol=5e-7)


def test_bands_outside_the_data_of_a_lamp_or_a_material_are_refused_by_name():
    with pytest.raises(InputError, match=r"lights\[0\]"):
        render(ColorChecker().build(), Bands.from_edges([300, 310]), (2, 2), QUICK)
    with pytest.raises(InputError, match=r"materials\..*reflectance"):
        render(ColorChecker(lamp=Spectrum.constant(1.0)).build(), Bands.from_edges([900, 1000]), (2, 2), QUICK)


class _Task:
    def __init__(self, samples, pixels):
        self.settings, self.pixels = RenderSettings(samples_per_pixel=samples), pixels


@pytest.mark.parametrize(("samples", "pixels"), [(1, 1), (2, 9), (7, 1), (64, 100), (1009, 64), (2**24, 2**20), (2**14, 2**30)])
def test_R10_a_pass_never_holds_more_paths_than_its_limit_and_no_sample_is_lost(samples, pixels):
    passes, each = passes_module.sample_plan(_Task(samples, pixels))
    assert samples <= passes * each < samples + passes
    assert each == 1 or (each - 1) * pixels < passes_module.MAX_PATHS_A_PASS
    assert each * pixels < 2**32 or each == 1
    assert passes >= min(samples, passes_module.MIN_PASSES)


def test_R10_a_render_split_into_passes_and_launches_has_the_variance_of_one(monkeypatch):
    from optsim.render import kernel

    whole = render(corner(1.0), FEW, (8, 8), RenderSettings(samples_per_pixel=512, seed=1))
    monkeypatch.setattr(passes_module, "MAX_PATHS_A_PASS", 8 * 8 * 16)
    monkeypatch.setattr(kernel, "SAMPLES_A_LAUNCH", 5)
    monkeypatch.setattr(kernel, "VALUES_A_TILE", 3 * 8 * 40)
    split = render(corner(1.0), FEW, (8, 8), RenderSettings(samples_per_pixel=512, seed=2))
    assert (whole.attrs["passes"], split.attrs["passes"]) == (8, 32)
    difference = (split.radiance - whole.radiance).values.mean((0, 1))
    error = np.sqrt((split.stderr**2 + whole.stderr**2).values.mean((0, 1))) / 8
    assert np.all(np.abs(difference) < 4 * error)
    assert split.attrs["error"] < 0.05


@pytest.mark.parametrize("vectorised", [True, False], ids=["own", "film"])
def test_R15_no_spectrum_reaches_mitsuba_as_a_bare_number_or_as_rgb(monkeypatch, vectorised):
    from optsim.render import reference, render_with_film, translate

    seen = []
    original = translate.mi.load_dict

    def spy(tree, **options):
        seen.append(tree)
        return original(tree, **options)

    monkeypatch.setattr(translate.mi, "load_dict", spy)
    (render if vectorised else render_with_film)(scene_by_name("relief").build(), FEW, (4, 4), RenderSettings(samples_per_pixel=4))
    assert reference.mi is translate.mi
    spectral = {"radiance", "irradiance", "intensity", "reflectance", "diffuse_reflectance", "specular_reflectance", "eta", "k"}
    found = []

    def walk(tree):
        for key, value in tree.items():
            if key in spectral:
                found.append(value["type"] if isinstance(value, dict) else value)
            if isinstance(value, dict):
                walk(value)

    for tree in seen:
        walk(tree)
    assert len(found) > 10
    assert set(found) <= {"uniform", "regular", "irregular"}


@pytest.mark.parametrize("recipe", SCENES, ids=lambda r: r.name)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_every_scene_that_comes_along_renders_to_light_somewhere_and_nothing_below_zero(recipe):
    cube = render(recipe.build(), BANDS, (6, 8), RenderSettings(samples_per_pixel=16))
    assert cube.radiance.shape == (6, 8, 24)
    assert np.all(cube.radiance.values >= 0)
    assert np.all(cube.radiance.values.mean((0, 1)) > 0)
    assert cube.attrs["cut_share"] < 1e-3

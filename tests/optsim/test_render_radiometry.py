"""Rendered radiance against closed forms of radiometry, in every band."""

import numpy as np
import pytest

from optsim.cube import Bands
from optsim.render import RenderSettings, render
from scenes.library import blackbody, illuminant, line, reflectance, reflectances
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
)
from scenes.spectrum import Spectrum

BANDS = Bands.paper()
VIEW = Orthographic(origin=(0, 0, 3), target=(0, 0, 0), half_height=0.05)
PLANE = Rectangle(name="plane", material="m", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
PATCHES = tuple(reflectances())
ILLUMINANTS = ("xenon", "D65", "A")


def scene_of(*lights, shapes=(PLANE,), view=VIEW, reflect=0.5):
    return Scene(name="test", shapes=shapes, materials={"m": Diffuse(reflectance=reflect)}, lights=lights, viewpoint=view)


def product_mean(a: Spectrum, b: Spectrum, bands: Bands) -> np.ndarray:
    """Mean of a x b over each band by 20001-point Gauss-free brute force: trapezia on a grid that holds every node."""
    means = []
    for low, high in zip(bands.lower, bands.upper):
        x = np.unique(
            np.concatenate(
                [np.linspace(low, high, 20001), *(s.wavelength_nm[(s.wavelength_nm > low) & (s.wavelength_nm < high)] for s in (a, b))]
            )
        )
        y = np.interp(x, a.wavelength_nm, a.value) * np.interp(x, b.wavelength_nm, b.value)
        means.append(np.trapezoid(y, x) / (high - low))
    return np.array(means)


def assert_within_noise(cube, expected, floor=3e-6, z=4.0):
    """Compare picture means with expected values: z standard errors of the mean, or float32 rounding."""
    values, errors = cube.radiance.values.astype(np.float64), cube.stderr.values.astype(np.float64)
    mean = values.mean((0, 1))
    error = np.sqrt((errors**2).mean((0, 1)) / (values.shape[0] * values.shape[1]))
    np.testing.assert_array_less(np.abs(mean - expected), z * error + floor * np.abs(expected) + 1e-300)


@pytest.mark.parametrize("name", ILLUMINANTS)
@pytest.mark.parametrize("patch", [PATCHES[14], PATCHES[17], PATCHES[18]])
def test_a_diffuse_plane_under_a_uniform_sky_returns_rho_times_the_sky(name, patch):
    lamp, rho = illuminant(name), reflectance(patch)
    cube = render(scene_of(ConstantSky(radiance=lamp), reflect=rho), BANDS, (4, 4), RenderSettings(samples_per_pixel=64))
    assert_within_noise(cube, product_mean(lamp, rho, BANDS))


@pytest.mark.parametrize("name", ILLUMINANTS)
def test_a_diffuse_plane_in_parallel_light_returns_rho_e_cosine_over_pi(name):
    lamp, rho = illuminant(name), reflectance(PATCHES[17])
    light = DirectionalLight(direction=(0.6, 0, -0.8), irradiance=lamp)
    cube = render(scene_of(light, reflect=rho), BANDS, (4, 4), RenderSettings(samples_per_pixel=64))
    assert_within_noise(cube, product_mean(lamp, rho, BANDS) * 0.8 / np.pi)


@pytest.mark.parametrize("name", ILLUMINANTS)
@pytest.mark.parametrize("height", [0.3, 3.0])
def test_a_square_lamp_over_a_plane_gives_the_exact_form_factor(name, height):
    lamp, rho, half = illuminant(name), reflectance(PATCHES[14]), 0.4
    light = AreaLight(center=(0, 0, height), half_u=(half, 0, 0), half_v=(0, -half, 0), radiance=lamp)
    view = Orthographic(origin=(0, 0, height / 2), target=(0, 0, 0), half_height=1e-4)
    a = (
        half / height
    )  # point below the middle: four corner rectangles (Howell, A Catalog of Radiation Heat Transfer Configuration Factors, B-4)
    factor = 4 / (2 * np.pi) * 2 * a / np.sqrt(1 + a * a) * np.arctan(a / np.sqrt(1 + a * a))
    cube = render(scene_of(light, reflect=rho, view=view), BANDS, (4, 4), RenderSettings(samples_per_pixel=4096))
    assert_within_noise(cube, product_mean(lamp, rho, BANDS) * factor)


def test_a_point_lamp_falls_off_with_the_square_of_the_distance():
    view = Orthographic(origin=(0, 0, 1), target=(0, 0, 0), half_height=1e-4)
    for distance in (2.0, 20.0):
        cube = render(
            scene_of(PointLight(position=(0, 0, distance), intensity=5.0), view=view), BANDS, (2, 2), RenderSettings(samples_per_pixel=16)
        )
        assert_within_noise(cube, np.full(24, 0.5 * 5 / distance**2 / np.pi))


def test_R1_an_empty_scene_under_a_sky_of_one_is_one_whatever_the_band():
    bands = Bands(np.array([500.0, 600]), np.array([510.0, 620]), np.array([505.0, 610]))
    cube = render(scene_of(ConstantSky(radiance=1.0), shapes=()), bands, (3, 4), RenderSettings(samples_per_pixel=16))
    np.testing.assert_allclose(cube.radiance.values, 1, rtol=1e-6)


@pytest.mark.parametrize(("case", "albedo"), [("R2", 1.0), ("R3", 0.5)])
def test_R2_R3_a_convex_sphere_in_a_furnace_shows_exactly_its_albedo(case, albedo):
    ball = Sphere(name="ball", material="m", center=(0, 0, 0), radius=1)
    view = Orthographic(origin=(0, 0, 5), target=(0, 0, 0), half_height=0.99 / np.sqrt(2))
    cube = render(
        scene_of(ConstantSky(radiance=1.0), shapes=(ball,), view=view, reflect=albedo), BANDS, (8, 8), RenderSettings(samples_per_pixel=64)
    )
    np.testing.assert_allclose(cube.radiance.values, albedo, rtol=1e-5)


def test_white_surfaces_of_any_shape_vanish_in_a_furnace():
    shapes = (
        PLANE,
        Box(name="box", material="m", center=(0.02, 0, 0.02), half_u=(0.02, 0, 0), half_v=(0, 0.02, 0), half_w=(0, 0, 0.02)),
        Sphere(name="ball", material="m", center=(-0.02, 0, 0.03), radius=0.02),
    )
    cube = render(
        scene_of(ConstantSky(radiance=1.0), shapes=shapes, reflect=1.0),
        BANDS,
        (16, 16),
        RenderSettings(samples_per_pixel=256, max_depth=500),
    )
    np.testing.assert_allclose(cube.radiance.values, 1, rtol=2e-4)


def room(side=1.0) -> Mesh:
    """Return a cube of edge 2 side with its fronts inside."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * side
    outward = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[q[0], q[b], q[a]] for q in outward for a, b in ((1, 2), (2, 3))]
    normals = [np.cross(corners[f[1]] - corners[f[0]], corners[f[2]] - corners[f[0]]) @ corners[f].mean(0) for f in faces]
    faces = [f if n < 0 else f[::-1] for f, n in zip(faces, normals)]
    return Mesh(name="room", material="m", vertices=corners, faces=faces)


@pytest.mark.parametrize(("albedo", "depth"), [(0.5, 3), (0.5, 12), (0.8, 9), (0.9, 60), (0.999, 40)])
def test_R4_a_closed_room_sends_out_the_geometric_series_of_its_albedo(albedo, depth):
    """A lamp of flux 4 pi I in the middle: each reflection sends out flux x rho, whatever the shape; all six walls are alike."""
    view = Orthographic(origin=(0, 0, 0), target=(0, 0, -1), half_height=1)
    scene = scene_of(PointLight(position=(0, 0, 0), intensity=1.0), shapes=(room(),), view=view, reflect=albedo)
    cube = render(scene, Bands.from_edges([500, 550, 600]), (8, 8), RenderSettings(samples_per_pixel=4096, max_depth=depth))
    flux = 4 * np.pi * albedo * (1 - albedo ** (depth - 1)) / (1 - albedo)
    assert_within_noise(cube, np.full(2, flux / np.pi / 24), floor=1e-5)
    assert cube.attrs["cut_share"] == pytest.approx(albedo ** (depth - 1), rel=0.15)


def test_R4_a_room_of_albedo_0_999999_is_warned_about_with_the_depth_it_needs():
    scene = scene_of(
        PointLight(position=(0, 0, 0), intensity=1.0),
        shapes=(room(),),
        view=Orthographic(origin=(0, 0, 0), target=(0, 0, -1), half_height=1),
        reflect=0.999999,
    )
    with pytest.warns(RuntimeWarning, match="needs depth 4605168"):
        render(scene, Bands.from_edges([500, 600]), (1, 1), RenderSettings(samples_per_pixel=4))


def test_R5_an_albedo_of_zero_is_exactly_zero_and_not_negative_zero():
    cube = render(scene_of(ConstantSky(radiance=1.0), reflect=0.0), BANDS, (4, 4), RenderSettings(samples_per_pixel=16))
    assert np.all(cube.radiance.values == 0)
    assert not np.any(np.signbit(cube.radiance.values))
    assert np.all(cube.stderr.values == 0)


def test_a_scene_without_light_is_black():
    cube = render(scene_of(), BANDS, (3, 5), RenderSettings(samples_per_pixel=16))
    assert cube.radiance.shape == (3, 5, 24)
    assert np.all(cube.radiance.values == 0)


def test_a_lamp_in_view_shows_its_own_radiance_on_its_front_only():
    light = AreaLight(center=(0, 0, 1), half_u=(1, 0, 0), half_v=(0, 1, 0), radiance=7.0)
    cube = render(scene_of(light), BANDS, (2, 2), RenderSettings(samples_per_pixel=16))
    np.testing.assert_allclose(cube.radiance.values, 7, rtol=1e-6)
    back = AreaLight(center=(0, 0, 1), half_u=(1, 0, 0), half_v=(0, -1, 0), radiance=7.0)
    assert np.all(render(scene_of(back), BANDS, (2, 2), RenderSettings(samples_per_pixel=16)).radiance.values == 0)


def test_lights_of_different_spectra_add_up_and_a_lamp_shades_the_sky():
    place = {"center": (0.3, 0, 1), "half_u": (0.1, 0, 0), "half_v": (0, -0.1, 0)}
    lights = [
        AreaLight(**place, radiance=illuminant("A")),
        ConstantSky(radiance=illuminant("D65")),
        DirectionalLight(direction=(0, 0.3, -1), irradiance=blackbody(3000, np.arange(380, 731, 5.0))),
    ]
    rho, settings = reflectance(PATCHES[14]), RenderSettings(samples_per_pixel=1024)
    together = render(scene_of(*lights, reflect=rho), BANDS, (4, 4), settings)
    off = AreaLight(**place, radiance=0.0)
    alone = [render(scene_of(light, off, reflect=rho), BANDS, (4, 4), settings) for light in lights]
    assert_within_noise(together, sum(a.radiance.values.astype(np.float64).mean((0, 1)) for a in alone), floor=1e-4)


def test_R18_a_line_emitter_keeps_its_energy_over_bands_wider_than_itself():
    lamp = line(546.07, 1.0)
    bands = Bands.from_edges(np.arange(450, 671, 10.0))
    cube = render(scene_of(ConstantSky(radiance=lamp), reflect=0.5), bands, (4, 4), RenderSettings(samples_per_pixel=64))
    np.testing.assert_allclose(cube.radiance.values.astype(np.float64) @ bands.width, 0.5, rtol=1e-5)
    assert np.count_nonzero(cube.radiance.values.mean((0, 1))) == 1


def test_a_hemisphere_of_view_sees_the_furnace_through_a_perspective_camera():
    view = Perspective(origin=(0, 0, 2), target=(0, 0, 0), fov_deg=100)
    cube = render(
        scene_of(
            ConstantSky(radiance=2.0), shapes=(Sphere(name="s", material="m", center=(0, 0, 0), radius=5e-3),), view=view, reflect=1.0
        ),
        BANDS,
        (5, 5),
        RenderSettings(samples_per_pixel=64),
    )
    np.testing.assert_allclose(cube.radiance.values, 2, rtol=1e-5)

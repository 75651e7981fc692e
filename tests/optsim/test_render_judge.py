"""The table and the shared path agree with each other and with Mitsuba's own path and film, which share no transport code with them."""

from functools import partial

import numpy as np
import pytest

from optsim.cube import Bands
from optsim.errors import InputError
from optsim.render import RenderSettings, render, render_with_film
from optsim.render import transport as transport_module
from optsim.render.picture import picture
from optsim.render.reference import FilmTransport, box_responses, node_cells, proven_responses, self_test
from scenes.color_checker import ColorChecker
from scenes.library import illuminant, reflectance, reflectances
from scenes.scene import (
    AreaLight,
    Box,
    Conductor,
    ConstantSky,
    Dielectric,
    Diffuse,
    Orthographic,
    Perspective,
    PointLight,
    Rectangle,
    RoughPlastic,
    Scene,
    Sphere,
)
from scenes.spectrum import Spectrum

PATCH = tuple(reflectances())
GOLD_N = Spectrum(np.array([400.0, 500, 600, 700]), np.array([1.66, 0.97, 0.25, 0.13]))
GOLD_K = Spectrum(np.array([400.0, 500, 600, 700]), np.array([1.95, 1.87, 2.98, 4.06]))


def still_life(**materials) -> Scene:
    """A ball and a block on a coloured floor before a lamp and a sky; materials replace the diffuse ones."""
    own = {
        "floor": Diffuse(reflectance=reflectance(PATCH[14])),
        "ball": Diffuse(reflectance=reflectance(PATCH[15])),
        "block": Diffuse(reflectance=reflectance(PATCH[13])),
    }
    return Scene(
        name="still life",
        shapes=(
            Rectangle(name="floor", material="floor", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0)),
            Sphere(name="ball", material="ball", center=(-0.25, 0, 0.25), radius=0.25),
            Box(name="block", material="block", center=(0.2, 0, 0.2), half_u=(0.15, 0, 0), half_v=(0, 0.15, 0), half_w=(0, 0, 0.2)),
        ),
        materials=own | materials,
        lights=(
            AreaLight(center=(1, -1, 2), half_u=(0.4, 0.4, 0), half_v=(0.3, -0.3, 0.3), radiance=illuminant("xenon").scaled(5)),
            ConstantSky(radiance=illuminant("D65").scaled(1e-2)),
        ),
        viewpoint=Perspective(origin=(0, -2.2, 1.4), target=(0, 0, 0.2), up=(0, 0, 1), fov_deg=28),
    )


BANDS = Bands.from_edges([455, 470, 500, 540, 580, 600, 630, 665])


def assert_agree(a, b, limit=4.5):
    """Compare picture means band by band in units of their standard error, and pixels by the mean square of theirs."""
    difference = (a.radiance.values - b.radiance.values).astype(np.float64)
    error = np.hypot(a.stderr.values, b.stderr.values).astype(np.float64)
    pixels = difference.shape[0] * difference.shape[1]
    z = difference.mean((0, 1)) / np.sqrt((error**2).mean((0, 1)) / pixels)
    assert np.all(np.abs(z) < limit), z
    assert np.sum(difference**2) / np.sum(error**2) < 1.5
    relative = np.abs(difference.mean((0, 1))) / a.radiance.values.mean((0, 1))
    assert np.all(relative < 0.02), relative


@pytest.mark.parametrize("bands", [BANDS, Bands.paper()], ids=["seven", "paper"])
def test_the_diffuse_table_agrees_with_mitsubas_path_and_film(bands):
    scene = still_life()
    ours = render(scene, bands, (24, 32), RenderSettings(samples_per_pixel=1024))
    assert ours.attrs["integrator"] == "diffuse table"
    assert_agree(ours, render_with_film(scene, bands, (24, 32), RenderSettings(samples_per_pixel=4096)))


def test_the_chart_agrees_with_mitsubas_path_and_film():
    scene = ColorChecker().build()
    ours = render(scene, Bands.paper(), (16, 16), RenderSettings(samples_per_pixel=1024))
    assert_agree(ours, render_with_film(scene, Bands.paper(), (16, 16), RenderSettings(samples_per_pixel=8192)))


def test_the_shared_path_follows_the_same_light_as_the_table(monkeypatch):
    scene = still_life()
    table = render(scene, BANDS, (16, 20), RenderSettings(samples_per_pixel=1024, seed=1))
    hidden = still_life(hidden=RoughPlastic(reflectance=0.5))
    spot = Sphere(name="hidden", material="hidden", center=(0, 0, -1), radius=0.01)  # below the floor: it only changes the route
    hidden = hidden.model_copy(update={"shapes": (*hidden.shapes, spot)})
    shared = render(hidden, BANDS, (16, 20), RenderSettings(samples_per_pixel=1024, seed=2))
    assert shared.attrs["integrator"] == "shared path"
    assert_agree(table, shared)


MATERIALS = {
    "glass": {"ball": Dielectric(index=1.5)},
    "plastic": {"ball": RoughPlastic(reflectance=reflectance(PATCH[15]), roughness=0.3)},
    "gold": {"ball": Conductor(eta=GOLD_N, k=GOLD_K)},
    "all": {"ball": Dielectric(index=1.7), "block": RoughPlastic(reflectance=0.4, roughness=0.2), "floor": Conductor(eta=GOLD_N, k=GOLD_K)},
}


@pytest.mark.parametrize("name", MATERIALS)
def test_every_material_agrees_with_mitsubas_path_and_film(name):
    scene, settings = still_life(**MATERIALS[name]), RenderSettings(samples_per_pixel=4096, max_depth=10)
    ours = render(scene, BANDS, (16, 20), settings)
    assert ours.attrs["integrator"] == "shared path"
    assert_agree(ours, render_with_film(scene, BANDS, (16, 20), settings))


def test_many_nodes_in_several_kernels_give_what_one_kernel_gives(monkeypatch):
    scene, settings = still_life(), RenderSettings(samples_per_pixel=64)
    whole = render(scene, Bands.paper(), (8, 8), settings)
    monkeypatch.setattr(transport_module, "NODES_A_KERNEL", 5)
    parts = render(scene, Bands.paper(), (8, 8), settings)
    np.testing.assert_allclose(parts.radiance.values, whole.radiance.values, rtol=2e-6)


def test_nodes_are_dense_enough_for_light_between_coloured_surfaces(monkeypatch):
    """Ten times the nodes change every band by less than a tenth of a per cent of the picture's mean."""
    scene, settings = still_life(), RenderSettings(samples_per_pixel=128)
    usual = render(scene, Bands.paper(), (16, 16), settings)
    monkeypatch.setattr("optsim.render.spectral.TWO_BOUNCE_TOLERANCE", 1e-5)
    dense = render(scene, Bands.paper(), (16, 16), settings)
    assert dense.attrs["transport_nodes"] > 3 * usual.attrs["transport_nodes"]
    change = np.sqrt(((dense.radiance - usual.radiance).values ** 2).mean((0, 1))) / dense.radiance.values.mean((0, 1))
    assert np.all(change < 1e-3)


@pytest.mark.parametrize("bands", [Bands.from_edges(np.linspace(450, 670, 25)), Bands.from_edges(np.linspace(400, 700, 32)), Bands.paper()])
def test_the_film_passes_its_self_test_with_widened_bands(bands):
    self_test(box_responses(bands, 1e-3))


def test_the_self_test_catches_the_films_biased_sampling_of_exact_edges():
    with pytest.raises(InputError, match="within 1 %"):
        self_test(box_responses(Bands.from_edges(np.linspace(450, 670, 25)), 0.0))


def test_bands_that_need_more_widening_get_it():
    cells, _ = node_cells(np.array([450.0, 460, 470, 475, 480, 485, 490, 500, 503 + 1 / 3, 506 + 2 / 3, 510, 520]))
    low = [response["wavelength_min"] for response in proven_responses(cells).values()]
    self_test(proven_responses(cells))
    assert np.all(np.abs(np.array(low) - cells.lower) <= 0.05)


def slab(material, **light) -> Scene:
    """A block that fills the view, with a lamp behind it that fills it too, seen square on."""
    return Scene(
        name="slab",
        shapes=(Box(name="slab", material="m", center=(0, 0, 0), half_u=(5, 0, 0), half_v=(0, 5, 0), half_w=(0, 0, 0.1)),),
        materials={"m": material},
        lights=(AreaLight(center=(0, 0, -1), half_u=(4, 0, 0), half_v=(0, 4, 0), radiance=2.0),),
        viewpoint=Orthographic(origin=(0, 0, 1), target=(0, 0, 0), half_height=0.01),
    )


@pytest.mark.parametrize("index", [1.0, 1.5, 2.4])
def test_a_glass_slab_transmits_what_fresnels_equations_say_with_all_inner_reflections(index):
    cube = render(slab(Dielectric(index=index)), BANDS, (4, 4), RenderSettings(samples_per_pixel=2**14, max_depth=100))
    r = ((index - 1) / (index + 1)) ** 2
    error = np.sqrt((cube.stderr.values**2).mean((0, 1))) / 4
    assert np.all(np.abs(cube.radiance.values.mean((0, 1)) - 2 * (1 - r) / (1 + r)) < 4 * error + 1e-5)


def test_dispersive_glass_transmits_each_band_by_its_own_index():
    glass = Dielectric(index=1.8, abbe=10)
    narrow = Bands(np.array([455.0, 550, 660]), np.array([456.0, 551, 661]), np.array([455.5, 550.5, 660.5]))
    cube = render(slab(glass), narrow, (4, 4), RenderSettings(samples_per_pixel=2**14, max_depth=100))
    assert cube.attrs["integrator"] == "shared path, parted at glass"
    n = glass.index_at(narrow.center)
    r = ((n - 1) / (n + 1)) ** 2
    error = np.sqrt((cube.stderr.values**2).mean((0, 1))) / 4
    assert np.ptp(n) > 0.1
    assert np.all(np.abs(cube.radiance.values.mean((0, 1)) - 2 * (1 - r) / (1 + r)) < 4 * error + 1e-4)


def test_a_band_of_dispersive_glass_equals_glass_of_that_bands_index():
    glass, narrow = Dielectric(index=1.7, abbe=15), Bands(np.array([460.0]), np.array([460.5]), np.array([460.25]))
    same = Dielectric(index=float(glass.index_at(460.25)))
    settings = RenderSettings(samples_per_pixel=1024, max_depth=12)
    a = render(still_life(ball=glass), narrow, (16, 20), settings)
    b = render(still_life(ball=same), narrow, (16, 20), settings.model_copy(update={"seed": 1}))
    assert_agree(a, b)


def test_the_film_refuses_dispersive_glass_and_says_how_to_switch_it_off():
    with pytest.raises(InputError, match="abbe to None"):
        render_with_film(slab(Dielectric(index=1.5, abbe=40)), BANDS, (2, 2), RenderSettings(samples_per_pixel=4))


def test_a_polished_metal_mirrors_the_sky_by_its_complex_index():
    mirror = Rectangle(name="m", material="m", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
    view = Orthographic(origin=(0, 0, 1), target=(0, 0, 0), half_height=0.01)
    gold = Conductor(eta=GOLD_N, k=GOLD_K)
    scene = Scene(name="s", shapes=(mirror,), materials={"m": gold}, lights=(ConstantSky(radiance=1.0),), viewpoint=view)
    narrow = Bands(np.array([455.0, 550, 660]), np.array([455.1, 550.1, 660.1]), np.array([455.05, 550.05, 660.05]))
    n, k = GOLD_N.at(narrow.center), GOLD_K.at(narrow.center)
    cube = render(scene, narrow, (2, 2), RenderSettings(samples_per_pixel=16))
    expected = ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    np.testing.assert_allclose(cube.radiance.values, np.broadcast_to(expected, (2, 2, 3)), rtol=2e-3)


def test_clear_glass_vanishes_in_a_furnace():
    scene = still_life(ball=Dielectric(index=1.5), block=Dielectric(index=1.9), floor=Diffuse(reflectance=1.0))
    scene = scene.model_copy(update={"lights": (ConstantSky(radiance=1.0),)})
    cube = render(scene, BANDS, (8, 8), RenderSettings(samples_per_pixel=4096, max_depth=500))
    error = np.sqrt((cube.stderr.values**2).mean((0, 1))) / 8
    assert np.all(np.abs(cube.radiance.values.mean((0, 1)) - 1) < 4 * error + 1e-4)


def test_a_point_lamp_seen_through_nothing_agrees_in_both_routes():
    scene = still_life()
    scene = scene.model_copy(update={"lights": (PointLight(position=(1, -1, 2), intensity=illuminant("A")),)})
    ours = render(scene, BANDS, (16, 16), RenderSettings(samples_per_pixel=512))
    assert_agree(ours, render_with_film(scene, BANDS, (16, 16), RenderSettings(samples_per_pixel=4096)))


def test_the_film_at_nodes_gives_what_the_film_gives_at_bands_for_many_bands():
    scene, fine = still_life(), Bands.from_edges(np.linspace(455, 665, 85))
    ours = render(scene, fine, (12, 16), RenderSettings(samples_per_pixel=1024))
    substitute = picture(
        partial(FilmTransport, through_nodes=True), scene, fine, (12, 16), RenderSettings(samples_per_pixel=4096), None, None
    )
    assert substitute.attrs["transport_nodes"] < 60
    assert_agree(ours, substitute)


@pytest.mark.parametrize("nodes", [[450.0, 460, 470, 480], [400.0, 401, 450, 700], [200.0, 2500]])
def test_cell_means_of_a_curve_that_is_linear_between_nodes_give_back_its_values(nodes):
    curve = Spectrum(np.array(nodes), np.random.Generator(np.random.Philox(1)).random(len(nodes)))
    cells, to_nodes = node_cells(curve.wavelength_nm)
    np.testing.assert_allclose(to_nodes @ curve.band_mean(cells.lower, cells.upper), curve.value, rtol=1e-12)

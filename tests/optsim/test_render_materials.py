"""Every material in a furnace, colours against colour-science's own integrals, and the shipped scenes at any scale."""

import numpy as np
import pytest

import scenes
from optsim.cube import Bands
from optsim.render import RenderSettings, render
from optsim.render.furnace import FURNACE, loss_of_energy
from scenes.library import illuminant
from scenes.scene import (
    MATERIALS,
    AreaLight,
    Box,
    Conductor,
    ConstantSky,
    Dielectric,
    Diffuse,
    DirectionalLight,
    Mesh,
    Orthographic,
    PointLight,
    Rectangle,
    RoughPlastic,
    Scene,
    Sphere,
    Textured,
)
from scenes.spectrum import Spectrum

BANDS = Bands.from_edges([500.0, 550.0, 600.0])
WHITE = Spectrum.constant(1.0)
LOSSLESS = {
    Diffuse: Diffuse(reflectance=1.0),
    Textured: Textured(basis=(WHITE, WHITE), weights=np.full((2, 2, 2), 0.5, np.float32)),
    Dielectric: Dielectric(index=1.5, abbe=40),
    RoughPlastic: RoughPlastic(reflectance=1.0, roughness=0.3),
    Conductor: Conductor(eta=0.0, k=3.0),
}


def furnace(material):
    ball = Sphere(name="ball", material="m", center=(0, 0, 0), radius=1)
    sheet = Rectangle(name="sheet", material="m", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0))
    view = Orthographic(origin=(0, 0, 3), target=(0, 0, 0), half_height=0.9)
    shape = sheet if isinstance(material, Textured) else ball
    return Scene(name="furnace", shapes=[shape], materials={"m": material}, lights=[ConstantSky(radiance=1.0)], viewpoint=view)


def test_every_material_offered_is_tried_in_the_furnace():
    assert set(LOSSLESS) == set(MATERIALS)


@pytest.mark.filterwarnings("ignore:material")
@pytest.mark.parametrize("kind", MATERIALS, ids=lambda kind: kind.__name__)
def test_a_material_that_absorbs_nothing_vanishes_in_the_furnace_but_for_what_is_warned_of(kind):
    cube = render(furnace(LOSSLESS[kind]), BANDS, (12, 12), RenderSettings(samples_per_pixel=1024))
    mean = cube["radiance"].values.mean((0, 1))
    noise = np.sqrt((cube["stderr"].values.astype(float) ** 2).sum((0, 1))) / 144
    lost = loss_of_energy(LOSSLESS[kind])
    assert np.all(mean <= 1 + 5 * noise + 1e-5), "no material makes energy"
    assert np.all(mean >= 1 - lost - 5 * noise - 1e-5)
    assert lost == 0 or np.any(mean < 1 - 0.2 * lost), "the loss that is told is there"


def test_a_plastic_of_which_mitsuba_loses_light_is_warned_of_with_the_share():
    with pytest.warns(RuntimeWarning, match=r"material 'm' .* loses up to"):
        render(furnace(LOSSLESS[RoughPlastic]), BANDS, (4, 4), RenderSettings(samples_per_pixel=4))
    assert all(loss_of_energy(LOSSLESS[kind]) == 0 for kind in MATERIALS if kind is not RoughPlastic)
    assert np.all((FURNACE.loss >= 0) & (FURNACE.loss < 1))


def test_every_patch_under_D65_has_the_colour_that_colour_science_integrates():
    """380:730:35 bands, colour matching functions weighted by band, unclipped Lab; CIEDE2000 below 0.3 for all 24 patches."""
    colour = pytest.importorskip("colour")
    from optsim.report.color import band_weights

    chart = scenes.scene_by_name("color-checker")
    built = chart.build()
    d65 = illuminant("D65")
    lamps = tuple(light.model_copy(update={"radiance": d65}) for light in built.lights)
    bands = Bands.parse("380:730:35")
    cube = render(built.model_copy(update={"lights": lamps}), bands, (96, 96), RenderSettings(error=1e-3))
    cmf = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    nm = np.arange(380.0, 730.01, 0.25)
    curve = np.stack([np.interp(nm, cmf.wavelengths, cmf.values[:, i]) for i in range(3)], 1)
    white = np.trapezoid(d65.at(nm)[:, None] * curve, nm, axis=0)
    patches = [s for s in built.shapes if isinstance(s, Rectangle) and not s.name.startswith(("frame", "board"))]
    assert len(patches) == 24
    (right, up, forward), half, target = built.viewpoint.axes(), built.viewpoint.half_height, np.asarray(built.viewpoint.target)
    light = d65.band_mean(bands.lower, bands.upper) @ band_weights(bands)
    worst = 0.0
    for shape in patches:
        across, down = (int(48 * (1 + sign * (np.subtract(shape.center, target) @ axis) / half)) for sign, axis in ((1, right), (-1, up)))
        point = target + half * (((across + 0.5) / 48 - 1) * right - ((down + 0.5) / 48 - 1) * up)
        point = point + ((np.asarray(shape.center) - point) @ forward) * forward
        lit = sum(lamp.irradiance_per_radiance(point, -forward) for lamp in lamps) / np.pi
        rho = built.materials[shape.material].reflectance
        expected = np.trapezoid((d65.at(nm) * rho.at(nm))[:, None] * curve, nm, axis=0) / white[1]
        found = cube["radiance"].values[down, across].astype(float) @ band_weights(bands) / (lit * light[1])
        one, other = (colour.XYZ_to_Lab(v, colour.XYZ_to_xy(w)) for v, w in ((found, light), (expected, white)))
        worst = max(worst, float(colour.delta_E(one, other, method="CIE 2000")))
    assert worst < 0.3


def scaled(scene, factor):
    """Return a scene with every length multiplied by a factor."""

    def times(model, *names):
        return {n: tuple(factor * x for x in getattr(model, n)) for n in names}

    def shape(s):
        if isinstance(s, Mesh):
            return Mesh(name=s.name, material=s.material, vertices=s.vertices * factor, faces=s.faces)
        if isinstance(s, Sphere):
            return s.model_copy(update=times(s, "center") | {"radius": s.radius * factor})
        return s.model_copy(update=times(s, "center", "half_u", "half_v", *(["half_w"] if isinstance(s, Box) else [])))

    def light(one):
        if isinstance(one, AreaLight):
            return one.model_copy(update=times(one, "center", "half_u", "half_v"))
        if isinstance(one, PointLight):
            return one.model_copy(update=times(one, "position") | {"intensity": one.intensity.scaled(factor**2)})
        assert isinstance(one, ConstantSky | DirectionalLight)
        return one

    view = scene.viewpoint
    change = times(view, "origin", "target")
    if isinstance(view, Orthographic):
        change["half_height"] = view.half_height * factor
    parts = {"shapes": tuple(map(shape, scene.shapes)), "lights": tuple(map(light, scene.lights))}
    return scene.model_copy(update=parts | {"viewpoint": view.model_copy(update=change)})


@pytest.mark.slow
@pytest.mark.parametrize("recipe", scenes.SCENES, ids=lambda r: r.name)
def test_R20_every_shipped_scene_is_the_same_from_a_micrometre_to_a_thousand_kilometres(recipe):
    scene = recipe.build()
    cubes = [render(scaled(scene, f), BANDS, (12, 12), RenderSettings(samples_per_pixel=64)) for f in (1e-6, 1.0, 1e6)]
    level = cubes[1]["radiance"].values.mean()
    for cube in (cubes[0], cubes[2]):
        away = cube["radiance"].values.astype(float) - cubes[1]["radiance"].values
        noise = np.hypot(cube["stderr"].values.astype(float), cubes[1]["stderr"].values)
        assert np.abs(away.mean()) <= 4 * np.sqrt((noise**2).sum()) / noise.size + 1e-5 * level

"""Paths that part at dispersing glass give what a path for every wavelength gives, and tell where they parted."""

import numpy as np
import pytest

from optsim.cube import Bands
from optsim.render import RenderSettings, render, render_to, render_with_film
from optsim.render.passes import run
from optsim.render.shared_path import Parting
from optsim.render.transport import Transport
from scenes.glass import Glass
from scenes.library import illuminant, reflectance, reflectances
from scenes.scene import AreaLight, Conductor, ConstantSky, Dielectric, Diffuse, Orthographic, Perspective, Rectangle, Scene, Sphere

PATCH = tuple(reflectances())
BANDS = Bands.from_edges([455, 470, 500, 540, 580, 600, 630, 665])
STRONG = Dielectric(index=1.7, abbe=12)
MIRROR = Conductor(eta=0.2, k=3.0)


def room(**materials) -> Scene:
    """A ball of dispersing glass and another ball on a coloured floor, before a tilted wall, a lamp and a sky."""
    own = {"floor": Diffuse(reflectance=reflectance(PATCH[14])), "wall": Diffuse(reflectance=0.6), "ball": STRONG, "other": STRONG}
    return Scene(
        name="room",
        shapes=(
            Rectangle(name="floor", material="floor", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0)),
            Rectangle(name="wall", material="wall", center=(0, 0.7, 0.5), half_u=(1, 0, 0), half_v=(0, 0.2, 0.5)),
            Sphere(name="ball", material="ball", center=(-0.3, 0, 0.3), radius=0.28),
            Sphere(name="other", material="other", center=(0.3, -0.1, 0.25), radius=0.22),
        ),
        materials=own | materials,
        lights=(
            AreaLight(center=(1, -1, 2), half_u=(0.5, 0.5, 0), half_v=(0.4, -0.4, 0.4), radiance=illuminant("xenon").scaled(5)),
            ConstantSky(radiance=illuminant("D65").scaled(1e-2)),
        ),
        viewpoint=Perspective(origin=(0, -2.2, 1.4), target=(0, 0, 0.2), up=(0, 0, 1), fov_deg=28),
    )


def values(scene, samples, parting=None, seed=0, size=(14, 18)):
    """Return band radiance (K, pixels), variances of the bands' picture means, and their mean square errors a pixel."""
    task = Transport(scene, BANDS, size, RenderSettings(samples_per_pixel=samples, seed=seed, max_depth=12), parting)
    state = run(task, None, None, "")
    noise = state.noise(task.weights)
    return sum(w @ g.mean for w, g in zip(task.weights, state.groups)), noise.squares.sum(0) / noise.pixels


def assert_same(a, b, limit=4.5):
    """Compare picture means in units of their standard error, and pixels by the mean square of theirs."""
    difference, square = a[0] - b[0], a[1] + b[1]
    z = difference.mean(1) / np.sqrt(square / difference.shape[1])
    assert np.all(np.abs(z) < limit), z
    share = np.mean(difference**2, axis=1) / square
    assert np.all(share < 1.6), share


CASES = {
    "two balls of glass": {},
    "beside glass of one index": {"other": Dielectric(index=1.5)},
    "beside a mirror": {"other": MIRROR},
    "on a mirror": {"floor": MIRROR},
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=pytest.mark.slow if "mirror" in name else ()) for name in CASES])
def test_parted_paths_agree_with_a_path_for_every_node(name):
    scene = room(**CASES[name])
    assert_same(values(scene, 256), values(scene, 256, Parting(apart=True), seed=1))


@pytest.mark.slow
@pytest.mark.parametrize("parting", [Parting(seen=1, met=1), Parting(seen=1000, met=5), Parting(seen=7, met=1000)], ids=str)
def test_however_many_nodes_go_on_behind_the_glass_the_mean_is_the_same(parting):
    assert_same(values(room(), 1024, parting), values(room(), 256, Parting(apart=True), seed=1))


@pytest.mark.slow
def test_narrow_bands_agree_with_mitsubas_path_and_film_at_the_index_of_each():
    """Two codes: a path that parts at the glass, and Mitsuba's own with one index, band by band."""
    centre = np.array([460.0, 540, 660])
    ours = render(room(), Bands(centre - 1, centre + 1, centre), (14, 18), RenderSettings(samples_per_pixel=2048, max_depth=12))
    for k, nm in enumerate(centre):
        one = Dielectric(index=float(STRONG.index_at(nm)))
        band = Bands(centre[k : k + 1] - 1, centre[k : k + 1] + 1, centre[k : k + 1])
        film = render_with_film(room(ball=one, other=one), band, (14, 18), RenderSettings(samples_per_pixel=4096, max_depth=12, seed=1))
        a, b = (cube.isel(wavelength=i) for cube, i in ((ours, k), (film, 0)))
        assert_same(*((c.radiance.values.reshape(1, -1), (c.stderr.values.reshape(1, -1).astype(float) ** 2).mean(1)) for c in (a, b)))


def test_a_camera_inside_dispersing_glass_sees_what_a_path_for_every_node_sees():
    """Total reflection from inside, where some wavelengths still pass and others do not."""
    inside = Sphere(name="bubble", material="ball", center=(0, 0, 0), radius=1)
    view = Perspective(origin=(0.5, 0, 0.3), target=(0.6, 0.1, 1), up=(0, 1, 0), fov_deg=100)
    scene = room().model_copy(update={"shapes": (inside,), "viewpoint": view, "lights": (ConstantSky(radiance=1.0),)})
    assert_same(values(scene, 256), values(scene, 256, Parting(apart=True), seed=1))


def test_dispersing_glass_vanishes_in_a_furnace():
    scene = room(floor=Diffuse(reflectance=1.0), wall=Diffuse(reflectance=1.0))
    scene = scene.model_copy(update={"lights": (ConstantSky(radiance=1.0),)})
    found, square = values(scene, 1024)
    lost = 0.004  # of twelve reflections between white walls and glass, none goes on
    assert np.all(found.mean(1) <= 1 + 4 * np.sqrt(square / found.shape[1]) + 1e-4)
    assert np.all(found.mean(1) >= 1 - lost - 4 * np.sqrt(square / found.shape[1]))


def test_glass_of_one_index_tells_its_caustics_but_no_dispersed_pixels():
    cube = render(room(ball=Dielectric(index=1.7), other=Dielectric(index=1.5)), BANDS, (8, 8), RenderSettings(samples_per_pixel=64))
    assert "dispersed_share" not in cube.attrs
    assert 0 < cube.attrs["caustic_share"] < 1


def test_pixels_that_show_dispersing_glass_are_told_apart_with_their_error():
    cube = render(room(other=Diffuse(reflectance=0.5)), BANDS, (24, 24), RenderSettings(samples_per_pixel=64))
    tell = cube.attrs
    assert 0.02 < tell["dispersed_share"] < 0.6
    share = tell["dispersed_share"]
    both = share * tell["error_dispersed"] ** 2 + (1 - share) * tell["error_elsewhere"] ** 2
    np.testing.assert_allclose(both, tell["error"] ** 2, rtol=1e-9)
    assert 0 < tell["caustic_share"] < 1


def test_a_picture_full_of_dispersing_glass_and_one_without_any_in_view_say_so():
    face = Rectangle(name="near", material="ball", center=(0, 0, 0.05), half_u=(1, 0, 0), half_v=(0, 1, 0))
    back = Rectangle(name="far", material="ball", center=(0, 0, -0.05), half_u=(-1, 0, 0), half_v=(0, 1, 0))
    full = room().model_copy(
        update={
            "shapes": (face, back),
            "viewpoint": Orthographic(origin=(0, 0, 1), target=(0, 0, 0), half_height=0.01),
            "lights": (ConstantSky(radiance=1.0),),
        }
    )
    cube = render(full, BANDS, (4, 4), RenderSettings(samples_per_pixel=16))
    assert cube.attrs["dispersed_share"] == 1.0
    assert cube.attrs["error_elsewhere"] == 0.0
    away = Perspective(origin=(0, -2.2, 1.4), target=(0, -4, -2), up=(0, 0, 1), fov_deg=20)
    cube = render(room().model_copy(update={"viewpoint": away}), BANDS, (4, 4), RenderSettings(samples_per_pixel=16))
    assert cube.attrs["dispersed_share"] == 0.0
    assert cube.attrs["error_dispersed"] == 0.0


class Memory:
    """A sink that keeps the cube."""

    def begin(self, shape, bands, dtype, stderr, digest):
        self.radiance = np.zeros(shape, dtype)
        return 0, np.zeros(0)

    def rows(self, top, radiance, stderr, notes):
        self.radiance[top : top + len(radiance)] = radiance
        self.notes = notes

    def finish(self, attrs):
        self.attrs = attrs


def test_a_streamed_dispersed_render_has_the_bytes_and_the_words_of_one_in_memory():
    settings, size = RenderSettings(samples_per_pixel=8), (64, 32)
    scene = Glass(abbe=30).build()
    whole = render(scene, BANDS, size, settings)
    sink = Memory()
    render_to(sink, scene, BANDS, size, settings, memory=2**20)
    assert np.array_equal(sink.radiance, whole.radiance.values)
    for name in ("dispersed_share", "error_dispersed", "error_elsewhere", "caustic_share"):
        np.testing.assert_allclose(sink.attrs[name], whole.attrs[name], rtol=1e-6)


def test_a_resumed_dispersed_render_has_the_bytes_of_one_in_one_go(tmp_path):
    scene, settings = room(), RenderSettings(samples_per_pixel=64, max_depth=6)
    whole = render(scene, BANDS, (6, 8), settings)
    file = tmp_path / "state"

    def stop(done, error):
        if done >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(scene, BANDS, (6, 8), settings, progress=stop, checkpoint=file)
    again = render(scene, BANDS, (6, 8), settings, checkpoint=file)
    assert np.array_equal(again.radiance.values, whole.radiance.values)
    assert {k: again.attrs[k] for k in ("dispersed_share", "error_dispersed", "caustic_share")} == {
        k: whole.attrs[k] for k in ("dispersed_share", "error_dispersed", "caustic_share")
    }

"""The error that a render states: per band, with an interval that covers the truth; tiles that get what their noise deserves."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import f as f_distribution

from optsim.cube import Bands
from optsim.render import RenderSettings, render
from optsim.render import passes as passes_module
from optsim.render.estimate import TAILS, ErrorBars, TileNoise, tile_noise
from optsim.render.replicates import Replicates
from optsim.render.tiles import Tiles
from scenes.catalogue import scene_by_name
from scenes.color_checker import ColorChecker
from scenes.library import illuminant
from scenes.scene import AreaLight, Box, ConstantSky, Diffuse, Perspective, Rectangle, Scene, Sphere
from scenes.spectrum import Spectrum

BANDS = Bands.paper()
FLAT = ColorChecker().build()
CHART = FLAT.model_copy(update={"shapes": (*FLAT.shapes, Sphere(name="speck", material="board", center=(0, 0, -0.01), radius=1e-4))})
RED = Diffuse(reflectance=Spectrum(np.array([400.0, 580, 620, 700]), np.array([0.1, 0.1, 0.8, 0.8])))
BLOCK = Scene(
    name="block",
    shapes=(
        Rectangle(name="floor", material="red", center=(0, 0, 0), half_u=(1, 0, 0), half_v=(0, 1, 0)),
        Box(name="block", material="red", center=(0.1, 0, 0.1), half_u=(0.1, 0, 0), half_v=(0, 0.1, 0), half_w=(0, 0, 0.1)),
    ),
    materials={"red": RED},
    lights=(
        AreaLight(center=(-2, 0, 2), half_u=(0, 0.2, 0), half_v=(-0.15, 0, -0.15), radiance=illuminant("xenon")),
        ConstantSky(radiance=illuminant("D65")),
    ),
    viewpoint=Perspective(origin=(-1, -1, 1.5), target=(0, 0, 0), up=(0, 0, 1), fov_deg=30),
)
CASES = {
    "chart": (CHART, 2**14),
    "block": (BLOCK, 2**14),
    "relief": (scene_by_name("relief").build(), 2**13),
    "cornell": (scene_by_name("cornell").build(), 2**12),
}


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{"samples_per_pixel": 32}, {"error": 0.06}], ids=["samples", "error"])
def test_the_95_percent_interval_covers_the_error_made_in_90_percent_of_renders(settings):
    covered, bands = [], []
    for scene, samples in CASES.values():
        truth = render(scene, BANDS, (16, 16), RenderSettings(samples_per_pixel=samples, seed=999)).radiance.values.astype(np.float64)
        for seed in range(20):
            cube = render(scene, BANDS, (16, 16), RenderSettings(seed=seed, **settings))
            made = np.sqrt(np.mean((cube.radiance.values - truth) ** 2, axis=(0, 1))) / truth.mean((0, 1))
            told = {name: np.array(row) for name, row in json.loads(cube.attrs["error_by_band"]).items()}
            worst = int(np.argmax(told["error"]))
            assert told["error"][worst] == pytest.approx(cube.attrs["error"], rel=1e-3)
            covered.append(cube.attrs["error_low"] <= made[worst] <= cube.attrs["error_high"])
            bands.append(np.mean((told["low"] <= made) & (made <= told["high"])))
    assert np.mean(covered) >= 0.9
    assert np.mean(bands) >= 0.9


def test_the_interval_is_that_of_a_ratio_of_two_mean_squares():
    stream = np.random.Generator(np.random.Philox(7))
    pixels, passes, inside = 50, 4, []
    spread = 1 + stream.random(pixels)
    for _ in range(400):
        samples = 1 + stream.normal(size=(passes, pixels)) * spread
        square = samples.var(0, ddof=1) / passes
        bars = ErrorBars(1)
        noise = TileNoise(np.array([[square.sum()]]), np.array([[float(pixels)]]), np.array([pixels]))
        bars.add(noise, np.sqrt(square)[:, None], np.full(pixels, passes))
        error, low, high = bars.bounds()[:, 0]
        assert error == pytest.approx(np.sqrt(square.mean()), rel=1e-12)
        inside.append(low <= np.sqrt(np.mean((samples.mean(0) - 1) ** 2)) <= high)
    assert np.mean(inside) > 0.95  # of normal noise; that of paths has heavier tails
    even = f_distribution(TAILS * pixels, TAILS * pixels * (passes - 1))
    assert high / error == pytest.approx(np.sqrt(even.ppf(0.975)), rel=0.1)


def test_the_noise_of_tiles_is_that_of_band_radiances_pass_by_pass():
    stream = np.random.Generator(np.random.Philox(3))
    film, weights = (40, 50), stream.random((3, 5))
    tiles = Tiles(film)
    assert (tiles.count, tiles.sizes.sum()) == (4, 2000)
    group, kept = Replicates((5, 2000), weights, tiles), []
    for i in range(6):
        sample = stream.random((5, 2000))
        active = tiles.of_pixel != 3 if i > 3 else np.ones(2000, bool)
        kept.append(np.where(active, weights @ sample, np.nan))
        group.add(sample, None if i <= 3 else active)
    noise = tile_noise([group], [weights], tiles)
    count = np.where(tiles.of_pixel == 3, 4, 6)
    variance = np.nanvar(kept, axis=0, ddof=1) / count
    for tile in range(4):
        here = tiles.of_pixel == tile
        np.testing.assert_allclose(noise.squares[tile], variance[:, here].sum(1), rtol=1e-10)
        np.testing.assert_allclose(noise.levels[tile], np.nanmean(kept, axis=0)[:, here].sum(1), rtol=1e-12)


def test_tiles_share_the_paths_as_neyman_says():
    target, film = 0.01, (64, 96)
    spread = np.array([0.0, 1.0, 1.0, 2.0, 4.0, 8.0])
    tiles = Tiles(film)
    spent = np.full(6, 16)
    pilot = TileNoise((spread**2 / 16 * tiles.sizes)[:, None], tiles.sizes[:, None] * 5.0, tiles.sizes)
    task = SimpleNamespace(settings=RenderSettings(error=target, max_samples=2**24), pixels=film[0] * film[1])
    plan = passes_module.allot(task, pilot, spent)
    paths = plan.samples * passes_module.PASSES_PLANNED
    relative = np.sqrt(np.mean(spread**2 / paths)) / 5
    assert relative == pytest.approx(target, rel=0.06)
    alike = np.mean(spread**2) / (5 * target) ** 2
    best = np.mean(spread) ** 2 / (5 * target) ** 2
    assert best <= paths.mean() < 1.05 * best + 40 < 0.65 * alike
    assert plan.budget.mean() == pytest.approx((target * 5) ** 2, rel=1e-9)


def test_an_error_is_reached_with_more_paths_where_there_is_more_noise():
    lit = scene_by_name("dim-bright").build()
    speck = Sphere(name="speck", material=next(iter(lit.materials)), center=(0, 0, -0.01), radius=1e-4)
    scene = lit.model_copy(update={"shapes": (*lit.shapes, speck)})
    cube = render(scene, BANDS, (96, 96), RenderSettings(error=0.2, seed=2))
    assert cube.attrs["error"] <= 0.2
    assert cube.attrs["samples_per_pixel_most"] > 3 * cube.attrs["samples_per_pixel"]


def test_an_interrupted_render_of_many_tiles_resumes_to_the_same_bytes(tmp_path):
    settings, size, file = RenderSettings(error=0.01, seed=4), (40, 70), tmp_path / "render.npz"
    whole = render(BLOCK, BANDS, size, settings)
    assert whole.attrs["samples_per_pixel_most"] > whole.attrs["samples_per_pixel"]
    calls = []

    def interrupt(done, error):
        calls.append(done)
        if len(calls) == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(BLOCK, BANDS, size, settings, progress=interrupt, checkpoint=file)
    resumed = render(BLOCK, BANDS, size, settings, checkpoint=file)
    assert resumed.radiance.values.tobytes() == whole.radiance.values.tobytes()
    assert resumed.stderr.values.tobytes() == whole.stderr.values.tobytes()
    assert resumed.attrs == whole.attrs

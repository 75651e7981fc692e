"""Passes: seeds, the error asked for, honest standard errors, checkpoint and resume."""

import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

from optsim.cube import Bands
from optsim.render import RenderSettings, render
from optsim.render import passes as passes_module
from optsim.render.replicates import Replicates, load, save
from optsim.render.transport import Transport
from scenes.color_checker import ColorChecker
from scenes.library import illuminant
from scenes.scene import AreaLight, Box, ConstantSky, Diffuse, Perspective, Rectangle, Scene, Sphere
from scenes.spectrum import Spectrum

BANDS = Bands.paper()
FLAT = ColorChecker().build()
SPECK = Sphere(name="speck", material="board", center=(0, 0, -0.01), radius=1e-4)
CHART = FLAT.model_copy(update={"shapes": (*FLAT.shapes, SPECK)})
"""A speck behind the board is never seen, but a scene that is not flat needs samples."""
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
"""Two illuminants, shadows, light from block to floor."""


def test_R11_the_same_seed_gives_the_same_bytes_and_another_seed_other_noise():
    for seed in (0, 2**32 - 1):
        a, b = (render(CHART, BANDS, (16, 16), RenderSettings(samples_per_pixel=16, seed=seed)) for _ in range(2))
        assert a.radiance.values.tobytes() == b.radiance.values.tobytes()
        assert a.stderr.values.tobytes() == b.stderr.values.tobytes()
        assert a.attrs == b.attrs
    other = render(CHART, BANDS, (16, 16), RenderSettings(samples_per_pixel=16, seed=1))
    noise = ((other.radiance - a.radiance) / np.hypot(other.stderr, a.stderr)).values[:, :, 0]
    assert np.count_nonzero(noise) > 0.9 * noise.size


def test_noise_of_different_seeds_and_of_neighbouring_pixels_is_independent():
    settings = [RenderSettings(samples_per_pixel=16, seed=seed) for seed in range(3)]
    truth = render(CHART, BANDS, (32, 32), RenderSettings(samples_per_pixel=4096, seed=99)).radiance.values[:, :, 0]
    noise = [(render(CHART, BANDS, (32, 32), s).radiance.values[:, :, 0] / truth - 1) for s in settings]
    limit = 4 / 32
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < limit
    assert abs(np.corrcoef(noise[0].ravel(), noise[2].ravel())[0, 1]) < limit
    assert abs(np.corrcoef(noise[0][:, 1:].ravel(), noise[0][:, :-1].ravel())[0, 1]) < limit
    assert abs(np.corrcoef(noise[0][1:].ravel(), noise[0][:-1].ravel())[0, 1]) < limit


@pytest.mark.parametrize("scene", [CHART, BLOCK], ids=["chart", "block"])
@pytest.mark.parametrize("samples", [32, 128])
def test_the_standard_error_is_the_scatter_of_renders_with_other_seeds(scene, samples):
    cubes = [render(scene, BANDS, (12, 12), RenderSettings(samples_per_pixel=samples, seed=seed)) for seed in range(16)]
    scatter = np.var([c.radiance.values for c in cubes], axis=0, ddof=1).mean((0, 1))
    claimed = np.mean([c.stderr.values.astype(np.float64) ** 2 for c in cubes], axis=0).mean((0, 1))
    ratio = scatter / claimed
    assert np.all(ratio < 1.5)  # an upper bound, to the noise of a variance over 16 seeds
    assert np.all(ratio > 0.5)


@pytest.mark.parametrize(
    ("scene", "error"), [(CHART, 0.01), (CHART, 0.002), (BLOCK, 0.02)], ids=["chart-0.01", "chart-0.002", "block-0.02"]
)
def test_a_render_reaches_the_error_asked_for_in_every_band(scene, error):
    cube = render(scene, BANDS, (24, 24), RenderSettings(error=error, seed=3))
    truth = render(scene, BANDS, (24, 24), RenderSettings(error=error / 5, seed=4)).radiance.values
    real = np.sqrt(((cube.radiance.values - truth) ** 2).mean((0, 1))) / truth.mean((0, 1))
    assert cube.attrs["error"] <= error
    assert cube.attrs["passes"] >= 4
    assert np.all(real < 1.5 * error)


def test_an_error_out_of_reach_ends_at_the_cap_with_a_warning():
    with pytest.warns(RuntimeWarning, match="stopped at 64 samples"):
        cube = render(BLOCK, BANDS, (8, 8), RenderSettings(error=1e-5, max_samples=64))
    assert cube.attrs["error"] > 1e-5
    assert cube.attrs["samples_per_pixel"] == 64


def test_one_sample_a_pixel_is_valid_and_has_no_standard_error():
    cube = render(CHART, BANDS, (8, 8), RenderSettings(samples_per_pixel=1))
    assert "stderr" not in cube
    assert (cube.attrs["passes"], cube.attrs["samples_per_pixel"]) == (1, 1)


def test_progress_rises_to_one_and_tells_the_error():
    seen = []
    render(CHART, BANDS, (8, 8), RenderSettings(samples_per_pixel=64), progress=lambda done, error: seen.append((done, error)))
    assert [round(done * 8) for done, _ in seen] == list(range(1, 9))
    assert seen[0][1] is None
    assert all(error > 0 for _, error in seen[1:])
    seen.clear()
    render(CHART, BANDS, (8, 8), RenderSettings(error=0.01), progress=lambda done, error: seen.append((done, error)))
    assert seen[-1][0] == 1
    assert seen[-1][1] <= 0.01


@pytest.mark.parametrize("settings", [RenderSettings(samples_per_pixel=64), RenderSettings(error=0.03, max_samples=2**20)])
@pytest.mark.parametrize("stop_after", [1, 3, 5])
def test_an_interrupted_render_resumes_to_the_same_bytes(tmp_path, settings, stop_after):
    scene, file = BLOCK, tmp_path / "render.npz"
    whole = render(scene, BANDS, (8, 8), settings)
    calls = []

    def interrupt(done, error):
        calls.append(done)
        if len(calls) == stop_after:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(scene, BANDS, (8, 8), settings, progress=interrupt, checkpoint=file)
    assert file.exists()
    traced = []
    original = Transport.trace

    def counted(self, group, samples, key):
        traced.append(key)
        return original(self, group, samples, key)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Transport, "trace", counted)
        resumed = render(scene, BANDS, (8, 8), settings, checkpoint=file)
        rest = len(traced)
        again = render(scene, BANDS, (8, 8), settings, checkpoint=file)
        assert len(traced) == rest  # nothing is left to do
    for cube in (resumed, again):
        assert cube.radiance.values.tobytes() == whole.radiance.values.tobytes()
        assert cube.stderr.values.tobytes() == whole.stderr.values.tobytes()
        assert cube.attrs == whole.attrs
    assert not list(tmp_path.glob("*.tmp"))


def test_an_interruption_between_two_light_groups_keeps_whole_passes_only(tmp_path):
    scene = BLOCK
    settings, file = RenderSettings(samples_per_pixel=64), tmp_path / "render.npz"
    whole = render(scene, BANDS, (6, 6), settings)
    original = Transport.trace

    def interrupted(self, group, samples, key):
        if group == 1 and key[-1] == 2:
            raise KeyboardInterrupt
        return original(self, group, samples, key)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Transport, "trace", interrupted)
        patch.setattr(passes_module, "CHECKPOINT_EVERY_S", 0.0)
        with pytest.raises(KeyboardInterrupt):
            render(scene, BANDS, (6, 6), settings, checkpoint=file)
    resumed = render(scene, BANDS, (6, 6), settings, checkpoint=file)
    assert resumed.radiance.values.tobytes() == whole.radiance.values.tobytes()


@pytest.mark.parametrize("scene", [CHART, BLOCK], ids=["one-light-group", "two-light-groups"])
@pytest.mark.parametrize("often", [False, True], ids=["saved-at-the-end", "saved-each-pass"])
@pytest.mark.parametrize("at", [1, 2, 7, 8])
def test_an_interruption_while_a_pass_is_added_leaves_no_half_pass_in_the_checkpoint(tmp_path, scene, often, at):
    settings, file = RenderSettings(samples_per_pixel=64), tmp_path / "render.npz"
    whole = render(scene, BANDS, (6, 6), settings)
    original, calls = Replicates.add, []

    def interrupted_rows(sample):
        yield sample[0]
        raise KeyboardInterrupt

    def add(self, sample, active=None):
        calls.append(1)
        original(self, interrupted_rows(sample) if len(calls) == at else sample, active)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Replicates, "add", add)
        if often:
            patch.setattr(passes_module, "CHECKPOINT_EVERY_S", 0.0)
        with pytest.raises(KeyboardInterrupt):
            render(scene, BANDS, (6, 6), settings, checkpoint=file)
    resumed = render(scene, BANDS, (6, 6), settings, checkpoint=file)
    assert resumed.radiance.values.tobytes() == whole.radiance.values.tobytes()
    assert resumed.stderr.values.tobytes() == whole.stderr.values.tobytes()
    assert resumed.attrs == whole.attrs


def test_an_interruption_while_a_pass_is_traced_keeps_all_passes_before_it(tmp_path):
    settings, file = RenderSettings(samples_per_pixel=64), tmp_path / "render.npz"
    original, traced = Transport.trace, []

    def trace(self, group, samples, key):
        if key[-1] == 5 and len(traced) == 5:
            raise KeyboardInterrupt
        traced.append(key[-1])
        return original(self, group, samples, key)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Transport, "trace", trace)
        with pytest.raises(KeyboardInterrupt):
            render(CHART, BANDS, (6, 6), settings, checkpoint=file)
        traced.clear()
        render(CHART, BANDS, (6, 6), settings, checkpoint=file)
    assert traced == [5, 6, 7]


def test_an_interruption_between_pilot_and_main_stage_mixes_nothing(tmp_path):
    settings, file = RenderSettings(error=0.002), tmp_path / "render.npz"
    whole = render(CHART, BANDS, (6, 6), settings)
    original, calls = Transport.empty, []

    def empty(self, part):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return original(self, part)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Transport, "empty", empty)
        patch.setattr(passes_module, "CHECKPOINT_EVERY_S", 0.0)
        with pytest.raises(KeyboardInterrupt):
            render(CHART, BANDS, (6, 6), settings, checkpoint=file)
    resumed = render(CHART, BANDS, (6, 6), settings, checkpoint=file)
    assert resumed.radiance.values.tobytes() == whole.radiance.values.tobytes()
    assert resumed.attrs == whole.attrs


def test_a_checkpoint_of_another_configuration_or_a_broken_one_is_not_used(tmp_path):
    file = tmp_path / "render.npz"
    render(CHART, BANDS, (8, 8), RenderSettings(samples_per_pixel=16, seed=5), checkpoint=file)
    plain = render(CHART, BANDS, (8, 8), RenderSettings(samples_per_pixel=16))
    other = render(CHART, BANDS, (8, 8), RenderSettings(samples_per_pixel=16), checkpoint=file)
    assert other.radiance.values.tobytes() == plain.radiance.values.tobytes()
    file.write_bytes(file.read_bytes()[:1000])
    broken = render(CHART, BANDS, (8, 8), RenderSettings(samples_per_pixel=16), checkpoint=file)
    assert broken.radiance.values.tobytes() == plain.radiance.values.tobytes()


def test_a_checkpoint_never_unpickles(tmp_path):
    file = tmp_path / "evil.npz"
    np.savez(file, digest=np.array("d"), mean_0=np.array([{"a": 1}], object))
    assert load(file, "d") is None
    save(file, "d", {"count": 3, "mean": np.arange(4.0)})
    kept = load(file, "d")
    assert int(kept["count"]) == 3
    assert load(file, "other") is None


def test_replicates_agree_with_numpy_to_rounding():
    data = np.random.Generator(np.random.Philox(0)).normal(5, 2, (9, 3, 50))
    sums = Replicates((3, 50))
    for sample in data:
        sums.add(sample.copy())
    np.testing.assert_allclose(sums.mean, data.mean(0), rtol=1e-14)
    np.testing.assert_allclose(sums.squared_error(), data.var(0, ddof=1) / 9, rtol=1e-12)


def test_provenance_tells_what_made_the_cube():
    cube = render(CHART, BANDS, (4, 4), RenderSettings(samples_per_pixel=16, seed=7))
    assert {"config_digest", "seed", "versions", "variant", "samples_per_pixel", "passes", "error", "integrator"} <= set(cube.attrs)
    assert (cube.attrs["seed"], cube.attrs["variant"], cube.attrs["samples_per_pixel"]) == (7, "llvm_ad_spectral", 16)
    assert all(isinstance(value, str | int | float) for value in cube.attrs.values())
    again = render(CHART, BANDS, (4, 4), RenderSettings(samples_per_pixel=16, seed=7))
    assert again.attrs["config_digest"] == cube.attrs["config_digest"]
    for change in (RenderSettings(samples_per_pixel=16, seed=8), RenderSettings(samples_per_pixel=17, seed=7)):
        assert render(CHART, BANDS, (4, 4), change).attrs["config_digest"] != cube.attrs["config_digest"]


def test_plain_renders_warn_about_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        render(CHART, BANDS, (8, 8))


HASH = """
import hashlib
from optsim.cube import Bands
from optsim.render import RenderSettings, render
from scenes.catalogue import scene_by_name
cube = render(scene_by_name("relief").build(), Bands.paper(), (12, 12), RenderSettings(samples_per_pixel=16, seed=3))
print(hashlib.sha256(cube.radiance.values.tobytes() + cube.stderr.values.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_other_processes_and_other_numbers_of_cores_give_the_same_bytes():
    hashes = set()
    for cores in ({0}, None):
        pin = f"import os; os.sched_setaffinity(0, {cores})\n" if cores and hasattr(os, "sched_setaffinity") else ""
        run = subprocess.run([sys.executable, "-c", pin + HASH], capture_output=True, text=True, check=True)
        hashes.add(run.stdout.strip())
    assert len(hashes) == 1
    assert len(hashes.pop()) == 64

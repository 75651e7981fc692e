"""How the readings' data come about: masks that are shared, light that is counted, mosaics that are interpolated."""

import numpy as np
import pytest

from optsim.camera import Bayer, Foveon, Mono
from optsim.camera.budgets import EqualTime, PaperRatio
from optsim.cube import Bands
from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, MONO_REPEATED
from optsim.study.claims.captures import FULL_WELL_E, OFFSET_DN, Demosaiced, Lit, Matched, draw
from optsim.study.claims.curves import GLASS_FOVEON, PHOTONS, PUBLISHED, without_mosaic
from optsim.study.claims.demosaic import bilinear
from optsim.study.claims.readings import lit_captures
from optsim.study.claims.worlds import Cell


class Flat:
    """A world without a render: smooth in wavelength, edges in the picture."""

    def __init__(self, size=32):
        self.scene, self.size, self.bands = "flat", size, Bands.paper()
        y, x, k = np.meshgrid(np.arange(size), np.arange(size), np.arange(24), indexing="ij")
        self.truth = 0.01 * (1.5 + np.sign(np.sin(y / 5) * np.sin(x / 6)) * np.cos(k / 7))


@pytest.fixture(scope="module")
def world():
    return Flat()


def test_bilinear_reproduces_a_plane_inside_and_keeps_what_was_measured():
    y, x = np.mgrid[:12, :14]
    colors = Bayer.nikon().mosaic(12, 14)
    plane = 3.0 + 0.5 * y - 0.25 * x
    full = bilinear(plane[None], colors)
    assert full.shape == (1, 3, 12, 14)
    assert full[0, :, 1:-1, 1:-1] == pytest.approx(np.broadcast_to(plane[1:-1, 1:-1], (3, 10, 12)))
    kept = np.take_along_axis(full[0], colors[None].astype(int), axis=0)[0]
    assert np.array_equal(kept, plane)


def test_bilinear_gives_means_of_colour_neighbours():
    colors = np.array([[0, 1], [1, 2]], np.int8)
    full = bilinear(np.array([[1.0, 2.0], [4.0, 8.0]]), colors)
    assert full[:, 0, 0] == pytest.approx([1.0, 3.0, 8.0])


def test_targets_share_their_masks_and_every_random_scene_has_its_own():
    assert Cell("color-checker", 3, 64).seed(0) == Cell("color-checker-bars", 3, 64).seed(0)
    seeds = [
        Cell(scene, mask, 64).seed(root)
        for root in (0, 1)
        for scene in ("color-checker", "procedural-1", "procedural-2")
        for mask in range(9)
    ]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**63 for seed in seeds)


def test_all_sensors_and_both_readings_of_mono_share_the_first_mask(world):
    first = [draw(PUBLISHED.of(s.sensor), s, 3, world, 5)[0] for s in (MONO_DISTINCT, MONO_REPEATED, BAYER, FOVEON)]
    assert all(np.array_equal(first[0], mask) for mask in first)
    repeated = draw(Mono(), MONO_REPEATED, 3, world, 5)
    assert np.array_equal(repeated[0], repeated[2])
    assert not np.array_equal(*draw(Mono(), MONO_DISTINCT, 2, world, 5))


def test_matched_frames_are_the_paper_s_sum(world):
    taken = Matched().take(world, BAYER, 1, 7)
    masks = draw(PUBLISHED.of("bayer"), BAYER, 1, world, 7)
    response = Bayer.nikon().band_mean(world.bands)
    expected = np.zeros(taken.signal.shape[-2:])
    colors = Bayer.nikon().mosaic(*expected.shape)
    for k in range(24):
        shifted = np.zeros_like(expected)
        shifted[:, k : k + world.size] = masks[0] * world.truth[:, :, k]
        expected += response[colors, k] * shifted
    assert taken.signal[0, 0] == pytest.approx(expected)


def test_demosaiced_frames_have_three_colours_and_their_own_curves(world):
    taken = Demosaiced(Matched()).take(world, BAYER, 2, 7)
    assert taken.signal.shape[:2] == (2, 3)
    assert taken.operator.out_shape == taken.signal.shape
    mosaic = Matched().take(world, BAYER, 2, 7).signal[:, 0]
    colors = Bayer.nikon().mosaic(*mosaic.shape[-2:])
    assert np.array_equal(np.take_along_axis(taken.signal, colors[None, None].astype(int), axis=1)[:, 0], mosaic)
    plain = without_mosaic(Bayer.nikon())
    assert isinstance(plain, Foveon)
    assert plain.response([500.0, 600.0]) == pytest.approx(Bayer.nikon().response([500.0, 600.0]))


def test_the_glass_foveon_has_the_plates_own_curves():
    from optsim.camera.emulate import GlassPlates

    wavelength = np.linspace(455, 660, 50)
    plates = GlassPlates()
    expected = np.stack([plate.at(wavelength) for plate in (plates.red, plates.green, plates.blue)])
    assert GLASS_FOVEON.of("foveon").response(wavelength) == pytest.approx(expected)


def test_light_is_the_charge_of_mono_s_brightest_pixel(world):
    taken = Lit(50_000.0, 1, curves=PHOTONS).take(world, MONO_DISTINCT, 1, 3)
    electrons = taken.signal / (2**16 - 1 - OFFSET_DN) * FULL_WELL_E
    assert electrons.max() == pytest.approx(50_000, rel=0.03)


def test_equal_time_gives_mono_s_three_shots_the_light_of_one(world):
    whole = lit_captures(PaperRatio(), 50_000.0, MONO_DISTINCT)["mono"].take(world, MONO_DISTINCT, 1, 3).signal
    shared = lit_captures(EqualTime(), 50_000.0, MONO_DISTINCT)["mono"].take(world, MONO_DISTINCT, 1, 3).signal
    assert whole.shape == shared.shape
    assert shared.sum() == pytest.approx(whole.sum() / 3, rel=2e-3)


def test_the_stated_variance_is_that_of_the_frames(world):
    capture = Lit(500.0, 1, curves=PHOTONS)
    again = [_again(capture, world, seed) for seed in range(100)]
    seen = np.stack([signal for signal, _ in again])
    assert seen.var(0, ddof=1).mean() == pytest.approx(np.mean([variance for _, variance in again]), rel=0.02)
    assert min(variance.min() for _, variance in again) > 0


def _again(capture, world, seed):
    """Expose the same mean frames with another noise seed."""
    from unittest.mock import patch

    from optsim.study.claims import captures

    real = captures.masks_for
    with patch.object(captures, "masks_for", lambda sensor, shots, rule, size, _: real(sensor, shots, rule, size, 1)):
        taken = capture.take(world, BAYER, 1, seed)
    return taken.signal, taken.variance


def test_budget_f_is_only_for_one_mask_and_budget_a_only_for_different_ones():
    from optsim.camera.budgets import EqualMasks, EqualPatterns

    assert lit_captures(EqualPatterns(), 500.0, MONO_DISTINCT) is None
    assert lit_captures(EqualPatterns(), 500.0, MONO_REPEATED)["mono"].shots == 3
    assert lit_captures(EqualMasks(), 500.0, MONO_REPEATED) is None
    assert lit_captures(EqualMasks(), 500.0, MONO_DISTINCT)["mono"].shots == 1

"""The study of what nonlinearity costs: beliefs, pairing, intervals, resuming."""

import json
import math

import numpy as np
import pytest
from scipy import stats

from optsim.camera import Mono, physical_model
from optsim.camera.camera import CameraConfig
from optsim.cube import Bands, band_mean
from optsim.report.figures_cost import draw_cost
from optsim.study.assumptions import ASSUMPTIONS, Calibrated, ExactWeights, Linear, OneColumn, PaperTable, WholePixels
from optsim.study.fine_scene import TexturedField
from optsim.study.nonlinearity import NonlinearityConfig, all_cases, nominal, run_nonlinearity, summarise
from optsim.study.pairs import interval, paired_loss

BANDS = Bands.paper()
CAMERA = nominal(CameraConfig(), BANDS)
WAVELENGTH = np.linspace(453, 668, 44)


def error_px(belief, seed=1):
    exact = CAMERA.dispersion.position_px(WAVELENGTH)[0]
    return belief.positions(CAMERA, BANDS, WAVELENGTH, seed) - exact


def test_a_line_misses_the_prism_by_pixels_and_leaves_no_line_in_its_residual():
    error = error_px(Linear())
    assert 1 < np.abs(error).max() < 5
    assert np.abs(np.polynomial.Polynomial.fit(WAVELENGTH, error, 1).convert().coef[1] * 200) < 0.3


def test_whole_pixels_miss_by_up_to_half_a_band_and_half_a_pixel():
    assert 0.4 < np.abs(error_px(WholePixels())).max() <= 1.1


def test_the_papers_table_misses_the_default_prism_by_a_quarter_of_a_pixel():
    assert 0.1 < np.abs(error_px(PaperTable())).max() < 0.3


def test_a_calibrated_curve_misses_by_the_spots_noise_over_their_number_and_differently_for_each_seed():
    errors = np.array([error_px(Calibrated(), seed) for seed in range(1, 101)])
    per_spot = 0.1 / math.sqrt(9 * 24 / 6)  # six coefficients from 9 x 24 spots
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(per_spot, rel=0.25)
    assert np.all(np.ptp(errors, axis=0) > 0)
    np.testing.assert_array_equal(error_px(Calibrated(), 3), error_px(Calibrated(), 3))
    assert np.abs(error_px(Calibrated(noise_px=0, degree=9))).max() < 1e-3


def test_exact_weights_miss_nothing():
    assert np.abs(error_px(ExactWeights())).max() == 0


def test_the_nominal_camera_sends_all_its_light_into_the_bands_of_h():
    assert (CAMERA.bandpass.lower_nm, CAMERA.bandpass.upper_nm) == (452.5, 668.5)
    assert CAMERA.dmd.leak == 0
    assert not CAMERA.relay.diffraction
    assert CAMERA.prism == CameraConfig().prism.model_copy(update={"fresnel": False})


def test_every_registration_error_displaces_the_data_by_its_amount_and_h_does_not_know():
    config = NonlinearityConfig(size=64)
    cases = list(all_cases(CAMERA, config))
    assert len(cases) == len(ASSUMPTIONS) + 4 * len(config.offsets_px)
    half = 32 * CAMERA.dmd.pitch_um / 1000
    for case in cases[len(ASSUMPTIONS) :]:
        assert case.believed == CAMERA
        true, believed = (c.optics.position_px(550.0, half, half) for c in (case.camera, case.believed))
        moved = math.hypot(true[0] - believed[0], true[1] - believed[1])
        assert moved == pytest.approx(case.amount_px, rel=0.01), case.name


def test_the_interval_is_students():
    values = [1.0, 2.0, 4.0, 3.5]
    mean, low, high = interval(values)
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    assert (mean, low, high) == pytest.approx((2.625, expected.low, expected.high))
    assert interval([2.0]) == (2.0, None, None)


def test_the_intervals_of_normal_draws_hold_their_mean_in_ninety_five_of_a_hundred():
    draws = np.random.Generator(np.random.Philox(5)).standard_normal((2000, 5))
    held = [low <= 0 <= high for _, low, high in map(interval, draws)]
    assert 0.935 < np.mean(held) < 0.965


def test_losses_are_paired_so_that_what_scenes_and_masks_share_drops_out():
    random = np.random.Generator(np.random.Philox(6))
    best = {(scene, seed): 20 + 5 * random.standard_normal() for scene in "ab" for seed in range(4)}
    other = {key: value - 0.5 for key, value in best.items()}
    mean, low, high = paired_loss(best, other)
    assert (mean, low, high) == pytest.approx((0.5, 0.5, 0.5))


def test_the_textured_field_holds_spectra_between_its_darkest_and_brightest_reflectance_everywhere_different():
    cube = TexturedField(seed=3).cube(BANDS.subdivide(2), (8, 8), 3)
    values = cube["radiance"].values
    assert values.shape == (24, 24, 48)
    flat = TexturedField(contrast=0).cube(BANDS.subdivide(2), (8, 8), 3)["radiance"].values
    assert np.ptp(flat, axis=(0, 1)).max() < 1e-5 * flat.max()
    assert values.std((0, 1)).min() > 0.05 * values.mean()
    np.testing.assert_array_equal(values, TexturedField(seed=3).cube(BANDS.subdivide(2), (8, 8), 3)["radiance"].values)
    assert band_mean(cube, BANDS)["radiance"].shape == (24, 24, 24)


def test_one_column_is_the_belief_of_one_tap():
    model = physical_model(CAMERA, Mono(), BANDS, np.ones((1, 8, 8), np.uint8), OneColumn())
    assert model.taps.shape == (24, 1)
    assert np.all(model.taps == 1)
    assert np.abs(model.first_column - model.shift_px).max() < 0.8


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cost")
    config = NonlinearityConfig(size=16, seeds=2, scenes=(TexturedField(),), offsets_px=(1.0,), samples=2)
    return folder, config, run_nonlinearity(folder, config, chosen=[Mono()], quiet=True)


@pytest.mark.slow
def test_a_line_costs_more_than_the_table_and_exact_weights_cost_nothing(study):
    _, _, cost = study
    loss = {(row.sensor, row.case): row.loss_db.mean for row in cost.losses if row.scene is None}
    assert loss["mono", "exact weights"] == 0
    assert loss["mono", "linear"] > 1
    assert loss["mono", "linear"] > loss["mono", "paper's table"]
    assert loss["mono", "x 1 px"] > 0.5


@pytest.mark.slow
def test_a_finished_study_is_found_and_not_computed_again(study, monkeypatch):
    folder, config, cost = study
    monkeypatch.setattr("optsim.study.nonlinearity.judge", lambda *_: pytest.fail("computed again"))
    again = run_nonlinearity(folder, config, chosen=[Mono()], quiet=True)
    assert again.rows == cost.rows
    assert json.loads((folder / "nonlinearity.json").read_text())["rows"] == cost.rows


@pytest.mark.slow
def test_the_study_is_drawn(study, tmp_path):
    _, _, cost = study
    draw_cost(cost.as_dict(), tmp_path / "cost.png")
    assert (tmp_path / "cost.png").stat().st_size > 20_000


def test_losses_are_summed_up_for_all_scenes_and_for_each():
    rows = [
        {"scene": scene, "sensor": "mono", "seed": seed, "case": case, "kind": "assumption", "amount_px": 0.0, "psnr_db": db}
        for scene in "ab"
        for seed in (1, 2)
        for case, db in (("exact weights", 20.0 + seed), ("linear", 17.0 + seed + (scene == "a")))
    ]
    losses = {(row.scene, row.case): row.loss_db.mean for row in summarise(rows)}
    assert losses[None, "linear"] == 2.5
    assert (losses["a", "linear"], losses["b", "linear"]) == (2, 3)

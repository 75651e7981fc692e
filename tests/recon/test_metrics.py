"""Metrics against closed forms and scikit-image."""

import json
import warnings

import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from recon.errors import InputError
from recon.metrics import band_psnr, ergas, pooled_psnr, psnr, rmse, score, spectral_angle, ssim

KEYS = ("psnr_db", "psnr_pooled_db", "ssim", "sam_deg", "rmse", "data_range", "band_psnr_db")


@pytest.fixture
def pair():
    rng = np.random.Generator(np.random.Philox(1))
    truth = rng.uniform(0.1, 3, (19, 23, 5))
    return truth + rng.normal(0, 0.05, truth.shape), truth


def test_M1_identical_cubes_are_exact_and_store_no_infinity(pair):
    _, truth = pair
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = score(truth, truth.copy())
    assert result.exact
    assert result.exact_bands == 5
    assert result.psnr_db is None
    assert result.psnr_pooled_db is None
    assert result.band_psnr_db == (None,) * 5
    assert (result.ssim, result.sam_deg, result.ergas, result.rmse) == (pytest.approx(1, abs=1e-14), 0, 0, 0)
    assert psnr(truth, truth) == pooled_psnr(truth, truth) == np.inf
    stored = json.dumps(result.as_dict(), allow_nan=False)
    assert json.loads(stored)["psnr_db"] is None
    assert json.loads(stored)["exact"] is True


def test_M1_one_exact_band_does_not_lift_the_mean(pair):
    estimate, truth = (a.copy() for a in pair)
    estimate[:, :, 2] = truth[:, :, 2]
    result = score(estimate, truth)
    others = [v for v in result.band_psnr_db if v is not None]
    assert len(others) == 4
    assert result.psnr_db == pytest.approx(np.mean(others), abs=1e-12) == psnr(estimate, truth)
    assert not result.exact
    assert result.exact_bands == 1


@pytest.mark.parametrize("d", [0.25, -2.0, 2.0**-40])
def test_M2_constant_offset_has_that_rmse_and_the_closed_form_psnr(d):
    truth = np.arange(2 * 3 * 4, dtype=float).reshape(2, 3, 4) / 8
    assert rmse(truth + d, truth) == abs(d)
    assert psnr(truth + d, truth, 2.0) == pytest.approx(20 * np.log10(2 / abs(d)), abs=1e-12)
    assert pooled_psnr(truth + d, truth, 2.0) == pytest.approx(20 * np.log10(2 / abs(d)), abs=1e-12)
    assert psnr(truth + d, truth) == pytest.approx(20 * np.log10(truth.max() / abs(d)), abs=1e-12)


@pytest.mark.parametrize("value", [0, -1.0, float("nan"), float("inf")])
def test_M3_a_data_range_that_is_no_peak_is_refused(pair, value):
    for metric in (psnr, pooled_psnr, band_psnr, ssim, score):
        with pytest.raises(InputError, match="data_range"):
            metric(*pair, value)


def test_M3_an_absent_range_is_the_largest_value_of_the_true_cube_whatever_the_estimate(pair):
    estimate, truth = (a.copy() for a in pair)
    truth[4, 5, 1] = 7.0
    for scale in (1.0, 50.0):
        result = score(estimate * scale, truth)
        assert result.data_range == 7.0
        assert result == score(estimate * scale, truth, 7.0)


def test_M3_a_dark_truth_has_no_peak_and_the_range_used_is_told(pair):
    with pytest.raises(InputError, match="maximum of the true cube"):
        score(np.ones((8, 8, 2)), np.zeros((8, 8, 2)))
    assert score(*pair).data_range == pair[1].max()
    assert score(*pair, 7.0).data_range == 7.0


def test_M4_a_zero_spectrum_is_excluded_from_the_angle_and_counted(pair):
    estimate, truth = (a.copy() for a in pair)
    cosine = (estimate * truth).sum(2) / np.sqrt((estimate**2).sum(2) * (truth**2).sum(2))
    angle = np.rad2deg(np.arccos(cosine))
    truth[3, 4] = 0
    estimate[5, 6] = 0
    others = np.ones(angle.shape, bool)
    others[3, 4] = others[5, 6] = False
    result = score(estimate, truth)
    assert result.excluded_pixels == 2
    assert result.sam_deg == pytest.approx(angle[others].mean(), rel=1e-12)
    assert abs(angle[others].mean() / (angle[others].sum() / angle.size) - 1) > 1e-3  # a zero counted as an angle of 0 would show
    assert spectral_angle(estimate * 0, truth) == (None, truth[:, :, 0].size)


def test_M5_identical_float32_spectra_have_angle_zero(pair):
    truth = pair[1].astype(np.float32)
    assert spectral_angle(truth, truth.copy()).mean_deg == 0.0


def test_M6_a_doubled_cube_has_angle_zero_and_finite_psnr(pair):
    truth = pair[1]
    result = score(2 * truth, truth)
    assert result.sam_deg == 0
    assert np.isfinite(result.psnr_db)


@pytest.mark.parametrize("shape", [(6, 30, 2), (30, 6, 2), (1, 1, 1)])
def test_M7_ssim_is_not_defined_below_seven_pixels_but_the_rest_is(shape):
    truth = np.full(shape, 2.0)
    result = score(truth + 0.5, truth)
    assert result.ssim is None
    assert ssim(truth + 0.5, truth) is None
    assert result.rmse == 0.5
    assert result.psnr_db == pytest.approx(20 * np.log10(4), abs=1e-12)


def test_M7_ssim_is_defined_at_exactly_seven_pixels():
    assert ssim(np.ones((7, 7, 1)), np.ones((7, 7, 1))) == pytest.approx(1)


def test_M8_detail_lost_under_a_large_offset_is_seen():
    rng = np.random.Generator(np.random.Philox(2))
    detail = rng.uniform(0, 64, (32, 32, 2))
    truth = (detail + 1e8).astype(np.float32)
    kept = np.round(detail / 8) * 8
    lost = np.full(truth.shape, np.float32(1e8 + 32), np.float32)
    assert ssim(truth, (kept + 1e8).astype(np.float32), 64.0) > 0.999
    value = ssim(lost, truth, 64.0)
    # SSIM's means keep the offset, so luminance is 1 and what remains is the structure term without covariance.
    assert value < 0.05
    var = np.array([[truth[i : i + 7, j : j + 7, k].astype(float).var(ddof=1) for i in range(26) for j in range(26)] for k in range(2)])
    assert value == pytest.approx(np.mean((0.03 * 64) ** 2 / (var + (0.03 * 64) ** 2)), rel=1e-6)


def test_M9_a_band_of_zero_mean_is_left_out_of_ergas_and_counted():
    truth = np.ones((8, 8, 3))
    truth[:, :, 1] = 0
    value, excluded = ergas(truth + 0.5, truth)
    assert excluded == 1
    assert value == pytest.approx(50)
    assert ergas(truth + 0.5, truth, ratio=0.25).value == pytest.approx(12.5)
    assert ergas(truth, truth * 0) == (None, 3)
    with pytest.raises(InputError, match="ratio"):
        ergas(truth, truth, ratio=0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_M10_one_non_finite_value_is_refused_with_its_place(pair, bad):
    for side, name in enumerate(("estimate", "truth")):
        cubes = [a.copy() for a in pair]
        cubes[side][3, 4, 1] = bad
        for metric in (psnr, pooled_psnr, ssim, rmse, spectral_angle, ergas, score):
            with pytest.raises(InputError, match=rf"{name}.*\(3, 4, 1\)"):
                metric(*cubes)


def test_M11_cubes_of_different_shape_are_refused_with_both_shapes(pair):
    estimate, truth = pair
    with pytest.raises(InputError, match=r"\(19, 23, 5\).*\(19, 23, 4\)"):
        score(estimate[:, :, :4], truth)
    with pytest.raises(InputError, match="truth"):
        score(estimate[:, :, 0], truth[:, :, 0])


def test_X17_a_negative_truth_is_refused(pair):
    estimate, truth = (a.copy() for a in pair)
    truth[2, 1, 0] = -1e-9
    with pytest.raises(InputError, match=r"truth.*\(2, 1, 0\)"):
        score(estimate, truth)


def test_psnr_and_ssim_equal_scikit_image(pair):
    estimate, truth = pair
    result = score(estimate, truth)
    peak = truth.max()
    bands = [peak_signal_noise_ratio(truth[:, :, k], estimate[:, :, k], data_range=peak) for k in range(5)]
    assert result.band_psnr_db == pytest.approx(bands, abs=1e-10)
    assert result.psnr_db == pytest.approx(np.mean(bands), abs=1e-10)
    assert result.psnr_pooled_db == pytest.approx(peak_signal_noise_ratio(truth, estimate, data_range=peak), abs=1e-10)
    judge = np.mean([structural_similarity(truth[:, :, k], estimate[:, :, k], data_range=peak) for k in range(5)])
    assert result.ssim == pytest.approx(judge, abs=1e-12)


def test_spectral_angle_of_known_spectra():
    a = np.zeros((1, 4, 2))
    b = np.zeros((1, 4, 2))
    a[0, :] = [[1, 0], [1, 0], [1, 0], [1, 1e-10]]
    b[0, :] = [[0, 5], [-1, 0], [1, 1], [1, 0]]
    for i, expected in enumerate((90, 180, 45, np.rad2deg(1e-10))):
        assert spectral_angle(a[:, i : i + 1], b[:, i : i + 1]).mean_deg == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("scale", [1e-200, 1e-30, 1e30, 1e200])
def test_scores_do_not_depend_on_the_unit(pair, scale):
    plain, scaled = score(*pair), score(pair[0] * scale, pair[1] * scale)
    for key in ("psnr_db", "psnr_pooled_db", "ssim", "sam_deg", "ergas"):
        assert getattr(scaled, key) == pytest.approx(getattr(plain, key), rel=1e-10)
    assert scaled.rmse == pytest.approx(plain.rmse * scale, rel=1e-12)


def test_band_major_views_and_float32_give_the_same_scores(pair):
    estimate, truth = (a.astype(np.float32) for a in pair)
    views = [np.ascontiguousarray(a.transpose(2, 0, 1)).transpose(1, 2, 0) for a in (estimate, truth)]
    assert score(*views) == score(estimate, truth)
    assert score(estimate.astype(float), truth.astype(float)) == score(estimate, truth)


def test_scores_carry_the_keys_of_the_command_line_first(pair):
    assert tuple(score(*pair).as_dict())[: len(KEYS)] == KEYS

"""Verdicts on the paper's claims follow one stated rule and the run's cubes."""

import numpy as np
import pytest

from optsim.report.claims import band_errors, judge, make_claims
from optsim.report.data import RunData
from optsim.report.gallery import Gallery


@pytest.mark.parametrize(
    ("gaps", "size", "up_to", "standing"),
    [
        ([3.0, 2.5], 3, False, "holds"),
        ([3.75, 2.25], 3, False, "holds"),
        ([3.8, 3.0], 3, False, "partly"),
        ([0.2, 2.9], 3, True, "holds"),
        ([0.2, 0.9], 3, True, "partly"),
        ([-1.0, -3.0], 3, False, "fails"),
        ([0.01, -0.04], 1, False, "fails"),
        ([1.0, -1.0], 1, False, "partly"),
        ([1.0, 0.01], 1, False, "partly"),
        ([], 1, False, "open"),
        ([0.9], 0.5, False, "holds"),
        ([12.4, 7.6], 10, False, "holds"),
    ],
)
def test_a_claimed_size_is_judged_to_half_a_decibel_or_a_quarter(gaps, size, up_to, standing):
    assert judge(gaps, size, up_to)[1] == standing


def test_claims_carry_the_numbers_of_the_rows(run):
    claims = {(c.claim, c.reading): c for c in make_claims(Gallery(run))}
    repeated = claims["Target 1: Bayer up to 3 dB above mono", "repeated mask"]
    distinct = claims["Target 1: Bayer up to 3 dB above mono", "distinct masks"]
    assert repeated.found.startswith("+2.9 dB at R = 1/8, 1/4, 3/8 and 1/2")
    assert repeated.standing == "holds"
    assert distinct.found.startswith("−3.6 dB")
    assert distinct.verdict == "reversed"
    assert claims["Every sensor improves with the number of shots", ""].found.startswith("24 of 24 steps")
    whole = claims["The colour sensors’ error is lower over the whole spectrum", "repeated mask"]
    assert "Bayer lower in 24 of 24 bands (color-checker, mean absolute error)" in whole.found
    assert whole.standing == "holds"


def test_band_errors_are_the_mean_absolute_differences(run):
    errors = band_errors(Gallery(run), "color-checker", 0.125)
    row = next(r for r in run.rows if r.sensor == "bayer" and r.R == 0.125 and r.solver == "basis-pursuit" and r.model == "matched")
    expected = [float(np.mean(np.abs(run.cube_of(row)[..., k] - run.truths[row.target].radiance[..., k]))) for k in range(24)]
    assert errors["bayer"] == pytest.approx(expected, rel=1e-12)


def test_a_run_without_the_second_target_says_not_run(make):
    quick = make(size=24, targets=("color-checker",), ratios=(0.125, 0.5), gpsr=False, physical=False)
    claims = make_claims(Gallery(quick))
    assert all(c.standing == "open" for c in claims if c.claim.startswith("Target 2"))
    assert any(c.standing == "holds" for c in claims)


def test_an_empty_run_leaves_every_claim_open():
    assert {c.standing for c in make_claims(Gallery(RunData({"rows": []}, {})))} == {"open"}


def test_false_colour_counts_tints_and_not_the_noise_of_single_pixels(make):
    gallery = Gallery(make(size=64, targets=("color-checker-bars",), ratios=(0.125,), gpsr=False, physical=False))
    truth = gallery.truth("color-checker-bars").radiance
    window = (slice(20, 52), slice(8, 40))
    checks = (np.indices(truth.shape[:2]).sum(0) % 2)[..., None] - 0.5
    wave = np.cos(np.linspace(0, np.pi, 24))
    noise = truth + 0.2 * truth.max() * checks * wave
    tint = truth + 0.02 * truth.max() * wave
    assert gallery.chroma_error(truth, "color-checker-bars", window) == 0
    assert gallery.chroma_error(noise, "color-checker-bars", window) < 1e-6
    assert gallery.chroma_error(noise, "color-checker-bars", window, block=1) > 10
    assert gallery.chroma_error(tint, "color-checker-bars", window) > 1

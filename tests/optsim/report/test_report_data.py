"""The contract between a run and its report refuses what would make a page lie."""

import numpy as np
import pytest

from optsim.errors import InputError
from optsim.report.data import Row, RunData, Truth


def raw_row(run, **changes):
    return dict(run.summary["rows"][0], **changes)


@pytest.mark.parametrize("key", ["target", "R", "stop", "tau_rule"])
def test_a_row_without_a_key_is_refused_by_name(run, key):
    raw = raw_row(run)
    del raw[key]
    with pytest.raises(InputError, match=rf"rows\[4\]\.{key}"):
        Row.from_mapping(raw, 4)


@pytest.mark.parametrize(
    ("key", "value"),
    [("sensor", "x3"), ("masks", "both"), ("model", "ideal"), ("psnr_db", float("nan")), ("R", None), ("sam_deg", float("inf"))],
)
def test_an_unknown_word_or_a_number_that_is_not_finite_is_refused(run, key, value):
    with pytest.raises(InputError, match=rf"rows\[0\]\.{key}"):
        Row.from_mapping(raw_row(run, **{key: value}))


def test_an_exact_estimate_has_no_psnr_and_is_accepted(run):
    assert Row.from_mapping(raw_row(run, psnr_db=None)).psnr_db is None


def test_keys_added_later_are_kept(run):
    row = Row.from_mapping(raw_row(run, rmse=0.25, converged=False))
    assert row.extra["rmse"] == 0.25
    assert row.converged is False


def test_a_truth_with_a_hole_is_refused(run):
    truth = next(iter(run.truths.values()))
    bad = truth.radiance.copy()
    bad[1, 2, 3] = np.nan
    with pytest.raises(InputError, match=r"truth\.radiance"):
        Truth(bad, truth.bands)


def test_an_estimate_of_another_shape_is_refused(run):
    broken = RunData(run.summary, run.truths, estimate=lambda solve: np.zeros((2, 2, 24)))
    with pytest.raises(InputError, match="estimate"):
        broken.cube_of(broken.rows[0])

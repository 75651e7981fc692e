"""Intervals and tests, against closed forms, SciPy and simulated coverage."""

import math

import numpy as np
import pytest
from scipy import stats

from optsim.study.statistics import RESAMPLES, holm, paired_estimate, weakest


def table(random, scenes, masks, between, within, mean, skewed=False):
    draw = (lambda n: random.exponential(1.0, n) - 1) if skewed else random.standard_normal
    effects = between * draw(scenes)
    return {f"s{i}": list(mean + effects[i] + within * random.standard_normal(masks)) for i in range(scenes)}


def coverage(trials, **design):
    random = np.random.Generator(np.random.Philox(11))
    mean = design.pop("mean", 0.7)
    found = [paired_estimate(table(random, mean=mean, **design), seed=i, resamples=499) for i in range(trials)]
    return np.mean([e.low <= mean <= e.high for e in found]), found


def bounds(share, trials):
    """Return what a true coverage of ``share`` shows in so many trials, to three standard errors."""
    error = 3 * math.sqrt(share * (1 - share) / trials)
    return share - error, min(1.0, share + error)


@pytest.mark.parametrize(
    "design",
    [
        {"scenes": 20, "masks": 5, "between": 0.8, "within": 0.3},
        {"scenes": 20, "masks": 1, "between": 0.8, "within": 0.3},
        {"scenes": 20, "masks": 5, "between": 0.05, "within": 1.0},
        {"scenes": 1, "masks": 10, "between": 0.0, "within": 0.3},
        {"scenes": 1, "masks": 5, "between": 0.0, "within": 0.3},
        {"scenes": 4, "masks": 2, "between": 0.8, "within": 0.3},
    ],
)
def test_the_interval_holds_the_true_mean_in_95_of_100_trials(design):
    low, high = bounds(0.95, 500)
    found, _ = coverage(500, **design)
    assert low <= found <= high


def test_the_interval_of_skewed_scenes_still_covers_more_than_nine_of_ten():
    found, _ = coverage(500, scenes=20, masks=5, between=1.0, within=0.2, skewed=True)
    assert found > 0.9


def test_ignoring_that_scenes_are_random_would_cover_far_too_rarely():
    random = np.random.Generator(np.random.Philox(5))
    hits = []
    for i in range(150):
        cells = table(random, 20, 5, between=1.0, within=0.2, mean=0.0)
        pooled = paired_estimate({"all": [v for values in cells.values() for v in values]}, seed=i, resamples=499)
        hits.append(pooled.low <= 0 <= pooled.high)
    assert np.mean(hits) < 0.75


def test_the_half_width_of_many_trials_is_students():
    random = np.random.Generator(np.random.Philox(3))
    values = random.standard_normal(400)
    found = paired_estimate({"a": list(values)})
    low, high = stats.t.interval(0.95, 399, values.mean(), values.std(ddof=1) / 20)
    assert found.low == pytest.approx(low, abs=0.006)
    assert found.high == pytest.approx(high, abs=0.006)


def test_the_resampling_is_scipys_bootstrap_but_for_the_stretch():
    values = np.random.Generator(np.random.Philox(9)).gamma(2.0, 1.0, 12)
    ours = paired_estimate({"a": list(values)}, resamples=RESAMPLES)
    theirs = stats.bootstrap(
        (values,), np.mean, n_resamples=RESAMPLES, method="percentile", rng=np.random.default_rng(1)
    ).confidence_interval
    stretch = math.sqrt(12 / 11) * stats.t.ppf(0.975, 11) / stats.norm.ppf(0.975)
    assert (ours.low - ours.mean) / stretch == pytest.approx(theirs.low - values.mean(), abs=0.03)
    assert (ours.high - ours.mean) / stretch == pytest.approx(theirs.high - values.mean(), abs=0.03)


def test_p_is_students_one_sided_test_on_the_scenes_means():
    cells = table(np.random.Generator(np.random.Philox(2)), 8, 3, 1.0, 0.5, 0.4)
    means = [np.mean(v) for v in cells.values()]
    assert paired_estimate(cells).p == pytest.approx(stats.ttest_1samp(means, 0, alternative="greater").pvalue)


def test_the_false_alarm_rate_of_p_is_its_level():
    _, found = coverage(500, scenes=6, masks=2, between=0.8, within=0.5, mean=0.0)
    low, high = bounds(0.05, 500)
    assert low <= np.mean([e.p < 0.05 for e in found]) <= high


def test_the_components_of_variance_are_those_that_were_put_in():
    _, found = coverage(200, scenes=20, masks=5, between=0.8, within=0.3)
    assert np.mean([e.between_masks**2 for e in found]) == pytest.approx(0.09, rel=0.03)
    assert np.mean([e.between_scenes**2 for e in found]) == pytest.approx(0.64, rel=0.08)


def test_equal_differences_have_an_interval_of_no_width():
    found = paired_estimate({"a": [0.3, 0.3], "b": [0.3]})
    assert (found.low, found.high) == pytest.approx((0.3, 0.3))
    assert found.p == 0
    assert paired_estimate({"a": [0.0, 0.0]}).p == 1


def test_scenes_count_alike_whatever_their_number_of_masks():
    assert paired_estimate({"a": [1.0, 1.0, 1.0, 1.0], "b": [3.0]}).mean == pytest.approx(2.0)


@pytest.mark.parametrize("cells", [{"a": [1.0]}, {"a": []}, {"a": [1.0, float("nan")]}, {"a": [1.0, 2.0], "b": []}])
def test_one_trial_or_a_value_that_is_not_finite_is_refused(cells):
    with pytest.raises(ValueError, match="differences"):
        paired_estimate(cells)


def test_holm_agrees_with_a_worked_example():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([]) == []
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    with pytest.raises(ValueError, match="p_values"):
        holm([1.2])


def test_holm_rejects_what_the_step_down_definition_rejects():
    random = np.random.Generator(np.random.Philox(4))
    for _ in range(50):
        p = random.random(9) ** 3
        rejected = set()
        for rank, index in enumerate(np.argsort(p)):
            if p[index] > 0.05 / (9 - rank):
                break
            rejected.add(int(index))
        assert rejected == {i for i, a in enumerate(holm(p)) if a <= 0.05}


def test_holm_keeps_the_chance_of_any_false_alarm_below_its_level():
    random = np.random.Generator(np.random.Philox(6))
    alarms = np.mean([min(holm(random.random(20))) < 0.05 for _ in range(2000)])
    assert alarms <= bounds(0.05, 2000)[1]


def test_all_parts_are_shown_only_if_the_weakest_is():
    sure, unsure = {"a": [1.0, 1.1, 1.2]}, {"a": [0.1, -0.1, 0.2]}
    assert weakest([sure, unsure]) is unsure
    assert weakest([{"a": [0.0, 0.0]}, {"a": [-1.0, -1.0]}]) == {"a": [-1.0, -1.0]}

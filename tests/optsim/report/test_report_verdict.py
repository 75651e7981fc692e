"""The headline's verbs follow the signs of the rows, whatever the ordering."""

import itertools
import re

import pytest

from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, MONO_REPEATED, RunData
from optsim.report.page import render_page
from optsim.report.select import db, ratio_text
from optsim.report.verdict import EXPECTED, make_verdict
from optsim.report.wording import compare, ordering, outcome

KEYS = [s.key for s in (MONO_DISTINCT, MONO_REPEATED, BAYER, FOVEON)]


def run_with(scores: dict[str, float], R: float = 0.125, target: str = "color-checker") -> RunData:
    """Return a run of rows alone, with the given PSNR."""
    names = {
        "mono-distinct": ("mono", "distinct"),
        "mono-repeated": ("mono", "repeated"),
        "bayer": ("bayer", "distinct"),
        "foveon": ("foveon", "distinct"),
    }
    rows = [
        {
            "target": target, "sensor": names[key][0], "masks": names[key][1], "R": R, "shots": 3, "model": "matched",
            "operator": "unit-shift", "solver": "basis-pursuit", "tau": None, "tau_rule": None, "psnr_db": value, "ssim": 0.9,
            "sam_deg": 5.0, "seconds": 1.0, "iterations": 9, "stop": "converged", "seed": 0,
        }
        for key, value in scores.items()
    ]  # fmt: skip
    return RunData({"rows": rows}, {})


@pytest.mark.parametrize("order", list(itertools.permutations(KEYS)))
def test_the_title_says_who_wins_for_each_of_the_24_orderings(order):
    scores = {key: 20.0 + 2 * i for i, key in enumerate(order)}
    verdict = make_verdict(run_with(scores))
    clauses = verdict.title.removesuffix(".").split("; ")
    for clause, mono in zip(clauses, ("mono-distinct", "mono-repeated")):
        wins = [name for name, key in (("Bayer", "bayer"), ("Foveon", "foveon")) if scores[mono] > scores[key]]
        said = clause.split(", ", 1)[1]
        if len(wins) == 2:
            assert said == "mono beats both colour sensors"
        elif not wins:
            assert said == "both colour sensors beat mono"
        else:
            loser = "Foveon" if wins == ["Bayer"] else "Bayer"
            assert said == f"mono beats {wins[0]} but loses to {loser}"
    expected = [s.key for s in EXPECTED]
    text = verdict.findings[0].text
    assert ("Confirmed" in text) == (list(order) == expected)
    assert ("Refuted" in text) == (list(order) != expected)


@pytest.mark.parametrize("order", list(itertools.permutations(KEYS, 4))[::5])
def test_the_ordering_is_written_ascending_with_the_stored_numbers(order):
    scores = {key: 20.123 + 1.5 * i for i, key in enumerate(order)}
    numbers = [float(x) for x in re.findall(r"\d+\.\d\d", ordering(scores))]
    assert numbers == [pytest.approx(scores[key], abs=0.005) for key in order]


def test_gaps_under_a_twentieth_of_a_decibel_are_ties():
    scores = {"mono-distinct": 27.0, "bayer": 27.04, "foveon": 26.97, "mono-repeated": 20.0}
    assert outcome(scores, MONO_DISTINCT) == "mono ties with both colour sensors"
    assert "beats" not in compare("mono", 27.0, [("Bayer", 27.04)])
    assert outcome({**scores, "bayer": 27.06}, MONO_DISTINCT) == "mono ties with Foveon but loses to Bayer"
    text = make_verdict(run_with(scores)).findings[0].text
    assert "Refuted" in text
    assert "ties with" in text


def test_amounts_are_the_differences_of_the_rows():
    verdict = make_verdict(run_with({"mono-distinct": 27.30, "mono-repeated": 20.80, "bayer": 23.70, "foveon": 26.90}))
    assert verdict.readings == (
        "Three different masks: mono beats Bayer by 3.6 dB and Foveon by 0.40 dB.",
        "One mask, three times: mono loses to Bayer by 2.9 dB and Foveon by 6.1 dB.",
    )


def test_what_was_not_run_is_said():
    assert "Nothing was reconstructed" in make_verdict(RunData({"rows": []}, {})).title
    lonely = make_verdict(run_with({"bayer": 24.0}))
    assert lonely.title.startswith("Not all sensors were run")
    half = make_verdict(run_with({"mono-distinct": 27.0, "bayer": 24.0, "foveon": 26.0}))
    assert "repeated mask was not run" in half.title
    assert "Not decided" in half.findings[0].text
    other_r = make_verdict(run_with(dict.fromkeys(KEYS, 24.0), R=0.5))
    assert "R = 1/2" in other_r.basis
    assert "Not decided" in other_r.findings[0].text


def test_tau_that_changes_the_ordering_is_reported_with_both_gaps(make):
    run = make(size=24, targets=("color-checker",), ratios=(0.125,))
    rows = [dict(row) for row in run.summary["rows"]]
    for row in rows:
        if row["solver"] == "gpsr" and row["sensor"] == "foveon" and row["tau_rule"] == "auto":
            row["psnr_db"] = 10.0
    finding = next(f for f in make_verdict(RunData({"rows": rows}, run.truths)).findings if f.label == "How tau changes it")
    text = " ".join(finding.points)
    assert "No path over tau" in text
    assert "Bayer − Foveon is +13.3 dB instead of −3.2 dB" in text
    assert "(Foveon, R = 1/8)" in text


def test_solves_that_stopped_early_are_counted(make):
    run = make(size=24)
    early = sum(row["converged"] is False for row in run.summary["rows"])
    text = make_verdict(run).findings[-1].text
    assert early > 0
    assert f"{early} of {len(run.rows)} solves stopped before" in text
    assert "One mask seed" in text


@pytest.mark.parametrize(
    ("value", "sign", "text"),
    [(0.4, False, "0.40 dB"), (-0.4, True, "−0.40 dB"), (12.34, True, "+12.3 dB"), (0.996, False, "1.0 dB"), (0.001, True, "±0.00 dB")],
)
def test_decibels_are_written_with_a_true_minus(value, sign, text):
    assert db(value, sign) == text


@pytest.mark.parametrize(("R", "text"), [(0.125, "1/8"), (0.375, "3/8"), (0.5, "1/2"), (1 / 24, "1/24"), (1.0, "1")])
def test_compression_ratios_are_written_as_fractions(R, text):
    assert ratio_text(R) == text


def test_scores_of_unfinished_solves_are_marked_and_counted(make):
    run = make(size=24, targets=("color-checker",), ratios=(0.125,))
    rows = [dict(row, converged=not (row["model"] == "physical" and row["operator"] == "camera")) for row in run.summary["rows"]]
    verdict = make_verdict(RunData({"rows": rows}, run.truths))
    matched = next(f for f in verdict.findings if f.label == "What matched data hide")
    assert [sum(cell.endswith("*") for cell in row) for row in matched.rows] == [0, 0, 4]
    assert [point.count("4 of these solves stopped before their tolerance") for point in matched.points] == [0, 1]
    assert "stopped before" not in verdict.basis
    early = [dict(row, converged=False) for row in rows]
    assert "4 of these solves stopped before their tolerance" in make_verdict(RunData({"rows": early}, run.truths)).basis


def test_physical_data_are_compared_with_matched_data_solved_the_same_way(make):
    run = make(size=24, targets=("color-checker",), ratios=(0.125,))
    rows = [dict(row) for row in run.summary["rows"]]
    for row in [r for r in rows if r["solver"] == "basis-pursuit"]:
        for rule in ("auto", "oracle"):
            rows.append(
                dict(row, solver="admm", tau=1e-4, tau_rule=rule, psnr_db=row["psnr_db"] - (1.0 if row["model"] == "physical" else 0.0))
            )
    finding = next(f for f in make_verdict(RunData({"rows": rows}, run.truths)).findings if f.label == "What matched data hide")
    assert len(finding.rows) == 9
    assert len(finding.points) == 4
    assert finding.points[0].startswith("Eq. 4, ADMM, automatic tau, physical data, unit-shift H: ")
    assert (
        "Eq. 4, ADMM, automatic tau, physical data, the camera’s own shifts: −1.1 dB against matched data; the order" in finding.points[1]
    )
    assert "basis pursuit, physical data, unit-shift H: −0.80 to −0.20 dB against matched data" in finding.points[2]
    assert "oracle" not in " ".join(finding.points)
    assert "Eq. 4 may leave a residual" in finding.text


def test_the_title_says_by_which_score_it_ranks_and_what_was_expected_is_called_an_estimate():
    verdict = make_verdict(run_with({"mono-distinct": 27.30, "mono-repeated": 20.80, "bayer": 23.70, "foveon": 26.90}))
    assert verdict.title.startswith("By PSNR: if monochrome’s three shots use three different masks, mono beats")
    assert verdict.findings[0].text.startswith("An earlier estimate with painted targets expected")


@pytest.mark.parametrize(("seeds", "said"), [((0,), "One mask seed: no interval can be given"), ((0, 1), "means over 2 mask seeds")])
def test_M12_one_seed_shows_no_interval(seeds, said):
    rows = [dict(row, seed=seed) for seed in seeds for row in run_with(dict.fromkeys(KEYS, 24.0)).summary["rows"]]
    run = RunData({"rows": rows}, {})
    assert said in make_verdict(run).findings[-1].text
    page = render_page(run, ())
    if len(seeds) == 1:
        assert not re.search(r"\d ± \d|confidence|standard deviation|error bar", page)
        assert "no interval can be given" in page

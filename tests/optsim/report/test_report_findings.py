"""What the page says of tau and of the other scores is recomputed here from hand-written rows and paths."""

import pytest

from optsim.report.data import RunData, TauScore
from optsim.report.finding_scores import other_scores
from optsim.report.finding_tau import fraction_text, tau_finding, tau_lead
from optsim.report.page import render_page
from optsim.report.select import main_recipe
from optsim.report.verdict import make_verdict

NAMES = {"mono-distinct": ("mono", "distinct"), "bayer": ("bayer", "distinct"), "foveon": ("foveon", "distinct")}
PURSUIT = {"mono-distinct": 27.0, "bayer": 23.0, "foveon": 26.0}


def row(key, psnr, *, solver="basis-pursuit", rule=None, tau=None, target="card", R=0.125, ssim=0.9, angle=5.0):
    """Return one row of summary.json."""
    return {
        "target": target, "sensor": NAMES[key][0], "masks": NAMES[key][1], "R": R, "shots": 1, "model": "matched",
        "operator": "unit-shift", "solver": solver, "tau": tau, "tau_rule": rule, "psnr_db": psnr, "ssim": ssim,
        "sam_deg": angle, "seconds": 1.0, "iterations": 9, "stop": "converged", "seed": 0,
    }  # fmt: skip


def point(key, fraction, psnr, solver="admm", model="matched"):
    """Return one point of a tau path, with tau_max = 2."""
    return TauScore("card", *NAMES[key], 0.125, 2 * fraction, fraction, psnr, solver=solver, model=model)


def tau_run(path, chosen=()):
    """Return a run with basis pursuit, some chosen taus and a path."""
    rows = [row(key, psnr) for key, psnr in PURSUIT.items()] + [row("bayer", 23.0, solver="admm", rule="auto", tau=2e-4)] * (not chosen)
    return RunData({"rows": rows + list(chosen)}, {}, tau_path=path)


def points_of(run):
    return tau_finding(run, main_recipe(run), "card").points


def test_a_flip_along_the_path_is_told_with_its_tau_gap_and_solvers():
    path = [point(k, 1e-4, v, s) for s in ("admm", "gpsr") for k, v in PURSUIT.items()]
    path += [point("foveon", 3e-4, 22.7, s) for s in ("admm", "gpsr")] + [point("bayer", 3e-4, 23.0, s) for s in ("admm", "gpsr")]
    run = tau_run(path)
    assert points_of(run)[0] == "card, R = 1/8: at tau = 3e-4 of tau_max, Bayer leads Foveon by 0.30 dB (ADMM, GPSR agree)."
    lead = tau_lead(run, main_recipe(run), "card", 0.125)
    assert lead.startswith("How tau changes it: at R = 1/8, at tau = 3e-4 of tau_max, Bayer leads Foveon by 0.30 dB (ADMM, GPSR agree)")
    assert make_verdict(run).tau == lead
    assert lead in render_page(run, ()).replace("&#x27;", "'")


def test_a_flip_that_one_solver_alone_finds_is_told_as_such():
    path = [
        point("foveon", 3e-4, 22.7),
        point("bayer", 3e-4, 23.0),
        point("foveon", 3e-4, 25.0, "gpsr"),
        point("bayer", 3e-4, 23.0, "gpsr"),
    ]
    assert "Bayer leads Foveon by 0.30 dB (ADMM; not GPSR)" in points_of(tau_run(path))[0]


def test_a_pair_that_becomes_a_tie_is_told():
    assert "Bayer ties with Foveon (ADMM)" in points_of(tau_run([point("foveon", 3e-4, 23.0), point("bayer", 3e-4, 23.01)]))[0]


def test_no_flip_is_said_with_the_range_of_tau():
    run = tau_run([point(k, f, v) for f in (1e-5, 3e-4) for k, v in PURSUIT.items()])
    assert points_of(run)[0] == ("No pair flips against basis pursuit at every tau tried from 1e-5 to 3e-4 of tau_max: card at R = 1/8.")
    assert tau_lead(run, main_recipe(run), "card", 0.125).endswith("not at all, at every tau tried from 1e-5 to 3e-4 of tau_max.")


def test_paths_of_physical_data_are_not_mixed_in():
    run = tau_run([point("foveon", 3e-4, 20.0, model="physical"), point("bayer", 3e-4, 23.0, model="physical")])
    assert points_of(run)[0].startswith("No path over tau")
    assert tau_lead(run, main_recipe(run), "card", 0.125) == ""


def chosen(auto, oracle):
    """Return the chosen rows of Foveon at two tau fractions; the oracle scores 0.5 dB more."""
    return [
        row("foveon", 24.5, solver="admm", rule="auto", tau=2 * auto),
        row("foveon", 25.0, solver="admm", rule="oracle", tau=2 * oracle),
    ]


@pytest.mark.parametrize(
    ("auto", "oracle", "said", "unsaid"),
    [
        (1e-5, 1e-5, "both want the smallest tau offered: Eq. 4’s limit of basis pursuit", "without the truth costs"),
        (3e-4, 3e-4, "both want the largest tau offered", "without the truth costs"),
        (1e-4, 1e-5, "without the truth costs up to 0.50 dB (Foveon, R = 1/8)", "both want"),
        (1e-4, 1e-4, "without the truth costs up to 0.50 dB (Foveon, R = 1/8)", "both want"),
    ],
)
def test_the_cost_of_choosing_tau_is_told_only_where_there_is_a_choice(auto, oracle, said, unsaid):
    text = " ".join(points_of(tau_run([point("foveon", f, 25.0) for f in (3e-4, 1e-4, 1e-5)], chosen(auto, oracle))))
    assert said in text
    assert unsaid not in text


def test_taus_at_an_end_of_the_grid_that_only_one_rule_chose_are_counted():
    path = [point("foveon", f, 25.0) for f in (3e-4, 1e-4, 1e-5)]
    alone = [dict(r, at_edge=r["tau_rule"] == "oracle") for r in chosen(1e-4, 1e-5)]
    assert "1 of the 2 chosen taus lie at an end of the grid that one rule alone chose" in " ".join(points_of(tau_run(path, alone)))
    both = [dict(r, at_edge=True) for r in chosen(1e-5, 1e-5)]
    assert "one rule alone" not in " ".join(points_of(tau_run(path, both)))


@pytest.mark.parametrize(("value", "text"), [(3e-4, "3e-4"), (1e-5, "1e-5"), (2.5e-3, "2.5e-3"), (1.0, "1e0")])
def test_fractions_of_tau_max_are_written_short(value, text):
    assert fraction_text(value) == text


def test_scores_that_rank_against_psnr_are_told_with_their_numbers():
    rows = []
    for target, R in (("card", 0.125), ("card", 0.5), ("bars", 0.125)):
        rows += [
            row("mono-distinct", 27.0, target=target, R=R, ssim=0.95, angle=6.25),
            row("bayer", 23.0, target=target, R=R, ssim=0.80, angle=9.0),
            row("foveon", 26.0, target=target, R=R, ssim=0.97 if (target, R) == ("card", 0.5) else 0.90, angle=4.5),
        ]
    run = RunData({"rows": rows}, {})
    finding = other_scores(run, main_recipe(run), 0.125)
    assert finding.points == (
        "By SSIM, Foveon beats mono distinct, which leads by PSNR, on card, R = 1/2.",
        "By mean spectral angle, Foveon beats mono distinct, which leads by PSNR, at all 3 combinations of target and R "
        "(R = 1/8: card 4.50° against 6.25°; bars 4.50° against 6.25°).",
    )
    assert finding.rows[2] == ("card", "mean spectral angle", "6.25°", "not run", "9.00°", "4.50°")
    assert "<li>By SSIM, Foveon beats" in render_page(run, ())


def test_scores_that_rank_as_psnr_does_are_told_to():
    run = RunData({"rows": [row("bayer", 23.0, ssim=0.8, angle=9.0), row("foveon", 26.0, ssim=0.9, angle=4.0)]}, {})
    assert [p.split(" no pair")[0] for p in other_scores(run, main_recipe(run), 0.125).points] == ["By SSIM", "By mean spectral angle"]


def test_a_run_without_these_scores_has_no_such_finding():
    run = RunData({"rows": [row("bayer", 23.0, ssim=None, angle=None), row("foveon", 26.0, ssim=None, angle=None)]}, {})
    assert "By other scores" not in [f.label for f in make_verdict(run).findings]

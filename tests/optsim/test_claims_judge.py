"""Verdicts from invented numbers: a claim holds when its sign is shown and its size met, and the page says under which reading."""

import json
import math
import zlib
from dataclasses import replace

import numpy as np
import pytest

from optsim.study.claims.conditions import condition
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.judge import EVERY, Outcome, Verdict, judge, overall
from optsim.study.claims.measures import BandsBelow, Drop, Gap, LargestGap, MoreShots, Table, background_db, false_color_db
from optsim.study.claims.paper import CLAIMS, about, up_to
from optsim.study.claims.plan import tasks_of
from optsim.study.claims.readings import readings
from optsim.study.claims.run import run_claims
from optsim.study.claims.worlds import BENCH, TARGET_2

CONFIG = ClaimsConfig.quick().model_copy(update={"few_target_masks": 3})
LEVEL = {"mono-distinct": 24.0, "mono-repeated": 20.0, "bayer": 22.9, "foveon": 24.0}


def row(task, level=None, noise=0.03):
    """Invent a row: the series' level, 10 dB less on target 2, 2 dB more a group, a little noise."""
    random = np.random.Generator(np.random.Philox(zlib.crc32(task.name.encode())))
    base = (level or LEVEL)[task.series.key] + 2 * task.groups - 10 * (task.cell.scene == TARGET_2)
    bands = base + noise * random.standard_normal() + 0.01 * random.standard_normal(24)
    made = {"psnr_db": float(bands.mean()), "band_psnr_db": bands.tolist(), "ssim": 0.5, "sam_deg": 3.0, "seconds": 1.0, "iterations": 9}
    made |= {"converged": True, "tau_fraction": None, "at_edge": False}
    if task.cell.scene == TARGET_2:
        made["false_color"] = {"bayer": 20.0, "foveon": 8.0}.get(task.series.sensor, 12.0) * math.exp(0.01 * random.standard_normal())
    if task.cell.scene == BENCH:
        error = 10 ** (-bands.mean() / 20)
        made["signatures"] = {p: {"error": error, "background": error / 2, "gain": 1.0} for p in ("green chest", "red helmet")}
    return made


def tables(level=None, config=CONFIG):
    found = []
    for reading in readings(config):
        rows = {(t.cell.scene, t.cell.mask, t.groups, t.series.sensor): row(t, level) for t in tasks_of(config, reading)}
        found.append(Table(reading, config.size, rows))
    return found


@pytest.fixture(scope="module")
def judged():
    return judge(tables(), 0)


def outcomes(rows, ident, masks):
    return {row.outcome for row in rows if row.claim.ident == ident and row.reading.mono.masks == masks}


def test_a_gap_of_the_claimed_size_holds_and_a_reversed_one_shows_the_opposite(judged):
    assert outcomes(judged, "target1-bayer-mono", "repeated") == {Outcome.HOLDS}
    assert outcomes(judged, "target1-bayer-mono", "distinct") == {Outcome.OPPOSITE}
    assert outcomes(judged, "target1-foveon-mono", "repeated") == {Outcome.HOLDS}
    assert outcomes(judged, "target2-harder", "repeated") == {Outcome.HOLDS}


def test_a_gap_of_another_size_holds_in_sign_only_and_that_is_not_the_claim(judged):
    assert outcomes(judged, "target2-foveon-mono", "repeated") == {Outcome.SIGN}
    assert {row.verdict for row in judged if row.outcome is Outcome.SIGN} == {Verdict.DOES_NOT}
    found = {(o.claim.ident, o.among): o for o in overall(judged)}["target2-foveon-mono", EVERY]
    assert found.verdict is Verdict.DOES_NOT
    assert found.words.startswith("never of the claimed size (1.5 to 2.5 dB); its sign if the masks are repeated")


def test_a_size_is_met_by_the_mean_however_wide_the_interval():
    noisy = tables()
    row_of = next(t for t in noisy if t.reading.base and t.reading.mono.masks == "repeated")
    gaps = row_of.paired("color-checker", 1, "foveon", "mono", lambda row: row["psnr_db"])
    assert about(4).met(float(np.mean(gaps)))
    assert not about(4).met(2.9)
    assert not about(4).met(5.1)


def test_the_numbers_are_those_that_were_invented(judged):
    for found in judged:
        if found.claim.ident == "target1-foveon-mono" and found.reading.mono.masks == "repeated":
            assert found.estimate.mean == pytest.approx(4.0, abs=0.35)
            assert found.estimate.low <= found.estimate.mean <= found.estimate.high


def test_a_claim_that_hangs_on_the_masks_says_so(judged):
    by_id = {o.claim.ident: o for o in overall(judged) if o.among == EVERY}
    assert by_id["target1-bayer-mono"].verdict is Verdict.ONLY_IF
    assert by_id["target1-bayer-mono"].words.startswith("if the masks are repeated")
    assert by_id["target1-bayer-mono"].best.reading.mono.masks == "repeated"
    assert by_id["target2-harder"].verdict is Verdict.HOLDS
    assert by_id["more-shots"].verdict is Verdict.HOLDS
    assert len(by_id) == len(CLAIMS)


def test_a_condition_is_named_with_its_counts_where_enough_cases_meet_and_miss_it():
    cases = [
        {"masks": f"if the masks are {m}", "R": f"at R = {r}"} for m in ("distinct", "repeated") for r in ("1/8", "1/2") for _ in range(4)
    ]
    repeated = ["repeated" in case["masks"] for case in cases]
    assert condition(cases, repeated) == "if the masks are repeated: 8 of 8 such cases, 0 of the 8 others"
    assert condition(cases, [m and "1/8" in c["R"] for m, c in zip(repeated, cases)]) == (
        "if the masks are repeated at R = 1/8: 4 of 4 such cases, 0 of the 12 others"
    )
    assert condition(cases[6:], [m and "1/8" in c["R"] for m, c in zip(repeated, cases)][6:]) is not None
    assert condition(cases[10:], [i < 2 for i in range(6)]) is None  # two cases are too few
    assert condition(cases, [i % 2 == 0 for i in range(16)]) is None


def test_where_no_condition_sorts_them_the_cases_are_named(judged):
    mine = [row for row in judged if row.claim.ident == "bench-foveon-mono"]
    alone = [replace(row, fits=i == 0, p=0.0 if i == 0 else 1.0, p_opposite=1.0) for i, row in enumerate(mine)]
    words = next(o.words for o in overall(alone) if o.among == EVERY)
    assert words == f"in 1 of {len(mine)}: {mine[0].name}, {mine[0].where}"


def test_cases_at_unequal_shots_are_told_by_their_shots_and_left_out_of_the_verdict(judged):
    odd = [row for row in judged if not row.equal]
    assert {row.reading.change[:8] for row in odd} == {"budget A", "budget E"}
    assert "shots: foveon 1 and mono 1" in {row.where.split(",")[0] for row in odd if row.claim.ident == "target1-foveon-mono"}
    alone = [replace(row, fits=not row.equal, p=0.0) for row in judged]
    assert all(o.verdict is not Verdict.HOLDS and o.best.equal for o in overall(alone) if any(r.claim is o.claim for r in odd))


def test_the_same_solves_are_judged_once(judged):
    seen = set()
    for row in judged:
        sensors = sorted(row.claim.measure.sensors)
        mono = row.reading.mono.key if "mono" in sensors else ""
        key = (row.claim.ident, row.where, mono, row.reading.depth, *(row.reading.recipes[s] for s in sensors))
        assert key not in seen
        seen.add(key)
    budgets = [row for row in judged if row.claim.ident == "target1-foveon-bayer" and row.alike]
    assert any("budget B" in other for row in budgets for other in row.alike)


def test_equal_sensors_make_no_claim_of_a_gap_hold():
    rows = judge(tables(dict.fromkeys(LEVEL, 22.0)), 0)
    gaps = [r for r in rows if "mono" in r.claim.ident and r.claim.ident.count("-") == 2 and "bench-long" not in r.claim.ident]
    assert gaps
    assert not [r for r in gaps if r.verdict is Verdict.HOLDS]


def test_every_p_is_holms_over_the_bases_or_over_the_changed_readings_of_its_claim(judged):
    for claim in CLAIMS:
        for base in (True, False):
            mine = [r for r in judged if r.claim is claim and r.reading.base is base]
            if mine:
                smallest = min(mine, key=lambda r: r.estimate.p)
                assert smallest.p == pytest.approx(min(1.0, smallest.estimate.p * len(mine)))
                assert all(r.p >= r.estimate.p for r in mine)


def test_claims_about_other_sensors_are_not_judged_again(judged):
    changed = [r for r in judged if "Bayer demosaiced" in r.reading.change]
    assert changed
    assert all("bayer" in r.claim.measure.sensors for r in changed)


def test_a_claim_about_all_bands_has_a_part_for_each_band_and_target():
    table = tables()[0]
    assert len(list(BandsBelow("foveon").parts(table, 1))) == 48


def test_a_drop_has_a_part_for_each_sensor_and_all_must_be_of_its_size():
    drops = [part["targets"] for part in Drop().parts(tables()[0], 1)]
    assert [np.mean(drop) for drop in drops] == pytest.approx([10, 10, 10], abs=0.5)


def test_the_largest_gap_is_that_of_one_R_and_needs_more_than_one():
    table = tables()[0]
    gaps = [np.mean(table.paired("color-checker", g, "bayer", "mono", lambda row: row["psnr_db"])) for g in table.groups("color-checker")]
    assert np.mean(next(iter(LargestGap("bayer", "mono", "color-checker").parts(table, 1)))["color-checker"]) == max(gaps)
    assert not list(LargestGap("bayer", "mono", "color-checker").parts(tables()[-2], 1))


def test_a_background_is_compared_by_its_size():
    table = next(t for t in tables() if t.reading.depth.bench)
    found = next(iter(Gap("mono", "foveon", (BENCH,), background_db).parts(table, 1)))[BENCH]
    assert len(found) == table.reading.depth.target_masks
    assert background_db({"signatures": {"a": {"background": -0.1}, "b": {"background": 0.0}}}) == pytest.approx(-40)


def test_false_colour_counts_in_decibels_and_more_shots_by_steps():
    table = tables()[0]
    assert np.mean(next(iter(Gap("bayer", "foveon", (TARGET_2,), false_color_db).parts(table, 1)))[TARGET_2]) == pytest.approx(
        20 * math.log10(2.5), abs=0.2
    )
    steps = [np.mean(v) for part in MoreShots().parts(table, 1) for v in part.values()]
    assert len(steps) == 2 * 3 * (len(CONFIG.groups) - 1)
    assert min(steps) > 5


def test_a_claim_without_mono_is_judged_once_for_both_readings_of_mono(judged):
    mine = [r for r in judged if r.claim.ident == "target1-foveon-bayer"]
    assert len({(r.name, r.where) for r in mine}) == len(mine)
    assert any("F equal" in change for r in judged for change in (r.reading.change, *r.alike))
    assert not any("masks" in r.traits or r.name.startswith(("distinct", "repeated")) for r in mine)


def test_sizes_allow_half_a_decibel_or_a_quarter():
    assert (about(4).low, about(4).high) == (3, 5)
    assert (about(1).low, about(1).high) == (0.5, 1.5)
    assert (up_to(3).low, up_to(3).high) == (0, 3.75)
    assert about(4).met(4.9)


@pytest.mark.slow
def test_the_whole_study_leaves_its_page_and_json_of_the_stated_form(tmp_path, monkeypatch):
    """With invented rows in place of solves: plan, verdicts, figures and page are the real ones."""
    monkeypatch.setattr("optsim.study.claims.run.run_task", lambda config, task, *_: row(task))
    monkeypatch.setattr("optsim.study.claims.worlds.World.fine", property(lambda self: pytest.fail("rendered")))
    monkeypatch.setattr("optsim.study.claims.run.make_ready", lambda *_: None)
    monkeypatch.setattr("optsim.study.claims.drawings.paper_figures", lambda *_: [])
    found = run_claims(CONFIG, tmp_path, quiet=True)
    claims = json.loads((tmp_path / "claims.json").read_text())
    assert claims == found.as_dict()
    assert set(claims) == {"claims"}
    for entry in claims["claims"]:
        assert set(entry) == {"id", "claim", "reading", "value_db", "interval_db", "verdict"}
        assert entry["verdict"] in ("holds", "holds_only_if", "does_not_hold")
        low, high = entry["interval_db"]
        assert low <= entry["value_db"] <= high
    keys = [(entry["id"], entry["reading"]) for entry in claims["claims"]]
    assert len(set(keys)) == len(keys)
    page = found.page.read_text()
    assert "http" not in page.split("<body>")[1].replace("http-equiv", "")
    for claim in CLAIMS:
        assert claim.text.split("'")[0] in page
    assert (tmp_path / "figures" / "light.png").exists()
    rows = json.loads((tmp_path / "rows.json").read_text())["rows"]
    assert {"scene", "size", "mask", "sensor", "masks", "groups", "capture", "method", "psnr_db"} <= set(rows[0])

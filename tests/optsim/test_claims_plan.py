"""What the study of the paper's claims runs: every factor once, from stated bases, each solve once."""

from collections import Counter

import pytest

from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.plan import all_tasks, cells, tasks_of
from optsim.study.claims.readings import BENCH, MATCHED, NOISY, PHYSICAL, SENSORS, base_recipe, readings
from optsim.study.claims.worlds import TARGET_1, TARGET_2

FULL, QUICK = ClaimsConfig(), ClaimsConfig.quick()


def test_there_are_four_bases_and_each_differs_in_masks_or_data():
    bases = {(r.mono.masks, r.data) for r in readings(FULL) if r.base and r.depth.size is None}
    assert bases == {(m, d) for m in ("distinct", "repeated") for d in (MATCHED, PHYSICAL)}


@pytest.mark.parametrize("masks", ["distinct", "repeated"])
@pytest.mark.parametrize(
    ("data", "changes"),
    [
        (MATCHED, ("oracle tau", "automatic tau", "quality", "photon scaling", "silicon", "glass", "demosaiced")),
        (
            PHYSICAL,
            ("basis pursuit", "oracle tau", "quality", "photon scaling", "silicon", "glass", "demosaiced", "unit-shift", "calibrated"),
        ),
        (NOISY, ("A equal", "B paper", "C equal", "D equal", "E equal", "F equal", "noise-weighted", "peak scaling", "quality")),
    ],
)
def test_every_factor_of_the_study_is_a_reading(masks, data, changes):
    names = [r.change for r in readings(FULL) if (r.mono.masks, r.data) == (masks, data)]
    absent = {"distinct": "F equal", "repeated": "A equal"}[masks]
    for change in changes:
        assert any(change in name for name in names) == (change != absent), change


def test_a_reading_without_noise_differs_from_its_base_in_one_thing():
    for reading in readings(FULL):
        if reading.base or reading.data not in (MATCHED, PHYSICAL):
            continue
        base = base_recipe(reading.data)
        differing = {s for s in SENSORS if reading.recipes[s] != base}
        assert differing == reading.touched
        for sensor in differing:
            changed = reading.recipes[sensor]
            best_tau = "oracle" in reading.change and "demosaiced" in reading.change  # else a tau made for raw frames would be judged
            assert (changed.capture != base.capture) + (changed.method != base.method) == 1 + best_tau


def test_light_runs_from_50_to_50_000_electrons_at_equal_time():
    levels = [r.recipes["bayer"].capture.electrons for r in readings(FULL) if r.change.startswith("budget C")]
    assert (min(levels), max(levels)) == (50, 50_000)


@pytest.mark.parametrize("config", [FULL, QUICK])
def test_every_solve_is_listed_once_under_a_name_of_its_own(config):
    tasks = all_tasks(config, readings(config))
    assert len({task.name for task in tasks}) == len(tasks)
    assert max(Counter(tasks).values()) == 1
    assert all(task.cost > 0 for task in tasks)


def test_readings_share_the_solves_that_they_have_in_common():
    chosen = readings(QUICK)
    asked = sum(1 for reading in chosen for _ in tasks_of(QUICK, reading))
    assert len(all_tasks(QUICK, chosen)) < 0.7 * asked


def test_the_full_form_has_twenty_random_scenes_with_five_masks_each_and_both_targets():
    base = next(r for r in readings(FULL) if r.base)
    trials = [cell for cell, _ in cells(FULL, base.depth)]
    scenes = Counter(cell.scene for cell in trials if cell.random)
    assert len(scenes) >= 20
    assert min(scenes.values()) >= 5
    assert {TARGET_1, TARGET_2} <= {cell.scene for cell in trials}
    assert {cell.size for cell in trials} == {128}
    assert any(r.base and r.depth.size == 256 for r in readings(FULL))


def test_another_seed_has_other_scenes():
    first, second = ({cell.scene for cell, _ in cells(c, readings(c)[0].depth) if cell.random} for c in (QUICK, ClaimsConfig.quick(seed=1)))
    assert not first & second


def test_the_test_bed_is_read_both_ways():
    assert [r.mono.masks for r in readings(FULL) if r.data == BENCH] == ["distinct", "repeated"]


@pytest.mark.parametrize(
    ("field", "value"),
    [("few_masks", 50), ("noise_e", 7.0), ("groups", (2, 3)), ("groups", (4, 1)), ("large", 128), ("size", 8), ("light_e", ())],
)
def test_a_plan_that_makes_no_sense_is_refused_by_name(field, value):
    with pytest.raises(ValueError, match=field):
        ClaimsConfig(**{field: value})

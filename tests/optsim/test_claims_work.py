"""Solves of the study of claims: blind but for the oracle, kept and found again; and the experiment from end to end."""

import json

import numpy as np
import pytest

from optsim.cube import Bands, make_cube
from optsim.report.data import BAYER, FOVEON, MONO_REPEATED
from optsim.study.claims.captures import Lit, Matched
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.curves import PHOTONS, Curves
from optsim.study.claims.methods import BlindTau, KnownNoise, OracleTau, Pursuit
from optsim.study.claims.plan import Task
from optsim.study.claims.readings import Recipe, base_recipe
from optsim.study.claims.work import kept, reference_pixels, run_task, signature
from optsim.study.claims.worlds import BENCH, TARGET_1, TARGET_2, Cell
from optsim.study.experiment import ExperimentConfig, compared, run_experiment
from optsim.study.store import Store

CONFIG = ClaimsConfig(size=32, large=None)


class Flat:
    def __init__(self, scene=TARGET_1, size=32):
        self.scene, self.size, self.bands = scene, size, Bands.paper()
        y, x, k = np.meshgrid(np.arange(size), np.arange(size), np.arange(24), indexing="ij")
        self.truth = 0.01 * (1.5 + np.sign(np.sin(y / 5) * np.sin(x / 6)) * np.cos(k / 7))
        self.cube = make_cube(self.truth, self.bands)


def no(*_):
    return None


@pytest.mark.parametrize("method", [Pursuit(), Pursuit(quality=True), BlindTau(), KnownNoise(), KnownNoise(weighted=True)])
def test_no_method_but_the_oracle_looks_at_the_truth(method):
    world = Flat()
    capture = Lit(5000.0, 1, curves=PHOTONS) if isinstance(method, KnownNoise) else Matched()
    taken = capture.take(world, BAYER, 1, 3)
    first, second = method.invert(taken, world.truth, no), method.invert(taken, np.full_like(world.truth, np.nan), no)
    assert np.array_equal(first.cube, second.cube)


def test_the_oracle_is_at_least_as_good_as_any_value_of_its_grid():
    from recon.metrics import psnr

    world = Flat()
    taken = Matched().take(world, FOVEON, 1, 3)
    blind, oracle = (m.invert(taken, world.truth, no) for m in (BlindTau(), OracleTau()))
    assert psnr(oracle.cube, world.truth) > psnr(blind.cube, world.truth) - 0.1


def test_basis_pursuit_does_not_depend_on_how_the_layers_are_scaled():
    world = Flat()
    half = Curves("half", lambda: tuple(s.with_peak_qe(0.3) for s in PHOTONS.make()))
    a, b = (Pursuit().invert(Matched(c).take(world, FOVEON, 1, 3), world.truth, no).cube for c in (PHOTONS, half))
    assert a == pytest.approx(b, abs=1e-3 * world.truth.max())


def test_a_finished_solve_is_found_and_a_damaged_one_is_done_again(tmp_path, monkeypatch):
    world, store = Flat(), Store(tmp_path)
    task = Task(Cell(TARGET_1, 0, 32), MONO_REPEATED, 1, base_recipe("matched"))
    first = run_task(CONFIG, task, world, store, no)
    assert kept(CONFIG, task)
    estimate = tmp_path / f"{task.name}.nc"
    assert estimate.exists()
    monkeypatch.setattr("optsim.study.claims.methods.Pursuit.invert", lambda *_: pytest.fail("solved again"))
    assert run_task(CONFIG, task, world, store, no) == first
    monkeypatch.undo()
    whole = estimate.read_bytes()
    estimate.write_bytes(whole[:-9])
    again = run_task(CONFIG, task, world, store, no)
    assert estimate.read_bytes() == whole
    assert again["band_psnr_db"] == first["band_psnr_db"]


def test_another_seed_does_not_find_the_old_solve(tmp_path):
    from optsim.study.claims.work import task_key

    task = Task(Cell(TARGET_1, 1, 32), BAYER, 1, Recipe(Matched(), Pursuit()))
    assert not kept(CONFIG, task)
    assert task_key(CONFIG, task) != task_key(CONFIG.model_copy(update={"seed": 1}), task)


def test_only_target_2_has_false_colour_and_only_the_test_bed_signatures(tmp_path):
    rows = {}
    for scene in (TARGET_1, TARGET_2, BENCH):
        task = Task(Cell(scene, 1, 32), FOVEON, 1, Recipe(Matched(), Pursuit()))
        rows[scene] = run_task(CONFIG, task, Flat(scene), Store(tmp_path), no)
    assert ["false_color" in rows[s] for s in rows] == [False, True, False]
    assert ["signatures" in rows[s] for s in rows] == [False, False, True]
    assert set(rows[BENCH]["signatures"]) == {"green chest", "red helmet"}


def test_a_signature_is_the_mean_of_nine_pixels_and_its_error_is_relative():
    world = Flat(BENCH)
    place = (10, 12)
    assert signature(world.truth, place) == pytest.approx(world.truth[9:12, 11:14].reshape(9, 24).mean(0))
    assert compared(1.25 * world.truth, world.truth, place)["error"] == pytest.approx(0.25)


def test_background_and_gain_of_a_signature_are_those_that_were_put_in():
    truth = Flat().truth
    place = (10, 12)
    true = signature(truth, place)
    found = compared(0.3 * true.mean() + 0.7 * truth, truth, place)
    assert (found["background"], found["gain"]) == pytest.approx((0.3, 0.7))
    exact = compared(truth, truth, place)
    assert (exact["error"], exact["background"], exact["gain"]) == pytest.approx((0, 0, 1), abs=1e-12)
    assert exact["angle_deg"] == pytest.approx(0, abs=1e-5)


def test_reference_points_lie_on_the_green_and_the_red_figure():
    chest, helmet = reference_pixels(100)["green chest"], reference_pixels(100)["red helmet"]
    assert chest[1] < 50 < helmet[1]
    assert helmet[0] < chest[0]


@pytest.mark.slow
def test_the_experiment_leaves_page_cubes_and_signatures_and_resumes(tmp_path, monkeypatch):
    config = ExperimentConfig(size=32, groups=(1,), render_error=0.1)
    found = run_experiment(config, tmp_path, quiet=True)
    told = json.loads((tmp_path / "experiment.json").read_text())
    assert len(told["rows"]) == 4
    assert set(told["signatures"]) == {"green chest", "red helmet"}
    assert all(len(s["truth"]) == 24 for s in told["signatures"].values())
    assert {p.stem for p in (tmp_path / "estimates").glob("*.nc")} == {p.stem for p in (tmp_path / "frames").glob("*.nc")}
    assert {"frames.png", "fig10bc.png", "fig11-bricks.png"} <= {p.name for p in (tmp_path / "figures").iterdir()}
    assert "Foveon" in found.page.read_text()
    green, red = (np.array(told["signatures"][p]["truth"]) for p in ("green chest", "red helmet"))
    wavelength = np.array(told["wavelength_nm"])
    assert 500 < wavelength[green.argmax()] < 560
    assert wavelength[red.argmax()] > 600
    monkeypatch.setattr("optsim.study.experiment._solve", lambda *_: pytest.fail("solved again"))
    monkeypatch.setattr("optsim.study.claims.worlds.World.fine", property(lambda self: pytest.fail("rendered again")))
    assert run_experiment(config, tmp_path, quiet=True).rows == found.rows

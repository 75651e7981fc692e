"""What a referee asks: every solve is counted once, edges and failures by sensor, and the settings are those that were run."""

from pathlib import Path

import numpy as np
import pytest

from optsim.camera import Distinct, masks_for, matched_model
from optsim.cube import Bands
from optsim.study.claims.answer import Claims
from optsim.study.claims.captures import FULL_WELL_E, Demosaiced, Lit, Matched, Physical
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.curves import PHOTONS, PUBLISHED
from optsim.study.claims.disclosure import HEADER, disclosures, edge_of, fractions_of, largest_over_mono, settings_told
from optsim.study.claims.methods import BlindTau, KnownNoise, OracleTau, Pursuit
from optsim.study.claims.plan import Task, all_tasks
from optsim.study.claims.readings import BAYER, FOVEON, MONO_DISTINCT, Recipe, readings
from optsim.study.claims.worlds import Cell

CONFIG = ClaimsConfig.quick()


def row(converged=True, iterations=9, fraction=None, edge=False):
    return {"converged": converged, "iterations": iterations, "tau_fraction": fraction, "at_edge": edge}


def claims(solved):
    return Claims(CONFIG, [], [], [], solved, Path("."), Path("."), 0.0)


def task(series, recipe, mask=0):
    return Task(Cell("color-checker", mask, 40), series, 1, recipe)


def test_every_solve_of_the_study_is_counted_once():
    tasks = all_tasks(CONFIG, readings(CONFIG))
    header, rows = disclosures(claims({t: row(fraction=1e-5) for t in tasks}))
    assert all(len(line) == len(header) for line in rows)
    assert sum(int(line[HEADER.index("solves")]) for line in rows) == len(tasks)
    assert len({tuple(line[:4]) for line in rows}) == len(rows)


def test_failures_and_edges_are_told_by_sensor():
    method = BlindTau()
    recipe = Recipe(Physical(), method)
    solved = {
        task(MONO_DISTINCT, recipe): row(iterations=10, fraction=method.fractions[1]),
        task(BAYER, recipe): row(iterations=30, fraction=method.fractions[0], edge=True),
        task(FOVEON, recipe): row(False, 500, method.fractions[-1], True),
        task(FOVEON, recipe, 1): row(True, 20, method.fractions[-1], True),
    }
    ((*_, solves, failed, least, largest, iterations),) = disclosures(claims(solved))[1]
    assert (solves, iterations) == ("4", "25, at most 500")
    assert failed == "1 (25 %: Foveon 1)"
    assert least == "2 (50 %: Foveon 2)"
    assert largest == "1 (25 %: Bayer 1)"


def test_a_solve_without_tau_has_no_edge_to_tell():
    ((*_, least, largest, _),) = disclosures(claims({task(BAYER, Recipe(Matched(), Pursuit())): row()}))[1]
    assert (least, largest) == ("–", "–")


@pytest.mark.parametrize("method", [BlindTau(), OracleTau(), KnownNoise(), KnownNoise(quality=True)])
def test_an_edge_is_the_nearer_end_of_the_methods_own_grid(method):
    grid = fractions_of(method)
    assert edge_of(row(fraction=grid[0], edge=True), grid) == "largest"
    assert edge_of(row(fraction=grid[-1], edge=True), grid) == "least"
    assert edge_of(row(fraction=grid[0]), grid) == ""


def test_different_h_of_the_same_data_stand_apart():
    recipes = [Recipe(capture, Pursuit()) for capture in (Matched(), Matched(PHOTONS), Demosaiced(Matched()), Lit(50, 1))]
    rows = disclosures(claims({task(BAYER, recipe): row() for recipe in recipes}))[1]
    assert len(rows) == 3  # curves are counted together
    assert len({line[:2] for line in rows}) == 3


def test_no_pixel_of_a_colour_sensor_outshines_mono_by_more_than_the_ratio_told():
    """Against H itself: the bound on electrons, from which it is told that none saturates."""
    size, random = (24, 24), np.random.Generator(np.random.Philox(3))
    cube = random.random((*size, 24)) ** 4
    for curves in (PHOTONS, PUBLISHED):
        frames = []
        for name in ("mono", "bayer", "foveon"):
            sensor = curves.of(name)
            masks = masks_for(sensor, 1, Distinct(), size, 5)
            frames.append(matched_model(sensor, Bands.paper(), masks).operator(np.float64).forward(cube).max())
        assert max(frames[1:]) <= largest_over_mono() * frames[0] * (1 + 1e-12)
    assert max(ClaimsConfig().light_e) * largest_over_mono() * 2 < FULL_WELL_E


def test_the_settings_told_are_those_of_the_run():
    told = " ".join(settings_told(CONFIG))
    other = " ".join(settings_told(ClaimsConfig(seed=7, render_error=0.003)))
    assert "seed, 0;" in told
    assert "procedural-1 to procedural-3" in told
    assert "5 at 40 x 40" in told
    assert "below 0.02 in every band" in told
    assert "seed, 7;" in other
    assert "procedural-7001 to procedural-7020" in other
    assert "below 0.003 in every band" in other
    for said in ("peak", "db2", "DCT", "probability 0.5", "xenon", "two-sided", "one-sided", "Holm", "weakest part", "200,000 electrons"):
        assert said in told

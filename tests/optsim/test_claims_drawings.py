"""Figures of the verdict: bulk and arrows, paired bands, one point for the same solves, and what assumed efficiencies move."""

import zlib
from types import SimpleNamespace

import numpy as np
import pytest

from optsim.camera import Bayer, Foveon
from optsim.cube import Bands
from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, MONO_REPEATED
from optsim.report.figures_claims import Curve, CurvePanel, ForestPanel, Point, figure_curves, figure_forest, limits
from optsim.report.style import styled
from optsim.study.claims.answer import Claims
from optsim.study.claims.captures import Lit
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.curves import PHOTONS, Curves
from optsim.study.claims.drawings import LINES, NAMES, budget_figure, forest, forest_panels, gaps, label, note, short
from optsim.study.claims.judge import judge
from optsim.study.claims.lines import (
    against_ratio,
    by_scene,
    centred,
    equal_time,
    gap_curve,
    light_curve,
    light_gaps,
    moved,
    series_points,
)
from optsim.study.claims.measures import Table
from optsim.study.claims.plan import tasks_of
from optsim.study.claims.readings import NOISY, readings
from optsim.study.claims.worlds import TARGET_2
from optsim.study.statistics import mean_of, paired_estimate

CONFIG = ClaimsConfig.quick()
LEVEL = {"mono-distinct": 24.0, "mono-repeated": 20.0, "bayer": 22.0, "foveon": 23.0}
PER_DECADE = {"mono": 1.0, "bayer": 2.0, "foveon": 3.0}


def value(task):
    """Invent a PSNR: a level a series, dB a decade of light for each sensor, 7 dB between scenes, a little noise."""
    random = np.random.Generator(np.random.Philox(zlib.crc32(task.name.encode())))
    capture = task.recipe.capture
    light = PER_DECADE[task.series.sensor] * np.log10(capture.electrons) if isinstance(capture, Lit) else 8.0
    scene = 7.0 * int(task.cell.scene[-1]) if task.cell.random else 0.0
    return float(LEVEL[task.series.key] + light + scene + 0.02 * random.standard_normal())


def row(task):
    made = {"psnr_db": value(task), "converged": True, "iterations": 9, "tau_fraction": None, "at_edge": False}
    made["band_psnr_db"] = [made["psnr_db"]] * 24
    if task.cell.scene == TARGET_2:
        made["false_color"] = 10.0 + task.cell.mask
    made["signatures"] = {p: {"error": 0.1 + task.cell.mask / 50, "background": 0.1, "gain": 1.0} for p in ("green chest", "red helmet")}
    return made


@pytest.fixture(scope="module")
def tables():
    found = []
    for reading in readings(CONFIG):
        rows = {(t.cell.scene, t.cell.mask, t.groups, t.series.sensor): row(t) for t in tasks_of(CONFIG, reading)}
        found.append(Table(reading, CONFIG.size, rows))
    return found


@pytest.fixture(scope="module")
def found(tables, tmp_path_factory):
    folder = tmp_path_factory.mktemp("claims")
    return Claims(CONFIG, judge(tables, 0), [], tables, {}, folder, folder / "page.html", 0.0)


@pytest.fixture(autouse=True)
def _style():
    with styled():
        yield


def drawn_axes(monkeypatch):
    """Catch the figures instead of writing them."""
    figures = []

    def keep(figure, directory, name):
        figures.append(figure)
        return directory / f"{name}.png", directory / f"{name}.pdf"

    monkeypatch.setattr("optsim.report.figures_claims.save", keep)
    return figures


def at(mean, half=0.2, key="bayer", **more):
    return Point(mean, mean - half, mean + half, key, **more)


def test_the_axis_holds_the_bulk_and_the_claimed_range_whatever_a_few_readings_do():
    bulk = [at(m) for m in np.linspace(0.5, 2, 12)]
    calm = limits(bulk, (0.5, 1.5))
    assert limits([*bulk, at(34.0), at(-50.0, 20.0)], (0.5, 1.5)) == pytest.approx(calm, abs=1.0)
    assert calm[0] < 0 < 2.2 < calm[1]
    left, right = limits(bulk, (9.0, 11.0))
    assert left < 0
    assert right > 11


def test_what_lies_beyond_the_axis_is_an_arrow_with_its_number_and_a_cut_interval_ends_in_a_head(monkeypatch, tmp_path):
    figures = drawn_axes(monkeypatch)
    points = {f"r{i}": [at(m)] for i, m in enumerate(np.linspace(0.5, 2, 8))}
    points |= {"far": [at(34.0)], "low": [at(-50.0)], "wide": [at(1.0, 40.0)], "near": [at(-7.25)]}
    figure_forest([ForestPanel("t", points, None)], list(points), {"bayer": "b"}, tmp_path, "n", "t", "c")
    (ax,) = figures[0].axes
    assert {text.get_text() for text in ax.texts} == {"+34", "−50", "−7.2"}
    marks = [(line.get_marker(), float(line.get_ydata()[0])) for line in ax.lines if len(line.get_xdata()) == 1]
    y = {name: i for i, name in enumerate(points)}
    for name, markers in (("far", {">"}), ("low", {"<"}), ("near", {"<"}), ("wide", {"<", ">", "s"}), ("r0", {"s"})):
        assert {m for m, place in marks if place == y[name]} == markers


def test_random_scenes_have_no_claimed_range_and_say_whose_question_they_are(found, monkeypatch):
    figures = drawn_axes(monkeypatch)
    captions = [forest(found, place, place, found.folder).caption for place in ("target1", "scenes")]
    assert "Yellow" in captions[0]
    assert "our own question" in captions[1]
    assert "Yellow" not in captions[1]
    assert [len(figure.axes[0].patches) for figure in figures] == [1, 0]
    assert all(LINES in caption for caption in captions)


def test_the_same_solves_under_several_budgets_are_one_point(found):
    rows = [r for r in gaps(found, "target1") if r.reading.data == NOISY]
    notes = {(r.claim.ident, r.reading.mono.masks, note(r)) for r in rows if note(r)}
    assert ("target1-foveon-bayer", "distinct", "A, B, C, F") in notes
    assert ("target1-bayer-mono", "repeated", "B, F") in notes
    assert ("target1-foveon-mono", "repeated", "B, E, F") in notes
    panels, _ = forest_panels(rows, "target1", lambda r: short(r.reading))
    last = [p for points in panels[2].points.values() for p in points]
    assert len(last) == len({r.estimate.mean for r in rows if r.claim.ident == "target1-foveon-bayer"})
    assert {p.key for p in last} == {"foveon"}  # without mono there is no mono's mask to tell
    assert set(NAMES) >= {p.key for panel in panels for points in panel.points.values() for p in points}


def test_shots_are_told_where_they_are_not_three_of_mono_and_one_of_colour(found):
    labels = {label(r, CONFIG.size) for r in gaps(found, "target1")}
    assert "noise: A equal masks, 5000 e, shots 1 / 1 / 1" in labels
    assert "noise: E equal scalars, 5000 e, shots 3 / 3 / 1" in labels
    assert "noise: C equal time, 5000 e" in labels
    assert "matched: BASE" in labels


def test_centring_keeps_the_means_and_takes_off_what_all_series_share():
    random = np.random.Generator(np.random.Philox(1))
    trials = [(f"s{i}", m) for i in range(8) for m in range(2)]
    scene = {s: 10 * random.standard_normal() for s, _ in trials}
    values = {
        series: {t: LEVEL[series.key] + scene[t[0]] + 0.1 * random.standard_normal() for t in trials}
        for series in (MONO_DISTINCT, MONO_REPEATED, BAYER, FOVEON)
    }
    out = centred(values)
    for series, before in values.items():
        assert mean_of(by_scene(out[series])) == pytest.approx(mean_of(by_scene(before)))
        assert np.std(list(out[series].values())) < 0.2
    for trial in trials:
        assert sum(v[trial] for v in out.values()) == pytest.approx(4 * np.mean([mean_of(by_scene(v)) for v in values.values()]))


def test_bands_of_random_scenes_are_those_of_paired_values_and_bands_of_targets_are_not(tables):
    level = equal_time(SimpleNamespace(tables=tables))[5000.0]
    paired = series_points(level, (), 1, 0)
    assert set(paired) == {MONO_DISTINCT, MONO_REPEATED, BAYER, FOVEON}
    plain = paired_estimate(by_scene({(s, m): v for s in level[0].random_scenes for m, v in _psnr(level[0], s).items()}), 0)
    point = paired[FOVEON]
    assert point.mean == pytest.approx(plain.mean)
    assert point.high - point.low < 0.2 * (plain.high - plain.low)
    target = series_points(level, (TARGET_2,), 1, 0)[FOVEON]
    own = paired_estimate({TARGET_2: list(_psnr(level[0], TARGET_2).values())}, 0)
    assert (target.mean, target.low, target.high) == pytest.approx((own.mean, own.low, own.high))


def _psnr(table, scene):
    return table.values(scene, 1, "foveon", lambda r: r["psnr_db"])


def test_a_curve_moved_by_a_factor_on_its_light_is_read_over_log_electrons_and_stops_at_its_ends():
    levels, values = [100.0, 1000.0, 10000.0], [10.0, 20.0, 26.0]
    low, high = moved(levels, values, 1000.0)
    assert low == pytest.approx(20 + 10 * np.log10(0.7))
    assert high == pytest.approx(20 + 6 * np.log10(1.3))
    assert moved(levels, values, 100.0) == pytest.approx((10.0, 10 + 10 * np.log10(1.3)))
    assert moved(levels, values, 10000.0) == pytest.approx((26 + 6 * np.log10(0.7), 26.0))
    assert moved([100.0, 110.0, 120.0], [1.0, 9.0, 2.0], 100.0)[1] == 9.0  # a peak between the ends of the sweep


def test_gaps_move_with_the_colour_sensors_efficiency_alone_and_both_do_where_both_are_colour(tables):
    levels = equal_time(SimpleNamespace(tables=tables))
    curve = gap_curve(levels, BAYER, MONO_DISTINCT, (), 0, "")
    x, point = curve.points[1]
    low, high = curve.around[1]
    assert x == 5000.0
    assert (low - point.mean, high - point.mean) == pytest.approx((2 * np.log10(0.7), 2 * np.log10(1.3)), abs=0.02)
    both = gap_curve(levels, FOVEON, BAYER, (), 0, "")
    down, up = (end - both.points[1][1].mean for end in both.around[1])
    assert down == pytest.approx(3 * np.log10(0.7) - 2 * np.log10(1.3), abs=0.03)
    assert up == pytest.approx(3 * np.log10(1.3) - 2 * np.log10(0.7), abs=0.03)


def test_gaps_against_light_are_the_judges(found, tables):
    levels = equal_time(found)
    for above, ident in ((BAYER, "scenes-bayer-mono"), (FOVEON, "scenes-foveon-mono")):
        curve = gap_curve(levels, above, MONO_DISTINCT, (), 0, "")
        judged = {
            r.estimate.mean
            for r in gaps(found, "scenes")
            if r.claim.ident == ident and r.reading.mono == MONO_DISTINCT and "C equal time" in r.reading.change
        }
        assert {p.mean for _, p in curve.points} == judged


@pytest.mark.parametrize("series", [BAYER, FOVEON])
@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_a_factor_on_a_colour_sensors_efficiency_is_a_factor_on_its_light(series, factor):
    """What the bands around the gaps rest on: the very same frames and H."""

    def scaled():
        mono, bayer, foveon = PHOTONS.make()
        times = [[c.scaled(factor) for c in sensor.curves] for sensor in (bayer, foveon)]
        names = ("red", "green", "blue")
        return mono, bayer.model_copy(update=dict(zip(names, times[0]))), foveon.model_copy(update=dict(zip(names, times[1])))

    random = np.random.Generator(np.random.Philox(2))
    world = SimpleNamespace(bands=Bands.paper(), size=16, truth=random.random((16, 16, 24)))
    better = Lit(5000.0, 1, curves=Curves("scaled", scaled)).take(world, series, 1, 7)
    brighter = Lit(5000.0 * factor, 1, curves=PHOTONS).take(world, series, 1, 7)
    plain = Lit(5000.0, 1, curves=PHOTONS).take(world, series, 1, 7)
    assert np.array_equal(better.signal, brighter.signal)
    assert not np.array_equal(better.signal, plain.signal)
    assert np.array_equal(better.variance, brighter.variance)
    cube = world.truth.astype(np.float32)
    assert better.operator.forward(cube) == pytest.approx(brighter.operator.forward(cube), rel=1e-5)
    assert isinstance(Curves("scaled", scaled).of("bayer"), Bayer)
    assert isinstance(Curves("scaled", scaled).of("foveon"), Foveon)


def test_every_figure_is_drawn_and_its_caption_says_what_it_assumes(found, monkeypatch):
    figures = drawn_axes(monkeypatch)
    shown = light_gaps(found, found.folder)
    for said in ("last 0 s", "times 0.7 to 1.3", "assumed", "dark current", "budget D", "nothing was run", "200,000", "Random scenes"):
        assert said in shown.caption
    axes = figures[0].axes
    assert len(axes) == 9  # three pairs on three kinds of scene
    assert "Foveon − Bayer" in axes[6].get_ylabel()
    light = light_curve(found, found.folder)
    assert "Cousineau" in light.caption
    assert figures[1].axes[0].get_ylabel() == "PSNR, dB"
    assert figures[1]._supxlabel.get_text() == "electrons in the brightest pixel of one monochrome shot at full exposure"
    assert against_ratio(found, found.folder) is not None
    for place in ("target1", "target2", "scenes"):
        assert "other shots" in budget_figure(found, place, place, found.folder).caption


def test_a_study_without_noise_has_no_curve_against_light(found):
    quiet = Claims(CONFIG, [], [], [t for t in found.tables if t.reading.data != NOISY], {}, found.folder, found.page, 0.0)
    assert light_gaps(quiet, found.folder) is None
    assert light_curve(quiet, found.folder) is None
    assert forest(quiet, "target1", "Target 1", found.folder) is None


def test_a_scene_that_was_not_run_leaves_no_empty_diagram(monkeypatch, tmp_path):
    figures = drawn_axes(monkeypatch)
    rows = [[CurvePanel("a", [Curve("bayer", "Bayer", [(1.0, at(1.0))])], "dB"), CurvePanel("b", [Curve("bayer", "Bayer", [])], "dB")]]
    assert figure_curves(rows, tmp_path, "n", "t", "c", x_label="x") is not None
    assert [ax.get_title(loc="left") for ax in figures[0].axes] == ["a"]

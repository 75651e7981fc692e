"""The figures of the verdict: readings side by side, gaps against R, scores against light, and the paper's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from optsim.camera.budgets import EqualTime
from optsim.report import figures_target
from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, MONO_REPEATED, Row, RunData, Series, Solve
from optsim.report.figures_claims import Curve, CurvePanel, ForestPanel, Point, figure_curves, figure_forest
from optsim.report.gallery import Gallery
from optsim.report.select import Recipe as Shown
from optsim.report.style import Drawn, styled
from optsim.study.claims.answer import Claims
from optsim.study.claims.judge import Judged
from optsim.study.claims.measures import Table, psnr
from optsim.study.claims.plan import Task, tasks_of
from optsim.study.claims.readings import MATCHED, NOISY, PHYSICAL, Reading
from optsim.study.claims.truths import truth_of
from optsim.study.claims.worlds import TARGET_1, TARGET_2
from optsim.study.plan import BANDS, MONO_SHOTS_PER_GROUP
from optsim.study.statistics import paired_estimate
from optsim.study.store import Store

PLACES = (("target1", "Target 1"), ("target2", "Target 2"), ("scenes", "Random scenes"))
PAIRS = (("bayer-mono", "Bayer − mono"), ("foveon-mono", "Foveon − mono"), ("foveon-bayer", "Foveon − Bayer"))


def draw(found: Claims, store: Store) -> list[tuple[str, list[Drawn]]]:
    """Draw everything that was run, by heading."""
    folder = found.folder / "figures"
    with styled():
        forests = [forest(found, place, words, folder) for place, words in PLACES]
        light = [light_curve(found, folder), *(light_gaps(found, mono, folder) for mono in (MONO_DISTINCT, MONO_REPEATED))]
        light += [*(budget_figure(found, place, words, folder) for place, words in PLACES)]
        shots = [against_ratio(found, folder)]
        groups: list[tuple[str, Sequence[Drawn | None]]] = [
            ("Every reading", forests),
            ("Against light", light),
            ("Against the compression ratio", shots),
        ]
        for data in (MATCHED, PHYSICAL):
            groups.append((f"The paper’s figures under the base readings, {data} data", paper_figures(found, store, data, folder / data)))
    return [(heading, [d for d in drawn if d is not None]) for heading, drawn in groups]


def forest(found: Claims, place: str, words: str, folder: Path) -> Drawn | None:
    """Draw the three gaps at R = 1/8 under every reading, both readings of mono on one line; noise at one level only."""
    level = f"{found.config.noise_e:g} electrons"
    rows = [r for r in gaps(found, place) if r.reading.data != NOISY or level in r.reading.change]
    caption = (
        f"{words} at R = 1/8: mean paired difference of PSNR with its 95 % interval under every reading; yellow: what the paper claims. "
        "Blue: monochrome’s three shots with three masks; light blue: with one mask. A pair that a reading does not touch is left out."
    )
    panels, labels = forest_panels(rows, place, lambda row: label(row, found.config.size))
    return figure_forest(panels, labels, folder, f"readings-{place}", f"Every reading: {words.lower()}", caption)


def gaps(found: Claims, place: str) -> list[Judged]:
    """Return the rows about gaps at R = 1/8 on a target or the random scenes, in the order of the readings."""
    named = {f"{place}-{pair}" for pair, _ in PAIRS}
    return [r for r in found.rows if r.claim.ident in named and r.groups == 1]


def forest_panels(rows: Sequence[Judged], place: str, name: Callable[[Judged], str]) -> tuple[list[ForestPanel], list[str]]:
    """Return a panel for each gap, and the labels from top to bottom: matched, physical, noise, each base first."""
    panels = []
    for pair, title in PAIRS:
        mine = [r for r in rows if r.claim.ident == f"{place}-{pair}"]
        points: dict[str, list[Point]] = {}
        for row in mine:
            points.setdefault(name(row), []).append(point(row))
        if mine:
            panels.append(ForestPanel(title, points, (mine[0].claim.size.low, mine[0].claim.size.high)))
    ranked = sorted(rows, key=lambda r: (r.reading.data == NOISY, r.reading.data == PHYSICAL, not r.reading.base))
    return panels, list(dict.fromkeys(name(row) for row in ranked))


def label(row: Judged, size: int) -> str:
    """Write a reading without its mask rule."""
    reading, large = row.reading, row.where.rsplit(", ", 1)[-1]
    data = "noise" if reading.data == NOISY else reading.data
    name = f"{data}: BASE" if reading.base else f"{data}: {short(reading.change)}"
    return name if large == f"{size} x {size}" else f"{name}, {large}"


def short(change: str) -> str:
    """Write a change in few words."""
    return change.removeprefix("budget ").replace(" in every sensor's brightest pixel", "").replace(" of the responses", "")


def point(row: Judged) -> Point:
    """Return a row as a point in the colour of its reading of mono."""
    return Point(row.estimate.mean, row.estimate.low, row.estimate.high, row.reading.mono.key)


def light_curve(found: Claims, folder: Path) -> Drawn | None:
    """Draw PSNR of the three sensors against light at equal total time (budget C)."""
    panels = []
    tables = [t for t in found.tables if t.reading.data == NOISY and EqualTime.name in t.reading.change]
    for words, scenes in (("target 1", (TARGET_1,)), ("target 2", (TARGET_2,)), ("random scenes", None)):
        curves = []
        for series in (MONO_DISTINCT, MONO_REPEATED, BAYER, FOVEON):
            points = {electrons(t.reading): p for t in tables if (p := level_of(t, series, scenes, found.config.seed)) is not None}
            curves.append(Curve(series.key, series.label, sorted(points.items())))
        panels.append(CurvePanel(words, curves))
    caption = (
        "PSNR at R = 1/8 against light when all sensors have the same total time (three monochrome shots share the exposure of "
        "one colour "
        "shot): brightest pixel of one monochrome shot of the full exposure. Efficiencies are assumed (mono and Bayer 0.5 at "
        "their peaks, the Foveon’s layers "
        "together 0.6). Bands: 95 % over masks (targets) or scenes."
    )
    return figure_curves(
        panels, folder, "light", "Foveon, Bayer and mono against light at equal total time", caption, x_label="electrons", log=True
    )


def level_of(table: Table, series: Series, scenes: tuple[str, ...] | None, seed: int) -> Point | None:
    """Return the mean PSNR of a series under one reading, or None where the reading is not about it."""
    if series.sensor == "mono" and series != table.reading.mono:
        return None
    values = {s: list(table.values(s, 1, series.sensor, psnr).values()) for s in scenes or table.random_scenes}
    values = {s: v for s, v in values.items() if v}
    if not values:
        return None
    e = paired_estimate(values, seed)
    return Point(e.mean, e.low, e.high, series.key)


def electrons(reading: Reading) -> float:
    """Return the level of light of a reading with noise."""
    capture = reading.recipes["bayer"].capture
    return float(capture.electrons)  # type: ignore[attr-defined]


def light_gaps(found: Claims, mono: Series, folder: Path) -> Drawn | None:
    """Draw the three gaps against light at equal total time, for one reading of mono."""
    panels = []
    for place, words in PLACES:
        curves = []
        for pair, key, words_pair in (("bayer-mono", BAYER.key, "Bayer − mono"), ("foveon-mono", FOVEON.key, "Foveon − mono")):
            rows = [r for r in gaps(found, place) if r.claim.ident == f"{place}-{pair}" and r.reading.mono == mono]
            rows = [r for r in rows if r.reading.data == NOISY and r.reading.change.startswith(f"budget {EqualTime.name}")]
            points = [(electrons(r.reading), Point(r.estimate.mean, r.estimate.low, r.estimate.high, key)) for r in rows]
            curves.append(Curve(key, words_pair, sorted(points, key=lambda p: p[0])))
        panels.append(CurvePanel(words.lower(), curves))
    masks = {"distinct": "three masks", "repeated": "one mask"}[mono.masks]
    caption = f"The colour sensors over mono, whose three shots have {masks} and together the time of one colour shot; R = 1/8, paired."
    title = f"Gaps against light at equal total time, mono with {masks}"
    return figure_curves(panels, folder, f"light-gaps-{mono.masks}", title, caption, x_label="electrons", log=True)


def budget_figure(found: Claims, place: str, words: str, folder: Path) -> Drawn | None:
    """Draw the three gaps under all budgets at all their levels."""
    rows = [r for r in gaps(found, place) if r.reading.data == NOISY and "," not in _after_level(r.reading.change)]
    rows = sorted(rows, key=lambda r: (r.reading.change[:9], electrons(r.reading)))
    caption = (
        f"{words} at R = 1/8 under the light budgets A to F: mean paired difference of PSNR with its 95 % interval; yellow: "
        "what the paper claims."
    )
    panels, labels = forest_panels(rows, place, lambda row: short(row.reading.change))
    return figure_forest(panels, labels, folder, f"budgets-{place}", f"Light budgets: {words.lower()}", caption)


def _after_level(change: str) -> str:
    return change.split(" electrons", 1)[-1]


def against_ratio(found: Claims, folder: Path) -> Drawn | None:
    """Draw PSNR of the matched base against R on both targets and the random scenes."""
    tables = [t for t in found.tables if t.reading.base and t.reading.data == MATCHED and t.size == found.config.size]
    panels = []
    for words, scenes in (("target 1", (TARGET_1,)), ("target 2", (TARGET_2,)), ("random scenes", None)):
        curves = []
        for series in (MONO_DISTINCT, MONO_REPEATED, BAYER, FOVEON):
            points: dict[float, Point] = {}
            for table in tables:
                if series.sensor == "mono" and series != table.reading.mono:
                    continue
                for groups in sorted({g for s in scenes or table.random_scenes for g in table.groups(s)}):
                    values = {s: list(table.values(s, groups, series.sensor, psnr).values()) for s in scenes or table.random_scenes}
                    e = paired_estimate(values, found.config.seed)
                    points[MONO_SHOTS_PER_GROUP * groups / BANDS] = Point(e.mean, e.low, e.high, series.key)
            curves.append(Curve(series.key, series.label, sorted(points.items())))
        panels.append(CurvePanel(words, curves))
    caption = "Mean PSNR over bands of the matched base (basis pursuit) against R, with 95 % intervals over masks (targets) or scenes."
    return figure_curves(panels, folder, "against-ratio", "PSNR against the compression ratio", caption, x_label="compression ratio R")


def paper_figures(found: Claims, store: Store, data: str, folder: Path) -> list[Drawn | None]:
    """Draw Fig. 5, 6, 7 and 11 under the bases of one kind of data: both readings of mono stand in each."""
    run, shown = run_data(found, store, data)
    gallery = Gallery(run, shown)
    drawn: list[Drawn | None] = []
    for number, target in ((5, TARGET_1), (6, TARGET_2)):
        drawn.append(figures_target.figure_scene(gallery, target, number, target != TARGET_1, folder))
    for target in (TARGET_1, TARGET_2):
        drawn.append(figures_target.figure_errors(gallery, target, f"fig07-{target}", folder))
        drawn.append(figures_target.figure_single_shot(gallery, target, f"fig11-{target}", folder))
    return [None if d is None else replace(d, name=f"{data}-{d.name}", title=f"{d.title}, {data} data") for d in drawn]


def run_data(found: Claims, store: Store, data: str) -> tuple[RunData, Shown]:
    """Gather the base's rows of the targets at their largest size, as the report reads them."""
    size = found.config.large or found.config.size
    how = ("unit-shift", "basis-pursuit", None) if data == MATCHED else ("camera", "admm", "auto")
    shown = Shown(data, *how)
    tables = [t for t in found.tables if t.reading.base and t.reading.data == data and t.size == size]
    tasks = {t: None for table in tables for t in tasks_of(found.config, table.reading) if t.cell.scene in (TARGET_1, TARGET_2)}
    rows = []
    by_solve: dict[Solve, Task] = {}
    for task in tasks:
        row = _row(task, found, shown)
        rows.append(row)
        by_solve[Row.from_mapping(row).solve] = task

    def estimate(solve: Solve) -> object:
        task = by_solve.get(solve)
        path = None if task is None else store.path(task.name)
        return None if path is None or not path.exists() or task is None else store.load(f"{task.name}.nc")["radiance"].values

    truths = {target: truth_of(found.config, target, size, store) for target in (TARGET_1, TARGET_2)}
    return RunData(summary={"rows": rows}, truths=truths, estimate=estimate), shown  # type: ignore[arg-type]


def _row(task: Task, found: Claims, shown: Shown) -> Mapping[str, object]:
    solved = found.solved[task]
    return {
        "target": task.cell.scene,
        "sensor": task.series.sensor,
        "masks": task.series.masks,
        "R": MONO_SHOTS_PER_GROUP * task.groups / BANDS,
        "shots": task.groups * (MONO_SHOTS_PER_GROUP if task.series.sensor == "mono" else 1),
        "model": shown.model,
        "operator": shown.operator,
        "solver": shown.solver,
        "tau": None,
        "tau_rule": shown.tau_rule,
        "seed": task.cell.mask,
        "stop": "",
        **{name: solved[name] for name in ("psnr_db", "ssim", "sam_deg", "seconds", "iterations", "converged")},
    }

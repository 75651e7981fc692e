"""The figures of the verdict: readings side by side, gaps against R, scores against light, and the paper's own."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from optsim.report import figures_target
from optsim.report.data import FOVEON, MONO_DISTINCT, MONO_REPEATED, Row, RunData, Solve
from optsim.report.figures_claims import ForestPanel, Point, figure_forest
from optsim.report.gallery import Gallery
from optsim.report.select import Recipe as Shown
from optsim.report.style import Drawn, styled
from optsim.study.claims.answer import Claims
from optsim.study.claims.captures import Lit
from optsim.study.claims.judge import Judged
from optsim.study.claims.lines import against_ratio, electrons, light_curve, light_gaps
from optsim.study.claims.paper import ANY
from optsim.study.claims.plan import Task, tasks_of
from optsim.study.claims.readings import MATCHED, NOISY, PHYSICAL, SENSORS, Reading
from optsim.study.claims.truths import truth_of
from optsim.study.claims.worlds import TARGET_1, TARGET_2
from optsim.study.plan import BANDS, ratio_of, shots_of
from optsim.study.store import Store

USUAL = tuple(shots_of(sensor, 1) for sensor in SENSORS)
"""Shots of mono, Bayer and Foveon at R = 1/8."""
PLACES = (("target1", "Target 1"), ("target2", "Target 2"), ("scenes", "Random scenes"))
PAIRS = (("bayer-mono", "Bayer − mono"), ("foveon-mono", "Foveon − mono"), ("foveon-bayer", "Foveon − Bayer"))
NAMES = {
    MONO_DISTINCT.key: "against mono’s three shots with three masks",
    MONO_REPEATED.key: "against mono’s three shots with one mask",
    FOVEON.key: "Foveon against Bayer",
}
"""What a point of a forest compares, by its colour."""
LINES = (
    "A pair that a reading does not touch is left out. Each axis holds the bulk of the readings: an arrow with a number is a mean beyond "
    "it, an arrow head at the end of a line an interval that goes on."
)
BUDGET = re.compile(r"budget ([A-F]) ")


def draw(found: Claims, store: Store) -> list[tuple[str, list[Drawn]]]:
    """Draw everything that was run, by heading."""
    folder = found.folder / "figures"
    with styled():
        forests = [forest(found, place, words, folder) for place, words in PLACES]
        light = [light_gaps(found, folder), light_curve(found, folder)]
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
    """Draw the three gaps for one colour shot under every reading, both readings of mono on one line; noise at one level only."""
    level = f" {found.config.noise_e:g} electrons"
    rows = [r for r in gaps(found, place) if r.reading.data != NOISY or level in r.reading.change]
    caption = (
        f"{words}: mean paired difference of PSNR with its 95 % interval under every reading, R = 1/8 (one colour shot, three of mono) "
        f"unless the label gives other shots (mono / Bayer / Foveon). {claimed_words(rows)} {LINES} {same_words(rows)}"
    )
    panels, labels = forest_panels(rows, place, lambda row: label(row, found.config.size))
    return figure_forest(panels, labels, NAMES, folder, f"readings-{place}", f"Every reading: {words.lower()}", caption.strip())


def gaps(found: Claims, place: str) -> list[Judged]:
    """Return the rows about gaps for one colour shot on a target or the random scenes, in the order of the readings."""
    named = {f"{place}-{pair}" for pair, _ in PAIRS}
    return [r for r in found.rows if r.claim.ident in named and r.groups == 1]


def claimed_words(rows: Sequence[Judged]) -> str:
    """Say what is shaded."""
    if any(row.claim.size != ANY for row in rows):
        return "Yellow: the size that the paper claims."
    return "What happens on scenes at large is our own question, not the paper’s: no size is claimed and none is shaded."


def same_words(rows: Sequence[Judged]) -> str:
    """Say how the same solves under several readings are drawn."""
    return "Letters beside a point: these light budgets let the compared sensors make the same solves, so they are one point." * any(
        row.alike for row in rows
    )


def forest_panels(rows: Sequence[Judged], place: str, name: Callable[[Judged], str]) -> tuple[list[ForestPanel], list[str]]:
    """Return a panel for each gap, and the labels from top to bottom: matched, physical, noise, each base first."""
    panels = []
    for pair, title in PAIRS:
        mine = [r for r in rows if r.claim.ident == f"{place}-{pair}"]
        points: dict[str, list[Point]] = {}
        for row in mine:
            points.setdefault(name(row), []).append(point(row))
        if mine:
            size = mine[0].claim.size
            panels.append(ForestPanel(title, points, None if size == ANY else (size.low, size.high)))
    ranked = sorted(rows, key=lambda r: (r.reading.data == NOISY, r.reading.data == PHYSICAL, not r.reading.base))
    return panels, list(dict.fromkeys(name(row) for row in ranked))


def label(row: Judged, size: int) -> str:
    """Write a reading without its mask rule."""
    reading, large = row.reading, row.where.rsplit(", ", 1)[-1]
    data = "noise" if reading.data == NOISY else reading.data
    name = f"{data}: BASE" if reading.base else f"{data}: {short(reading)}"
    return name if large == f"{size} x {size}" else f"{name}, {large}"


def short(reading: Reading) -> str:
    """Write a change in few words; shots of the three sensors where they are not three of mono and one of each colour sensor."""
    change = reading.change.removeprefix("budget ").replace(" of the responses", "")
    change = change.replace(" in every sensor's brightest pixel", " in each").replace(" electrons", " e")
    shots = lit_shots(reading)
    return change if shots in (None, USUAL) else f"{change}, shots {' / '.join(map(str, shots or ()))}"


def lit_shots(reading: Reading) -> tuple[int, ...] | None:
    """Return the shots of mono, Bayer and Foveon under a light budget; None for other readings."""
    captures = [reading.recipes[sensor].capture for sensor in SENSORS]
    return tuple(c.shots for c in captures if isinstance(c, Lit)) or None


def point(row: Judged) -> Point:
    """Return a row as a point in the colour of what it compares, with the light budgets that share its solves."""
    key = row.reading.mono.key if "mono" in row.claim.measure.sensors else FOVEON.key
    return Point(row.estimate.mean, row.estimate.low, row.estimate.high, key, note(row))


def note(row: Judged) -> str:
    """Write which readings have the same solves: letters of light budgets."""
    letters = [found[1] for change in (row.reading.change, *row.alike) if (found := BUDGET.match(change))]
    return ", ".join(letters) if len(letters) > 1 else ""


def budget_figure(found: Claims, place: str, words: str, folder: Path) -> Drawn | None:
    """Draw the three gaps under all budgets at all their levels."""
    rows = [r for r in gaps(found, place) if r.reading.data == NOISY and "," not in _after_level(r.reading.change)]
    rows = sorted(rows, key=lambda r: (r.reading.change[:9], electrons(r.reading)))
    caption = (
        f"{words} under the light budgets A to F: mean paired difference of PSNR with its 95 % interval. One colour shot and three of "
        "mono (R = 1/8) unless the label gives other shots (mono / Bayer / Foveon; R is "
        f"shots / {BANDS} for mono, three times that for colour). "
        f"{claimed_words(rows)} {LINES} {same_words(rows)}"
    )
    panels, labels = forest_panels(rows, place, lambda row: short(row.reading))
    return figure_forest(panels, labels, NAMES, folder, f"budgets-{place}", f"Light budgets: {words.lower()}", caption.strip())


def _after_level(change: str) -> str:
    return change.split(" electrons", 1)[-1]


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
        "R": ratio_of(task.groups),
        "shots": shots_of(task.series.sensor, task.groups),
        "model": shown.model,
        "operator": shown.operator,
        "solver": shown.solver,
        "tau": None,
        "tau_rule": shown.tau_rule,
        "seed": task.cell.mask,
        "stop": "",
        **{name: solved[name] for name in ("psnr_db", "ssim", "sam_deg", "seconds", "iterations", "converged")},
    }

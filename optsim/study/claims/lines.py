"""Curves of the verdict: scores and gaps against light at equal total time, and scores against R."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from optsim.camera.absolute import AssumedEfficiencies
from optsim.camera.budgets import EqualTime
from optsim.report.data import BAYER, FOVEON, MONO_DISTINCT, MONO_REPEATED, SERIES, Series
from optsim.report.figures_claims import Curve, CurvePanel, Point, figure_curves
from optsim.report.style import Drawn
from optsim.study.claims.answer import Claims
from optsim.study.claims.captures import FULL_WELL_E, Lit
from optsim.study.claims.measures import Table, psnr
from optsim.study.claims.readings import MATCHED, NOISY, SENSOR_WORDS, Reading
from optsim.study.claims.worlds import TARGET_1, TARGET_2
from optsim.study.plan import ratio_of
from optsim.study.statistics import Estimate, mean_of, paired_estimate

Values = dict[tuple[str, int], float]
"""(scene, mask) -> value."""

PLACES: tuple[tuple[str, tuple[str, ...]], ...] = (("target 1", (TARGET_1,)), ("target 2", (TARGET_2,)), ("random scenes", ()))
"""Words and scenes; none: the random ones."""
ELECTRONS = "electrons in the brightest pixel of one monochrome shot at full exposure"
SWEPT = (0.7, 1.3)
"""Factors on assumed efficiencies."""
PAIRED_WORDS = (
    "On random scenes the bands are for comparing the sensors with each other: in every trial the mean of the four series is taken "
    "off first (Cousineau 2005, with Morey’s factor of 2008), for the scenes themselves differ far more (standard deviation {:.1f} dB)."
)


def light_curve(found: Claims, folder: Path) -> Drawn | None:
    """Draw PSNR of the sensors against light at equal total time (budget C)."""
    levels = equal_time(found)
    panels = [scores_panel(words, scenes, levels, 1, found.config.seed) for words, scenes in PLACES]
    caption = (
        "PSNR against light when all sensors have the same total time: three monochrome shots share the exposure of one colour shot "
        f"(R = 1/8). {assumed()} Bands: 95 % over masks (targets). {paired_words(levels, 1)}"
    )
    title = "Foveon, Bayer and mono against light at equal total time"
    return figure_curves([panels], folder, "light", title, caption, x_label=ELECTRONS, log=True)


def against_ratio(found: Claims, folder: Path) -> Drawn | None:
    """Draw PSNR of the matched base against R on both targets and the random scenes."""
    tables = [t for t in found.tables if t.reading.base and t.reading.data == MATCHED and t.size == found.config.size]
    groups = sorted({g for table in tables for scene in table.scenes for g in table.groups(scene)})
    panels = []
    for words, scenes in PLACES:
        points = {g: series_points(tables, scenes, g, found.config.seed) for g in groups}
        panels.append(CurvePanel(words, curves_of({ratio_of(g): p for g, p in points.items()}), "PSNR, dB"))
    caption = (
        "Mean PSNR over bands of the matched base (basis pursuit) against R. Bands: 95 % over masks (targets). "
        f"{paired_words({0.0: tables}, 1)}"
    )
    return figure_curves([panels], folder, "against-ratio", "PSNR against the compression ratio", caption, x_label="compression ratio R")


def light_gaps(found: Claims, folder: Path) -> Drawn | None:
    """Draw Foveon - Bayer - mono against light at equal total time, with what the assumed efficiencies leave open."""
    levels = equal_time(found)
    monos = ((MONO_DISTINCT, "against mono with three masks"), (MONO_REPEATED, "against mono with one mask"))
    rows = [
        gap_panels(levels, above, below, found.config.seed)
        for above, below in ((BAYER, monos), (FOVEON, monos), (FOVEON, ((BAYER, "against Bayer"),)))
    ]
    title = "Foveon − Bayer − mono against light at equal total time"
    return figure_curves(rows, folder, "light-gaps", title, gaps_caption(levels, rows), x_label=ELECTRONS, log=True)


def gap_panels(
    levels: Mapping[float, Sequence[Table]], above: Series, below: Sequence[tuple[Series, str]], seed: int
) -> list[CurvePanel]:  # fmt: skip
    """Return how far a series lies above others (with words for the legend): a diagram for each target and the random scenes."""
    other = SENSOR_WORDS[below[0][0].sensor]
    name = f"{above.label} − {other}, dB\n← {other} better    {above.label} better →"
    return [CurvePanel(words, [gap_curve(levels, above, b, s, seed, told) for b, told in below], name, gap=True) for words, s in PLACES]


def gaps_caption(levels: Mapping[float, Sequence[Table]], rows: Sequence[Sequence[CurvePanel]]) -> str:
    """Say what the gaps are, what they assume, and how they end on the random scenes."""
    largest = max(levels, default=0.0)
    ends = [ends_told(panel.y_label.split(" − ")[0], curve) for row in rows for panel in row[-1:] for curve in panel.curves if curve.points]
    return (
        "Mean paired difference of PSNR at R = 1/8 when the three monochrome shots together take the time of one colour shot; switching "
        f"between shots is taken to last {EqualTime().switch_s:g} s, and what it lasts mono would pay three times, a colour sensor once. "
        f"Bars: 95 % interval. {assumed()} Light bands: the colour sensors’ efficiencies times {SWEPT[0]:g} to {SWEPT[1]:g}, mono’s kept "
        "(Foveon − Bayer: each by itself). For these data a factor on a sensor’s efficiency is exactly a factor on its light: it scales "
        f"the mean electrons and H together, gain, offset and read noise stay, and no pixel comes near the well ({FULL_WELL_E:,.0f} "
        f"electrons; the largest level is {largest:,.0f}). So the bands are read off the sensor’s own curve, linear over log electrons "
        "between the levels that were run. Beyond the first and last level nothing was run and the end’s value stands: there the bands "
        "are too narrow on one side. It would not hold with dark current, with wells that fill, with a gain set for each sensor, or under "
        "budget D, where the exposure "
        "makes up for the efficiency. " + (f"Random scenes, first and last level: {'; '.join(ends)}." if ends else "")
    )


def ends_told(name: str, curve: Curve) -> str:
    """Write a curve's first and last point."""
    (x, first), (last_x, last) = curve.points[0], curve.points[-1]

    def number(p: Point) -> str:
        return f"{p.mean:+.1f} [{p.low:+.1f}, {p.high:+.1f}]".replace("-", "−")

    told = f"{name} {curve.label} {number(first)} dB at {x:,.0f} electrons"
    return told if last_x == x else f"{told}, {number(last)} dB at {last_x:,.0f}"


def assumed() -> str:
    """Say which efficiencies are assumed."""
    e = AssumedEfficiencies()
    return f"Efficiencies are assumed: mono {e.mono:g} and Bayer {e.bayer:g} at their peaks, the Foveon’s layers together {e.foveon_sum:g}."


def equal_time(found: Claims) -> dict[float, list[Table]]:
    """Return the tables of budget C by level of light, rising."""
    tables = [t for t in found.tables if t.reading.data == NOISY and t.reading.change.startswith(f"budget {EqualTime.name}")]
    levels: dict[float, list[Table]] = {}
    for table in sorted(tables, key=lambda t: electrons(t.reading)):
        levels.setdefault(electrons(table.reading), []).append(table)
    return levels


def electrons(reading: Reading) -> float:
    """Return the level of light of a reading with noise."""
    capture = reading.recipes["bayer"].capture
    assert isinstance(capture, Lit)
    return capture.electrons


def values_of(tables: Sequence[Table], series: Series, scenes: Sequence[str], groups: int) -> Values:
    """Return the PSNR of a series in every trial of the tables about it."""
    for table in tables:
        if series.sensor != "mono" or series == table.reading.mono:
            names = scenes or table.random_scenes
            return {(s, mask): v for s in names for mask, v in table.values(s, groups, series.sensor, psnr).items()}
    return {}


def by_scene(values: Values) -> dict[str, list[float]]:
    """Sort values by scene, as the statistics want them."""
    found: dict[str, list[float]] = {}
    for (scene, _), value in sorted(values.items()):
        found.setdefault(scene, []).append(value)
    return found


def series_points(tables: Sequence[Table], scenes: Sequence[str], groups: int, seed: int) -> dict[Series, Point]:
    """Return each series' mean PSNR with its interval; on random scenes the interval is that of paired values."""
    values = {s: v for s in SERIES if (v := values_of(tables, s, scenes, groups))}
    if scenes or len(values) < 2:
        return {s: _at(paired_estimate(by_scene(v), seed), s) for s, v in values.items()}
    stretch = math.sqrt(len(values) / (len(values) - 1))
    return {s: _at(paired_estimate(by_scene(v), seed), s, stretch) for s, v in centred(values).items()}


def centred(values: Mapping[Series, Values]) -> dict[Series, Values]:
    """Take each trial's mean over the series off its values and put the mean of all trials in its place (Cousineau 2005).

    Means of series stay, where all have the same trials; what remains of the scatter is what series don't share. It is
    sqrt((J-1)/J) too small for J series (Morey 2008).
    """
    trials = set.intersection(*(set(v) for v in values.values()))
    middle = {t: float(np.mean([v[t] for v in values.values()])) for t in trials}
    grand = mean_of(by_scene(middle))
    return {s: {t: v[t] - middle[t] + grand for t in trials} for s, v in values.items()}


def _at(e: Estimate, series: Series, stretch: float = 1.0) -> Point:
    return Point(e.mean, e.mean + stretch * (e.low - e.mean), e.mean + stretch * (e.high - e.mean), series.key)


def scores_panel(words: str, scenes: Sequence[str], levels: Mapping[float, Sequence[Table]], groups: int, seed: int) -> CurvePanel:
    """Return PSNR of every series against the levels on a target or the random scenes."""
    return CurvePanel(words, curves_of({x: series_points(tables, scenes, groups, seed) for x, tables in levels.items()}), "PSNR, dB")


def curves_of(points: Mapping[float, Mapping[Series, Point]]) -> list[Curve]:
    """Return a curve for each series."""
    return [Curve(s.key, s.label, [(x, at[s]) for x, at in sorted(points.items()) if s in at]) for s in SERIES]


def paired_words(levels: Mapping[float, Sequence[Table]], groups: int) -> str:
    """Say what the bands on random scenes mean, and how much the scenes scatter at the last level; nothing without such scenes."""
    values = values_of(levels[max(levels)], FOVEON, (), groups) if levels else {}
    means = [float(np.mean(v)) for v in by_scene(values).values()]
    return PAIRED_WORDS.format(float(np.std(means, ddof=1))) if len(means) > 1 else ""


def gap_curve(levels: Mapping[float, Sequence[Table]], above: Series, below: Series, scenes: Sequence[str], seed: int, label: str) -> Curve:
    """Return how far one series lies above another at every level, and how far the assumed efficiencies may move that.

    The efficiency of mono is kept: what counts is its ratio to the others'.
    """
    points, around = [], []
    seen = {s: {x: v for x, tables in levels.items() if (v := values_of(tables, s, scenes, 1))} for s in (above, below)}
    shared = sorted(seen[above].keys() & seen[below].keys())
    curves = {s: [mean_of(by_scene(seen[s][x])) for x in shared] for s in seen}
    for i, x in enumerate(shared):
        a, b = seen[above][x], seen[below][x]
        e = paired_estimate(by_scene({t: a[t] - b[t] for t in a.keys() & b.keys()}), seed)
        points.append((x, Point(e.mean, e.low, e.high, below.key if below.sensor == "mono" else above.key)))
        least, most = (end - curves[above][i] for end in moved(shared, curves[above], x))
        low, high = (0.0, 0.0) if below.sensor == "mono" else (end - curves[below][i] for end in moved(shared, curves[below], x))
        around.append((e.mean + least - high, e.mean + most - low))
    return Curve(below.key if below.sensor == "mono" else above.key, label, points, around)


def moved(levels: Sequence[float], values: Sequence[float], level: float) -> tuple[float, float]:
    """Return the least and the largest value of a curve over log10(level) while the level takes the factors ``SWEPT``.

    Args:
        levels: above 0, rising; beyond them the values at the ends stand.
        values: at the levels.
        level: one of them.
    """
    low, high = (level * factor for factor in SWEPT)
    places = [low, level, high, *(x for x in levels if low < x < high)]
    found = np.interp(np.log10(places), np.log10(levels), values)
    return float(found.min()), float(found.max())

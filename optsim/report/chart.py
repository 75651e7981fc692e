"""Mean PSNR against R as inline SVG: drawn from the rows, coloured by the page, readable without a script."""

from __future__ import annotations

import math
from collections.abc import Sequence

from optsim.report.data import SERIES, RunData, Series
from optsim.report.html import Markup, tag
from optsim.report.select import Recipe, ratio_text, ratios, score

WIDTH, HEIGHT = 490, 300
LEFT, RIGHT, TOP, BOTTOM = 50, 130, 34, 44


def psnr_chart(run: RunData, recipe: Recipe | None) -> Markup | None:
    """Draw one panel a target with a shared scale; None when nothing was run."""
    panels = {t: curves(run, recipe, t) for t in run.targets}
    panels = {t: c for t, c in panels.items() if c}
    if not panels:
        return None
    values = [y for c in panels.values() for points in c.values() for _, y in points]
    ratio = [x for c in panels.values() for points in c.values() for x, _ in points]
    ticks = nice_ticks(min(values), max(values))
    return tag("div", [panel(t, c, (min(ratio), max(ratio)), ticks) for t, c in panels.items()], class_="charts")


def curves(run: RunData, recipe: Recipe | None, target: str) -> dict[Series, list[tuple[float, float]]]:
    """Return the (R, PSNR dB) points of each series that was run."""
    found: dict[Series, list[tuple[float, float]]] = {}
    for s in SERIES:
        points = [(R, value) for R in ratios(run, recipe, target) if (value := score(run, recipe, target, s, R)) is not None]
        if points:
            found[s] = points
    return found


def nice_ticks(low: float, high: float) -> list[float]:
    """Return round numbers that enclose a range, four to eight of them."""
    step = next((s for s in (0.5, 1, 2, 5, 10, 20, 50, 100) if (high - low) / s <= 6), 1000.0)
    first = math.floor(low / step)
    return [step * i for i in range(first, max(math.ceil(high / step), first + 1) + 1)]


def spread(wanted: Sequence[float], gap: float) -> list[float]:
    """Move labels apart to at least ``gap``, keeping their order and staying near where they belong."""
    order = sorted(range(len(wanted)), key=lambda i: wanted[i])
    placed = [wanted[i] for i in order]
    for _ in range(50):
        for i in range(1, len(placed)):
            lack = gap - (placed[i] - placed[i - 1])
            if lack > 0:
                placed[i - 1] -= lack / 2
                placed[i] += lack / 2
    result = [0.0] * len(wanted)
    for position, i in enumerate(order):
        result[i] = placed[position]
    return result


def panel(target: str, series: dict[Series, list[tuple[float, float]]], span: tuple[float, float], ticks: list[float]) -> Markup:
    """Draw one target."""
    low, high = span
    wide = high - low or 1.0

    def x(R: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * ((R - low) / wide if high > low else 0.5)

    def y(value: float) -> float:
        return HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * (value - ticks[0]) / (ticks[-1] - ticks[0])

    parts = [tag("text", target, x=str(LEFT), y="18", class_="title")]
    for tick in ticks:
        parts.append(tag("line", x1=str(LEFT), x2=str(WIDTH - RIGHT), y1=f"{y(tick):.1f}", y2=f"{y(tick):.1f}", class_="grid"))
        parts.append(tag("text", f"{tick:g}", x=str(LEFT - 8), y=f"{y(tick) + 4:.1f}", class_="tick end"))
    for R in sorted({R for points in series.values() for R, _ in points}):
        parts.append(tag("text", ratio_text(R), x=f"{x(R):.1f}", y=str(HEIGHT - BOTTOM + 18), class_="tick middle"))
    parts.append(tag("text", "compression ratio R", x=f"{(LEFT + WIDTH - RIGHT) / 2:.1f}", y=str(HEIGHT - 8), class_="tick middle"))
    parts.append(tag("text", "mean PSNR, dB", x="12", y=f"{(TOP + HEIGHT - BOTTOM) / 2:.1f}", class_="tick middle turn"))
    ends = spread([y(points[-1][1]) for points in series.values()], 15)
    for (s, points), end in zip(series.items(), ends):
        path = " ".join(f"{x(R):.1f},{y(v):.1f}" for R, v in points)
        parts.append(tag("polyline", points=path, class_=f"line {s.key}"))
        for R, v in points:
            told = f"{s.label}: {v:.2f} dB at R = {ratio_text(R)}, {target}"
            dot = tag(
                "circle", tag("title", told), cx=f"{x(R):.1f}", cy=f"{y(v):.1f}", r="5", class_=f"dot {s.key}", tabindex="0", data_tip=told
            )
            parts.append(dot)
        parts.append(tag("text", s.short, x=str(WIDTH - RIGHT + 12), y=f"{end + 4:.1f}", class_=f"label {s.key}"))
    summary = "; ".join(f"{s.short} {', '.join(f'{v:.2f}' for _, v in points)}" for s, points in series.items())
    label = f"Mean PSNR in dB against R for {target}: {summary}."
    return tag("svg", *parts, viewBox=f"0 0 {WIDTH} {HEIGHT}", role="img", aria_label=label)

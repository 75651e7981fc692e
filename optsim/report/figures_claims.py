"""Figures of the verdict on the paper's claims: every reading with its interval, gaps against R, scores against light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from optsim.report.data import SERIES
from optsim.report.style import COLORS, DASHES, INK, MARKERS, MUTED, Drawn, new_figure, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D


REACH_DB = 8.0
"""How far from 0 the axis of readings goes at most."""


@dataclass(frozen=True)
class Point:
    """A number with its interval, in dB, and the series key whose colour it takes."""

    mean: float
    low: float
    high: float
    key: str


@dataclass(frozen=True)
class ForestPanel:
    """One claim: label of a reading -> its points; and the claimed range (high None: no upper end)."""

    title: str
    points: Mapping[str, Sequence[Point]]
    claimed: tuple[float, float | None]


@dataclass(frozen=True)
class Curve:
    """One line: series key -> (x, point) in rising x."""

    key: str
    label: str
    points: Sequence[tuple[float, Point]]


@dataclass(frozen=True)
class CurvePanel:
    """One diagram of lines."""

    title: str
    curves: Sequence[Curve]


def figure_forest(
    panels: Sequence[ForestPanel], labels: Sequence[str], directory: Path, name: str, title: str, caption: str
) -> Drawn | None:  # fmt: skip
    """Draw claims side by side, a line for each reading: points with 95 % intervals, the claimed range shaded.

    What lies beyond the axis is marked by an arrow at its edge with the number.

    Args:
        panels: claims that share their readings.
        labels: the readings from top to bottom.
        directory, name: where the files go.
        title, caption: of the figure.
    """
    if not labels or not panels:
        return None
    figure = new_figure(10.0, 0.24 * len(labels) + 1.4)
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    keys: dict[str, None] = {}
    for ax, panel in zip(axes, panels):
        keys |= dict.fromkeys(_forest(ax, panel, labels))
    axes[0].set_yticks(range(len(labels)), labels)
    axes[0].set_ylim(len(labels) - 0.4, -0.6)
    handles = [_handle(key) for key in keys]
    names = {s.key: s.label for s in SERIES}
    figure.legend(handles, [names[key] for key in keys], loc="outside upper center", ncols=len(handles))
    png, pdf = save(figure, directory, name)
    return Drawn(name, title, caption, f"{title}: a line for each of {len(labels)} readings, points with intervals.", png, pdf)


def _forest(ax: Axes, panel: ForestPanel, labels: Sequence[str]) -> list[str]:
    low, high = panel.claimed
    means = [p.mean for points in panel.points.values() for p in points]
    left = max(min([*means, 0.0]) - 1.0, -REACH_DB)
    right = min(max([*means, high or low + 1.0]) + 1.0, REACH_DB)
    ax.axvspan(low, right if high is None else high, color="#F0E442", alpha=0.3, linewidth=0)
    ax.axvline(0, color=INK, linewidth=0.8)
    seen = []
    for y, label in enumerate(labels):
        points = panel.points.get(label, ())
        for i, p in enumerate(points):
            _point(ax, p, y + 0.32 * (i - (len(points) - 1) / 2), (left, right))
            seen.append(p.key)
    ax.set_xlim(left, right)
    ax.set_title(panel.title, loc="left")
    ax.set_xlabel("dB")
    ax.tick_params(axis="y", length=0)
    return seen


def _point(ax: Axes, p: Point, y: float, limits: tuple[float, float]) -> None:
    left, right = limits
    color = COLORS[p.key]
    if left <= p.mean <= right:
        ax.plot([max(p.low, left), min(p.high, right)], [y, y], color=color, linewidth=1.6, solid_capstyle="butt")
        ax.plot([p.mean], [y], color=color, marker=MARKERS[p.key], markersize=3.8)
        return
    beyond = p.mean > right
    ax.plot([right if beyond else left], [y], color=color, marker=">" if beyond else "<", markersize=5, clip_on=False)
    room = 0.03 * (right - left)
    at, side = (right - room, "right") if beyond else (left + room, "left")
    ax.text(at, y, f"{p.mean:+.0f}".replace("-", "−"), color=color, fontsize=6.5, va="center", ha=side)


def _handle(key: str) -> Line2D:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=COLORS[key], marker=MARKERS[key], markersize=4, linewidth=1.6)


def figure_curves(
    panels: Sequence[CurvePanel], directory: Path, name: str, title: str, caption: str, *, x_label: str, log: bool = False
) -> Drawn | None:
    """Draw lines with bands of their intervals, a panel for each scene.

    Args:
        panels: with at least one point each.
        directory, name: where the files go.
        title, caption: of the figure.
        x_label: with its unit.
        log: whether x is logarithmic.
    """
    from matplotlib.ticker import FuncFormatter, NullLocator

    panels = [panel for panel in panels if any(curve.points for curve in panel.curves)]
    if not panels:
        return None
    figure = new_figure(10.0, 3.7)
    axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for ax, panel in zip(axes, panels):
        for curve in panel.curves:
            x = [at for at, _ in curve.points]
            color = COLORS[curve.key]
            ax.fill_between(x, [p.low for _, p in curve.points], [p.high for _, p in curve.points], color=color, alpha=0.16, linewidth=0)
            ax.plot(
                x, [p.mean for _, p in curve.points], color=color, linestyle=DASHES[curve.key], marker=MARKERS[curve.key], label=curve.label
            )
        ticks = sorted({at for curve in panel.curves for at, _ in curve.points})
        if log:
            ax.set_xscale("log")
            ax.xaxis.set_minor_locator(NullLocator())
            ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
        ax.set_xticks(ticks[:: max(1, len(ticks) // 4)])
        ax.set_title(panel.title, loc="left")
        ax.set_xlabel(x_label)
    axes[0].set_ylabel("dB")
    axes[0].legend(loc="best")
    for ax in axes:
        ax.axhline(0, color=MUTED, linewidth=0.8, zorder=0) if ax.get_ylim()[0] < 0 < ax.get_ylim()[1] else None
    png, pdf = save(figure, directory, name)
    return Drawn(name, title, caption, f"{title}: lines with intervals, {len(panels)} panels.", png, pdf)

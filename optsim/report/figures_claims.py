"""Figures of the verdict on the paper's claims: every reading with its interval, gaps against R, scores against light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optsim.report.style import COLORS, DASHES, INK, MARKERS, Drawn, new_figure, save

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D


FENCE = 1.5
"""Means farther than this many interquartile ranges from the quartiles stand outside a forest's axis."""
LEAST_SPREAD_DB = 1.0
"""Interquartile range that is assumed at least, so that readings which agree leave room around them."""
CLAIMED = "#F0E442"
NOTE_ROOM = 0.24
"""Share of a forest's axis that the words beside a point may need."""
DODGE = 1.12
"""Factor on x between the bars of two lines of one diagram."""


@dataclass(frozen=True)
class Point:
    """A number with its interval, in dB, the series key whose colour it takes, and a few words beside it."""

    mean: float
    low: float
    high: float
    key: str
    note: str = ""


@dataclass(frozen=True)
class ForestPanel:
    """One claim: label of a reading -> its points; and the claimed range (high None: no upper end), None where no size is claimed."""

    title: str
    points: Mapping[str, Sequence[Point]]
    claimed: tuple[float, float | None] | None


@dataclass(frozen=True)
class Curve:
    """One line.

    Args:
        key: of the series whose colour it takes.
        label: for the legend.
        points: x and point, in rising x.
        around: (low, high) of what an assumption moves, for each point; empty: none. Intervals are then drawn as bars.
    """

    key: str
    label: str
    points: Sequence[tuple[float, Point]]
    around: Sequence[tuple[float, float]] = ()


@dataclass(frozen=True)
class CurvePanel:
    """One diagram of lines; ``gap``: what it shows is compared with 0."""

    title: str
    curves: Sequence[Curve]
    y_label: str
    gap: bool = False


def figure_forest(
    panels: Sequence[ForestPanel], labels: Sequence[str], names: Mapping[str, str], directory: Path, name: str, title: str, caption: str
) -> Drawn | None:  # fmt: skip
    """Draw claims side by side, a line for each reading: points with 95 % intervals, the claimed range shaded.

    The axis holds the bulk. A mean beyond it is an arrow with its number, an interval that goes on beyond it ends in an arrow head.

    Args:
        panels: claims that share their readings.
        labels: the readings from top to bottom.
        names: legend's words for the points' keys.
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
    shown = [key for key in names if key in keys]
    figure.legend([_handle(key) for key in shown], [names[key] for key in shown], loc="outside upper center", ncols=len(shown))
    png, pdf = save(figure, directory, name)
    return Drawn(name, title, caption, f"{title}: a line for each of {len(labels)} readings, points with intervals.", png, pdf)


def limits(points: Sequence[Point], claimed: tuple[float, float | None] | None) -> tuple[float, float]:
    """Return the ends of a forest's axis in dB: 0, the claimed range and the bulk of the points with their intervals.

    Args:
        points: at least one.
        claimed: as of :class:`ForestPanel`.
    """
    means = np.array([p.mean for p in points])
    low, high = np.quantile(means, (0.25, 0.75))
    reach = FENCE * max(high - low, LEAST_SPREAD_DB)
    least, most = low - reach, high + reach
    bulk = [p for p in points if least <= p.mean <= most]
    held = [0.0] if claimed is None else [0.0, claimed[0], claimed[0] if claimed[1] is None else claimed[1]]
    left = min(*held, max(least, min(p.low for p in bulk)))
    right = max(*held, min(most, max(p.high for p in bulk)))
    room = 0.06 * (right - left)
    return float(left - room), float(right + room)


def _forest(ax: Axes, panel: ForestPanel, labels: Sequence[str]) -> list[str]:
    every = [p for points in panel.points.values() for p in points]
    ends = limits(every, panel.claimed)
    if panel.claimed is not None:
        low, high = panel.claimed
        ax.axvspan(low, ends[1] if high is None else high, color=CLAIMED, alpha=0.3, linewidth=0)
    ax.axvline(0, color=INK, linewidth=0.8)
    for y, label in enumerate(labels):
        points = panel.points.get(label, ())
        for i, p in enumerate(points):
            _point(ax, p, y + 0.32 * (i - (len(points) - 1) / 2), ends)
    ax.set_xlim(*ends)
    ax.set_title(panel.title, loc="left")
    ax.set_xlabel("PSNR difference, dB")
    ax.tick_params(axis="y", length=0)
    return [p.key for p in every]


def _point(ax: Axes, p: Point, y: float, ends: tuple[float, float]) -> None:
    left, right = ends
    color, room = COLORS[p.key], 0.035 * (right - left)
    inside = left <= p.mean <= right
    if p.low <= right and p.high >= left:
        ax.plot([max(p.low, left), min(p.high, right)], [y, y], color=color, linewidth=1.6, solid_capstyle="butt")
    for cut, end, marker in ((p.low < left <= p.mean, left, "<"), (p.mean <= right < p.high, right, ">")):
        if cut and p.low <= right and p.high >= left:
            ax.plot([end], [y], color=color, marker=marker, markersize=4, clip_on=False)
    if inside:
        ax.plot([p.mean], [y], color=color, marker=MARKERS[p.key], markersize=3.8)
        if p.note:
            needed = NOTE_ROOM * (right - left)
            if p.high + needed < right:
                _write(ax, p.high + room, y, p.note, color, "left")
            elif p.low - needed > left:
                _write(ax, p.low - room, y, p.note, color, "right")
            else:
                _write(ax, p.mean, y - 0.36, p.note, color, "center")
        return
    beyond = p.mean > right
    ax.plot([right if beyond else left], [y], color=color, marker=">" if beyond else "<", markersize=5.5, clip_on=False)
    number = f"{p.mean:+.1f}" if abs(p.mean) < 9.95 else f"{p.mean:+.0f}"
    text = number.replace("-", "−") + (f" ({p.note})" if p.note else "")
    _write(ax, right - room if beyond else left + room, y, text, color, "right" if beyond else "left")


def _write(ax: Axes, x: float, y: float, text: str, color: str, side: str) -> None:
    ground = {"facecolor": "white", "edgecolor": "none", "pad": 0.4, "alpha": 0.8}
    ax.text(x, y, text, color=color, fontsize=6.5, va="center", ha=side, bbox=ground)


def _handle(key: str) -> Line2D:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=COLORS[key], marker=MARKERS[key], markersize=4, linewidth=1.6)


def figure_curves(
    rows: Sequence[Sequence[CurvePanel]], directory: Path, name: str, title: str, caption: str, *, x_label: str, log: bool = False
) -> Drawn | None:
    """Draw lines with their intervals, a diagram for each scene; the diagrams of a row share their y axis where they compare with 0.

    Args:
        rows: of diagrams, as long as each other; those without a point are left out with their column.
        directory, name: where the files go.
        title, caption: of the figure.
        x_label: with its unit.
        log: whether x is logarithmic.
    """
    kept = [i for i in range(max(map(len, rows), default=0)) if any(curve.points for row in rows for curve in row[i].curves)]
    rows = [[row[i] for i in kept] for row in rows]
    rows = [row for row in rows if any(curve.points for panel in row for curve in panel.curves)]
    if not rows:
        return None
    figure = new_figure(10.0, 0.9 + 2.9 * len(rows) if len(rows) == 1 else 0.9 + 2.3 * len(rows))
    share = "row" if any(panel.gap for row in rows for panel in row) else False
    axes = figure.subplots(len(rows), len(kept), sharey=share, sharex=len(rows) > 1, squeeze=False)  # type: ignore[arg-type]
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            _panel(axes[i, j], panel, log, named=i == 0 or panel.title != rows[0][j].title)
        axes[i, 0].set_ylabel(row[0].y_label, fontsize=8.5)
    lines: dict[str, Artist] = {}
    for ax in axes[:, 0]:
        for handle, label in zip(*ax.get_legend_handles_labels()):
            lines.setdefault(label, handle)
    figure.legend(list(lines.values()), list(lines), loc="outside upper center", ncols=len(lines))
    figure.supxlabel(x_label, fontsize=9)
    png, pdf = save(figure, directory, name)
    return Drawn(name, title, caption, f"{title}: lines with intervals, {len(rows) * len(kept)} panels.", png, pdf)


def _panel(ax: Axes, panel: CurvePanel, log: bool, named: bool) -> None:
    from matplotlib.ticker import FuncFormatter, NullLocator

    for i, curve in enumerate(panel.curves):
        _curve(ax, curve, DODGE ** (i - (len(panel.curves) - 1) / 2) if log else 1.0)
    ticks = sorted({at for curve in panel.curves for at, _ in curve.points})
    if log:
        ax.set_xscale("log")
        ax.xaxis.set_minor_locator(NullLocator())
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    ax.set_xticks(ticks[:: max(1, len(ticks) // 4)])
    if named:
        ax.set_title(panel.title, loc="left")
    if panel.gap:
        ax.axhline(0, color=INK, linewidth=0.9, zorder=1)


def _curve(ax: Axes, curve: Curve, beside: float) -> None:
    """Draw a line; ``beside`` is the factor on x that keeps its bars apart from another line's."""
    x, color = np.array([at for at, _ in curve.points]), COLORS[curve.key]
    low, mean, high = ([getattr(p, end) for _, p in curve.points] for end in ("low", "mean", "high"))
    if curve.around:
        least, most = zip(*curve.around)
        ax.fill_between(x, least, most, color=color, alpha=0.22, linewidth=0)
        ax.vlines(x * beside, low, high, color=color, linewidth=1.4)
        x = x * beside
    else:
        ax.fill_between(x, low, high, color=color, alpha=0.16, linewidth=0)
    ax.plot(x, mean, color=color, linestyle=DASHES[curve.key], marker=MARKERS[curve.key], markersize=4, label=curve.label)

"""Draw what nonlinearity, registration and optical effects cost a reconstruction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim.report.style import INK, MUTED, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLORS = {"mono": "#0072B2", "bayer": "#009E73", "foveon": "#D55E00"}
MARKERS = {"mono": "o", "bayer": "s", "foveon": "D"}
BELIEF_COLORS = ("#D55E00", "#E69F00", "#009E73", "#CC79A7", "#000000")
DIRECTIONS = {"x": "along the dispersion, x", "y": "across it, y", "rotation": "rotation, at the corner", "scale": "scale, at the corner"}


def draw_cost(cost: Mapping[str, Any], path: Path) -> None:
    """Draw the study of nonlinearity from the contents of ``nonlinearity.json``; the path's ending chooses the format."""
    overall = [loss for loss in cost["losses"] if loss["scene"] is None]
    sensors = list(dict.fromkeys(loss["sensor"] for loss in overall))
    with styled():
        figure = new_figure(11.5, 6.8)
        grid = figure.add_gridspec(2, 4, height_ratios=(1.15, 1))
        _beliefs(figure.add_subplot(grid[0, :2]), [loss for loss in overall if loss["kind"] == "assumption"], sensors)
        _curves(figure.add_subplot(grid[0, 2:]), cost["curve"])
        first: Axes | None = None
        for column, (kind, title) in enumerate(DIRECTIONS.items()):
            axes = figure.add_subplot(grid[1, column], sharey=first)
            _offsets(axes, [loss for loss in overall if loss["kind"] == kind], sensors, title)
            if first is None:
                first = axes
                axes.set_ylabel("dB lost against exact registration")
        figure.suptitle(_headline(cost), color=INK, fontsize=10)
        figure.savefig(path, dpi=150)


def _headline(cost: Mapping[str, Any]) -> str:
    config = cost["config"]
    scenes = ", ".join(dict.fromkeys(row["scene"] for row in cost["rows"]))
    return (
        f"Data always exact: {config['subdivide']} wavelengths a band, {config['samples']} x {config['samples']} samples a mirror; "
        f"{config['size']} x {config['size']} mirrors, {config['seeds']} sets of masks; {scenes}"
    )


def _beliefs(axes: Axes, losses: Sequence[Mapping[str, Any]], sensors: Sequence[str]) -> None:
    """One dot a belief and sensor, with its 95 % interval."""
    names = list(dict.fromkeys(loss["case"] for loss in losses))
    for s, sensor in enumerate(sensors):
        mine = {loss["case"]: loss for loss in losses if loss["sensor"] == sensor}
        y = np.arange(len(names)) + (s - (len(sensors) - 1) / 2) * 0.24
        mean = np.array([mine[name]["loss_db"]["mean"] for name in names])
        axes.errorbar(
            mean, y, xerr=_arms([mine[n]["loss_db"] for n in names]), fmt=MARKERS[sensor], color=COLORS[sensor], label=sensor, lw=1.2
        )
        for value, place, name in zip(mean, y, names):
            high = mine[name]["loss_db"]["high"]
            axes.annotate(
                f"{value:.2f}", (value if high is None else max(value, high), place), (5, -3), textcoords="offset points", fontsize=7
            )
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.axvline(0, color=MUTED, lw=0.7)
    axes.margins(x=0.1)
    axes.set_xlabel("dB lost against exact weights, mean and 95 % interval")
    axes.set_title("What H believes about the dispersion")
    axes.legend(loc="lower right")


def _curves(axes: Axes, curve: Mapping[str, Any]) -> None:
    for color, (name, error) in zip(BELIEF_COLORS, curve["error_px"].items()):
        axes.plot(curve["wavelength_nm"], error, color=color, label=name, lw=1.3)
    axes.set_xlabel("wavelength (nm)")
    axes.set_ylabel("believed - true position (px)")
    axes.set_title("How wrong each belief is")
    axes.legend(ncols=2)


def _offsets(axes: Axes, losses: Sequence[Mapping[str, Any]], sensors: Sequence[str], title: str) -> None:
    for sensor in sensors:
        mine = sorted((loss for loss in losses if loss["sensor"] == sensor), key=lambda loss: float(loss["amount_px"]))
        x = [loss["amount_px"] for loss in mine]
        y = [loss["loss_db"]["mean"] for loss in mine]
        arms = _arms([loss["loss_db"] for loss in mine])
        axes.errorbar(x, y, yerr=arms, fmt=MARKERS[sensor] + "-", color=COLORS[sensor], label=sensor, lw=1.2, ms=4)
    axes.axhline(0, color=MUTED, lw=0.7)
    axes.set_xscale("log")
    ticks = sorted({loss["amount_px"] for loss in losses})
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.set_xlabel("mask registered wrong by (px)")
    axes.set_title(title)


def _arms(intervals: Sequence[Mapping[str, float | None]]) -> np.ndarray:
    """Return (2, n) lengths below and above the mean; 0 where there is no interval."""
    low = [0.0 if i["low"] is None or i["mean"] is None else i["mean"] - i["low"] for i in intervals]
    high = [0.0 if i["high"] is None or i["mean"] is None else i["high"] - i["mean"] for i in intervals]
    return np.array([low, high])


def draw_effects(report: Mapping[str, Any], path: Path) -> None:
    """Draw the ranking of ``optsim explain --camera --json``: shares of light wrong, and dB lost; the path's ending chooses the format."""
    rows = [row for row in report["effects"] if row["present"]]
    priced = any(row["loss_db"] for row in rows)
    with styled():
        figure = new_figure(9.5 if priced else 5.5, 1.2 + 0.42 * max(3, len(rows)))
        panels = np.ravel(figure.subplots(1, 2 if priced else 1, sharey=True, squeeze=False))
        _draw_shares(panels[0], report, rows)
        if priced:
            _draw_prices(panels[1], report, rows)
        figure.savefig(path, dpi=150)


def _draw_shares(share: Axes, report: Mapping[str, Any], rows: list[Mapping[str, Any]]) -> None:
    colors = [COLORS["foveon"] if row["required"] else MUTED for row in rows]
    share.scatter([row["relative"] for row in rows], np.arange(len(rows)), c=colors, s=28, zorder=3)
    share.axvline(report["error"], color=INK, lw=0.8, ls=":")
    share.set_xscale("log")
    share.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    share.xaxis.set_minor_formatter(lambda value, _: "")
    share.set_yticks(np.arange(len(rows)), [row["name"] for row in rows])
    share.invert_yaxis()
    share.set_xlabel("share of light wrong without it")
    share.set_title(f"Size; an error of {report['error']:g} requires the red ones")


def _draw_prices(decibels: Axes, report: Mapping[str, Any], rows: list[Mapping[str, Any]]) -> None:
    sensors = list(dict.fromkeys(name for row in rows for name in row["loss_db"]))
    for s, sensor in enumerate(sensors):
        there = [i for i, row in enumerate(rows) if sensor in row["loss_db"]]
        values = [rows[i]["loss_db"][sensor] for i in there]
        place = np.array(there) + (s - (len(sensors) - 1) / 2) * 0.22
        mean = [value["mean"] for value in values]
        decibels.errorbar(mean, place, xerr=_arms(values), fmt=MARKERS[sensor], color=COLORS[sensor], label=sensor, lw=1.2)
    decibels.axvline(0, color=MUTED, lw=0.7)
    decibels.set_xlabel("dB lost when H leaves it out, mean and 95 % interval")
    decibels.set_title(f"Cost, on {report['size']} x {report['size']} mirrors")
    decibels.legend(loc="lower right")

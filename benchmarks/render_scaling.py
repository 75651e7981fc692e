"""How the time of a render grows with pixels, bands and samples: measured, printed, drawn."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.render_routes import Case, own
from optsim.cube import Bands
from scenes.scene import Scene

SIDES = (32, 64, 128, 256, 512)
BANDS = (1, 24, 240)
SAMPLES = (32, 128, 512, 2048, 4096)
SIDE, SPP, DEPTH = 64, 256, 8
GOALS = {24: 2.0, 240: 10.0}
"""Largest time of so many bands, in times of one band."""
RANGE_NM = (450.0, 670.0)


def bands_of(count: int) -> Bands:
    """Return bands of equal width over the range; one band is the middle one of 24, as narrow as any of them."""
    if count == 1:
        return Bands.from_edges(np.linspace(*RANGE_NM, 25)[12:14])
    return Bands.from_edges(np.linspace(*RANGE_NM, count + 1))


def measure(scene: Scene, rounds: int) -> dict[str, list[dict[str, Any]]]:
    """Return seconds of processor time by pixels, bands and samples; the first call, which compiles, is not counted."""

    def case(side: int, count: int) -> Case:
        return Case(scene, bands_of(count), (side, side), DEPTH)

    calls: dict[tuple[str, int], Callable[[int], np.ndarray]] = {}
    calls |= {("pixels", side * side): own(case(side, 24), SPP // 8) for side in SIDES}
    calls |= {("bands", count): own(case(SIDE * 2, count), SPP // 4) for count in BANDS}
    calls |= {("samples", count): own(case(SIDE, 24), count) for count in SAMPLES}
    spent: dict[tuple[str, int], list[float]] = {key: [] for key in calls}
    for turn in range(rounds + 1):
        for key, render in calls.items():
            start = time.process_time()
            render(turn)
            if turn:
                spent[key].append(time.process_time() - start)
    found: dict[str, list[dict[str, Any]]] = {}
    for (kind, count), seconds in spent.items():
        rows = found.setdefault(kind, [])
        rows.append({"count": count, "seconds": float(np.median(seconds))})
        row, goal = rows[-1], GOALS.get(count) if kind == "bands" else None
        row["times_first"] = row["seconds"] / rows[0]["seconds"]
        row |= {"goal": goal, "met": None if goal is None else bool(row["times_first"] <= goal)}
    return found


def show(found: dict[str, list[dict[str, Any]]]) -> None:
    """Print the tables."""
    for kind, rows in found.items():
        print(f"\n{kind:>8s} {'s':>7s} {'times first':>12s} {'goal':>6s}   us per {kind.rstrip('s')}")
        for row in rows:
            goal = "" if row["goal"] is None else f"{row['goal']:.0f}{'' if row['met'] else ' !'}"
            print(
                f"{row['count']:8d} {row['seconds']:7.2f} {row['times_first']:12.2f} {goal:>6s}   {1e6 * row['seconds'] / row['count']:.3g}"
            )


def plot(found: dict[str, list[dict[str, Any]]], rows: list[dict[str, Any]], file: Path) -> None:
    """Draw time against pixels, bands and samples, and the ratios of the table if there are any."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 4, figsize=(15, 3.8), width_ratios=[1, 1, 1, 1.4], layout="constrained")
    labels = {
        "pixels": f"pixels (24 bands, {SPP // 8} samples a pixel)",
        "bands": f"bands ({2 * SIDE} x {2 * SIDE} pixels, {SPP // 4} samples a pixel)",
        "samples": f"samples a pixel ({SIDE} x {SIDE} pixels, 24 bands)",
    }
    for axis, (kind, label) in zip(axes, labels.items()):
        x, y = (np.array([row[key] for row in found[kind]], float) for key in ("count", "seconds"))
        axis.loglog(x, y, "o-", color="tab:blue", label="relief")
        axis.loglog(x, y[-1] * x / x[-1], "--", color="0.6", label="in proportion")
        axis.set(xlabel=label, ylabel="processor time / s")
        axis.grid(alpha=0.3, which="both")
        axis.legend()
    told = [row for row in rows if row["goal"] is not None]
    places = np.arange(len(told))
    axes[3].barh(places, [row["ratio"] for row in told], color="tab:blue", height=0.5, label="measured")
    axes[3].plot([row["goal"] for row in told], places, "k|", markersize=22, markeredgewidth=2, label="goal")
    axes[3].set_yticks(places, [row["scene"] for row in told])
    axes[3].set(xscale="log", xlim=(1, None), xlabel="time x error: best of Mitsuba's ways / ours")
    axes[3].invert_yaxis()
    axes[3].grid(alpha=0.3, axis="x", which="both")
    if told:
        axes[3].legend()
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=110)

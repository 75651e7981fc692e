"""Time x error of the renderers here against the best that Mitsuba's own pieces give, as ratios within one run.

    python -m benchmarks.render [--json] [--size 64] [--rounds 3] [--scene NAME ...] [--parting] [--scaling] [--plots docs/figures]

Cost is processor seconds times normalised mean square error, which does not depend on the number of samples for plain Monte Carlo: a
ratio of 10 means ten times less time at equal error. All routes of a scene take turns, each round with other seeds; medians of the
seconds and means of the errors count. Errors are products of the differences from two long renders, so that the noise of these cancels.
Compilation is not counted (a first call apart). The ratio told is against the better of Mitsuba's two ways: all bands on one spectral
film, or a film a band; with dispersion against the better of a film a band and our own path for every node. --parting compares numbers
of paths behind dispersing glass; --scaling adds tables of pixels, bands and samples; --plots draws them.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import render_scaling
from benchmarks.render_routes import Case, Render, band_by_band, film, flat, own, with_hidden_glass
from optsim.cube import Bands
from optsim.render import explain
from optsim.render.shared_path import Parting
from scenes.catalogue import scene_by_name
from scenes.glass import Glass
from scenes.scene import Scene

ABBE = 30.0
"""Of the glass in the case with dispersion."""
DEPTH = 16
"""Emissions counted at most, in every route."""
GOALS = {"color-checker": 100.0, "relief": 15.0, "glass": 8.0, "dispersive glass": 3.0}
"""Least ratio of the route that the scene takes by itself."""
TRUTH = 6
"""How many times the samples of a route the two long renders have."""
PARTINGS = ((1, 1), (4, 4), (8, 8), (16, 16), (24, 24), (1000, 16), (1000, 1000))


def scenes() -> dict[str, Scene]:
    """Return the scenes by the names of the table."""
    shipped = {name: scene_by_name(name).build() for name in ("color-checker", "relief", "glass")}
    return shipped | {"dispersive glass": Glass(abbe=ABBE).build()}


def case_of(scene: Scene, size: int) -> Case:
    """Return a case of 24 bands, no deeper than the scene needs."""
    return Case(scene, Bands.paper(), (size, size), min(DEPTH, explain(scene).max_depth))


def routes_of(name: str, case: Case, samples: int) -> tuple[dict[str, Render], list[str]]:
    """Return the routes, ours first, and the names of the rivals: Mitsuba's, and our own path for every node where there is one."""
    ours: dict[str, Render] = {}
    if name == "color-checker":
        ours["flat faces without samples"] = flat(case)
    if name in ("color-checker", "relief"):
        ours["diffuse table"] = own(case, samples)
        ours["shared path"] = own(Case(with_hidden_glass(case.scene), case.bands, case.film, case.max_depth), samples)
    elif name == "glass":
        ours["shared path"] = own(case, samples)
    else:
        ours["shared path, parted at glass"] = own(case, samples)
    rivals = {"Mitsuba: a film a band": band_by_band(case, max(4, samples // 4))}
    if name == "dispersive glass":
        rivals["a path for every node"] = own(case, samples, Parting(apart=True))
    else:
        rivals["Mitsuba: one spectral film"] = film(case, 4 * samples)
    return ours | rivals, list(rivals)


def compare(case: Case, routes: dict[str, Render], truth: Render, rounds: int) -> list[dict[str, Any]]:
    """Measure all routes in turns."""
    one, other = truth(10**6), truth(10**6 + 1)
    scale = np.mean((one + other) / 2, axis=1, keepdims=True)
    first: dict[str, float] = {}
    seconds: dict[str, list[float]] = {name: [] for name in routes}
    errors: dict[str, list[np.ndarray]] = {name: [] for name in routes}
    for turn in range(-1, rounds):
        for name, render in routes.items():
            start = time.process_time()
            found = render(turn + 1)
            spent = time.process_time() - start
            if turn < 0:
                first[name] = spent
                continue
            seconds[name].append(spent)
            errors[name].append(np.mean((found - one) * (found - other) / scale**2, axis=0))
    rows = []
    for name in routes:
        pixels = np.mean(errors[name], axis=0)
        nmse, unsure = float(pixels.mean()), float(pixels.std(ddof=1) / np.sqrt(pixels.size))
        bound = nmse < 2 * unsure
        spent, nmse = float(np.median(seconds[name])), max(nmse, 0) + 2 * unsure * bound
        rows.append({"route": name, "first_s": first[name], "seconds": spent, "nmse": nmse, "bound": bool(bound), "cost": spent * nmse})
    return rows


def table(name: str, case: Case, samples: int, rounds: int) -> list[dict[str, Any]]:
    """Return the rows of one scene with their ratios against the cheapest rival."""
    routes, rivals = routes_of(name, case, samples)
    rows = compare(case, routes, own(case, TRUTH * samples), rounds)
    least = min(row["cost"] for row in rows if row["route"] in rivals)
    for number, row in enumerate(rows):
        row |= {"scene": name, "size": case.film[0], "ratio": least / row["cost"], "goal": GOALS[name] if number == 0 else None}
        row["met"] = None if row["goal"] is None else bool(row["ratio"] >= row["goal"])
    return rows


def partings(case: Case, samples: int, rounds: int) -> list[dict[str, Any]]:
    """Return a row for each number of paths behind dispersing glass, with their cost against a path for every node."""
    routes = {f"{seen} seen, {met} met": own(case, samples, Parting(seen=seen, met=met)) for seen, met in PARTINGS}
    rows = compare(case, routes | {"a path for every node": own(case, samples, Parting(apart=True))}, own(case, TRUTH * samples), rounds)
    for row in rows:
        row |= {"scene": "dispersive glass", "size": case.film[0], "ratio": rows[-1]["cost"] / row["cost"], "goal": None, "met": None}
    return rows


def show(rows: list[dict[str, Any]], scene: str) -> None:
    """Print the rows of a scene."""
    head = ("first s", 8), ("s", 7), ("nMSE", 10), ("s x nMSE", 10), ("ratio", 9), ("goal", 5)
    print(f"{'scene':17s} {'px':>4s} {'route':29s} " + " ".join(f"{word:>{width}s}" for word, width in head))
    for r in (row for row in rows if row["scene"] == scene):
        goal = "" if r["goal"] is None else f"{r['goal']:.0f}{'' if r['met'] else ' !'}"
        less, more = ("<", ">") if r["bound"] else ("", "")
        values = f"{less}{r['nmse']:.3g}", f"{less}{r['cost']:.3g}", f"{more}{r['ratio']:.1f}"
        print(
            f"{r['scene']:17s} {r['size']:4d} {r['route']:29s} {r['first_s']:8.2f} {r['seconds']:7.2f} {values[0]:>10s} {values[1]:>10s} "
            f"{values[2]:>9s} {goal:>5s}",
            flush=True,
        )


def main() -> None:
    """Print the tables, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--size", type=int, default=64, help="picture side in pixels")
    parser.add_argument("--samples", type=int, default=256, help="samples a pixel of the routes here; Mitsuba's have four times as many")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--scene", nargs="*", choices=tuple(GOALS), default=tuple(GOALS), help="which rows; none: no table")
    parser.add_argument("--parting", action="store_true")
    parser.add_argument("--scaling", action="store_true")
    parser.add_argument("--plots", type=Path, nargs="?", const=Path("docs/figures"), default=None, metavar="DIR", help="implies --scaling")
    chosen = parser.parse_args()
    built = scenes()
    rows, tried = list[dict[str, Any]](), list[dict[str, Any]]()
    for name in chosen.scene:
        rows += table(name, case_of(built[name], chosen.size), chosen.samples, chosen.rounds)
        if not chosen.json:
            show(rows, name)
    if chosen.parting:
        tried = partings(case_of(built["dispersive glass"], chosen.size), chosen.samples, chosen.rounds)
        if not chosen.json:
            show(tried, "dispersive glass")
    scaling = render_scaling.measure(built["relief"], chosen.rounds) if chosen.scaling or chosen.plots is not None else None
    if chosen.json:
        print(json.dumps({"bands": 24, "rows": rows, "parting": tried, "scaling": scaling}))
    elif scaling is not None:
        render_scaling.show(scaling)
    if chosen.plots is not None and scaling is not None:
        render_scaling.plot(scaling, rows, chosen.plots / "render_speed.png")


if __name__ == "__main__":
    main()

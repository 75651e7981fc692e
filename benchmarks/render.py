"""Time x error of the renderers here against Mitsuba's path and spectral film, as ratios within one run.

    python -m benchmarks.render [--json] [--size 64] [--film-samples 1024]

Cost is seconds times normalised mean square error (against a long render with another seed), which does not depend on the number
of samples for plain Monte Carlo: a ratio of 10 means ten times less time at equal error. Low-discrepancy points make the cost
fall with the number of samples. Compilation is not counted (first call apart). The flat target is measured at two sizes, because
its borders cut pixels at other places in each: the ratio depends on how much of its error comes from the few pixels that are cut.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np

from optsim.cube import Bands
from optsim.render import RenderSettings
from optsim.render.passes import Renderable, State, run
from optsim.render.reference import FilmTransport
from optsim.render.transport import Transport
from scenes.catalogue import scene_by_name
from scenes.materials import Dielectric
from scenes.scene import Scene
from scenes.shapes import Sphere

GOALS = {"color-checker": 10.0, "relief": 4.0}
"""Least ratio against the film: a flat target, and a scene whose surfaces light each other."""


def with_hidden_glass(scene: Scene) -> Scene:
    """Add a speck of glass where nothing sees it: the scene takes the general route, its picture stays."""
    view = scene.viewpoint
    behind = np.asarray(view.origin) - 10 * view.axes()[2]
    speck = Sphere(name="speck", material="speck", center=tuple(behind), radius=1e-6)
    return scene.model_copy(update={"shapes": (*scene.shapes, speck), "materials": scene.materials | {"speck": Dielectric(index=1.5)}})


def band_values(task: Renderable, state: State) -> np.ndarray:
    """Return (K, pixels) radiance."""
    return sum(weight @ group.mean for weight, group in zip(task.weights, state.groups))


def measure(task: Renderable, truth: np.ndarray | None) -> dict[str, Any]:
    """Render twice, time the second run, and compare with the truth."""
    start = time.perf_counter()
    run(task, None, None, "")
    first = time.perf_counter() - start
    start = time.perf_counter()
    state = run(task, None, None, "")
    seconds = time.perf_counter() - start
    values = band_values(task, state)
    error = float(state.noise(task.weights).errors.max())
    found = {"samples": state.spent, "first_s": first, "seconds": seconds, "values": values, "estimated_error": error}
    if truth is not None:
        scale = truth.mean(1, keepdims=True)
        found["nmse"] = float(np.mean(((values - truth) / scale) ** 2))
        found["cost"] = found["seconds"] * found["nmse"]
    return found


def compare(name: str, size: int, film_samples: int, own_samples: int) -> list[dict[str, Any]]:
    """Compare the routes on one scene; ratio = cost of the film / cost of the route."""
    scene, bands, film = scene_by_name(name).build(), Bands.paper(), (size, size)
    depth = Transport(scene, bands, film, RenderSettings(samples_per_pixel=4)).max_depth
    deep = {"max_depth": min(depth, 16)}
    truth = measure(Transport(scene, bands, film, RenderSettings(samples_per_pixel=own_samples * 64, seed=1, **deep)), None)["values"]
    own, other = RenderSettings(samples_per_pixel=own_samples, **deep), RenderSettings(samples_per_pixel=film_samples, **deep)
    routes = {
        "diffuse table": lambda: Transport(scene, bands, film, own),
        "shared path": lambda: Transport(with_hidden_glass(scene), bands, film, own),
        "Mitsuba path and specfilm": lambda: FilmTransport(scene, bands, film, other),
    }
    rows = []
    for route, build in routes.items():
        found = measure(build(), truth)
        found.pop("values")
        rows.append({"scene": name, "size": size, "route": route, **found})
    for row in rows:
        row["ratio"] = rows[-1]["cost"] / row["cost"]
        row["goal"] = None if row is rows[-1] else GOALS[name]
        row["met"] = None if row["goal"] is None else bool(row["ratio"] >= row["goal"])
    return rows


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--size", type=int, default=64, help="picture side in pixels")
    parser.add_argument("--film-samples", type=int, default=1024, help="samples a pixel for Mitsuba's film")
    parser.add_argument("--own-samples", type=int, default=64, help="samples a pixel for the routes here")
    chosen = parser.parse_args()
    cases = [("color-checker", chosen.size), ("color-checker", chosen.size - 4), ("relief", chosen.size)]
    rows = [row for name, size in cases for row in compare(name, size, chosen.film_samples, chosen.own_samples)]
    if chosen.json:
        print(json.dumps({"bands": 24, "rows": rows}))
        return
    head = ("spp", 6), ("first s", 8), ("s", 7), ("nMSE", 10), ("s x nMSE", 10), ("ratio", 8), ("goal", 5)
    print(f"{'scene':15s} {'px':>4s} {'route':27s} " + " ".join(f"{word:>{width}s}" for word, width in head))
    for r in rows:
        goal = "" if r["goal"] is None else f"{r['goal']:.0f}{'' if r['met'] else ' !'}"
        print(
            f"{r['scene']:15s} {r['size']:4d} {r['route']:27s} {r['samples']:6d} {r['first_s']:8.2f} {r['seconds']:7.2f} {r['nmse']:10.3g} "
            f"{r['cost']:10.3g} {r['ratio']:8.1f} {goal:>5s}"
        )


if __name__ == "__main__":
    main()

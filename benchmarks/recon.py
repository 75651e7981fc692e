"""How fast is reconstruction, beside its peers on the same problem and beside streaming the bytes that it moves?

    python -m benchmarks.recon [--json] [--size 256] [--bands 24] [--shots 1] [--large] [--curves]

All figures are ratios within one run on one machine: the best of several interleaved repeats, so that other load hits both
sides. Peers: pylops' ``fista`` and pyproximal's ``AcceleratedProximalGradient`` on the same operator, basis, step and tau;
all use all cores they can. ``--large`` adds 1024 x 1024 x 31 whole and 2048 x 2048 x 31 in tiles (minutes), ``--curves`` the
race of the solvers (benchmarks.solver_curves).
"""

import argparse
import json
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

from benchmarks import recon_parts as parts
from benchmarks.recon_peers import LEVEL, WAVELET, Race, best_ms, camera, ours, peers, race_of
from recon import threads

GOALS = {"pylops": 12.0, "pyproximal": 8.0}
STREAMING = 3.0  # times longer than streaming its bytes may an iteration, H or H^T take
OWN = 2.0  # times longer than the matched camera's may an iteration of the camera's own H take
CUBES = 12.0  # of memory


def against_peers(race: Race, iterations: int, repeats: int) -> dict[str, Any]:
    """Time an iteration as the difference of two lengths, which is free of set-up, on all cores and (CPU time) on one thread."""
    runs = {"recon": lambda count: ours(race, count), **peers(race)}
    cubes = {name: run(iterations) for name, run in runs.items()}
    tasks: dict[str, Callable[[], Any]] = {}
    for name, run in runs.items():
        more = 6 * iterations if name == "recon" else 2 * iterations
        tasks[name] = lambda run=run: run(iterations)
        tasks[name + "+"] = lambda run=run, more=more: run(more)
    wall = best_ms(repeats, tasks)
    with threads.use(1):
        lone = best_ms(max(2, repeats // 2), tasks, time.process_time)
    found: dict[str, Any] = {"objective": {name: race.problem.eq4(cube, race.tau) for name, cube in cubes.items()}}
    for kind, timed in (("wall", wall), ("cpu", lone)):
        each = {name: (timed[name + "+"] - timed[name]) / ((5 if name == "recon" else 1) * iterations) for name in runs}
        found[kind + "_ms"] = each
        found[kind + "_times"] = {name: each[name] / each["recon"] for name in GOALS}
    found["met"] = {name: found["wall_times"][name] >= goal for name, goal in GOALS.items()}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--bands", type=int, default=24)
    parser.add_argument("--shots", type=int, default=1)
    parser.add_argument("--iterations", type=int, default=6)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--threads", type=int, default=None)
    parser.add_argument("--large", action="store_true", help="1024 x 1024 x 31 whole, 2048 x 2048 x 31 in tiles")
    parser.add_argument("--curves", action="store_true", help="run benchmarks.solver_curves afterwards")
    options = parser.parse_args()
    size, bands = options.size, options.bands
    with warnings.catch_warnings(), threads.use(options.threads) as used:
        warnings.simplefilter("ignore")  # PyWavelets' advice on depth
        race = race_of(camera(size, bands, options.shots))
        result: dict[str, Any] = {"size": size, "bands": bands, "shots": options.shots, "threads": used}
        result["peers"] = against_peers(race, options.iterations, options.repeats)
        result["stages"] = {name: part._asdict() for name, part in parts.stages(race, 6 * options.repeats).items()}
        result["operators"] = {name: part._asdict() for name, part in parts.applications(size, bands, 4 * options.repeats).items()}
        result["bases"] = {name: part._asdict() for name, part in parts.bases(size, bands, 2 * options.repeats).items()}
        result["own"] = parts.own_camera(size, bands, 4 * options.repeats)
        result["ns_a_voxel"] = parts.scaling((64, 128, 256, 512, 1024), bands, options.repeats)
        result["memory_cubes"] = parts.memory(size, bands)
    if options.large:
        from benchmarks.recon_large import large

        result["large"] = large()
    print(json.dumps(result) if options.json else text(result))
    if options.curves:
        subprocess.run([sys.executable, "-m", "benchmarks.solver_curves"], check=True)


def text(result: dict[str, Any]) -> str:
    """Write the tables."""
    race = result["peers"]
    what = f"{result['size']} x {result['size']} x {result['bands']}, float32, mono x{result['shots']}, {WAVELET} level {LEVEL}"
    lines = [
        f"{what}, {result['threads']} threads",
        "",
        "one l1 iteration (FISTA)      ms wall   times ours   goal        CPU ms, one thread   times ours",
    ]
    for name in ("recon", *GOALS):
        goal = f"{GOALS[name]:g}: {'met' if race['met'][name] else 'NOT MET'}" if name in GOALS else ""
        times, alone = race["wall_times"].get(name, 1.0), race["cpu_times"].get(name, 1.0)
        lines.append(f"{name:28s} {race['wall_ms'][name]:8.2f} {times:10.1f}     {goal:14s} {race['cpu_ms'][name]:12.2f} {alone:15.1f}")
    lines.append("objective reached: " + ", ".join(f"{name} {value:.7g}" for name, value in race["objective"].items()))
    for name, key, limit in (
        ("stages of the iteration", "stages", STREAMING),
        ("operators", "operators", STREAMING),
        ("bases", "bases", None),
    ):
        lines += ["", f"{name:34s}      ms   MB read and written   times streaming" + (f" (at most {limit:g})" if limit else "")]
        for part, value in result[key].items():
            verdict = "" if limit is None or value["times"] <= limit else "   NOT MET"
            lines.append(f"{part:34s} {value['ms']:7.3f} {value['megabytes']:21.2f} {value['times']:17.2f}{verdict}")
    lines += ["", f"camera's own H, three columns a band (at most {OWN:g})"]
    lines += [f"{name:44s} {value:6.2f}" for name, value in result["own"].items()]
    lines += ["", "time linear in voxels: ns a voxel and iteration by side"]
    lines.append("   ".join(f"{side}: {value:.3f}" for side, value in result["ns_a_voxel"].items()))
    lines += ["", f"peak memory of a solve in cubes of float32 (at most {CUBES:g})"]
    lines.append("   ".join(f"{name}: {value:.1f}" for name, value in result["memory_cubes"].items()))
    if "large" in result:
        lines += ["", *result["large"]["text"]]
    return "\n".join(lines)


if __name__ == "__main__":
    main()

"""How long the command line takes to start: help, and small renders, cold and warm.

    python -m benchmarks.cold_start [--runs 9] [--json]

Warm: as the second call. Cold: a home folder without a kernel cache or a proof of libLLVM, and optsim's own modules not yet compiled
to bytecode, as right after an installation (its dependencies are compiled when pip installs them). What the operating system keeps
of files in memory is left alone. Seconds mean something on an idle machine only; CPU seconds of all cores, and both as multiples of
`import xarray, h5netcdf` in the same run, which any program pays that writes such files, say more of a busy or another one.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PACKAGES = ("optsim", "scenes", "recon")
ROOT = Path(__file__).resolve().parents[1]
RENDER = ("render", "color-checker", "--size", "64", "-o", "cube.nc")
SAMPLED = ("render", "relief", "--size", "64", "--spp", "16", "-o", "cube.nc")
CASES = (
    ("optsim --help", ("--help",), False, 0.5),
    ("optsim render color-checker --size 64", RENDER, True, 4.0),
    ("optsim render color-checker --size 64", RENDER, False, 2.0),
    ("optsim render relief --size 64 --spp 16", SAMPLED, True, None),
    ("optsim render relief --size 64 --spp 16", SAMPLED, False, None),
)
"""Command, its words, whether cold, and the seconds that it may take."""


def seconds(command: list[str], folder: Path, environment: dict[str, str]) -> tuple[float, float]:
    """Run a command to its end; return the time that passed, and that of all cores."""

    def spent() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    start, before = time.perf_counter(), spent()
    subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
    return time.perf_counter() - start, spent() - before


def copied(folder: Path) -> dict[str, str]:
    """Copy the packages without bytecode, and return an environment in which they are found, with a home of its own."""
    for name in PACKAGES:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    home = folder / "home"
    home.mkdir()
    return os.environ | {"PYTHONPATH": str(folder), "HOME": str(home), "XDG_CACHE_HOME": str(home / "cache")}


def timed(words: tuple[str, ...], cold: bool, runs: int) -> list[tuple[float, float]]:
    """Time a command, each run in a fresh copy of the program when cold; else in one copy, after a run that is not counted."""
    command, found = [sys.executable, "-m", "optsim", *words], []
    if cold:
        for _ in range(runs):
            with tempfile.TemporaryDirectory() as name:
                found.append(seconds(command, Path(name), copied(Path(name))))
        return found
    with tempfile.TemporaryDirectory() as name:
        environment = copied(Path(name))
        for _ in range(runs + 1):
            found.append(seconds(command, Path(name), environment))
    return found[1:]


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=9, help="runs of each command")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    least = [seconds([sys.executable, "-c", "import xarray, h5netcdf"], Path.cwd(), dict(os.environ)) for _ in range(chosen.runs)]
    unit, unit_cpu = (statistics.median(column) for column in zip(*least))
    rows = []
    for name, words, cold, goal in CASES:
        found = timed(words, cold, chosen.runs)
        wall, cpu = zip(*found)
        middle, middle_cpu = statistics.median(wall), statistics.median(cpu)
        rows.append(
            {
                "command": name,
                "cold": cold,
                "median_s": middle,
                "least_s": min(wall),
                "most_s": max(wall),
                "cpu_s": middle_cpu,
                "goal_s": goal,
                "over_import_of_xarray": middle / unit,
                "cpu_over_import_of_xarray": middle_cpu / unit_cpu,
            }
        )
    if chosen.json:
        print(json.dumps({"runs": chosen.runs, "import_of_xarray_s": unit, "import_of_xarray_cpu_s": unit_cpu, "rows": rows}))
        return
    print(f"{chosen.runs} runs each; import xarray, h5netcdf: {unit:.2f} s, CPU {unit_cpu:.2f} s; load average {os.getloadavg()[0]:.1f}")
    for row in rows:
        goal = "" if row["goal_s"] is None else f"  goal {row['goal_s']:g} s: {'met' if row['median_s'] < row['goal_s'] else 'MISSED'}"
        print(
            f"{row['command']:42s} {'cold' if row['cold'] else 'warm'}  median {row['median_s']:.2f} s ({row['least_s']:.2f} to "
            f"{row['most_s']:.2f}), CPU {row['cpu_s']:.2f} s, {row['cpu_over_import_of_xarray']:.1f} x the import's{goal}"
        )


if __name__ == "__main__":
    main()

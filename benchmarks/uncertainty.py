"""Do the error estimates hold what they promise? Coverage of their intervals against the truth, over sensors, scenes and light.

    python -m benchmarks.uncertainty [--output benchmarks/results/uncertainty.json] [--size 48]

Without noise by basis pursuit, with noise by ADMM at the tau of ``Discrepancy``. A case found in the output is not run again.
"""

from __future__ import annotations

import argparse
import json
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import SENSORS, Case, measured
from recon import Admm
from recon.metrics import psnr
from recon.tau import Discrepancy, Given
from recon.uncertainty import Displaced, estimate_error

SCENES = ("color-checker", "procedural-1", "bricks")
"""The first two were looked at while the estimate was designed."""
WELLS = (None, 1_000)
LEVELS = (0.68, 0.95)
OUTPUT = Path("benchmarks/results/uncertainty.json")


def run(case: Case) -> dict[str, Any]:
    """Return coverage, and how the estimated errors compare with the ones made."""
    photo = measured(case)
    known: dict[str, Any] = {} if photo.variance is None else {"solver": Admm(max_iterations=150), "tau": Discrepancy()}
    given = Given(noise=photo.variance, threads=1)
    found = estimate_error(photo.operator, photo.frames, given, how=Displaced(repeats=6), **known)
    wrong = np.abs(found.solution.cube - photo.truth)
    worst = found.error >= np.quantile(found.error, 0.9)
    return {
        "scene": case.scene,
        "sensor": case.sensor,
        "well": case.well,
        "size": case.size,
        "psnr_db": float(psnr(found.solution.cube, photo.truth)),
        "coverage": [float((wrong <= found.half_width(level)).mean()) for level in LEVELS],
        "scale": found.scale,
        "rms_estimated_over_made": float(np.sqrt((found.error**2).mean() / (wrong**2).mean())),
        "energy_in_worst_tenth": float((wrong[worst] ** 2).sum() / (wrong**2).sum()),
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Return a table of the cases, and the range of their coverage."""
    lines = ["| scene | sensor | light | 68 % holds | 95 % holds | rms estimated / made | energy in the worst tenth |", "| " + "--- | " * 7]
    for row in rows:
        light = "no noise" if row["well"] is None else f"{row['well']} e"
        one, two = row["coverage"]
        lines.append(
            f"| {row['scene']} | {row['sensor']} | {light} | {one:.0%} | {two:.0%} | {row['rms_estimated_over_made']:.2f} |"
            f" {row['energy_in_worst_tenth']:.0%} |"
        )
    shares = np.array([row["coverage"] for row in rows])
    for i, level in enumerate(LEVELS):
        low, middle, high = shares[:, i].min(), np.median(shares[:, i]), shares[:, i].max()
        lines.append(
            f"\n{level:.0%} intervals hold {middle:.0%} of the voxels in the median case ({low:.0%} to {high:.0%}, {len(rows)} cases)."
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--size", type=int, default=48, help="mirrors along each side")
    options = parser.parse_args()
    rows = json.loads(options.output.read_text()) if options.output.exists() else []
    done = {(row["scene"], row["sensor"], row["well"], row["size"]) for row in rows}
    options.output.parent.mkdir(parents=True, exist_ok=True)
    for scene, sensor, well in product(SCENES, SENSORS, WELLS):
        if (scene, sensor, well, options.size) in done:
            continue
        rows.append(run(Case(scene, sensor, well, 1, options.size)))
        options.output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        print(rows[-1], flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()

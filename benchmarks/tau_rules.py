"""What a tau found without ground truth costs against the best one, over sensors, scenes and light.

    python -m benchmarks.tau_rules [--output benchmarks/results/tau_rules.json] [--size 64]

48 cases: four sensors, four scenes, three amounts of light. The rules' constants were set on other scenes (color-checker,
procedural-0). Every case is solved along a path of tau for the oracle, for each of two objectives: plain (``AutoTau``, which knows no
noise) and weighted by the noise (``Discrepancy``, which does). The loss is the oracle's PSNR minus the rule's. A case found in the
output is not run again.
"""

from __future__ import annotations

import argparse
import json
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import SENSORS, Case, Measured, measured
from recon import Admm, reconstruct
from recon.metrics import psnr
from recon.tau import AutoTau, Discrepancy, Given, TauPath, TauRule

SCENES = ("bricks", "metamers", "procedural-1", "procedural-2")
WELLS = (None, 20_000, 1_000)
FRACTIONS = (3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)
OUTPUT = Path("benchmarks/results/tau_rules.json")


def cases(size: int) -> list[Case]:
    """Return all cases."""
    return [Case(scene, sensor, well, seed=1, size=size) for scene, sensor, well in product(SCENES, SENSORS, WELLS)]


def judge(rule: TauRule, photo: Measured, variance: np.ndarray | None, scores: list[float]) -> dict[str, Any]:
    """Return what a rule chose, its PSNR and its loss against the better of the path's best and itself."""
    choice = rule.choose(photo.operator, photo.frames, Given(noise=variance, threads=1))
    solution = reconstruct(
        photo.operator, photo.frames, solver=Admm(), tau=choice.tau, noise=variance, start=choice.start, threads=1
    )  # fmt: skip
    value = float(psnr(solution.cube, photo.truth))
    return {
        "tau_fraction": choice.fraction,
        "at_edge": choice.at_edge,
        "psnr_db": value,
        "loss_db": max(0.0, max(scores) - value),
        "iterations": choice.iterations,
    }


def oracle(photo: Measured, variance: np.ndarray | None) -> dict[str, Any]:
    """Return the path's scores, its best value, and whether that is an end of the grid."""
    found = TauPath(fractions=FRACTIONS, solver=Admm()).follow(photo.operator, photo.frames, Given(noise=variance, threads=1))
    scores = [float(psnr(solution.cube, photo.truth)) for solution in found]
    best = int(np.argmax(scores))
    return {"scores": scores, "tau_fraction": FRACTIONS[best], "at_edge": best in (0, len(scores) - 1)}


def run(case: Case) -> dict[str, Any]:
    """Judge the rules on one case."""
    photo = measured(case)
    row: dict[str, Any] = {"scene": case.scene, "sensor": case.sensor, "well": case.well, "seed": case.seed, "size": case.size}
    row["plain"] = oracle(photo, None)
    row["held_out"] = judge(AutoTau(path=TauPath(fractions=FRACTIONS)), photo, None, row["plain"]["scores"])
    if photo.variance is not None:
        row["weighted"] = oracle(photo, photo.variance)
        for name, probes in (("discrepancy", 1), ("morozov", 0)):
            rule = Discrepancy(path=TauPath(fractions=FRACTIONS), probes=probes)
            row[name] = judge(rule, photo, photo.variance, row["weighted"]["scores"])
    return row


def spread(rows: list[dict[str, Any]], rule: str) -> dict[str, float]:
    """Return the distribution of a rule's losses in dB over the rows that have it."""
    losses = np.array([row[rule]["loss_db"] for row in rows if rule in row])
    edges = sum(row[rule]["at_edge"] for row in rows if rule in row)
    named = {"median": np.median(losses), "mean": losses.mean(), "p90": np.quantile(losses, 0.9), "max": losses.max()}
    return {"cases": len(losses), **{key: round(float(value), 3) for key, value in named.items()}, "edges": int(edges)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--size", type=int, default=64, help="mirrors along each side")
    options = parser.parse_args()
    rows = json.loads(options.output.read_text())["rows"] if options.output.exists() else []
    done = {(row["scene"], row["sensor"], row["well"], row["seed"], row["size"]) for row in rows}
    options.output.parent.mkdir(parents=True, exist_ok=True)
    for case in cases(options.size):
        if (case.scene, case.sensor, case.well, case.seed, case.size) in done:
            continue
        rows.append(run(case))
        options.output.write_text(json.dumps({"fractions": FRACTIONS, "rows": rows}, indent=1) + "\n", encoding="utf-8")
        row = rows[-1]
        known = {rule: round(row[rule]["loss_db"], 3) for rule in ("held_out", "discrepancy", "morozov") if rule in row}
        print(f"{case.scene:14s} {case.sensor:14s} {case.light:9s} loss in dB {known}", flush=True)
    for rule in ("held_out", "discrepancy", "morozov"):
        print(rule, spread(rows, rule))


if __name__ == "__main__":
    main()

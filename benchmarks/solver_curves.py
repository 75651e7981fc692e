"""Which solver is fastest: PSNR against seconds, and the time to 0.1 dB of the converged answer of the same objective.

    python -m benchmarks.solver_curves [--size 64] [--cases 4] [--output FILE.json] [--figure FILE.png]

Every point is a solve of its own, from zero, ended after so many iterations: set-up included, one thread, CPU seconds (other load on the
machine then hardly moves the ratios). GPSR-BB knows how many iterations it has and spaces its continuation accordingly, which favours it.
The number of iterations to 0.1 dB is found by doubling and halving. Seconds are those of this machine: read the ratios. What the
output holds already is not run again.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import Case, Measured, measured
from recon import Admm, BasisPursuit, Fista, Gpsr, reconstruct, warm_up
from recon.metrics import psnr
from recon.tau import Discrepancy, Given, tau_max

CLOSE_DB = 0.1
FRACTION = 5e-5
"""tau of the cases without noise, of tau_max; with noise tau is that of ``Discrepancy``."""
CONVERGED = Admm(tolerance=1e-6, max_iterations=2000)
REFERENCE = "GPSR-BB, continuation"
OUTPUT, FIGURE = Path("benchmarks/results/solver_curves.json"), Path("docs/figures/solver_curves.png")


@dataclass(frozen=True)
class Entrant:
    """One solver in the race.

    Args:
        name: in the tables.
        solver: its configuration without limits.
        first: iterations of the first point; the next ones double.
        most: iterations at which it gives up.
        prior: R; None: l1.
        regularised: whether it takes the case's tau.
        goal: the configuration that gives the converged answer of the same objective.
    """

    name: str
    solver: Any
    first: int
    most: int
    prior: Any = None
    regularised: bool = True
    goal: Any = CONVERGED


def entrants() -> tuple[Entrant, ...]:
    """Return all solvers, the slowest last."""
    from recon import Gap, TotalVariation

    pursuit = BasisPursuit(tolerance=1e-6, max_iterations=2000)
    return (
        Entrant("ADMM", Admm(tolerance=1e-9), 5, 640),
        Entrant("basis pursuit", BasisPursuit(tolerance=1e-9), 5, 640, regularised=False, goal=pursuit),
        Entrant("GAP-TV", Gap(tolerance=1e-9), 5, 320, prior=TotalVariation(), regularised=False, goal=Gap()),
        Entrant("FISTA", Fista(tolerance=1e-9), 25, 3200),
        Entrant(REFERENCE, Gpsr(tolerance=1e-9), 50, 6400),
        Entrant("GPSR-BB, continuation, full steps", Gpsr(tolerance=1e-9, monotone=False), 50, 6400),
        Entrant("GPSR-Basic", Gpsr(tolerance=1e-9, barzilai_borwein=False, continuation_steps=1), 100, 6400),
    )


def cases(size: int) -> list[Case]:
    """Return the cases: without noise for each kind of sensor, and one with it."""
    plain = [Case("color-checker", sensor, None, 1, size) for sensor in ("mono", "bayer", "foveon")]
    return [*plain, Case("color-checker", "mono", 1_000, 1, size)]


class Race:
    """One case and its converged answers."""

    def __init__(self, case: Case) -> None:
        self.case, self.photo = case, measured(case)
        photo = self.photo
        if photo.variance is None:
            self.tau = FRACTION * tau_max(photo.operator, photo.frames, Given(threads=1))
        else:
            self.tau = Discrepancy().choose(photo.operator, photo.frames, Given(noise=photo.variance, threads=1)).tau
        self._goals: dict[str, float] = {}

    def solve(self, entrant: Entrant, solver: Any) -> float:
        """Return the PSNR of a solve."""
        photo: Measured = self.photo
        about = {"tau": self.tau} if entrant.regularised else {}
        found = reconstruct(photo.operator, photo.frames, prior=entrant.prior, solver=solver, noise=photo.variance, threads=1, **about)
        return float(psnr(found.cube, photo.truth))

    def goal(self, entrant: Entrant) -> float:
        """Return the PSNR of the converged answer of the entrant's objective."""
        key = repr((entrant.goal, entrant.prior))
        if key not in self._goals:
            self._goals[key] = self.solve(entrant, entrant.goal)
        return self._goals[key]

    def run(self, entrant: Entrant) -> dict[str, Any]:
        """Return the curve of an entrant, ``[iterations, seconds, PSNR]`` a point, and where it came close."""
        goal = self.goal(entrant)
        self.solve(entrant, entrant.solver.model_copy(update={"max_iterations": 2}))  # compiles what is not compiled yet
        points: dict[int, tuple[float, float]] = {}

        def close(iterations: int) -> bool:
            began = time.process_time()
            value = self.solve(entrant, entrant.solver.model_copy(update={"max_iterations": iterations}))
            points[iterations] = (time.process_time() - began, value)
            return abs(value - goal) < CLOSE_DB

        count = entrant.first
        while not close(count) and count < entrant.most:
            count *= 2
        met = abs(points[count][1] - goal) < CLOSE_DB
        if met and count > entrant.first:
            low, high = count // 2, count
            for _ in range(2):
                middle = (low + high) // 2
                low, high = (low, middle) if close(middle) else (middle, high)
            count = high
        curve = [[n, round(seconds, 4), round(value, 3)] for n, (seconds, value) in sorted(points.items())]
        return {
            "solver": entrant.name,
            "goal_psnr_db": round(goal, 3),
            "met": met,
            "iterations": count,
            "seconds": points[count][0],
            "curve": curve,
        }


def report(rows: list[dict[str, Any]]) -> str:
    """Return the table: time to 0.1 dB in seconds, and as a multiple of the reference's."""
    lines = [
        "| case | solver | iterations to 0.1 dB | CPU seconds | times faster than GPSR-BB | converged PSNR |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        reference = next((r for r in row["results"] if r["solver"] == REFERENCE), None)
        for result in row["results"]:
            more = "" if result["met"] else "more than "
            ratio = ""
            if reference is not None:
                times = reference["seconds"] / result["seconds"]
                bound = "" if result["met"] and reference["met"] else ("at most " if reference["met"] else "at least ")
                ratio = f"{bound}{times:.{0 if times >= 10 else 2}f}"
            lines.append(
                f"| {row['case']} | {result['solver']} | {more}{result['iterations']} | {more}{result['seconds']:.2g} | {ratio} |"
                f" {result['goal_psnr_db']:.2f} |"
            )
    return "\n".join(lines)


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw PSNR against seconds, a panel a case."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(10, 7.5), sharex=True, layout="constrained")
    for axis, row in zip(axes.flat, rows):
        for i, result in enumerate(row["results"]):
            _, seconds, values = np.array(result["curve"]).T
            axis.semilogx(seconds, values, "o-", ms=3, color=f"C{i}", label=result["solver"])
            axis.axhline(result["goal_psnr_db"], color=f"C{i}", lw=0.6, ls=":")
        axis.set_title(row["case"])
        axis.grid(alpha=0.3)
    for axis in axes[1]:
        axis.set_xlabel("CPU seconds, one thread")
    for axis in axes[:, 0]:
        axis.set_ylabel("PSNR (dB)")
    axes[0, 0].legend(fontsize=7)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def measure(size: int, count: int = 4, output: Path | None = None) -> list[dict[str, Any]]:
    """Race all solvers on the first ``count`` cases; what ``output`` holds already is not run again, and it gets what is new."""
    warm_up()
    rows: list[dict[str, Any]] = json.loads(output.read_text()) if output is not None and output.exists() else []
    for case in cases(size)[:count]:
        name = f"{case.sensor}, {case.light}, {case.size} x {case.size}"
        race = Race(case)
        if name not in [row["case"] for row in rows]:
            rows.append({"case": name, "tau": race.tau, "results": []})
        results = next(row["results"] for row in rows if row["case"] == name)
        for entrant in entrants():
            if entrant.name in [result["solver"] for result in results]:
                continue
            results.append(race.run(entrant))
            if output is not None:
                output.parent.mkdir(parents=True, exist_ok=True)
                output.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
            print(f"{name}: {entrant.name} {results[-1]['iterations']} iterations, {results[-1]['seconds']:.2f} s", flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=64, help="mirrors along each side")
    parser.add_argument("--cases", type=int, default=4, help="how many of the four cases")
    parser.add_argument("--output", type=Path, default=OUTPUT)
    parser.add_argument("--figure", type=Path, default=FIGURE)
    options = parser.parse_args()
    rows = measure(options.size, options.cases, options.output)
    draw(rows, options.figure)
    print(report(rows))


if __name__ == "__main__":
    main()

"""The second stage of a study: invert one capture, score it, and keep estimate and rows."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from optsim import __version__
from optsim.study.config import StudyConfig
from optsim.study.inverse import estimate_of, invert
from optsim.study.plan import ADMM, SolveTask
from optsim.study.store import Store, digest
from optsim.study.world import world_key

if TYPE_CHECKING:
    import xarray as xr

    from recon import L1, Admm, Gpsr
    from recon.metrics import Scores
    from recon.solution import Solution
    from recon.tau import AutoTau

SOLVER_VERSION = 2
"""Raise when a change of recon changes estimates: old entries are then computed anew."""
GPSR_ITERATIONS = 160
"""A value of tau on all data; gradient projection needs thousands for the smallest (docs/theory.md S.z), and the rows say so."""
AUTO, ORACLE = "auto", "oracle"

Tick = Callable[..., None]


def solve_key(config: StudyConfig, task: SolveTask) -> str:
    """Return the key of a reconstruction: its data, its operator and its solver's settings."""
    return digest(
        {
            "stage": "solve",
            "version": __version__,
            "solver_version": SOLVER_VERSION,
            "world": world_key(config, task.shooting.target),
            "task": task.name,
            "wavelet": config.wavelet,
            "solver": _settings(config, task),
        }
    )


def _settings(config: StudyConfig, task: SolveTask) -> dict[str, Any]:
    from recon import BasisPursuit

    if not task.needs_tau:
        return BasisPursuit().model_dump(mode="json")
    return {"rule": _rule(config).model_dump(mode="json"), "refine": _refine(task).model_dump(mode="json")}


def _rule(config: StudyConfig) -> AutoTau:
    from recon.tau import AutoTau, TauPath

    return AutoTau(path=TauPath(fractions=config.tau_fractions), seed=config.seed)


def _refine(task: SolveTask) -> Admm | Gpsr:
    """Return the solver of the path on all data, which starts next to the answers of the held-out path."""
    from recon import Admm, Gpsr

    return Admm() if task.solver == ADMM else Gpsr(max_iterations=GPSR_ITERATIONS, tolerance=1e-4)


def run_solve(config: StudyConfig, task: SolveTask, store: Store, tick: Tick) -> dict[str, Any]:
    """Reconstruct one capture with one kernel thread, or find it finished.

    Args:
        config: the study.
        task: what to invert, and how.
        store: holds the frames and the true cube; gets ``estimates/*.nc``.
        tick: called on every iteration; what it raises ends the solve.

    Returns:
        ``rows`` as in summary.json and, for solvers of Eq. 4, ``tau_path``.
    """
    name, key = f"estimates/{task.name}", solve_key(config, task)
    done = store.finished(name, key)
    if done is not None:
        return done
    frames = store.load(f"frames/{task.shooting.name}.nc")
    if task.shooting.physical and task.unit_shift:
        from optsim.camera import with_unit_shifts

        frames = with_unit_shifts(frames)
    truth = store.load(f"cubes/{task.shooting.target}.nc")["radiance"].values.astype(np.float64)
    solve = _tuned if task.needs_tau else _basis_pursuit
    rows, path, solutions = solve(config, task, frames, truth, tick)
    datasets = {f"{name}{suffix}.nc": estimate_of(frames, solution) for suffix, solution in solutions.items()}
    return store.keep(name, key, {"rows": rows, "tau_path": path}, datasets)


Solved = tuple[list[dict[str, Any]], list[dict[str, Any]], dict[str, "Solution"]]


def _basis_pursuit(config: StudyConfig, task: SolveTask, frames: xr.Dataset, truth: np.ndarray, tick: Tick) -> Solved:
    from recon.metrics import score

    solution = invert(frames, prior=_prior(config, truth), threads=1, on_iteration=tick)
    return [_row(config, task, solution, score(solution.cube, truth), None, solution.seconds)], [], {"": solution}


def _tuned(config: StudyConfig, task: SolveTask, frames: xr.Dataset, truth: np.ndarray, tick: Tick) -> Solved:
    from optsim.camera import band_model_of, signal_of
    from recon.metrics import psnr, score
    from recon.tau import Given, tune

    began, marks = time.perf_counter(), []

    def on_point(*_: object) -> None:
        marks.append(time.perf_counter() - began)

    report = tune(
        band_model_of(frames).operator(np.float32),
        signal_of(frames),
        Given(prior=_prior(config, truth), threads=1),
        auto=_rule(config),
        refine=_refine(task),
        score=lambda cube: psnr(cube, truth),
        on_point=on_point,
        on_iteration=tick,
    )
    # The automatic answer costs the held-out path and the path on all data down to its tau; the oracle's the whole path on all data.
    spent = [solution.seconds for solution in report.solutions]
    seconds = {AUTO: marks[len(spent) - 1] + sum(spent[: report.automatic + 1]), ORACLE: sum(spent)}
    assert report.oracle is not None
    places = {AUTO: report.automatic, ORACLE: report.oracle}
    capture = task.shooting.capture
    path = [
        {
            "target": capture.target,
            "sensor": capture.sensor,
            "masks": capture.masks,
            "R": capture.R,
            "tau": float(solution.tau or 0.0),
            "tau_fraction": fraction,
            "psnr_db": float(value),
            "heldout": heldout,
        }
        for solution, fraction, value, heldout in zip(report.solutions, report.fractions, report.scores, report.choice.errors)
    ]
    edges = {AUTO: report.choice.at_edge, ORACLE: report.oracle_at_edge}
    solutions = {rule_name: report.solutions[place] for rule_name, place in places.items()}
    rows = [
        _row(config, task, solution, score(solution.cube, truth), rule_name, seconds[rule_name])
        | {"tau_fraction": report.fractions[places[rule_name]], "at_edge": edges[rule_name]}
        for rule_name, solution in solutions.items()
    ]
    return rows, path, {f"-{rule_name}": solution for rule_name, solution in solutions.items()}


def _prior(config: StudyConfig, truth: np.ndarray) -> L1:
    from recon import L1, Kronecker

    return L1(basis=Kronecker.for_shape(truth.shape, wavelet=config.wavelet))


def _row(config: StudyConfig, task: SolveTask, solution: Solution, scores: Scores, rule: str | None, seconds: float) -> dict[str, Any]:
    capture = task.shooting.capture
    return {
        "target": capture.target,
        "sensor": capture.sensor,
        "masks": capture.masks,
        "R": capture.R,
        "shots": task.shooting.shots,
        "model": capture.model,
        "operator": task.operator,
        "solver": task.solver,
        "tau": None if solution.tau is None else float(solution.tau),
        "tau_rule": rule,
        "psnr_db": scores.psnr_db,
        "psnr_pooled_db": scores.psnr_pooled_db,
        "ssim": scores.ssim,
        "sam_deg": scores.sam_deg,
        "rmse": scores.rmse,
        "data_range": scores.data_range,
        "band_psnr_db": list(scores.band_psnr_db),
        "seconds": seconds,
        "iterations": solution.iterations,
        "stop": str(solution.stop),
        "converged": solution.stop.converged,
        "relative_residual": float(solution.residual),
        "seed": config.seed,
    }

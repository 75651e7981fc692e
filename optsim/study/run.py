"""The whole study: worlds, then solves side by side, then summary, figures and page."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optsim.study.config import StudyConfig
from optsim.study.plan import SolveTask, solves
from optsim.study.pool import Progress, run_all
from optsim.study.solve import run_solve
from optsim.study.store import Store, write_json
from optsim.study.summary import make_run_data, make_summary
from optsim.study.world import make_world

WORLD_COST = 3.0
REPORT_COST = 3.0


class StudyFailed(RuntimeError):
    """Raised when some reconstructions failed; what succeeded is on disk and in the report."""


@dataclass(frozen=True)
class Outcome:
    """Say where a run left its results.

    Args:
        folder: the run's folder.
        page: report.html.
        summary: summary.json.
        rows: its rows.
        seconds: wall time of this call.
    """

    folder: Path
    page: Path
    summary: Path
    rows: list[dict[str, Any]]
    seconds: float


def run_study(config: StudyConfig, folder: Path, command: str = "optsim run", quiet: bool = False) -> Outcome:
    """Run a study, or what is left of it, into a folder.

    Args:
        config: what to run.
        folder: gets report.html, summary.json, cubes/, frames/, estimates/ and figures/.
        command: the line that makes the run again, for the page.
        quiet: show no progress.

    Raises:
        StudyFailed: when a reconstruction failed; the report is written all the same.
        KeyboardInterrupt: on Ctrl-C; finished work stays, and the same call goes on from there.
    """
    from threadpoolctl import threadpool_limits

    from recon import warm_up_beside

    began = time.perf_counter()
    store = Store(folder)
    tasks = solves(config)
    total = WORLD_COST * len(config.targets) + sum(t.cost for t in tasks) + REPORT_COST
    compiled = warm_up_beside()
    with Progress(total, quiet) as progress, threadpool_limits(limits=1, user_api="blas"):
        try:
            worlds = {}
            for target in config.targets:
                worlds[target] = make_world(config, target, store, progress.say_share)
                progress.advance(WORLD_COST, f"{target}: rendered and photographed")
            progress.say("compiling the solvers (the first time only)")
            compiled()
            results, failures = _solve_all(config, tasks, store, progress)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"stopped; what is finished stays in {folder}, and the same command goes on from there") from None
        solved = {task: results[task.name] for task in tasks if task.name in results}
        rows = [row for result in solved.values() for row in result["rows"]]
        summary = make_summary(config, rows, next(iter(worlds.values()))["variant"])
        write_json(summary, store.root / "summary.json")
        notes = [f"{name} failed: {type(error).__name__}: {error}" for name, error in failures.items()]
        progress.say("drawing the report")
        from optsim.report import write_report

        page = write_report(make_run_data(config, store, summary, worlds, solved, command, notes), folder)
        progress.advance(REPORT_COST, f"report: {page}")
    if failures:
        raise StudyFailed(f"{len(failures)} of {len(tasks)} reconstructions failed; see {page}. First: {notes[0]}")
    return Outcome(folder, page, store.root / "summary.json", rows, time.perf_counter() - began)


def _solve_all(
    config: StudyConfig, tasks: list[SolveTask], store: Store, progress: Progress
) -> tuple[dict[str, dict[str, Any]], dict[str, BaseException]]:  # fmt: skip
    """Run the long solves first, so that no core idles at the end; results come back by name."""
    results: dict[str, dict[str, Any]] = {}

    def work(task: SolveTask, tick: Callable[..., None]) -> str:
        result = run_solve(config, task, store, tick)
        results[task.name] = result
        return ", ".join(_brief(row) for row in result["rows"])

    failures = run_all(sorted(tasks, key=lambda t: -t.cost), work, config.workers, progress)
    return results, failures


def _brief(row: dict[str, Any]) -> str:
    score = "exact" if row["psnr_db"] is None else f"{row['psnr_db']:.2f} dB"
    rule = "" if row["tau_rule"] is None else f"{row['tau_rule']} tau "
    return f"{rule}{score} in {row['iterations']} iterations, {row['seconds']:.1f} s"

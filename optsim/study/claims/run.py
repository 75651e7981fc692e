"""The whole study of the paper's claims: plan, time estimate, solves, verdicts, page."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

from optsim import __version__
from optsim.study.claims.answer import Claims
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.judge import judge, overall
from optsim.study.claims.measures import Table
from optsim.study.claims.plan import Task, all_tasks, tasks_of
from optsim.study.claims.readings import Reading, readings
from optsim.study.claims.truths import keep_truth
from optsim.study.claims.work import run_task, task_key
from optsim.study.claims.worlds import Cell, World
from optsim.study.pool import Progress, run_all
from optsim.study.store import Store, write_json
from recon.threads import cores

WORLD_COST = 12.0
"""Expected time of a render, over that of a unit of work at 64 x 64; each core waits for it."""
REPORT_SECONDS = 40.0


class ClaimsFailed(RuntimeError):
    """Raised when some solves failed; what succeeded is on disk, and the same call tries the rest again."""


def run_claims(config: ClaimsConfig, folder: Path, command: str = "optsim study paper-claims", quiet: bool = False) -> Claims:
    """Run the study, or what is left of it, into a folder.

    Args:
        config: what to run.
        folder: gets claims.json, paper-claims.html, figures/ and solves/.
        command: the line that makes the run again, for the page.
        quiet: tell no plan and no progress.

    Raises:
        ClaimsFailed: when solves failed.
        KeyboardInterrupt: on Ctrl-C; finished work stays, and the same call goes on from there.
    """
    from threadpoolctl import threadpool_limits

    began = time.perf_counter()
    store = Store(folder)
    chosen = readings(config)
    tasks = all_tasks(config, chosen)
    waiting = [task for task in tasks if store.finished(task.name, task_key(config, task)) is None]
    with threadpool_limits(limits=1, user_api="blas"):
        if not quiet:
            tell_plan(config, chosen, tasks, waiting)
        try:
            rows = _solve(config, tasks, waiting, store, quiet)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"stopped; what is finished stays in {folder}, and the same command goes on from there") from None
    tables = [_table(config, reading, rows) for reading in chosen]
    judged = judge(tables, config.seed)
    found = Claims(config, judged, overall(judged), tables, rows, folder, folder / "paper-claims.html", 0.0)
    write_json(found.as_dict(), folder / "claims.json")
    write_json({"version": __version__, "config": config.model_dump(mode="json"), "rows": _plain(rows)}, folder / "rows.json")
    from optsim.study.claims.page import write_page

    write_page(found, store, command)
    return replace(found, seconds=time.perf_counter() - began)


def tell_plan(config: ClaimsConfig, chosen: Sequence[Reading], tasks: Sequence[Task], waiting: Sequence[Task]) -> None:
    """Say on standard error what will be run and how long it should take on this machine, measured by one small solve."""
    bases = sum(reading.base for reading in chosen)
    sizes = " and ".join(f"{s} x {s}" for s in sorted({task.cell.size for task in tasks}))
    trials = len({task.cell for task in tasks})
    _say(
        f"plan: {len(chosen)} readings ({bases} bases, {len(chosen) - bases} with one factor changed), {trials} trials of scene and mask"
        f" at {sizes}, {len(tasks)} solves, {len(tasks) - len(waiting)} of them finished before"
    )
    if waiting:
        unit = unit_seconds()
        worlds = len({(task.cell.scene, task.cell.size) for task in waiting})
        seconds = unit * (sum(task.cost for task in waiting) / (config.workers or cores()) + WORLD_COST * worlds) + REPORT_SECONDS
        _say(f"expected time: {seconds / 60:.0f} min on {config.workers or cores()} cores (a unit of work took {unit:.2f} s just now)")


def unit_seconds() -> float:
    """Time one basis pursuit of a Bayer shot at 64 x 64, kernels compiled."""
    import numpy as np

    from optsim.camera import Bayer, masks_for, matched_model
    from optsim.camera.dmd import Distinct
    from optsim.cube import Bands
    from optsim.study.claims.captures import Taken
    from optsim.study.claims.methods import Pursuit

    sensor, size = Bayer.nikon(), 64
    y, x, k = np.meshgrid(np.arange(size), np.arange(size), np.arange(24), indexing="ij")
    truth = 1.5 + np.sign(np.sin(y / 9) * np.sin(x / 7)) * np.cos(k / 8)
    model = matched_model(sensor, Bands.paper(), masks_for(sensor, 1, Distinct(), (size, size), 1))
    taken = Taken(model.operator(np.float32), model.operator(np.float64).forward(truth))
    Pursuit().invert(taken, truth, lambda *_: None)  # compiles, or finds on disk
    began = time.perf_counter()
    Pursuit().invert(taken, truth, lambda *_: None)
    return time.perf_counter() - began


def _solve(
    config: ClaimsConfig, tasks: Sequence[Task], waiting: Sequence[Task], store: Store, quiet: bool
) -> dict[Task, dict[str, Any]]:  # fmt: skip
    rows: dict[Task, dict[str, Any]] = {}
    total = sum(task.cost for task in waiting) + WORLD_COST * len({(t.cell.scene, t.cell.size) for t in waiting})
    failures: dict[str, BaseException] = {}
    undone = set(waiting)
    with Progress(total, quiet) as progress:
        for (scene, size), group in groupby(tasks, key=lambda task: (task.cell.scene, task.cell.size)):
            mine = list(group)
            todo = [task for task in mine if task in undone]
            world = World(scene, size, config.render_error, config.seed)
            if todo:
                progress.say(f"rendering {scene} at {size} x {size}")
                make_ready(config, world, store)
                progress.advance(WORLD_COST, f"{scene}, {size} x {size}: rendered")
            failures |= _solve_world(config, mine, todo, world, store, progress, rows)
    if failures:
        name, error = next(iter(failures.items()))
        raise ClaimsFailed(f"{len(failures)} of {len(tasks)} solves failed; the first, {name}: {type(error).__name__}: {error}") from error
    return rows


def make_ready(config: ClaimsConfig, world: World, store: Store) -> None:
    """Render a world before its solves start, and keep its true cube if figures show it."""
    _ = world.truth
    keep_truth(config, world, store)


def _solve_world(
    config: ClaimsConfig,
    mine: Sequence[Task],
    todo: Sequence[Task],
    world: World,
    store: Store,
    progress: Progress,
    rows: dict[Task, dict[str, Any]],
) -> dict[str, BaseException]:
    def work(task: Task, tick: Callable[..., None]) -> str:
        rows[task] = run_task(config, task, world, store, tick)
        return f"{rows[task]['psnr_db']:.2f} dB"

    failures = run_all(todo, work, config.workers, progress) if todo else {}
    for task in mine:
        if task not in rows and task.name not in failures:
            rows[task] = run_task(config, task, world, store, lambda *_: None)
    return failures


def _table(config: ClaimsConfig, reading: Reading, rows: dict[Task, dict[str, Any]]) -> Table:
    found = {}
    size = config.size
    for task in tasks_of(config, reading):
        found[task.cell.scene, task.cell.mask, task.groups, task.series.sensor] = rows[task]
        size = task.cell.size
    return Table(reading, size, found)


def _plain(rows: dict[Task, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return every solve's row with what it was, for rows.json."""

    def identity(cell: Cell, task: Task) -> dict[str, Any]:
        series = task.series
        return {"scene": cell.scene, "size": cell.size, "mask": cell.mask, "sensor": series.sensor, "masks": series.masks}

    return [
        identity(t.cell, t) | {"groups": t.groups, "capture": t.recipe.capture.name, "method": t.recipe.method.name} | row
        for t, row in rows.items()
    ]


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)

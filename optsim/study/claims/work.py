"""Do one task: photograph, invert, score, and keep what the claims look at."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from optsim import __version__
from optsim.cube import make_cube
from optsim.report.color import exposure_of, lab
from optsim.report.gallery import block_means, finest_window
from optsim.study.claims.config import ClaimsConfig
from optsim.study.claims.methods import Inverted, settings
from optsim.study.claims.plan import Task
from optsim.study.claims.readings import MATCHED, PHYSICAL, base_recipe, bench_recipe
from optsim.study.claims.truths import shown_size
from optsim.study.claims.worlds import BENCH, TARGET_2, World
from optsim.study.store import Store, digest
from optsim.study.world import PHYSICS_VERSION

CLAIMS_VERSION = 1
"""Raise when a change here or in recon changes estimates: old entries are then computed anew."""
BENCH_ROW = 2
"""Raise when rows of the test bed hold something else."""
FALSE_COLOR_BLOCK = 8
"""Side of the squares whose mean colour counts as false colour; smaller where the finest bars fill less."""

Row = dict[str, Any]


def task_key(config: ClaimsConfig, task: Task) -> str:
    """Return the key of a finished task: everything that its answer depends on."""
    return digest(
        {
            "stage": "claims",
            "version": [__version__, CLAIMS_VERSION, PHYSICS_VERSION],
            "task": task.name,
            "seed": config.seed,
            "error": config.render_error,
            "settings": settings(),
        }
        | ({"row": BENCH_ROW} if task.cell.scene == BENCH else {})
    )


def kept(config: ClaimsConfig, task: Task) -> bool:
    """Tell whether the estimate itself is kept, for the figures: targets and test bed, first mask, base recipes, largest size."""
    bases = {base_recipe(MATCHED), base_recipe(PHYSICAL), bench_recipe()}
    return task.cell.mask == 0 and shown_size(config, task.cell.scene) == task.cell.size and task.recipe in bases


def run_task(config: ClaimsConfig, task: Task, world: World, store: Store, tick: Callable[..., None]) -> Row:
    """Return the row of a task, computed or found finished."""
    key = task_key(config, task)
    done = store.finished(task.name, key)
    if done is not None:
        return done
    began, busy = time.perf_counter(), time.thread_time()
    taken = task.recipe.capture.take(world, task.series, task.groups, task.cell.seed(config.seed))
    found = task.recipe.method.invert(taken, world.truth, tick)
    row = score_row(found, world) | {"seconds": time.perf_counter() - began, "cpu_seconds": time.thread_time() - busy}
    estimate = {f"{task.name}.nc": make_cube(np.ascontiguousarray(found.cube, np.float32), world.bands)} if kept(config, task) else {}
    return store.keep(task.name, key, row, estimate)


def score_row(found: Inverted, world: World) -> Row:
    """Return the scores that the claims look at."""
    from recon.metrics import score

    cube = np.asarray(found.cube, np.float64)
    scores = score(cube, world.truth)
    row: Row = {
        "psnr_db": scores.psnr_db,
        "band_psnr_db": list(scores.band_psnr_db),
        "ssim": scores.ssim,
        "sam_deg": scores.sam_deg,
        "converged": found.converged,
        "iterations": found.iterations,
        "tau_fraction": found.tau_fraction,
        "at_edge": found.at_edge,
    }
    if world.scene == TARGET_2:
        row["false_color"] = false_color(cube, world)
    if world.scene == BENCH:
        row["signatures"] = {name: compared(cube, world.truth, place) for name, place in reference_pixels(world.size).items()}
    return row


def false_color(cube: np.ndarray, world: World) -> float:
    """Return the mean chroma difference to the truth of block means on the finest bars (CIE 1976 dC*ab)."""
    window = finest_window(world.truth)
    exposure = exposure_of(world.truth, world.bands)
    seen, true = (lab(block_means(values[window], FALSE_COLOR_BLOCK), world.bands, exposure) for values in (cube, world.truth))
    return float(np.mean(np.hypot(*np.moveaxis(seen - true, -1, 0)[1:])))


def reference_pixels(size: int) -> dict[str, tuple[int, int]]:
    """Return (row, column) of the test bed's two reference points."""
    from scenes.bricks import Bricks

    return {name: (int(y * size), int(x * size)) for name, (x, y) in Bricks().picture_points().items()}


def signature(cube: np.ndarray, place: tuple[int, int]) -> np.ndarray:
    """Return the mean spectrum (K,) of 3 x 3 pixels around a place."""
    y, x = place
    return np.asarray(cube[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2].mean((0, 1)), np.float64)


def compared(cube: np.ndarray, truth: np.ndarray, place: tuple[int, int]) -> dict[str, float]:
    """Compare the signature of a point with the true one.

    Returns:
        ``error``: rms of the difference over the true rms. ``background`` and ``gain``: of the line
        seen = background mean(true) + gain true that fits best over the bands; a faithful signature has 0 and 1.
        ``angle_deg``: between the two spectra.
    """
    seen, true = signature(cube, place), signature(truth, place)
    design = np.stack([np.full_like(true, true.mean()), true], axis=1)
    background, gain = np.linalg.lstsq(design, seen, rcond=None)[0]
    cosine = float(seen @ true / (np.linalg.norm(seen) * np.linalg.norm(true)))
    return {
        "error": float(np.sqrt(np.mean((seen - true) ** 2) / np.mean(true**2))),
        "background": float(background),
        "gain": float(gain),
        "angle_deg": float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))),
    }

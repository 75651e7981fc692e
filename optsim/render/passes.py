"""Add independent passes until the error asked for, with progress, checkpoint and resume."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from optsim.render import replicates
from optsim.render.needs import Needs
from optsim.render.replicates import Replicates
from optsim.render.settings import RenderSettings
from scenes.scene import Scene

MIN_PASSES = 4
PILOT_SAMPLES, DEEP_PILOT_SAMPLES = 4, 16
"""Samples of each of the first four passes: more where light takes rare ways that four samples may miss altogether."""
PASSES_PLANNED = 8
MAX_PATHS_A_PASS = 2**28
"""About ten seconds of a flat scene on two cores: the grain of progress and of what an interruption loses."""
CHECKPOINT_EVERY_S = 10.0

Progress = Callable[[float, float | None], None]
"""Called after each pass with the share of the work done (0 to 1) and the error estimate (None before there is one)."""


class Renderable(Protocol):
    """A scene ready to be traced: :class:`optsim.render.transport.Transport` or :class:`optsim.render.reference.FilmTransport`."""

    scene: Scene
    film: tuple[int, int]
    settings: RenderSettings
    needs: Needs
    pixels: int
    max_depth: int
    nodes: np.ndarray
    weights: list[np.ndarray]
    route: str

    @property
    def groups(self) -> Sequence[object]:
        """Return the light groups, each rendered apart."""
        ...

    def empty(self) -> list[Replicates]:
        """Return fresh accumulators, one per light group."""
        ...

    def error(self, groups: list[Replicates]) -> float:
        """Return the largest relative RMS error over the bands."""
        ...

    def trace(self, group: int, samples: int, key: tuple[int, ...]) -> tuple[np.ndarray, float]:
        """Render one pass of one light group: (n, pixels) and the share of light cut by the depth limit."""
        ...


@dataclass
class State:
    """Hold what a render has done so far.

    Args:
        groups: one accumulator per light group.
        samples: paths a pixel of the next pass.
        stage: 0 for the pilot, 1 for the passes that count (or 0 throughout when a number of samples was asked for).
        spent: paths a pixel of this stage so far.
        cut: largest share of light cut off by the depth limit in a pass.
        whole: False while a pass is being taken in, or a stage set up: what an interruption then leaves must not be saved.
    """

    groups: list[Replicates]
    samples: int
    stage: int = 0
    spent: int = 0
    cut: float = 0.0
    whole: bool = True

    @property
    def passes(self) -> int:
        """Return the number of passes of this stage."""
        return min((group.count for group in self.groups), default=0)


def run(task: Renderable, progress: Progress | None, checkpoint: Path | None, digest: str) -> State:
    """Render until the goal of the task's settings, or resume from a checkpoint of the same digest.

    The checkpoint is written every ten seconds, at the end, and on an interruption; one that falls into the taking in of a pass
    leaves the checkpoint before, of at most ten seconds and a pass ago.
    """
    state = _resume(task, checkpoint, digest)
    saved = time.monotonic()
    try:
        while True:
            if _finished(task, state):
                return state
            if checkpoint is not None and time.monotonic() - saved > CHECKPOINT_EVERY_S:
                _save(state, checkpoint, digest)
                saved = time.monotonic()
            for group, accumulator in enumerate(state.groups):
                sample, cut = task.trace(group, state.samples, (task.settings.seed, group, state.stage, state.passes))
                state.whole = False
                accumulator.add(sample)
                state.cut = max(state.cut, cut)
            state.spent += state.samples
            state.whole = True
            if progress is not None:
                progress(*_standing(task, state))
    finally:
        if checkpoint is not None and state.passes:
            _save(state, checkpoint, digest)


def _standing(task: Renderable, state: State) -> tuple[float, float | None]:
    """Return the share of the work done and the error so far."""
    error = task.error(state.groups) if state.passes > 1 else None
    target = task.settings.target
    if target is None:
        return state.passes / sample_plan(task)[0], error
    if state.passes < MIN_PASSES or error is None:
        return 0.0, error
    return 1.0 if error <= target else min(0.99, (target / error) ** 2), error


def _finished(task: Renderable, state: State) -> bool:
    """Tell whether the goal is reached, and set up the second stage when the pilot was not enough.

    With an error as goal four short passes come first. If they do not reach it they are set aside, and passes follow that are
    long enough for about eight of them: the low-discrepancy points within a pass are worth more the longer it is.
    """
    if not state.groups:
        return True
    done, error = _standing(task, state)
    target = task.settings.target
    if target is None or error is None or state.passes < MIN_PASSES or done >= 1:
        return done >= 1
    limit = task.settings.max_samples
    if state.stage == 1 and state.spent >= limit:
        warnings.warn(
            f"the render stopped at {state.spent} samples a pixel with an estimated error of {error:.3g} instead of {target:g}; "
            "raise max_samples or accept a larger error",
            RuntimeWarning,
            stacklevel=5,
        )
        return True
    if state.stage == 0:
        needed = state.spent * (error / target) ** 2
        longest = max(1, min(MAX_PATHS_A_PASS // task.pixels, limit // MIN_PASSES))
        state.whole = False
        state.samples = int(np.clip(np.ceil(needed / PASSES_PLANNED), min(PILOT_SAMPLES, longest), longest))
        state.stage, state.spent, state.cut = 1, 0, 0.0
        state.groups = task.empty()
        state.whole = True
    return False


def sample_plan(task: Renderable) -> tuple[int, int]:
    """Split the samples a pixel asked for into (passes, samples of a pass), rounded up.

    At least 4 passes if there are as many samples, and none over 2^28 paths.
    """
    samples, pixels = task.settings.samples_per_pixel or 1, task.pixels
    passes = PASSES_PLANNED if samples >= 64 else MIN_PASSES
    passes = min(samples, max(passes, -(-samples * pixels // MAX_PATHS_A_PASS)))
    return passes, -(-samples // passes)


def _resume(task: Renderable, checkpoint: Path | None, digest: str) -> State:
    settings = task.settings
    if settings.target is None:
        state = State(task.empty(), sample_plan(task)[1])
    else:
        pilot = PILOT_SAMPLES if task.needs.reflects_once else DEEP_PILOT_SAMPLES
        state = State(task.empty(), min(pilot, settings.max_samples // MIN_PASSES))
    kept = replicates.load(checkpoint, digest) if checkpoint is not None else None
    if kept is None:
        return state
    state.samples, state.stage, state.spent = int(kept["samples"]), int(kept["stage"]), int(kept["spent"])
    state.cut = float(kept["cut"])
    for i, group in enumerate(state.groups):
        group.count, group.mean, group.scatter = int(kept["count"]), kept[f"mean_{i}"], kept[f"scatter_{i}"]
    return state


def _save(state: State, file: Path, digest: str) -> None:
    """Save whole passes only: after an interruption inside a pass, or between two light groups, the file before stays."""
    if not state.whole:
        return
    values: dict[str, np.ndarray | float | int] = {"samples": state.samples, "stage": state.stage, "spent": state.spent, "cut": state.cut}
    values["count"] = state.passes
    for i, group in enumerate(state.groups):
        values |= {f"mean_{i}": group.mean, f"scatter_{i}": group.scatter}
    replicates.save(file, digest, values)

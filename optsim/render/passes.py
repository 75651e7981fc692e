"""Add independent passes until the error asked for, tile by tile, with progress, checkpoint and resume."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from optsim.render import replicates
from optsim.render.estimate import TileNoise, tile_noise
from optsim.render.needs import Needs
from optsim.render.replicates import Replicates
from optsim.render.settings import RenderSettings
from optsim.render.tiles import Samples, Tiles, Traced
from scenes.scene import Scene

MIN_PASSES = 4
PILOT_SAMPLES, DEEP_PILOT_SAMPLES = 4, 16
"""Samples of each of the first four passes: more where light takes rare ways that four samples may miss altogether."""
PASSES_PLANNED = 8
MAX_PATHS_A_PASS = 2**28
"""About ten seconds of a flat scene on two cores: the grain of progress and of what an interruption loses."""
CHECKPOINT_EVERY_S = 10.0
EVEN_SHARE = 0.1
"""Share of the error's square that all tiles get alike, so that none whose noise the pilot missed must be perfect."""

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

    @property
    def tiles(self) -> Tiles:
        """Return the whole picture's tiles."""
        ...

    def empty(self, part: Tiles) -> list[Replicates]:
        """Return fresh accumulators for a part of the picture, one per light group."""
        ...

    def trace(self, group: int, samples: Samples, key: tuple[int, ...]) -> Traced:
        """Render one pass of one light group at all nodes."""
        ...


@dataclass(frozen=True)
class Plan:
    """Say how the tiles of a picture, or of a part of it, share the work (theory.md (R.43)).

    Args:
        samples: (tiles,) paths a pixel of each pass.
        budget: (tiles, K) mean variance at which a tile may stop.
    """

    samples: np.ndarray
    budget: np.ndarray

    def of(self, tiles: slice) -> Plan:
        """Return the plan of some tiles."""
        return Plan(self.samples[tiles], self.budget[tiles])


@dataclass
class State:
    """Hold what the render of a part of the picture has done so far.

    Args:
        part: the part.
        groups: one accumulator per light group.
        plan: how many paths each pixel gets in a pass, and when tiles stop.
        stage: 0 for the pilot, 1 for the passes that count (or 0 throughout when a number of samples was asked for).
        passes_of: (tiles,) passes of this stage.
        going: (tiles,) which tiles go on.
        cut: largest share of light cut off by the depth limit in a pass.
        told: (2, pixels) sums over passes: share of the paths that met dispersing glass first, and radiance (mean of the bands) that came
            by way of glass or mirrors; (0, pixels) where nothing is told; None before the first pass.
        whole: False while a pass is being taken in, or a stage set up: what an interruption then leaves must not be saved.
    """

    part: Tiles
    groups: list[Replicates]
    plan: Plan
    stage: int
    passes_of: np.ndarray
    going: np.ndarray
    cut: float = 0.0
    told: np.ndarray | None = None
    whole: bool = True

    @property
    def passes(self) -> int:
        """Return the largest number of passes of a tile in this stage."""
        return int(self.passes_of.max()) if self.groups else 0

    @property
    def spent_by_tile(self) -> np.ndarray:
        """Return (tiles,) paths a pixel in this stage."""
        return self.plan.samples * self.passes_of

    @property
    def spent(self) -> int:
        """Return the mean number of paths a pixel in this stage, rounded."""
        return round(float(self.spent_by_tile @ self.part.sizes) / self.part.pixels) if self.groups else 0

    def noise(self, weights: list[np.ndarray]) -> TileNoise:
        """Return the noise of the tiles; at least two passes."""
        return tile_noise(self.groups, weights, self.part)


def run(task: Renderable, progress: Progress | None, checkpoint: Path | None, digest: str) -> State:
    """Render the whole picture until the goal of the task's settings, or resume from a checkpoint of the same digest.

    The checkpoint is written every ten seconds, at the end, and on an interruption; one that falls into the taking in of a pass
    leaves the checkpoint before, of at most ten seconds and a pass ago.
    """
    state = _resume(task, checkpoint, digest)
    saved = time.monotonic()
    try:
        while not _finished(task, state):
            if checkpoint is not None and time.monotonic() - saved > CHECKPOINT_EVERY_S:
                _save(state, checkpoint, digest)
                saved = time.monotonic()
            add_pass(task, state)
            if progress is not None:
                progress(*_standing(task, state))
        return state
    finally:
        if checkpoint is not None and state.passes:
            _save(state, checkpoint, digest)


def add_pass(task: Renderable, state: State) -> None:
    """Trace one pass of the tiles that go on and take it in."""
    part = state.part
    counts = np.where(state.going, state.plan.samples, 0).astype(np.uint32)[part.of_pixel]
    active = None if state.going.all() else state.going[part.of_pixel]
    for group, accumulator in enumerate(state.groups):
        key = (task.settings.seed, group, state.stage, state.passes)
        traced = task.trace(group, Samples(part.first, counts), key)
        state.whole = False
        accumulator.add(traced.values, active)
        state.cut = max(state.cut, traced.cut)
        factors = np.array([group == 0, task.weights[group].sum(1).mean()])[: len(traced.told), None]
        state.told = factors * traced.told + (0.0 if state.told is None else state.told)
    state.passes_of = state.passes_of + state.going
    state.whole = True


def _standing(task: Renderable, state: State) -> tuple[float, float | None]:
    """Return the share of the work done and the error so far."""
    noise = state.noise(task.weights) if state.passes > 1 else None
    error = None if noise is None else float(noise.errors.max())
    target = task.settings.target
    if target is None:
        return state.passes / sample_plan(task)[0], error
    if noise is None or error is None or state.passes < MIN_PASSES:
        return 0.0, error
    if state.stage == 0:
        return 1.0 if error <= target else min(0.99, (target / error) ** 2), error
    return 1.0 if error <= target and not settle(task, state, noise).any() else min(0.99, (target / max(error, target)) ** 2), error


def _finished(task: Renderable, state: State) -> bool:
    """Tell whether the goal is reached, and set up the second stage when the pilot was not enough.

    With an error as goal four short passes come first. If they do not reach it they are set aside, and passes follow that are
    long enough for about eight of them: the low-discrepancy points within a pass are worth more the longer it is.
    """
    if not state.groups:
        return True
    target = task.settings.target
    if target is None:
        return state.passes >= sample_plan(task)[0]
    if state.passes < MIN_PASSES:
        return False
    noise = state.noise(task.weights)
    if state.stage == 0:
        if noise.errors.max() <= target:
            return True
        state.whole = False
        plan = allot(task, noise, state.plan.samples * state.passes_of)
        state.plan, state.stage, state.cut, state.told = plan, 1, 0.0, None
        state.groups = task.empty(state.part)
        state.passes_of, state.going = np.zeros_like(state.passes_of), np.ones_like(state.going)
        state.whole = True
        return False
    state.going = settle(task, state, noise)
    if state.going.any():
        return False
    warn_if_missed(task, float(noise.errors.max()), state.spent)
    return True


def settle(task: Renderable, state: State, noise: TileNoise) -> np.ndarray:
    """Tell which tiles go on: those whose noise is above their budget and whose paths are not used up."""
    far = np.any(noise.squares / noise.sizes[:, None] > state.plan.budget, axis=1)
    left = state.spent_by_tile + state.plan.samples <= task.settings.max_samples
    return state.going & far & (left | (state.passes_of < MIN_PASSES))


def warn_if_missed(task: Renderable, error: float, spent: int) -> None:
    """Warn when the passes ended before the error asked for."""
    target = task.settings.target
    if target is not None and error > target:
        warnings.warn(
            f"the render stopped at {spent} samples a pixel with an estimated error of {error:.3g} instead of {target:g}; "
            "raise max_samples or accept a larger error",
            RuntimeWarning,
            stacklevel=6,
        )


def allot(task: Renderable, pilot: TileNoise, spent: np.ndarray) -> Plan:
    """Share the work among tiles so that the picture's error is reached with the fewest paths (Neyman 1934; theory.md (R.43)).

    Args:
        task: what is rendered.
        pilot: noise of a first stage, all tiles of the picture.
        spent: (tiles,) paths a pixel that made it.
    """
    target = task.settings.target
    assert target is not None
    mean = pilot.level / pilot.pixels
    lit = mean > 0
    square = np.divide(pilot.squares / pilot.sizes[:, None], mean**2, out=np.zeros_like(pilot.squares), where=lit)
    spread = np.sqrt(square.max(1) * spent)  # of one path, in the worst band
    share = (1 - EVEN_SHARE) * spread / (spread @ pilot.sizes / pilot.pixels) + EVEN_SHARE
    needed = spent * square.max(1) / (share * target**2)
    limit = task.settings.max_samples
    longest = max(1, min(MAX_PATHS_A_PASS // task.pixels, limit // MIN_PASSES))
    samples = np.clip(np.ceil(needed / PASSES_PLANNED), min(PILOT_SAMPLES, longest), longest).astype(np.int64)
    return Plan(samples, np.where(lit, share[:, None] * target**2 * mean**2, np.inf))


def sample_plan(task: Renderable) -> tuple[int, int]:
    """Split the samples a pixel asked for into (passes, samples of a pass), rounded up.

    At least 4 passes if there are as many samples, and none over 2^28 paths.
    """
    samples, pixels = task.settings.samples_per_pixel or 1, task.pixels
    passes = PASSES_PLANNED if samples >= 64 else MIN_PASSES
    passes = min(samples, max(passes, -(-samples * pixels // MAX_PATHS_A_PASS)))
    return passes, -(-samples // passes)


def first_state(task: Renderable, part: Tiles) -> State:
    """Return the state in which a part of the picture starts: all of it when a number of samples was asked for, else the pilot."""
    if task.settings.target is None:
        samples = sample_plan(task)[1]
    else:
        pilot = PILOT_SAMPLES if task.needs.reflects_once else DEEP_PILOT_SAMPLES
        samples = min(pilot, task.settings.max_samples // MIN_PASSES)
    plan = Plan(np.full(part.count, samples), np.zeros((part.count, len(task.weights[0]) if task.weights else 0)))
    return State(part, task.empty(part), plan, 0, np.zeros(part.count, np.int64), np.ones(part.count, bool))


def _resume(task: Renderable, checkpoint: Path | None, digest: str) -> State:
    state = first_state(task, task.tiles)
    kept = replicates.load(checkpoint, digest) if checkpoint is not None else None
    if kept is None:
        return state
    state.plan, state.stage, state.cut = Plan(kept["samples"], kept["budget"]), int(kept["stage"]), float(kept["cut"])
    state.passes_of, state.going, state.told = kept["passes"], kept["going"], kept["told"]
    for i, group in enumerate(state.groups):
        group.counts, group.mean, group.scatter, group.band_scatter = (kept[f"{name}_{i}"] for name in _KEPT)
    return state


_KEPT = ("counts", "mean", "scatter", "bands")


def _save(state: State, file: Path, digest: str) -> None:
    """Save whole passes only: after an interruption inside a pass, or between two light groups, the file before stays."""
    if not state.whole:
        return
    values: dict[str, np.ndarray | float | int] = {"samples": state.plan.samples, "budget": state.plan.budget, "stage": state.stage}
    values |= {"cut": state.cut, "passes": state.passes_of, "going": state.going}
    values["told"] = np.zeros((0, state.part.pixels)) if state.told is None else state.told
    for i, group in enumerate(state.groups):
        assert group.band_scatter is not None
        values |= {f"{name}_{i}": a for name, a in zip(_KEPT, (group.counts, group.mean, group.scatter, group.band_scatter))}
    replicates.save(file, digest, values)

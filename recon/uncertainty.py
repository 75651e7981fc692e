"""How wrong is every voxel? The estimate, displaced and photographed again, tells (theory.md (S.82) to (S.85))."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from recon import threads as pool
from recon.config import Config
from recon.errors import InputError
from recon.operator import Operator
from recon.problem import Problem, Solver
from recon.solution import Solution
from recon.tau.choice import Given, as_given

if TYPE_CHECKING:
    from recon.tau.choice import TauRule

OnRepeat = Callable[[int, Solution], None]
"""Called with the number of the finished solve, from 0, and its solution; what it raises ends the work."""
QUADRANTS = ((1, 1), (-1, -1), (1, -1), (-1, 1))
FAINTEST = 1e-3  # of the rms: no voxel is believed to be better than this
LEVELS = 1001
GENERATIONS = 2
"""Repeats that are photographed and reconstructed once more."""


class Displaced(Config):
    """Estimate errors by repeating the measurement on the estimate itself, displaced by some pixels each time.

    Every repeat meets the masks and the wavelets at other places, so that what they lose of structures like these shows as error.
    Where the scene has more detail than its estimate, repeats are too good. Two factors make up for that: what the pixels held out
    show more of error in the frames than in the repeats, and how much less error repeats of the repeats have.

    Args:
        repeats: 4 to 64, each as long as a reconstruction; four more are made besides.
        reach: largest displacement as a part of the sides, above 0 and at most 0.5.
        share: part of the detector's pixels held out, above 0 and at most 0.5.
        seed: of displacements, pixels and noise, 0 to 2^64 - 1.
    """

    repeats: int = Field(default=8, ge=4, le=64)
    reach: float = Field(default=1 / 6, gt=0, le=0.5)
    share: float = Field(default=0.1, gt=0, le=0.5)
    seed: int = Field(default=0, ge=0, lt=2**64)


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """An estimated cube with an estimate of each voxel's error.

    Args:
        solution: the reconstruction from all data.
        error: (M, N, K) expected root mean square error of each voxel, in the cube's unit.
        scale: factor on the repeats' error (held-out pixels, repeats of repeats), at least 1; far above it says that the scene is unlike
            its estimate.
        quantiles: of |error made| / ``error`` over the repeats, from level 0 to 1 in equal steps.
    """

    solution: Solution
    error: np.ndarray
    scale: float
    quantiles: np.ndarray

    def half_width(self, level: float = 0.95) -> np.ndarray:
        """Return (M, N, K) h such that the truth lies within ``cube - h`` and ``cube + h`` in a share ``level`` of all voxels.

        The level holds on average over the cube, not for each voxel.

        Raises:
            InputError: field ``level`` outside (0, 1).
        """
        if not 0 < level < 1:
            raise InputError("level", level, "above 0 and below 1")
        factor = float(np.interp(level, np.linspace(0, 1, self.quantiles.size), self.quantiles))
        return np.asarray(factor * self.error)


def estimate_error(
    operator: Operator,
    frames: np.ndarray,
    given: Given | None = None,
    *,
    solver: Solver | None = None,
    tau: float | TauRule | None = None,
    how: Displaced | None = None,
    on_repeat: OnRepeat | None = None,
) -> ErrorEstimate:
    """Reconstruct, and estimate the error of every voxel without ground truth.

    Args:
        operator: H.
        frames: measurements of its ``out_shape``, not all zero.
        given: prior, noise, sign and threads. Without noise the repeats get the residual with random signs.
        solver: as for :func:`recon.reconstruct`.
        tau: the same; a rule chooses once, for all repeats.
        how: the repeats; None: ``Displaced()``.
        on_repeat: called after each solve.

    Raises:
        InputError: see :func:`recon.reconstruct`; ``frames`` when they are zero everywhere.
    """
    about, plan = as_given(given), Displaced() if how is None else how
    plain = Given(about.prior, None, about.nonnegative, about.threads)
    problem = plain.pose(operator, frames)
    if problem is None:
        raise InputError("frames", 0.0, "different from zero somewhere: without light there is no error to estimate")
    solution = about.reconstruct(operator, frames, solver=solver, tau=tau)
    _tell(on_repeat, 0, solution)
    world = _World(problem, about, plan, np.asarray(frames, np.float64), solution)
    blind = about.without(world.held, world.frames.shape)
    again = blind.reconstruct(operator, frames, solver=solver, tau=solution.tau, start=solution.cube)
    _tell(on_repeat, 1, again)
    asked = world.surprise(frames, again.cube)
    repeats, found, grown = [], [], []
    for i in range(plan.repeats):
        step = world.displacement(i)
        truth, seen = world.photograph(world.cube, step)
        repeat = blind.reconstruct(operator, seen, solver=solver, tau=solution.tau)
        _tell(on_repeat, 2 + i, repeat)
        found.append(world.surprise(seen, repeat.cube))
        repeats.append(_returned(repeat.cube - truth, step))
        if i < GENERATIONS:
            offspring, seen = world.photograph(repeat.cube, world.displacement(i + 1))
            child = blind.reconstruct(operator, seen, solver=solver, tau=solution.tau)
            grown.append((((repeat.cube - truth) ** 2).mean(), ((child.cube - offspring) ** 2).mean()))
    scale = _at_least_one(asked, float(np.mean(found))) * _at_least_one(*np.mean(grown, axis=0))
    squares, counts = (np.sum(part, axis=0) for part in zip(*repeats))
    error = _smoothed(squares, counts)
    return ErrorEstimate(solution, scale * error, scale, _quantiles(repeats, squares, counts))


def _at_least_one(above: float, below: float) -> float:
    """Return the root of a ratio of squares, never less than 1."""
    return max(1.0, math.sqrt(above / below)) if below > 0 else 1.0


class _World:
    """The scene that the estimate describes, to be photographed again."""

    def __init__(self, problem: Problem, about: Given, plan: Displaced, frames: np.ndarray, solution: Solution) -> None:
        self.frames, self._problem, self._about, self._plan = frames, problem, about, plan
        self._draw = np.random.Generator(np.random.Philox(plan.seed))
        detector = frames.shape[-2:]
        self.held = self._draw.random(detector) < plan.share
        if self.held.all() or not self.held.any():
            self.held.flat[0] = not self.held.flat[0]
        self.cube = solution.cube.astype(np.float64)
        self._residual = frames - self._seen(self.cube)
        self._variance = None if about.noise is None else np.broadcast_to(np.asarray(about.noise, np.float64), frames.shape)
        if self._variance is not None and not np.isfinite(self._variance[..., self.held]).any():
            drawn = f"infinite at all {int(self.held.sum())} held-out pixels"
            raise InputError("noise", drawn, "finite at some of the pixels held out; take a larger Displaced.share or another seed")

    def displacement(self, number: int) -> tuple[int, int]:
        """Draw rows and columns to move by; four repeats cover all four corners."""
        signs = QUADRANTS[number % 4]
        sides = [max(1, int(self._plan.reach * side)) if side > 1 else 0 for side in self.cube.shape[:2]]
        down, right = (sign * int(self._draw.integers(0, side + 1)) for sign, side in zip(signs, sides))
        return down, right

    def photograph(self, scene: np.ndarray, step: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return the displaced scene and frames of it with noise."""
        truth = _displaced(scene.astype(np.float64), step)
        return truth, self._seen(truth) + self._noise()

    def surprise(self, frames: np.ndarray, cube: np.ndarray) -> float:
        """Return the mean squared error at the held-out pixels, above the noise that is known."""
        gap = (np.asarray(frames, np.float64) - self._seen(cube.astype(np.float64)))[..., self.held]
        if self._variance is None:
            return float((gap**2).mean())
        variance = self._variance[..., self.held]
        weight = np.where(np.isfinite(variance), variance[np.isfinite(variance)].min() / variance, 0.0)
        noise = np.where(np.isfinite(variance), variance, 0.0)
        total = float((weight * gap**2).sum())
        return max(total - float((weight * noise).sum()), 0.05 * total) / gap.size

    def _noise(self) -> np.ndarray:
        if self._variance is None:
            return np.asarray(self._residual * self._draw.choice(np.array([-1.0, 1.0]), self.frames.shape))
        sigma = np.sqrt(np.where(np.isfinite(self._variance), self._variance, 0.0))
        return np.asarray(sigma * self._draw.standard_normal(self.frames.shape))

    def _seen(self, cube: np.ndarray) -> np.ndarray:
        with pool.use(self._about.threads):
            return self._problem.photographed(cube) * self._problem.light


def _tell(on_repeat: OnRepeat | None, number: int, solution: Solution) -> None:
    if on_repeat is not None:
        on_repeat(number, solution)


def _displaced(cube: np.ndarray, step: tuple[int, int]) -> np.ndarray:
    """Move a cube by whole pixels; its edge pixels fill what comes in."""
    rows, columns = (np.clip(np.arange(side) - by, 0, side - 1) for side, by in zip(cube.shape, step))
    return np.asarray(cube[rows][:, columns])


def _returned(error: np.ndarray, step: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Move errors back to where their structures are: squares (0 where nothing came back) and how many there are, 0 or 1."""
    there = [(np.arange(side) + by >= 0) & (np.arange(side) + by < side) for side, by in zip(error.shape, step)]
    valid = (there[0][:, None] & there[1][None, :])[:, :, None]
    back = _displaced(error.astype(np.float64) ** 2, (-step[0], -step[1]))
    return back * valid, np.broadcast_to(valid, error.shape).astype(np.float64)


def _smoothed(squares: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the rms over repeats and over the 3 x 3 x 3 voxels around each voxel."""
    from scipy.ndimage import uniform_filter

    total, number = (np.maximum(uniform_filter(part, 3, mode="constant"), 0) for part in (squares, counts))
    mean = np.divide(total, number, out=np.full_like(total, squares.sum() / counts.sum()), where=number > 1e-6)
    return np.asarray(np.sqrt(np.maximum(mean, FAINTEST**2 * mean.mean())))


def _quantiles(repeats: list[tuple[np.ndarray, np.ndarray]], squares: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return quantiles of |error| / estimated error, where each repeat's errors are estimated from the other repeats."""
    ratios = []
    for own, one in repeats:
        others = _smoothed(squares - own, counts - one)
        ratios.append((np.sqrt(own) / np.maximum(others, np.finfo(float).tiny))[(one > 0) & (counts > 1)])
    return np.asarray(np.quantile(np.concatenate(ratios), np.linspace(0, 1, LEVELS)))

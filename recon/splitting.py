"""Douglas-Rachford splitting, the engine of basis pursuit and of ADMM (theory.md (S.11)).

It alternates the exact data step with the prior's proximal map. The threshold's level only sets the speed, never
the answer: it starts high, where the picture's large structures settle in a few iterations, and falls geometrically
to an end level that balances the two residuals. Levels are in units of the root mean square of the first estimate, so
nothing depends on the light or on the response.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from recon.coded_aperture import empty_cube
from recon.operator_step import DataStep, Sums
from recon.prior import Penalty
from recon.problem import Problem
from recon.solution import Stop


@dataclass(frozen=True)
class Levels:
    """How the threshold falls: from ``start`` to ``end``, in units of the first estimate's rms, by ``decay`` every ``hold`` iterations."""

    start: float = 3.5
    end: float = 0.6
    decay: float = 0.98
    hold: int = 1

    def after(self, iteration: int) -> float:
        """Return the level that iteration + 1 uses."""
        return max(self.end, self.start * self.decay ** (iteration // self.hold * self.hold))


def levels_for(penalty: Penalty, default: Levels) -> Levels:
    """Return how the threshold falls best for a penalty that knows (its ``levels``), else ``default``."""
    known = getattr(penalty, "levels", None)
    return known if isinstance(known, Levels) else default


@dataclass
class Limits:
    """When to stop: tolerance, iterations and wall time."""

    tolerance: float
    max_iterations: int
    time_limit_s: float | None = None
    _began: float = field(default_factory=time.perf_counter)

    def out_of_time(self) -> bool:
        """Tell whether the wall-time limit has passed."""
        return self.time_limit_s is not None and time.perf_counter() - self._began > self.time_limit_s

    def exhausted(self, iteration: int, residual: float) -> Stop | None:
        """Return why to give up after this iteration, if so."""
        where = f"the residual {residual:.2g} is above the tolerance {self.tolerance:.2g}"
        if self.out_of_time():
            return Stop(f"the time limit of {self.time_limit_s:g} s came at iteration {iteration}: {where}; allow more time", False)
        if iteration >= self.max_iterations:
            return Stop(f"max_iterations = {self.max_iterations} reached: {where}; raise max_iterations or the tolerance", False)
        return None


@dataclass
class State:
    """The iterates: ``x`` from the data step and ``sparse``, which holds the shrunk cube s in the callback and ``2 x - z`` at the end.

    ``value`` is R(s) of the last s, ``level`` the threshold that comes next.
    """

    x: np.ndarray
    sparse: np.ndarray
    value: float = 0.0
    level: float = 0.0
    iterations: int = 0


def split(
    problem: Problem,
    step_at: Callable[[float], DataStep],
    levels: Levels,
    relax: float,
    limits: Limits,
    scale: float | None = None,
    on_iteration: Callable[[State], None] | None = None,
) -> tuple[State, Stop]:
    """Iterate until both residuals are below the tolerance.

    Args:
        problem: the normalised problem.
        step_at: the data step for a threshold's level (absolute); called again when the level changes.
        levels: the schedule of the threshold.
        relax: over-relaxation, of (0, 2).
        limits: tolerance, iterations, time.
        scale: rms of the cube; None: of the first data step's answer.
        on_iteration: called with the state after each iteration.

    The primal residual is ``||s - x|| / ||x||``, the dual one ``||x - x_before|| / (10 ||z - x||)``.
    """
    state, z, w, x = begin(problem)
    level = levels.start * (1.0 if scale is None else scale)
    step = step_at(level)
    sums = step.advance(z, w, x, 0.0)
    if scale is None:
        scale = math.sqrt(sums.size / x.size)
        level = levels.start * scale
    state.level = level
    stop = None
    while stop is None:
        state.value = problem.penalty.shrink(state.sparse, level)
        state.iterations += 1
        if on_iteration is not None:
            on_iteration(state)
        follow = levels.after(state.iterations) * scale
        if follow != level:
            sums = step.advance(z, w, x, relax, follow / level)
            level, step = follow, step_at(follow)
            state.level = level
        else:
            sums = step.advance(z, w, x, relax)
        stop = _judge(state.iterations, sums, limits)
    return state, stop


def begin(problem: Problem) -> tuple[State, np.ndarray, np.ndarray, np.ndarray]:
    """Return the state and the band-major z, w, x that ``DataStep.advance`` works on; w and x are the state's cubes."""
    shape = tuple(problem.operator.in_shape)
    cubes = [empty_cube(shape, problem.operator.dtype) for _ in range(3)]
    for cube in cubes:
        cube[...] = 0
    if problem.start is not None:
        cubes[0][...] = problem.start
    z, w, x = (cube.transpose(2, 0, 1) for cube in cubes)
    return State(cubes[2], cubes[1]), z, w, x


def _judge(iteration: int, sums: Sums, limits: Limits) -> Stop | None:
    gap, change, size, moved = sums
    primal = math.sqrt(gap / size) if size > 0 else 0.0
    dual = 0.1 * math.sqrt(change / moved) if moved > 0 else 0.0
    residual = max(primal, dual)
    if residual <= limits.tolerance:
        return Stop(f"converged: both residuals ({primal:.2g}, {dual:.2g}) are below the tolerance {limits.tolerance:.2g}", True)
    return limits.exhausted(iteration, residual)

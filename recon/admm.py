"""ADMM for Eq. 4 with the exact data step (theory.md (S.13))."""

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from recon.config import Config
from recon.data_step import DataStep, data_step, doubts, largest_eigenvalue, least_squares_step, project
from recon.lanczos import worst
from recon.nonnegative import Bound
from recon.operator_step import ProjectionStep
from recon.precision import check_step
from recon.problem import Found, OnIteration, Problem, blank, edge_cases
from recon.solution import Stop
from recon.splitting import Levels, Limits, State, levels_for, split

BOUND_RHO = 0.1  # of the largest eigenvalue of H^T H: rho of the splitting at tau = 0
CEILING = 0.3  # of the reference tau: above it priors without a tau_max get higher levels, not a larger rho
LEVELS = Levels(start=3.0, end=0.6, decay=0.6 ** (1 / 20), hold=20)  # each new level costs new blocks, so it is held


class Admm(Config):
    """Minimise ``||g - H f||^2 + tau R(f)`` by alternating an exact data step with the prior's proximal map.

    This is Douglas-Rachford splitting, the form of ADMM that eliminates the multiplier.

    Args:
        tolerance: both residuals of the splitting must fall below it (relative); below less where a prior without a tau_max,
            such as total variation, gets a tau above 0.3 of the reference.
        max_iterations: 0 returns the first guess.
        time_limit_s: wall time in s, or None.
        gamma: multiplies every threshold level; it changes the speed, not the answer.
        relax: over-relaxation, of (0, 2).
    """

    needs_tau: ClassVar[bool] = True

    tolerance: float = Field(default=2e-4, gt=0, lt=1)
    max_iterations: int = Field(default=500, ge=0, le=10**7)
    time_limit_s: float | None = Field(default=None, gt=0)
    gamma: float = Field(default=1.0, ge=1e-3, le=1e3)
    relax: float = Field(default=1.8, gt=0, lt=2)

    def solve(self, problem: Problem, on_iteration: OnIteration | None = None) -> Found:
        """Solve; ``on_iteration(iteration, objective)`` with Eq. 4 of the sparse iterate in the caller's units."""
        tau, tau_max = problem.weight, problem.tau_max()
        if (found := edge_cases(problem, tau, tau_max, self.max_iterations)) is not None:
            return found
        if tau == 0 and not problem.nonnegative:
            return least_squares(problem, tau_max, Limits(self.tolerance, self.max_iterations, self.time_limit_s))
        scale = _rms_guess(problem)
        if tau == 0:
            return self._bounded_least_squares(problem, tau_max, scale, on_iteration)
        steps: dict[float, DataStep] = {}

        def step_at(level: float) -> DataStep:
            if level not in steps:
                steps.clear()
                steps[level] = data_step(problem.operator, problem.exact_frames, tau / (2 * level))
            return steps[level]

        def report(state: State) -> None:
            if on_iteration is not None:
                on_iteration(state.iterations, (problem.misfit(state.sparse) + tau * state.value) * problem.light**2)

        lift = _lift(problem, tau, tau_max)
        rule, raised = levels_for(problem.penalty, LEVELS), self.gamma * lift
        levels = Levels(rule.start * raised, rule.end * raised, rule.decay, LEVELS.hold)
        least = min(self.tolerance, 8 * float(np.finfo(problem.frames.dtype).eps))
        limits = Limits(max(self.tolerance / lift, least), self.max_iterations, self.time_limit_s)
        state, stop = split(problem, step_at, levels, self.relax, limits, scale, report)
        value = problem.penalty.shrink(state.sparse, state.level)
        sparse = problem.misfit(state.sparse) + tau * value
        cube = state.sparse if problem.nonnegative or sparse <= problem.eq4(state.x, tau) else state.x
        return Found(cube, state.iterations, stop, tau, tau_max)

    def _bounded_least_squares(self, problem: Problem, tau_max: float | None, scale: float, on_iteration: OnIteration | None) -> Found:
        """Minimise ``||g - H f||^2`` over f >= 0; the answer depends neither on the level nor on rho."""
        bounded = replace(problem, penalty=Bound())
        step = data_step(problem.operator, problem.exact_frames, BOUND_RHO * self.gamma * largest_eigenvalue(problem.operator))

        def report(state: State) -> None:
            if on_iteration is not None:
                on_iteration(state.iterations, problem.misfit(state.sparse) * problem.light**2)

        limits = Limits(self.tolerance, self.max_iterations, self.time_limit_s)
        state, stop = split(bounded, lambda level: step, Levels(1, 1, 1), self.relax, limits, scale, report)
        bounded.penalty.shrink(state.sparse, 0.0)
        notes = (*step.notes, *doubts(problem.operator, problem.exact_frames, limits.out_of_time))
        reason = f"tau = 0: the unregularised least-squares cube without negative values; {stop.reason}"
        return Found(state.sparse, state.iterations, Stop(reason, stop.converged), 0.0, tau_max, notes)


def least_squares(problem: Problem, tau_max: float | None, limits: Limits) -> Found:
    """Return the least-squares cube nearest to the start: Eq. 4 at tau = 0, in one exact step or by conjugate gradients."""
    step = least_squares_step(problem.operator, problem.exact_frames, limits.max_iterations, limits.out_of_time)
    start = blank(problem) if problem.start is None else problem.start
    cube = project(step, start)
    check_step(problem.frames.dtype, step.condition)
    reason = "tau = 0: the unregularised least-squares cube nearest to the start; give a tau above 0 or use basis pursuit for a sparse one"
    if not isinstance(step, ProjectionStep):
        return Found(project(step, cube), 1, Stop(reason, True), 0.0, tau_max, step.notes)
    reason += f"; {step.made} iterations of conjugate gradients, condition at least {step.seen:.1e}"
    safe = step.seen <= worst(problem.frames.dtype)
    if not safe:
        reason += ", too ill-conditioned to trust"
    elif not step.met:
        reason += f"; the gradient has not vanished: raise max_iterations = {limits.max_iterations} or the time limit"
    return Found(cube, step.made, Stop(reason, step.met and safe), 0.0, tau_max, (*step.notes, *step.warning()))


def _lift(problem: Problem, tau: float, tau_max: float | None) -> float:
    """Return how much higher levels must be, and lower the tolerance, where a large tau would freeze the cube by its rho.

    What the residuals leave of R counts tau times in the objective, so they must be smaller by as much (theory.md (S.13)).
    """
    return 1.0 if tau_max is not None else max(1.0, tau / (CEILING * problem.reference_tau()))


def _rms_guess(problem: Problem) -> float:
    """Estimate the rms of the answer by one steepest-descent step from zero."""
    back = problem.operator.adjoint(problem.frames)
    seen = problem.operator.forward(back)
    size, image = float((back.astype(float) ** 2).sum()), float((seen.astype(float) ** 2).sum())
    return size / image * math.sqrt(size / back.size)

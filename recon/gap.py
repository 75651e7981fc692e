"""Generalised alternating projection with a decaying weight: projection and denoising by turns (theory.md (S.67))."""

import math
from typing import ClassVar

from pydantic import Field

from recon.config import Config
from recon.data_step import data_step, project
from recon.problem import Found, OnIteration, Problem, first_guess
from recon.solution import Stop
from recon.splitting import Limits, begin


class Gap(Config):
    """Project on the cubes that explain the frames, denoise with the prior's proximal map, lower the weight, again (Yuan 2016).

    With a total variation as prior it is GAP-TV. It minimises nothing: while the weight falls the answer follows it, and it ends at a
    cube that explains the frames and that the prior hardly changes any more. A good preview after few iterations; use
    ``BasisPursuit`` for an answer that doesn't depend on the way to it.

    Args:
        start, end: first and last weight of the prior, in units of the first estimate's root mean square.
        decay: factor from one iteration to the next, of (0, 1].
        tolerance: stop when, at the last weight, an iteration changed the cube by less than this part of its norm.
        max_iterations: 0 returns the first guess.
        time_limit_s: wall time in s, or None.
    """

    needs_tau: ClassVar[bool] = False

    start: float = Field(default=2.0, gt=0, le=1e6)
    end: float = Field(default=0.003, gt=0, le=1e6)
    decay: float = Field(default=0.94, gt=0, le=1)
    tolerance: float = Field(default=1e-3, gt=0, lt=1)
    max_iterations: int = Field(default=300, ge=0, le=10**7)
    time_limit_s: float | None = Field(default=None, gt=0)

    def solve(self, problem: Problem, on_iteration: OnIteration | None = None) -> Found:
        """Solve; ``on_iteration(iteration, R of the denoised cube)``, in the caller's units."""
        if self.max_iterations == 0:
            return first_guess(problem, None, None)
        step = data_step(problem.operator, problem.exact_frames, 0.0, mixed=True)
        state, z, w, x = begin(problem)
        sums = step.advance(z, w, x, 0.0, 0.0)
        scale = math.sqrt(sums.size / x.size)
        limits = Limits(self.tolerance, self.max_iterations, self.time_limit_s)
        stop = None
        while stop is None:
            weight = max(self.end, self.start * self.decay**state.iterations)
            state.value = problem.penalty.shrink(state.sparse, weight * scale)
            state.iterations += 1
            if on_iteration is not None:
                on_iteration(state.iterations, state.value * problem.unit)
            sums = step.advance(z, w, x, 1.0, 0.0)  # relax 1 and ratio 0: z = w, x = P(z), then z = w = x
            change = math.sqrt(sums.change / sums.size) if sums.size > 0 else 0.0
            if weight <= self.end and change <= self.tolerance:
                reason = f"the weight fell to {self.end:g} and the last iteration changed the cube by {change:.2g} of its norm"
                stop = Stop(reason, True)
            else:
                stop = limits.exhausted(state.iterations, change)
        return Found(project(step, state.x), state.iterations, stop, notes=step.notes)

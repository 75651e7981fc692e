"""FISTA with restart for Eq. 4 (theory.md (S.14); Beck and Teboulle 2009, O'Donoghue and Candes 2015)."""

import math
from typing import ClassVar

import numpy as np
from pydantic import Field

from recon.coded_aperture import CodedAperture, empty_cube
from recon.config import Config
from recon.data_step import doubts, largest_eigenvalue
from recon.problem import Found, OnIteration, Problem, edge_cases
from recon.solution import Stop
from recon.splitting import Limits

ABRUPT = "; the objective grew without momentum (the step was above 2/L), so the step was shortened"
WINDOW = 10  # iterations over which the objective's fall is judged


class Fista(Config):
    """Minimise ``||g - H f||^2 + tau R(f)`` by accelerated proximal gradient steps.

    The momentum restarts whenever the objective grows. When it grows without momentum the step was too long: the last good
    cube is taken up again with a step from a new estimate of the largest eigenvalue, and the reason to stop says so.

    Args:
        tolerance: the solver stops when the objective stayed within this part of itself over 10 iterations; at tau = 0, where it
            may fall to 0, also within the square of this part of ||g||^2.
        max_iterations: 0 returns the first guess.
        time_limit_s: wall time in s, or None.
        lipschitz: largest eigenvalue of H^T H in the operator's units; None: exact from the pixel blocks, or the power
            method plus 5 % where there are none.
    """

    needs_tau: ClassVar[bool] = True

    tolerance: float = Field(default=1e-5, gt=0, lt=1)
    max_iterations: int = Field(default=1000, ge=0, le=10**7)
    time_limit_s: float | None = Field(default=None, gt=0)
    lipschitz: float | None = Field(default=None, gt=0)

    def solve(self, problem: Problem, on_iteration: OnIteration | None = None) -> Found:
        """Solve; ``on_iteration(iteration, objective)`` in the caller's units."""
        tau, tau_max = problem.weight, problem.tau_max()
        if (found := edge_cases(problem, tau, tau_max, self.max_iterations)) is not None:
            return found
        strength = problem.light / problem.unit
        given = None if self.lipschitz is None else self.lipschitz / strength**2
        descent = Descent(problem, given)
        limits = Limits(self.tolerance, self.max_iterations, self.time_limit_s)
        if tau == 0:
            descent.remark += (
                "; tau = 0: the unregularised least-squares problem; give a tau above 0 or use basis pursuit for a sparse cube"
            )
        least = descent.power * (self.tolerance if tau == 0 else float(np.finfo(problem.frames.dtype).eps) ** 2)
        trace: list[float] = []
        stop = None
        while stop is None:
            objective = descent.iterate(tau)
            if on_iteration is not None and descent.iterations > 0:
                on_iteration(descent.iterations, objective * problem.light**2)
            trace.append(objective)
            stop = self._judge(trace, descent, limits, least)
        notes = doubts(problem.operator, problem.exact_frames, limits.out_of_time) if tau == 0 else ()
        return Found(descent.best, descent.iterations, stop, tau, tau_max, notes)

    def _judge(self, trace: list[float], descent: "Descent", limits: Limits, least: float) -> Stop | None:
        fall = 1.0
        if len(trace) > WINDOW:
            last = trace[-1 - WINDOW :]
            fall = (max(last) - min(last)) / max(last[-1], least)
            if fall <= limits.tolerance:
                text = f"converged: {WINDOW} iterations changed the objective by {fall:.2g} of itself (tolerance {limits.tolerance:.2g})"
                return Stop(text + descent.remark, True)
        stop = limits.exhausted(descent.iterations, fall)
        return None if stop is None else Stop(stop.reason + descent.remark, False)


class Descent:
    """The iterates of FISTA: two cubes, the frames of the older one, and the last cube from which a step without momentum began.

    Args:
        problem: what is solved.
        bound: of the largest eigenvalue of H^T H, in normalised units; None: ``largest_eigenvalue``.
    """

    def __init__(self, problem: Problem, bound: float | None) -> None:
        shape, dtype = tuple(problem.operator.in_shape), problem.operator.dtype
        self._problem = problem
        self._x, self._old, self._kept = (empty_cube(shape, dtype) for _ in range(3))
        self._x[...] = 0 if problem.start is None else problem.start
        self._value = self._kept_value = problem.penalty.value(self._x)
        self._momentum = 0.0
        self._begin()
        self._first = self._kept_objective = math.inf
        self._last, self._plain, self._estimated = math.inf, False, bound is None
        self.power = float(np.vdot(problem.exact_frames, problem.exact_frames))
        self.iterations = -1
        self.remark = ""
        self._bound = largest_eigenvalue(problem.operator) if bound is None else self._possible(bound)

    @property
    def best(self) -> np.ndarray:
        """Return the iterate that the last objective belongs to, or the kept one where that is better."""
        return self._old if self._last <= self._kept_objective else self._kept

    def iterate(self, tau: float) -> float:
        """Return Eq. 4 of x, which becomes ``best``, and move on to the next x."""
        grown = 0.5 + math.sqrt(0.25 + self._momentum**2)
        beta = (self._momentum - 1) / grown
        objective = self._gradient_step(beta) + tau * self._value
        self.iterations += 1
        self._momentum = grown
        if not objective <= self._last * (1 + 1e-6):
            self._momentum = 1.0
            if self._plain and not objective <= self._last + self._blur() and self._overshot():
                return self._go_back()
        self._keep(objective, beta)
        self._plain, self._last = beta <= 0, objective
        self._x, self._old = self._old, self._x
        self._value = self._problem.penalty.shrink(self._x, tau / (2 * self._bound))
        return objective

    def _begin(self) -> None:
        """Start anew from x, without momentum."""
        self._old[...] = self._x
        self._seen_old = self._problem.operator.forward(self._x)
        self._momentum = 0.0

    def _keep(self, objective: float, beta: float) -> None:
        """Remember x when a step without momentum begins there, unless it is worse than the start."""
        if self._first == math.inf:
            self._first = objective
        if beta <= 0 and objective <= self._first:
            self._kept[...] = self._x
            self._kept_value, self._kept_objective = self._value, objective

    def _overshot(self) -> bool:
        """Tell whether H^T H exceeds the bound between the kept iterate and x: else an inexact proximal map made the objective grow."""
        way = self._x - self._kept
        seen = self._problem.operator.forward(way).astype(np.float64)
        return not float(np.vdot(seen, seen)) <= self._bound * float(np.vdot(way, way)) * (1 + 1e-3)

    def _go_back(self) -> float:
        """Take up the kept iterate again with a shorter step; return its objective."""
        self._bound *= 2
        if not self._estimated:
            self._bound = max(self._bound, largest_eigenvalue(self._problem.operator))
            self._estimated = True
        self._say()
        self._x[...] = self._kept
        self._value = self._kept_value
        self._begin()
        self._plain, self._last = True, self._kept_objective
        return self._last

    def _possible(self, bound: float) -> float:
        """Return a bound that is not surely below half the largest eigenvalue, which is at least |H^T g|^2 / |g|^2."""
        back = self._problem.operator.adjoint(self._problem.frames).astype(np.float64)
        least = float(np.vdot(back, back)) / self.power
        if bound >= least / 2:
            return bound
        self._say()
        return least

    def _say(self) -> None:
        if ABRUPT not in self.remark:
            self.remark += ABRUPT

    def _blur(self) -> float:
        """Return by how much rounding may make the last objective differ from itself."""
        rounding = 4 * float(np.finfo(self._problem.operator.dtype).eps) * math.sqrt(self.power)
        return 2 * math.sqrt(self._last) * rounding + rounding**2 + 1e-6 * self._last

    def _gradient_step(self, beta: float) -> float:
        """Set ``old = y + H^T (g - H y) / bound`` with ``y = x + beta (x - old)``; return ``||g - H x||^2``."""
        operator, frames = self._problem.operator, self._problem.frames
        if isinstance(operator, CodedAperture):
            return operator.descend(self._x, self._old, self._seen_old, beta, 1 / self._bound, frames)
        real = operator.dtype.type
        seen = operator.forward(self._x)
        gap = frames - seen
        rest = gap - real(beta) * (seen - self._seen_old)
        self._seen_old = seen
        self._old[...] = self._x + real(beta) * (self._x - self._old) + real(1 / self._bound) * operator.adjoint(rest)
        return float(np.vdot(gap.astype(np.float64), gap.astype(np.float64)))

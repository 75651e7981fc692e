"""FISTA with restart for Eq. 4 (theory.md (S.14); Beck and Teboulle 2009, O'Donoghue and Candes 2015)."""

import math
from typing import ClassVar

import numpy as np
from pydantic import Field

from recon.coded_aperture import CodedAperture, empty_cube
from recon.config import Config
from recon.data_step import largest_eigenvalue
from recon.problem import Found, OnIteration, Problem, edge_cases
from recon.solution import Stop
from recon.splitting import Limits

ABRUPT = "; the objective grew without momentum (the step was above 2/L), so the step was shortened"
WINDOW = 10  # iterations over which the objective's fall is judged


class Fista(Config):
    """Minimise ``||g - H f||^2 + tau R(f)`` by accelerated proximal gradient steps.

    The momentum restarts whenever the objective grows. When it grows without momentum the step was too long: it is
    halved, and the reason to stop says so.

    Args:
        tolerance: the solver stops when the objective stayed within this part of itself over 10 iterations.
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
        bound = largest_eigenvalue(problem.operator) if self.lipschitz is None else self.lipschitz / strength**2
        descent = Descent(problem, bound)
        limits = Limits(self.tolerance, self.max_iterations, self.time_limit_s)
        if tau == 0:
            descent.remark = "; tau = 0: the unregularised least-squares problem; give a tau above 0 or use basis pursuit for a sparse cube"
        trace: list[float] = []
        stop = None
        while stop is None:
            objective = descent.iterate(tau)
            if on_iteration is not None and descent.iterations > 0:
                on_iteration(descent.iterations, objective * problem.light**2)
            trace.append(objective)
            stop = self._judge(trace, descent, limits)
        return Found(descent.best, descent.iterations, stop, tau, tau_max)

    def _judge(self, trace: list[float], descent: "Descent", limits: Limits) -> Stop | None:
        if len(trace) <= WINDOW:
            return limits.exhausted(descent.iterations, 1.0)
        last = trace[-1 - WINDOW :]
        fall = (max(last) - min(last)) / max(last[-1], np.finfo(float).tiny)
        if fall <= limits.tolerance:
            text = f"converged: {WINDOW} iterations changed the objective by {fall:.2g} of itself (tolerance {limits.tolerance:.2g})"
            return Stop(text + descent.remark, True)
        stop = limits.exhausted(descent.iterations, fall)
        return None if stop is None else Stop(stop.reason + descent.remark, False)


class Descent:
    """The iterates of FISTA: two cubes and the frames of the older one."""

    def __init__(self, problem: Problem, bound: float) -> None:
        shape, dtype = tuple(problem.operator.in_shape), problem.operator.dtype
        self._problem, self._bound = problem, bound
        self._x, self._old = empty_cube(shape, dtype), empty_cube(shape, dtype)
        self._x[...] = 0 if problem.start is None else problem.start
        self._old[...] = self._x
        self._seen_old = problem.operator.forward(self._x)
        self._value = problem.penalty.value(self._x)
        self._momentum, self._last, self._plain = 0.0, math.inf, False
        self.iterations = -1
        self.remark = ""

    @property
    def best(self) -> np.ndarray:
        """Return the iterate that the last objective belongs to."""
        return self._old

    def iterate(self, tau: float) -> float:
        """Return Eq. 4 of x, which becomes ``best``, and move on to the next x."""
        grown = 0.5 + math.sqrt(0.25 + self._momentum**2)
        beta = (self._momentum - 1) / grown
        objective = self._gradient_step(beta) + tau * self._value
        self._momentum = grown
        if not objective <= self._last * (1 + 1e-6):
            self._momentum = 1.0
            if self._plain:
                self._bound *= 2
                if ABRUPT not in self.remark:
                    self.remark += ABRUPT
        self._plain, self._last = beta <= 0, objective
        self._x, self._old = self._old, self._x
        self._value = self._problem.penalty.shrink(self._x, tau / (2 * self._bound))
        self.iterations += 1
        return objective

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

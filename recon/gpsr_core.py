"""Gradient projection on theta = u - v: steps of GPSR-Basic and GPSR-BB, and debiasing (theory.md (S.31) to (S.34)).

Everything here is scaled so that the largest measurement is 1; ``weight`` is tau / 2 of that problem, because
Figueiredo, Nowak and Wright (2007) minimise half of Eq. 4.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from recon import gpsr_kernels as kernels
from recon import threads
from recon.lanczos import condition
from recon.splitting import Limits

STEP_MIN, STEP_MAX = 1e-30, 1e30
SUFFICIENT_DECREASE, BACKTRACK = 0.1, 0.5


class CoefficientModel(Protocol):
    """A = H Psi on flat coefficients: what :class:`Descent` needs of operator and basis."""

    def forward(self, theta: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply A; returns frames."""
        ...

    def adjoint(self, frames: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply A^T; returns flat coefficients."""
        ...


class LeastSquares(NamedTuple):
    """Iterations of conjugate gradients, whether the tolerance was met, and the condition of A as far as they saw it: at least that."""

    iterations: int
    converged: bool
    condition: float


class Descent:
    """One point theta with its residual r = g - A theta and A^T r, and the steps that lower the objective.

    Args:
        model: A.
        measured: g, any shape, largest magnitude 1; not changed.
        theta: flat coefficients to start from; taken over and changed in place.
    """

    def __init__(self, model: CoefficientModel, measured: np.ndarray, theta: np.ndarray) -> None:
        self.model, self.measured, self.theta = model, measured, theta
        self.delta = np.empty_like(theta)
        self.ahead = np.empty_like(measured)
        self.residual = measured.copy()
        self.back = np.empty_like(theta)
        self._sums = np.empty((max(kernels.chunk_count(theta.size), kernels.chunk_count(measured.size)), 2))
        self.step = 1.0
        self.refresh()

    def refresh(self) -> None:
        """Compute residual, A^T r and the norms anew from theta."""
        self._run(kernels.advance, self.theta.size, self.theta, self.theta, 0.0)
        self.l1, self.nonzeros = self._total(self.theta.size)
        self.residual[...] = self.measured
        if self.nonzeros:
            self.model.forward(self.theta, self.ahead)
            self._add_to_residual(-1.0)
        else:
            self.misfit = self._square(self.residual)
        self.model.adjoint(self.residual, self.back)

    def objective(self, weight: float) -> float:
        """Return Eq. 4 (without the factor 1/2) in the scaled units."""
        return self.misfit + 2 * weight * self.l1

    def barzilai_borwein(self, weight: float, monotone: bool) -> bool:
        """Make one step of GPSR-BB (theory.md (S.33)); tell whether it moved."""
        self._run(kernels.direction, self.theta.size, self.theta, self.back, weight, self.step, self.delta)
        slope, length = self._total(self.theta.size)
        if not slope < 0 or length == 0:
            return False
        self.model.forward(self.delta, self.ahead)
        curvature = self._square(self.ahead)
        along = min(1.0, -slope / curvature) if monotone and curvature > 0 else 1.0
        self._move(along)
        self.step = float(np.clip(length / curvature, STEP_MIN, STEP_MAX)) if curvature > 0 else STEP_MAX
        return True

    def basic(self, weight: float) -> bool:
        """Make one step of GPSR-Basic (theory.md (S.34)): Armijo backtracking along the projection arc."""
        self._run(kernels.free_gradient, self.theta.size, self.theta, self.back, weight, self.delta)
        length = self._total(self.theta.size)[0]
        if length == 0:
            return False
        self.model.forward(self.delta, self.ahead)
        curvature = self._square(self.ahead)
        self.step = float(np.clip(length / curvature, STEP_MIN, STEP_MAX)) if curvature > 0 else STEP_MAX
        for _ in range(60):
            self._run(kernels.direction, self.theta.size, self.theta, self.back, weight, self.step, self.delta)
            slope, length = self._total(self.theta.size)
            if not slope < 0 or length == 0:
                return False
            self.model.forward(self.delta, self.ahead)
            # F(z + d) - F(z) = slope + |A d|^2 / 2, in the paper's scale, before the common part of u and v comes off.
            if slope + self._square(self.ahead) / 2 <= SUFFICIENT_DECREASE * slope:
                self._move(1.0)
                return True
            self.step *= BACKTRACK
        return False

    def least_squares(self, support: np.ndarray | None, limits: Limits) -> LeastSquares:
        """Minimise ||g - A theta||^2 by conjugate gradients (CGLS) from the present point.

        Args:
            support: 1 for coefficients that may change, else 0; None: all may.
            limits: iterations, time, and the fraction of |A^T g| on the support at which the gradient there is small enough.
        """
        reference = self.model.adjoint(self.measured)
        if support is not None:
            reference *= support
            self.back *= support
        goal = limits.tolerance**2 * self._square(reference)
        search = self.back.copy()
        power = self._square(self.back)
        steps: list[float] = []
        turns: list[float] = []
        while power > goal and len(steps) < limits.max_iterations and not limits.out_of_time():
            self.model.forward(search, self.ahead)
            curvature = self._square(self.ahead)
            if curvature == 0:
                break
            self.delta[...] = search
            self._move(power / curvature)
            if support is not None:
                self.back *= support
            before, power = power, self._square(self.back)
            steps.append(before / curvature)
            turns.append(power / before)
            search *= search.dtype.type(turns[-1])
            search += self.back
        return LeastSquares(len(steps), power <= goal, math.sqrt(condition(steps, turns)))

    def _move(self, along: float) -> None:
        """Go from theta to theta + along delta, where ahead = A delta."""
        self._run(kernels.advance, self.theta.size, self.theta, self.delta, along)
        self.l1, self.nonzeros = self._total(self.theta.size)
        self._add_to_residual(-along)
        self.model.adjoint(self.residual, self.back)

    def _add_to_residual(self, factor: float) -> None:
        flat = self.residual.reshape(-1)
        self._run(kernels.add_scaled, flat.size, flat, self.ahead.reshape(-1), factor)
        self.misfit = self._total(flat.size)[0]

    def _square(self, values: np.ndarray) -> float:
        flat = values.reshape(-1)
        self._run(kernels.squares, flat.size, flat)
        return self._total(flat.size)[0]

    def _run(self, kernel: Callable[..., Any], size: int, *arguments: Any) -> None:
        threads.run(kernel, kernels.chunk_count(size), *arguments, self._sums)

    def _total(self, size: int) -> tuple[float, float]:
        total = self._sums[: kernels.chunk_count(size)].sum(axis=0)
        return float(total[0]), float(total[1])

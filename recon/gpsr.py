"""Gradient projection for sparse reconstruction: the paper's solver (Figueiredo, Nowak, Wright 2007; theory.md S.G)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from recon.basis import Basis
from recon.coded_aperture import empty_cube
from recon.config import Config
from recon.operator import LinearOperator
from recon.problem import Found, OnIteration, Problem
from recon.solution import Stop

if TYPE_CHECKING:
    from recon.gpsr_core import Descent

WINDOW = 10
"""The stopping rule looks at the change of the objective over so many iterations: single Barzilai-Borwein steps are erratic."""
FIRST_FRACTION = 0.1
"""Continuation starts at this fraction of tau_max, where a solution has few coefficients and comes in a dozen iterations."""
STAGE_TOLERANCE = 1e-3
"""Continuation leaves a stage at this change of the objective over the window; more would be thrown away at the next tau."""
WORST_CONDITION = 1e6
"""Condition above which an unregularised answer is called unsafe (less where 1e-3 / rounding error is less: 8e3 in float32)."""


class Gpsr(Config):
    """Configure GPSR for ``||g - H Psi theta||^2 + tau ||theta||_1`` (theory.md (S.4), no factor 1/2).

    Args:
        tau: absolute weight of the l1 norm, at least 0; 0 gives the least-squares cube nearest to the start (zero).
        barzilai_borwein: True: GPSR-BB; False: GPSR-Basic with Armijo backtracking.
        monotone: let GPSR-BB minimise along its step, so that the objective never rises; False takes full steps.
        continuation_steps: values of tau, falling to the one asked for, that a solve without a start passes through; 1: none.
        debias: afterwards minimise ||g - H Psi theta||^2 over the coefficients that are not zero. Skipped, and said so,
            when they outnumber the measurements.
        max_iterations: at most this many in all stages; debiasing may add as many again.
        tolerance: stop when the objective changed by less than this part of itself over ten iterations; for debiasing and
            tau = 0: when the gradient of the misfit is this fraction of that at zero.
    """

    tau: float = Field(ge=0)
    barzilai_borwein: bool = True
    monotone: bool = True
    continuation_steps: int = Field(default=5, ge=1, le=100)
    debias: bool = False
    max_iterations: int = Field(default=3000, ge=0)
    tolerance: float = Field(default=1e-5, gt=0, lt=1)

    def solve(self, problem: Problem, on_iteration: OnIteration | None = None) -> Found:
        """Solve; the objective that ``on_iteration`` gets is Eq. 4 at the tau of the present stage, in the caller's units."""
        from recon.gpsr_core import Descent

        model = FlatModel(problem.operator, problem.basis)
        tau, tau_max = problem.inner_tau(self.tau), problem.tau_max()
        if tau >= tau_max:
            reason = f"tau {self.tau:.6g} is at or above tau_max = {problem.outer_tau(tau_max):.6g}: zero is the exact answer"
            return Found(model.cube_of(np.zeros(model.size, problem.frames.dtype)), 0, Stop(reason, True), tau, tau_max)
        theta = np.zeros(model.size, problem.frames.dtype) if problem.start is None else model.coefficients_of(problem.start)
        descent = Descent(model, problem.frames, theta)
        if tau == 0:
            made, stop = self._least_squares(descent)
        else:
            stages = self._stages(tau, tau_max, fresh=problem.start is None)
            made, stop = self._descend(descent, stages, on_iteration, problem.light**2)
            if self.debias:
                made, stop = self._debias(descent, made, stop)
        return Found(model.cube_of(descent.theta), made, stop, tau, tau_max)

    def _stages(self, tau: float, tau_max: float, fresh: bool) -> list[float]:
        first = FIRST_FRACTION * tau_max
        if not fresh or tau >= first or self.continuation_steps == 1:
            return [tau]
        ratios = np.linspace(0, 1, self.continuation_steps)[:-1]
        return [float(first * (tau / first) ** r) for r in ratios] + [tau]

    def _descend(self, descent: Descent, stages: list[float], on_iteration: OnIteration | None, scale: float) -> tuple[int, Stop]:
        made, share = 0, self.max_iterations // (2 * len(stages))
        for tau in stages[:-1]:
            made += self._stage(descent, tau, max(self.tolerance, STAGE_TOLERANCE), share, made, on_iteration, scale)[0]
        more, stop = self._stage(descent, stages[-1], self.tolerance, self.max_iterations - made, made, on_iteration, scale)
        return made + more, stop

    def _stage(
        self, descent: Descent, tau: float, tolerance: float, limit: int, before: int, on_iteration: OnIteration | None, scale: float
    ) -> tuple[int, Stop]:
        weight = tau / 2
        values = [descent.objective(weight)]
        best, best_theta = values[0], None if self.monotone or not self.barzilai_borwein else descent.theta.copy()
        change = np.inf
        stop = None
        for i in range(limit):
            moved = descent.barzilai_borwein(weight, self.monotone) if self.barzilai_borwein else descent.basic(weight)
            values.append(descent.objective(weight))
            if best_theta is not None and values[-1] < best:
                best = values[-1]
                best_theta[...] = descent.theta
            if on_iteration is not None:
                on_iteration(before + i + 1, values[-1] * scale)
            if not moved:
                stop = Stop("no step lowers the objective any more: it is at its minimum to rounding", True)
                break
            if len(values) > WINDOW:
                recent = values[-1 - WINDOW :]
                change = (max(recent) - min(recent)) / max(values[-1], np.finfo(float).tiny)
                if change <= tolerance:
                    stop = Stop(f"the objective changed by {change:.1e} of itself over {WINDOW} iterations (<= {tolerance:.1e})", True)
                    break
        if best_theta is not None and best < values[-1]:
            descent.theta[...] = best_theta
            descent.refresh()
        return len(values) - 1, stop or self._limit_reached(change)

    def _limit_reached(self, change: float) -> Stop:
        pace = f"the objective still changed by {change:.1e} of itself over {WINDOW} iterations, " if np.isfinite(change) else ""
        return Stop(f"max_iterations = {self.max_iterations} came first; {pace}tolerance {self.tolerance:.1e}: raise max_iterations", False)

    def _least_squares(self, descent: Descent) -> tuple[int, Stop]:
        made, met, condition = descent.least_squares(None, self.max_iterations, self.tolerance)
        reason = f"tau = 0 is unregularised least squares: {made} iterations of conjugate gradients, condition about {condition:.1e}"
        if condition > min(WORST_CONDITION, 1e-3 / float(np.finfo(descent.theta.dtype).eps)):
            return made, Stop(f"{reason}, too ill-conditioned to trust in {descent.theta.dtype}: take tau > 0", False)
        return made, Stop(reason if met else f"{reason}; tolerance {self.tolerance:.1e} not met: raise max_iterations", met)

    def _debias(self, descent: Descent, made: int, stop: Stop) -> tuple[int, Stop]:
        count, numbers = descent.nonzeros, descent.measured.size
        if count > numbers:
            return made, Stop(f"{stop.reason}; not debiased: {count:.0f} coefficients for {numbers} measurements", stop.converged)
        support = (descent.theta != 0).astype(descent.theta.dtype)
        more, met, _ = descent.least_squares(support, self.max_iterations, self.tolerance)
        note = f"debiased on {count:.0f} coefficients in {more} iterations" + ("" if met else ", which max_iterations ended")
        return made + more, Stop(f"{stop.reason}; {note}", stop.converged and met)


class FlatModel:
    """A = H Psi on flat coefficients in band-major order, without allocation in the loop."""

    def __init__(self, operator: LinearOperator, basis: Basis) -> None:
        self.operator, self.basis = operator, basis
        self.shape = tuple(operator.in_shape)
        self.size = int(np.prod(self.shape))
        self._cube = empty_cube(self.shape, operator.dtype)

    def forward(self, theta: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply A to (Q,) coefficients."""
        self.basis.synthesis(self._folded(theta), self._cube)
        return self.operator.forward(self._cube, out)

    def adjoint(self, frames: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Apply A^T to frames; returns (Q,) coefficients."""
        theta = np.empty(self.size, self.operator.dtype) if out is None else out
        self.operator.adjoint(frames, self._cube)
        self.basis.analysis(self._cube, self._folded(theta))
        return theta

    def cube_of(self, theta: np.ndarray) -> np.ndarray:
        """Return Psi theta as a new cube (M, N, K)."""
        return self.basis.synthesis(self._folded(theta))

    def coefficients_of(self, cube: np.ndarray) -> np.ndarray:
        """Return Psi^T f as new flat coefficients."""
        theta = np.empty(self.size, self.operator.dtype)
        self.basis.analysis(cube, self._folded(theta))
        return theta

    def _folded(self, theta: np.ndarray) -> np.ndarray:
        rows, columns, bands = self.shape
        return theta.reshape(bands, rows, columns).transpose(1, 2, 0)

"""Gradient projection for sparse reconstruction: the paper's solver (Figueiredo, Nowak, Wright 2007; theory.md (S.31) to (S.36))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from pydantic import Field

from recon.basis import Basis, Kronecker
from recon.coded_aperture import empty_cube
from recon.config import Config
from recon.data_step import doubts
from recon.errors import InputError
from recon.l1 import L1Penalty
from recon.lanczos import worst
from recon.operator import LinearOperator
from recon.problem import Found, OnIteration, Problem, edge_cases
from recon.solution import Stop
from recon.splitting import Limits

if TYPE_CHECKING:
    from recon.gpsr_core import Descent

WINDOW = 10
"""The stopping rule looks at the change of the objective over so many iterations: single Barzilai-Borwein steps are erratic."""
FIRST_FRACTION = 0.1
"""Continuation starts at this fraction of tau_max, where a solution has few coefficients and comes in a dozen iterations."""
STAGE_TOLERANCE = 1e-3
"""Continuation leaves a stage at this change of the objective over the window; more would be thrown away at the next tau."""


class Gpsr(Config):
    """Configure GPSR for ``||g - H Psi theta||^2 + tau ||theta||_1`` (theory.md (S.4), no factor 1/2): the prior is ``L1`` without weights.

    At tau = 0 it gives the least-squares cube nearest to the start (zero).

    Args:
        barzilai_borwein: True: GPSR-BB; False: GPSR-Basic with Armijo backtracking.
        monotone: let GPSR-BB minimise along its step, so that the objective never rises; False takes full steps.
        continuation_steps: values of tau, falling to the one asked for, that a solve without a start passes through; 1: none.
        debias: afterwards minimise ||g - H Psi theta||^2 over the coefficients that are not zero. Skipped, and said so,
            when they outnumber the measurements.
        max_iterations: at most this many in all stages; debiasing may add as many again. 0 returns the first guess.
        time_limit_s: wall time in s, or None.
        tolerance: stop when the objective changed by less than this part of itself over ten iterations; for debiasing and
            tau = 0: when the gradient of the misfit is this fraction of that at zero.
    """

    needs_tau: ClassVar[bool] = True

    barzilai_borwein: bool = True
    monotone: bool = True
    continuation_steps: int = Field(default=5, ge=1, le=100)
    debias: bool = False
    max_iterations: int = Field(default=3000, ge=0, le=10**7)
    time_limit_s: float | None = Field(default=None, gt=0)
    tolerance: float = Field(default=1e-5, gt=0, lt=1)

    def solve(self, problem: Problem, on_iteration: OnIteration | None = None) -> Found:
        """Solve; the objective that ``on_iteration`` gets is Eq. 4 at the tau of the present stage, in the caller's units."""
        from recon.gpsr_core import Descent

        basis = _basis(problem)
        tau, tau_max = problem.weight, problem.tau_max()
        if (found := edge_cases(problem, tau, tau_max, self.max_iterations)) is not None:
            return found
        assert tau_max is not None
        model = FlatModel(problem.operator, basis)
        theta = np.zeros(model.size, problem.frames.dtype) if problem.start is None else model.coefficients_of(problem.start)
        descent = Descent(model, problem.frames, theta)
        limits = Limits(self.tolerance, self.max_iterations, self.time_limit_s)
        if tau == 0:
            made, stop = self._least_squares(descent, limits)
        else:
            run = _Run(self, descent, limits, problem.light**2, on_iteration)
            stop = run.through(self._stages(tau, tau_max, fresh=problem.start is None))
            made, stop = self._debias(descent, limits, run.made, stop) if self.debias else (run.made, stop)
        notes = doubts(problem.operator, problem.exact_frames, limits.out_of_time) if tau == 0 else ()
        return Found(model.cube_of(descent.theta), made, stop, tau, tau_max, notes, value=descent.l1)

    def _stages(self, tau: float, tau_max: float, fresh: bool) -> list[float]:
        first = FIRST_FRACTION * tau_max
        if not fresh or tau >= first or self.continuation_steps == 1:
            return [tau]
        ratios = np.linspace(0, 1, self.continuation_steps)[:-1]
        return [float(first * (tau / first) ** r) for r in ratios] + [tau]

    def _least_squares(self, descent: Descent, limits: Limits) -> tuple[int, Stop]:
        made, met, condition = descent.least_squares(None, limits)
        reason = f"tau = 0 is unregularised least squares: {made} iterations of conjugate gradients, condition at least {condition:.1e}"
        if condition > worst(descent.theta.dtype):
            return made, Stop(f"{reason}, too ill-conditioned to trust in {descent.theta.dtype}: take tau > 0", False)
        return made, Stop(reason if met else f"{reason}; tolerance {self.tolerance:.1e} not met: raise the limits", met)

    def _debias(self, descent: Descent, limits: Limits, made: int, stop: Stop) -> tuple[int, Stop]:
        count, numbers = descent.nonzeros, descent.measured.size
        if count > numbers:
            return made, Stop(f"{stop.reason}; not debiased: {count:.0f} coefficients for {numbers} measurements", stop.converged)
        support = (descent.theta != 0).astype(descent.theta.dtype)
        more, met, _ = descent.least_squares(support, limits)
        note = f"debiased on {count:.0f} coefficients in {more} iterations" + ("" if met else ", which the limits ended")
        return made + more, Stop(f"{stop.reason}; {note}", stop.converged and met)


def _basis(problem: Problem) -> Basis:
    """Return the basis of an l1 problem, the only one that gradient projection on coefficients solves."""
    if problem.nonnegative:
        raise InputError("nonnegative", True, "False with Gpsr, whose unknowns are coefficients; take Admm or Fista")
    if not isinstance(problem.penalty, L1Penalty) or problem.penalty.weighted:
        raise InputError("prior", problem.prior_name, "L1 without weights with Gpsr; take Admm or Fista for other priors")
    return problem.penalty.basis


@dataclass
class _Run:
    """One descent through the stages of tau, within its limits; ``made`` counts the iterations."""

    config: Gpsr
    descent: Descent
    limits: Limits
    scale: float
    on_iteration: OnIteration | None
    made: int = 0

    def through(self, stages: list[float]) -> Stop:
        share = self.limits.max_iterations // (2 * len(stages))
        for tau in stages[:-1]:
            self._stage(tau, max(self.limits.tolerance, STAGE_TOLERANCE), self.made + share)
        return self._stage(stages[-1], self.limits.tolerance, self.limits.max_iterations)

    def _stage(self, tau: float, tolerance: float, last: int) -> Stop:
        values = [self.descent.objective(tau / 2)]
        best = None if self.config.monotone or not self.config.barzilai_borwein else self.descent.theta.copy()
        stop = None
        while stop is None:
            stop = self._judge(values, tolerance, last)
            if stop is None and not self._step(tau / 2):
                stop = Stop("no step lowers the objective any more: it is at its minimum to rounding", True)
            elif stop is None:
                values.append(self.descent.objective(tau / 2))
                self.made += 1
                if best is not None and values[-1] < min(values[:-1]):
                    best[...] = self.descent.theta
                if self.on_iteration is not None:
                    self.on_iteration(self.made, values[-1] * self.scale)
        if best is not None and values[-1] > min(values):
            self.descent.theta[...] = best
            self.descent.refresh()
        return stop

    def _step(self, weight: float) -> bool:
        if self.config.barzilai_borwein:
            return self.descent.barzilai_borwein(weight, self.config.monotone)
        return self.descent.basic(weight)

    def _judge(self, values: list[float], tolerance: float, last: int) -> Stop | None:
        pace = ""
        if len(values) > WINDOW:
            recent = values[-1 - WINDOW :]
            change = (max(recent) - min(recent)) / max(values[-1], np.finfo(float).tiny)
            if change <= tolerance:
                return Stop(f"the objective changed by {change:.1e} of itself over {WINDOW} iterations (<= {tolerance:.1e})", True)
            pace = f"the objective still changed by {change:.1e} of itself over {WINDOW} iterations, "
        if self.limits.out_of_time():
            reason = f"the time limit of {self.limits.time_limit_s:g} s came at iteration {self.made}"
            return Stop(f"{reason}; {pace}tolerance {tolerance:.1e}: allow more time", False)
        if self.made >= last:
            reason = f"max_iterations = {self.limits.max_iterations} came first"
            return Stop(f"{reason}; {pace}tolerance {tolerance:.1e}: raise max_iterations", False)
        return None


class FlatModel:
    """A = H Psi on flat coefficients in band-major order, without allocation in the loop."""

    def __init__(self, operator: LinearOperator, basis: Basis) -> None:
        self.operator, self.basis = operator, basis
        self.shape = basis.theta_shape(operator.in_shape) if isinstance(basis, Kronecker) else tuple(operator.in_shape)
        self.size = int(np.prod(self.shape))
        self._cube = empty_cube(tuple(operator.in_shape), operator.dtype)

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

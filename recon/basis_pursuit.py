"""Basis pursuit: the sparsest cube that explains the frames exactly; it has no tau (theory.md (S.12))."""

from typing import ClassVar

from pydantic import Field

from recon.coded_aperture import CodedAperture
from recon.config import Config
from recon.data_step import data_step, project
from recon.field_aperture import FieldAperture
from recon.precision import check_step
from recon.problem import Found, OnIteration, Problem, first_guess
from recon.solution import Stop
from recon.splitting import Levels, Limits, State, levels_for, split


class BasisPursuit(Config):
    """``min R(f)`` subject to ``H f = g``: the limit tau -> 0 of Eq. 4, for data without noise.

    The answer depends on no weight, on no scale of the responses and on no mix of a sensor's layers.
    Where H H^T is singular the least-squares projection takes its place (eigenvalues under 1e-6 of a block's largest count as 0).

    Args:
        tolerance: both residuals of the splitting must fall below it (relative); 5e-4 leaves the PSNR within about
            0.05 dB of the converged value.
        max_iterations: 0 returns the first guess.
        time_limit_s: wall time in s, or None.
        gamma: multiplies every threshold level; it changes the speed, not the answer.
        relax: over-relaxation, of (0, 2).
    """

    needs_tau: ClassVar[bool] = False

    tolerance: float = Field(default=5e-4, gt=0, lt=1)
    max_iterations: int = Field(default=400, ge=0, le=10**7)
    time_limit_s: float | None = Field(default=None, gt=0)
    gamma: float = Field(default=1.0, gt=0, le=1e3, ge=1e-3)
    relax: float = Field(default=1.8, gt=0, lt=2)

    def solve(self, problem: Problem, on_iteration: OnIteration | None = None) -> Found:
        """Solve; ``on_iteration(iteration, R)``, in the caller's units."""
        if self.max_iterations == 0:
            return first_guess(problem, None, None)
        step = data_step(problem.operator, problem.exact_frames, 0.0, mixed=True)
        check_step(problem.frames.dtype, step.condition)
        rule = levels_for(problem.penalty, Levels())
        levels = Levels(rule.start * self.gamma, rule.end * self.gamma, rule.decay)

        def report(state: State) -> None:
            if on_iteration is not None:
                on_iteration(state.iterations, state.value * problem.unit)

        limits = Limits(self.tolerance, self.max_iterations, self.time_limit_s)
        state, stop = split(problem, lambda level: step, levels, self.relax, limits, on_iteration=report)
        return Found(project(step, state.x), state.iterations, _explained(problem, stop), notes=step.notes)


def _explained(problem: Problem, stop: Stop) -> Stop:
    if isinstance(problem.operator, CodedAperture | FieldAperture) and problem.operator.repeated_shots():
        return Stop(stop.reason + "; repeated masks were merged, the rank of H does not grow with them", stop.converged)
    return stop

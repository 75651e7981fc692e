"""What a solver hands back: the cube, and the reason why it stopped there."""

from dataclasses import dataclass, field

import numpy as np

SPOKEN = {"BasisPursuit": "basis pursuit", "Gap": "GAP", "Admm": "ADMM", "Fista": "FISTA", "Gpsr": "GPSR"}
"""What people call the solvers."""


@dataclass(frozen=True)
class Stop:
    """Why a solver stopped.

    Args:
        reason: one sentence; when not converged it names a remedy.
        converged: whether the tolerance asked for was met.
    """

    reason: str
    converged: bool

    def __str__(self) -> str:
        return self.reason


@dataclass(frozen=True)
class Solution:
    """An estimated cube with everything needed to judge it.

    Args:
        cube: (M, N, K) estimate, in the units of frames / response.
        objective: ``||g - H f||^2 + tau R(f)``, Eq. 4 with the l1 prior (theory.md (S.4)), the misfit weighted where the noise
            is known; for solvers without a tau ``R(f)``.
        stop: why the solver stopped.
        iterations: how many it made.
        tau: the absolute weight of R; None for solvers without one.
        seconds: wall time, set-up included.
        residual: ``||g - H f|| / ||g||`` (0 when g = 0), weighted where the noise is known.
        tau_max: the least tau whose answer is zero, with l1 ``2 max |Psi^T H^T g|``; None for solvers without a tau and priors without one.
        notes: sentences about the problem itself, e.g. that shots repeat one mask.
        solver: name of the solver's class.
    """

    cube: np.ndarray
    objective: float
    stop: Stop
    iterations: int
    tau: float | None
    seconds: float
    residual: float
    tau_max: float | None = None
    notes: tuple[str, ...] = field(default=())
    solver: str = ""

    def __str__(self) -> str:
        rows, columns, bands = self.cube.shape
        name = SPOKEN.get(self.solver, self.solver) or "a solver"
        what = name if self.tau is None else f"{name} with tau = {self.tau:.4g}"
        if self.tau and self.tau_max:
            what += f" ({self.tau / self.tau_max:.3g} of tau_max)"
        lines = [
            f"{rows} x {columns} x {bands} cube by {what}: {self.iterations} iterations in {self.seconds:.1f} s",
            f"{'converged' if self.stop.converged else 'NOT converged'}: {self.stop.reason.removeprefix('converged: ')}",
            f"objective {self.objective:.6g}, relative residual {self.residual:.3g}",
        ]
        return "\n".join([*lines, *self.notes])

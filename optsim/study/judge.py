"""Invert frames with one H and score the answer: the same solver and the same blind rule for tau, whatever H believes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from recon.operator import LinearOperator

TAU_FRACTIONS = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6, 1e-6)
FEW_FRACTIONS = (1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)
"""For frames that no H explains to better than a thousandth."""
GPSR_ITERATIONS = 200
JUDGE_VERSION = 2
"""Raise when a change here changes scores: old entries are then computed anew."""


@dataclass(frozen=True)
class Judged:
    """Hold what one H made of the frames.

    Args:
        psnr_db: mean over bands, against the truth.
        tau_fraction: that held-out detector pixels chose, of tau_max.
        at_edge: whether that is an end of the grid.
        residual: ``||g - H f|| / ||g||``.
        converged: of the final solve.
    """

    psnr_db: float
    tau_fraction: float
    at_edge: bool
    residual: float
    converged: bool

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return dict(vars(self))


def judge(
    operator: LinearOperator,
    signal: np.ndarray,
    truth: np.ndarray,
    on_iteration: Callable[..., None] | None = None,
    *,
    fractions: tuple[float, ...] = TAU_FRACTIONS,
    by_gradients: bool = False,
) -> Judged:
    """Invert Eq. 4 with one kernel thread, its tau found from held-out detector pixels.

    Args:
        operator: H as believed.
        signal: (L, C, M, W) frames without their dark level.
        truth: (M, N, K), only for the score.
        on_iteration: called often; what it raises ends the work.
        fractions: values of tau / tau_max to try, falling.
        by_gradients: solve by GPSR rather than ADMM, whose data step is slow where H couples rows.
    """
    from recon import Admm, Gpsr, reconstruct
    from recon.metrics import psnr
    from recon.tau import AutoTau, Given, TauPath

    choice, _ = AutoTau(path=TauPath(fractions=fractions)).try_all(operator, signal, Given(threads=1), on_iteration=on_iteration)
    solver = Gpsr(max_iterations=GPSR_ITERATIONS, tolerance=1e-4) if by_gradients else Admm()
    solution = reconstruct(operator, signal, solver=solver, tau=choice.tau, start=choice.start, threads=1, on_iteration=on_iteration)
    return Judged(float(psnr(solution.cube, truth)), choice.fraction, choice.at_edge, float(solution.residual), solution.stop.converged)

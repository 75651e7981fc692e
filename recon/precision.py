"""When float32 is not enough (theory.md (S.57)): the solve is then made in float64, and the solution says why."""

import math

import numpy as np

from recon.problem import Problem, Solver

RESOLVED = 8
"""Rounding errors of a correlation that a tau must exceed to be told from 0."""
BLURRED = 1e-2
"""Rounding of a data step, relative to the step, above which answers move by percents and splittings stop converging."""


class TooCoarse(Exception):
    """Raised before the first iteration of a float32 solve that would lose; the text is the reason."""


def check(problem: Problem, solver: Solver) -> None:
    """Raise ``TooCoarse`` when the problem's own numbers say that float32 loses.

    Eq. 4 compares correlations, rounded to eps of tau_max, with tau: it must exceed 8 eps tau_max. With as many measurements
    as voxels a solver without tau, or at tau = 0, reaches the exact answer, and rounding alone limits it.
    """
    dtype = problem.frames.dtype
    if dtype != np.float32:
        return
    if solver.needs_tau and problem.weight > 0:
        top, least = problem.tau_max(), RESOLVED * float(np.finfo(dtype).eps)
        if top is not None and problem.weight < least * top:
            raise TooCoarse(f"tau is {problem.weight / top:.1e} of tau_max, below what float32 resolves ({least:.1e})")
        return
    measurements, voxels = problem.frames.size, math.prod(problem.operator.in_shape)
    if measurements >= voxels:
        raise TooCoarse(f"{measurements} measurements of {voxels} voxels leave rounding as the only error")


def check_step(dtype: np.dtype, condition: float) -> None:
    """Raise ``TooCoarse`` when H H^T is so ill-conditioned (root mean square over its blocks) that float32 blurs the data step."""
    if dtype == np.float32 and float(np.finfo(dtype).eps) * condition > BLURRED:
        raise TooCoarse(f"H H^T has a condition of {condition:.1e} (root mean square over its blocks)")

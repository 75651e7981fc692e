"""What a rule for tau is given and what it answers; tau as a fraction of tau_max."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from pydantic import Field

from recon import threads as pool
from recon.arrays import real_array
from recon.config import Config
from recon.errors import InputError
from recon.operator import Operator
from recon.prior import Prior
from recon.problem import OnIteration, Problem, Solver, checked_prior, pose
from recon.solution import Solution
from recon.solve import reconstruct


@dataclass(frozen=True, eq=False)
class Given:
    """Say what a reconstruction holds fixed while tau varies; the fields mean what they mean to :func:`recon.reconstruct`.

    Args:
        prior: R; None: ``L1()``.
        noise: variance of each measurement, in squared units of the frames; None: all alike. Infinite: left out.
        nonnegative: look among cubes >= 0 only.
        threads: threads of the kernels; None: all cores.
    """

    prior: Prior | None = None
    noise: np.ndarray | None = None
    nonnegative: bool = False
    threads: int | None = None

    def __post_init__(self) -> None:
        if self.prior is not None:
            checked_prior(self.prior)
        if self.noise is not None:
            real_array("noise", self.noise)
        if not isinstance(self.nonnegative, bool | np.bool_):
            raise InputError("nonnegative", self.nonnegative, "True or False")

    def pose(self, operator: Operator, frames: np.ndarray) -> Problem | None:
        """Return the checked and normalised problem; None for frames that are zero everywhere."""
        return pose(operator, frames, self.prior, noise=self.noise, nonnegative=self.nonnegative)

    def reconstruct(
        self,
        operator: Operator,
        frames: np.ndarray,
        *,
        solver: Solver | None = None,
        tau: float | TauRule | None = None,
        start: np.ndarray | None = None,
        on_iteration: OnIteration | None = None,
    ) -> Solution:
        """Call :func:`recon.reconstruct` with what is given."""
        return reconstruct(
            operator,
            frames,
            prior=self.prior,
            solver=solver,
            tau=tau,
            noise=self.noise,
            nonnegative=self.nonnegative,
            start=start,
            threads=self.threads,
            on_iteration=on_iteration,
        )

    def without(self, held: np.ndarray, shape: tuple[int, ...]) -> Given:
        """Return the same with the measurements ``held`` (bool, broadcastable to frames of ``shape``) left out."""
        variance = np.ones(shape) if self.noise is None else np.broadcast_to(np.asarray(self.noise, np.float64), shape)
        return replace(self, noise=np.where(held, np.inf, variance))


def as_given(given: Given | None) -> Given:
    """Return what is given, ``Given()`` for None.

    Raises:
        InputError: field ``given`` for something else, such as bare variances.
    """
    if given is None:
        return Given()
    if not isinstance(given, Given):
        raise InputError("given", given, "recon.tau.Given(...), e.g. Given(noise=variance), or None")
    return given


@dataclass(frozen=True)
class TauChoice:
    """The tau that a rule chose, and why.

    Args:
        tau: absolute weight of the prior.
        fraction: tau / tau_max.
        reason: one sentence.
        at_edge: the choice is an end of its grid, so a better value may lie outside.
        errors: what the rule measured at each value tried: held-out error ``||g - H f||^2 / ||g||^2`` over the held-out pixels, or
            misfit over expected noise; empty without a grid.
        iterations: made to find it.
        start: (M, N, K) an estimate at or near this tau, a first guess for the final solve; None without a grid.
    """

    tau: float
    fraction: float
    reason: str
    at_edge: bool = False
    errors: tuple[float, ...] = ()
    iterations: int = 0
    start: np.ndarray | None = None


class TauRule(Protocol):
    """A way to find an absolute tau for one operator and its frames without ground truth."""

    def choose(self, operator: Operator, frames: np.ndarray, given: Given | None = None) -> TauChoice:
        """Return the tau for these frames."""
        ...


class TauFraction(Config):
    """Take tau as a fraction of tau_max, the least tau whose answer is zero (theory.md (S.9)).

    Args:
        fraction: tau / tau_max, at least 0; from 1 on the answer is zero.
    """

    fraction: float = Field(ge=0)

    def choose(self, operator: Operator, frames: np.ndarray, given: Given | None = None) -> TauChoice:
        """Return ``fraction * tau_max`` for these frames."""
        tau = self.fraction * tau_max(operator, frames, given)
        return TauChoice(tau, self.fraction, f"tau is {self.fraction:g} of tau_max, as asked")


def tau_max(operator: Operator, frames: np.ndarray, given: Given | None = None) -> float:
    """Return the least tau whose answer is zero, with l1 ``2 max |Psi^T H^T g|`` (theory.md (S.9)); 0 for dark frames.

    For priors without such a formula it is ``2 max |H^T g|``, a scale that fractions can refer to.
    """
    about = as_given(given)
    problem = about.pose(operator, frames)
    if problem is None:
        return 0.0
    with pool.use(about.threads):
        return problem.outer_tau(problem.reference_tau())


def dark_choice() -> TauChoice:
    """Return the choice for frames that are zero everywhere."""
    return TauChoice(0.0, 0.0, "the frames are zero everywhere, so tau does not matter")

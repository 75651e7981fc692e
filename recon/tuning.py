"""Choosing tau: as a fraction of tau_max, or without ground truth from detector pixels held out (theory.md (S.37))."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol, cast

import numpy as np
from pydantic import Field, SerializeAsAny, field_validator

from recon import threads as pool
from recon.config import Config
from recon.errors import InputError
from recon.fista import Fista
from recon.gpsr import Gpsr
from recon.l1 import L1
from recon.nonnegative import NonNegative
from recon.operator import LinearOperator, RowWeighted
from recon.prior import Prior
from recon.problem import OnIteration, Problem, Solver, prepare
from recon.solution import Solution
from recon.solve import reconstruct

OnPoint = Callable[[int, Solution], None]
"""Called with the number of the finished point of a path, from 0, and its solution; what it raises ends the path."""


@dataclass(frozen=True)
class TauChoice:
    """The tau that a rule chose, and why.

    Args:
        tau: absolute weight of the prior.
        fraction: tau / tau_max.
        reason: one sentence.
        at_edge: the choice is an end of its grid, so a better value may lie outside.
        errors: held-out error of each value tried, ``||g - H f||^2 / ||g||^2`` over the held-out pixels; empty without a grid.
        iterations: made to find it.
        start: (M, N, K) the held-out estimate at this tau, a first guess for the final solve; None without a grid.
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

    def choose(
        self,
        operator: LinearOperator,
        frames: np.ndarray,
        *,
        prior: Prior | None = None,
        noise: np.ndarray | None = None,
        nonnegative: bool = False,
        threads: int | None = None,
    ) -> TauChoice:
        """Return the tau for these frames."""
        ...


class TauFraction(Config):
    """Take tau as a fraction of tau_max, the least tau whose answer is zero (theory.md (S.9)).

    Args:
        fraction: tau / tau_max, at least 0; from 1 on the answer is zero.
    """

    fraction: float = Field(ge=0)

    def choose(
        self,
        operator: LinearOperator,
        frames: np.ndarray,
        *,
        prior: Prior | None = None,
        noise: np.ndarray | None = None,
        nonnegative: bool = False,
        threads: int | None = None,
    ) -> TauChoice:
        """Return ``fraction * tau_max`` for these frames."""
        tau = self.fraction * tau_max(operator, frames, prior=prior, noise=noise, threads=threads)
        return TauChoice(tau, self.fraction, f"tau is {self.fraction:g} of tau_max, as asked")


class TauPath(Config):
    """Solve Eq. 4 for falling values of tau, each from what the solutions before predict.

    The start is what keeps a small tau honest: from zero, the same number of iterations leaves it far from its minimum, and
    the comparison of values of tau then measures the solver. The prediction (theory.md (S.38)) carries on the last change.

    Args:
        fractions: strictly falling values of tau / tau_max, each above 0 and below 1, 1 to 64 of them.
        solver: configuration of the solves; None: ``Gpsr`` for the l1 norm without weights, ``Fista`` for other priors.
    """

    fractions: tuple[float, ...] = Field(default=(1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5), min_length=1, max_length=64)
    solver: SerializeAsAny[Config] | None = None

    @field_validator("fractions")
    @classmethod
    def _falling(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        if not all(0 < v < 1 for v in values) or any(b >= a for a, b in pairwise(values)):
            raise InputError("TauPath.fractions", values, "strictly falling, each above 0 and below 1 (of tau_max)")
        return values

    @field_validator("solver")
    @classmethod
    def _has_tau(cls, solver: Config | None) -> Config | None:
        if solver is not None and not getattr(solver, "needs_tau", False):
            raise InputError("TauPath.solver", type(solver).__name__, "a solver of Eq. 4 with a tau: Gpsr, Admm or Fista")
        return solver

    def follow(
        self,
        operator: LinearOperator,
        frames: np.ndarray,
        *,
        prior: Prior | None = None,
        noise: np.ndarray | None = None,
        nonnegative: bool = False,
        threads: int | None = None,
        largest: float | None = None,
        guide: tuple[np.ndarray, ...] = (),
        on_point: OnPoint | None = None,
        on_iteration: OnIteration | None = None,
    ) -> tuple[Solution, ...]:
        """Solve along the path; one solution for each fraction.

        Args:
            operator: H.
            frames: (L, C, M, W) measurements.
            prior: R; None: ``L1()``.
            noise: variance of each measurement, as for :func:`recon.reconstruct`.
            nonnegative: look among cubes >= 0 only.
            threads: threads of the kernels; None: all cores.
            largest: tau_max that the fractions refer to; None: that of these frames.
            guide: cubes (M, N, K) of the same path on nearly the same data, one a point, whose changes predict the starts;
                empty: each start is predicted from the two points before.
            on_point: called after every point.
            on_iteration: called in every solve; what it raises ends the path.

        Raises:
            InputError: see :func:`recon.reconstruct`; ``guide`` when there are not as many as fractions.
        """
        if guide and len(guide) != len(self.fractions):
            raise InputError("guide", len(guide), f"as many cubes as fractions, {len(self.fractions)}")
        if largest is None:
            largest = tau_max(operator, frames, prior=prior, noise=noise, threads=threads)
        solver = self.solver_for(prior, nonnegative)
        found: list[Solution] = []
        for i, fraction in enumerate(self.fractions):
            start = _followed(guide, found) if guide else self._predicted(found)
            found.append(
                reconstruct(
                    operator,
                    frames,
                    prior=prior,
                    solver=solver,
                    tau=fraction * largest,
                    noise=noise,
                    nonnegative=nonnegative,
                    start=start,
                    threads=threads,
                    on_iteration=on_iteration,
                )
            )
            if on_point is not None:
                on_point(i, found[-1])
        return tuple(found)

    def solver_for(self, prior: Prior | None, nonnegative: bool = False) -> Solver:
        """Return the solver given, or the one that suits the prior."""
        if self.solver is not None:
            return cast(Solver, self.solver)
        plain = not nonnegative and (prior is None or (isinstance(prior, L1) and prior.weights is None))
        return Gpsr(max_iterations=80, tolerance=1e-4) if plain else Fista(max_iterations=80, tolerance=1e-4)

    def _predicted(self, found: list[Solution]) -> np.ndarray | None:
        """Continue the last change, in proportion to the step in log tau, at most in full (theory.md (S.38))."""
        i = len(found)
        if i < 2:
            return found[-1].cube if found else None
        far, near, next_one = np.log(self.fractions[i - 2 : i + 1])
        step = min(1.0, float((next_one - near) / (near - far)))
        return np.asarray(found[-1].cube + found[-1].cube.dtype.type(step) * (found[-1].cube - found[-2].cube))


class AutoTau(Config):
    """Find tau by detector pixels that the solve does not see (theory.md (S.37)).

    A share of the detector's pixels, drawn at random, is left out with all its shots and channels. The smallest tau is
    taken whose estimate predicts them nearly as well as the best does. Nothing about the scene enters.

    Args:
        path: values of tau to try and the solver to try them with.
        share: part of the pixels held out, above 0 and at most 0.5.
        slack: how much above the least a held-out error still counts as good, 0 to 1. The default was validated
            (theory.md (S.37)): the error's minimum is flat, and what the pixels see weakly still gains as tau falls.
        seed: of the draw, 0 to 2^64 - 1.
    """

    path: TauPath = TauPath()
    share: float = Field(default=0.05, gt=0, le=0.5)
    slack: float = Field(default=0.1, ge=0, le=1)
    seed: int = Field(default=0, ge=0, lt=2**64)

    def choose(
        self,
        operator: LinearOperator,
        frames: np.ndarray,
        *,
        prior: Prior | None = None,
        noise: np.ndarray | None = None,
        nonnegative: bool = False,
        threads: int | None = None,
    ) -> TauChoice:
        """Return the smallest tau that predicts the held-out pixels within ``slack`` of the best.

        Raises:
            InputError: see :func:`recon.reconstruct`.
        """
        return self.try_all(operator, frames, prior=prior, noise=noise, nonnegative=nonnegative, threads=threads)[0]

    def try_all(
        self,
        operator: LinearOperator,
        frames: np.ndarray,
        *,
        prior: Prior | None = None,
        noise: np.ndarray | None = None,
        nonnegative: bool = False,
        threads: int | None = None,
        on_point: OnPoint | None = None,
        on_iteration: OnIteration | None = None,
    ) -> tuple[TauChoice, tuple[np.ndarray, ...]]:
        """Return the choice and the held-out estimates (M, N, K) along the path, a guide for a path on all data."""
        problem = _prepared(operator, frames, prior, noise, nonnegative)
        if problem is None:
            return TauChoice(0.0, 0.0, "the frames are zero everywhere, so tau does not matter"), ()
        held = self.held_out(operator.out_shape)
        kept = (~held).astype(problem.frames.dtype)
        with pool.use(threads):
            largest = problem.reference_tau()
        seen = RowWeighted(problem.operator, kept)
        solutions = self.path.follow(
            seen,
            problem.frames * kept,
            prior=prior,
            nonnegative=nonnegative,
            threads=threads,
            largest=largest,
            on_point=on_point,
            on_iteration=on_iteration,
        )
        with pool.use(threads):
            squares = np.array([_held_squares(problem, s.cube, held) for s in solutions])
        energy = float((problem.frames[..., held].astype(np.float64) ** 2).sum())
        best = int(np.flatnonzero(squares <= (1 + self.slack) * squares.min())[-1])
        errors = tuple(float(e) for e in squares / energy) if energy > 0 else (0.0,) * len(squares)
        guide = tuple(s.cube.astype(np.float64) * problem.unit for s in solutions)
        edge = best in (0, len(solutions) - 1)
        fraction = self.path.fractions[best]
        choice = TauChoice(
            tau=problem.outer_tau(fraction * largest),
            fraction=fraction,
            reason=_reason(fraction, errors, best, int(held.sum())),
            at_edge=edge,
            errors=errors,
            iterations=sum(s.iterations for s in solutions),
            start=guide[best],
        )
        return choice, guide

    def held_out(self, shape: tuple[int, ...]) -> np.ndarray:
        """Draw the held-out pixels: (M, W) bool, at least one and never all, for frames of ``shape`` (L, C, M, W)."""
        rows, width = shape[-2:]
        pixels = rows * width
        if pixels < 2:
            raise InputError("frames", tuple(shape), "of at least 2 detector pixels, so that one can be held out")
        count = min(max(1, round(self.share * pixels)), pixels - 1)
        held = np.zeros(pixels, bool)
        held[np.random.Generator(np.random.Philox(self.seed)).choice(pixels, count, replace=False)] = True
        return held.reshape(rows, width)


@dataclass(frozen=True)
class TauReport:
    """One path of tau on all data: the value found without ground truth and the value that the truth prefers.

    Args:
        solutions: of the path, tau falling.
        fractions: tau / tau_max of each.
        choice: the automatic choice.
        automatic: its place on the path.
        scores: what ``score`` said of each cube (higher is better); empty without a score.
    """

    solutions: tuple[Solution, ...]
    fractions: tuple[float, ...]
    choice: TauChoice
    automatic: int
    scores: tuple[float, ...] = ()

    @property
    def oracle(self) -> int | None:
        """Return the place of the best score; None without scores."""
        return int(np.argmax(self.scores)) if self.scores else None

    @property
    def oracle_at_edge(self) -> bool:
        """Tell whether the best score lies at an end of the grid, so that a better value may lie outside."""
        return self.oracle in (0, len(self.solutions) - 1)


def tune(
    operator: LinearOperator,
    frames: np.ndarray,
    *,
    auto: AutoTau | None = None,
    refine: Config | None = None,
    score: Callable[[np.ndarray], float] | None = None,
    prior: Prior | None = None,
    noise: np.ndarray | None = None,
    nonnegative: bool = False,
    threads: int | None = None,
    on_point: OnPoint | None = None,
    on_iteration: OnIteration | None = None,
) -> TauReport:
    """Follow one path with pixels held out, and one on all data guided by it, and report both choices of tau.

    Args:
        operator: H.
        frames: (L, C, M, W) measurements, not all zero.
        auto: the automatic rule and the path's values; None: ``AutoTau()``.
        refine: solver of the path on all data, which starts close to its answers; None: the same as with pixels held out.
        score: figure of merit of a cube against the truth, higher is better; for the oracle only.
        prior: R; None: ``L1()``.
        noise: variance of each measurement, as for :func:`recon.reconstruct`.
        nonnegative: look among cubes >= 0 only.
        threads: threads of the kernels; None: all cores.
        on_point: called after every point of both paths, numbered through.
        on_iteration: called in every solve; what it raises ends the search.

    Raises:
        InputError: see :func:`recon.reconstruct`; ``frames`` when they are zero everywhere.
    """
    rule = AutoTau() if auto is None else auto
    count = len(rule.path.fractions)
    about: Any = {"prior": prior, "noise": noise, "nonnegative": nonnegative, "threads": threads, "on_iteration": on_iteration}
    choice, guide = rule.try_all(operator, frames, on_point=on_point, **about)
    if not guide:
        raise InputError("frames", 0.0, "different from zero somewhere: without light there is no tau to choose")
    path = rule.path if refine is None else rule.path.model_copy(update={"solver": refine})
    later = None if on_point is None else (lambda i, solution: on_point(count + i, solution))
    solutions = path.follow(operator, frames, guide=guide, on_point=later, **about)
    scores = () if score is None else tuple(float(score(s.cube)) for s in solutions)
    return TauReport(solutions, path.fractions, choice, rule.path.fractions.index(choice.fraction), scores)


def tau_max(
    operator: LinearOperator,
    frames: np.ndarray,
    *,
    prior: Prior | None = None,
    noise: np.ndarray | None = None,
    threads: int | None = None,
) -> float:
    """Return the least tau whose answer is zero, with l1 ``2 max |Psi^T H^T g|`` (theory.md (S.9)); 0 for dark frames.

    For priors without such a formula it is ``2 max |H^T g|``, a scale that fractions can refer to.
    """
    problem = _prepared(operator, frames, prior, noise)
    if problem is None:
        return 0.0
    with pool.use(threads):
        return problem.outer_tau(problem.reference_tau())


def _prepared(
    operator: LinearOperator, frames: np.ndarray, prior: Prior | None, noise: np.ndarray | None, nonnegative: bool = False
) -> Problem | None:
    penalty = (L1() if prior is None else prior).bind(tuple(operator.in_shape), operator.dtype)
    return prepare(operator, frames, NonNegative(penalty) if nonnegative else penalty, noise=noise)


def _followed(guide: tuple[np.ndarray, ...], found: list[Solution]) -> np.ndarray:
    """Add the guide's next change to the last solution."""
    i = len(found)
    return guide[0] if i == 0 else np.asarray(found[-1].cube + (guide[i] - guide[i - 1]))


def _held_squares(problem: Problem, cube: np.ndarray, held: np.ndarray) -> float:
    gap = (problem.frames - problem.operator.forward(cube))[..., held].astype(np.float64)
    return float(np.vdot(gap, gap))


def _reason(fraction: float, errors: tuple[float, ...], best: int, pixels: int) -> str:
    said = f"tau = {fraction:g} of tau_max predicts {pixels} held-out detector pixels to {np.sqrt(errors[best]):.2e} of their signal"
    if len(errors) > 1 and best == len(errors) - 1:
        return said + "; smaller values may do better still: data without noise ask for tau -> 0, which is basis pursuit"
    if len(errors) > 1 and best == 0:
        return said + "; larger values may do better still"
    return said + f", the best of {len(errors)} values to {np.sqrt(min(errors)):.2e}"

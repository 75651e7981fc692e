"""Tau without ground truth and without knowing the noise, from detector pixels held out (theory.md (S.37))."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from recon import threads as pool
from recon.config import Config
from recon.errors import InputError
from recon.operator import Operator
from recon.problem import OnIteration, Problem
from recon.tau.choice import Given, TauChoice, as_given, dark_choice
from recon.tau.path import OnPoint, TauPath


class AutoTau(Config):
    """Find tau by detector pixels that the solve does not see (theory.md (S.37)).

    A share of the detector's pixels, drawn at random, is left out with all its shots and channels. The smallest tau is
    taken whose estimate predicts them nearly as well as the best does. Nothing about the scene enters.

    Args:
        path: values of tau to try and the solver to try them with.
        share: part of the pixels held out, above 0 and at most 0.5.
        slack: how much above the least a held-out error still counts as good, 0 to 1; and it must not be above the least by more
            than the draw of the pixels explains (one standard error of the difference). Validated: docs/solvers.md.
        seed: of the draw, 0 to 2^64 - 1.
    """

    path: TauPath = TauPath()
    share: float = Field(default=0.05, gt=0, le=0.5)
    slack: float = Field(default=0.1, ge=0, le=1)
    seed: int = Field(default=0, ge=0, lt=2**64)

    def choose(self, operator: Operator, frames: np.ndarray, given: Given | None = None) -> TauChoice:
        """Return the smallest tau that predicts the held-out pixels nearly as well as the best.

        Raises:
            InputError: see :func:`recon.reconstruct`.
        """
        return self.try_all(operator, frames, given)[0]

    def try_all(
        self,
        operator: Operator,
        frames: np.ndarray,
        given: Given | None = None,
        *,
        on_point: OnPoint | None = None,
        on_iteration: OnIteration | None = None,
    ) -> tuple[TauChoice, tuple[np.ndarray, ...]]:
        """Return the choice and the held-out estimates (M, N, K) along the path, a guide for a path on all data."""
        about = as_given(given)
        problem = about.pose(operator, frames)
        if problem is None:
            return dark_choice(), ()
        held = self.held_out(tuple(problem.operator.out_shape), problem.counting())
        with pool.use(about.threads):
            largest = problem.reference_tau()
        blind = about.without(held, tuple(problem.operator.out_shape))
        solutions = self.path.follow(
            operator, frames, blind, largest=problem.outer_tau(largest), on_point=on_point, on_iteration=on_iteration
        )
        with pool.use(about.threads):
            squares = np.stack([held_squares(problem, s.cube, held) for s in solutions])
        best = self.smallest_good(squares)
        energy = float((problem.exact_frames[..., held] ** 2).sum())
        totals = squares.sum(1)
        errors = tuple(float(e) for e in totals / energy) if energy > 0 else (0.0,) * len(totals)
        fraction = self.path.fractions[best]
        choice = TauChoice(
            tau=problem.outer_tau(fraction * largest),
            fraction=fraction,
            reason=_reason(fraction, errors, best, int(held.sum())),
            at_edge=best in (0, len(solutions) - 1),
            errors=errors,
            iterations=sum(s.iterations for s in solutions),
            start=solutions[best].cube,
        )
        return choice, tuple(s.cube for s in solutions)

    def held_out(self, shape: tuple[int, ...], counts: np.ndarray | None = None) -> np.ndarray:
        """Draw the held-out pixels: bool of the last two axes of ``shape`` (or of its only one), at least one and never all.

        Args:
            shape: of the frames.
            counts: which measurements count, bool of ``shape``: pixels without one are not drawn, they would tell nothing. None: all.

        Raises:
            InputError: fields ``frames`` or ``noise`` for fewer than two pixels to draw from.
        """
        pixels = int(np.prod(shape[-2:]))
        if pixels < 2:
            raise InputError("frames", tuple(shape), "of at least 2 detector pixels, so that one can be held out")
        some = np.arange(pixels) if counts is None else np.flatnonzero(counts.reshape(-1, pixels).any(0))
        if some.size < 2:
            allowed = f"finite at 2 of the {pixels} detector pixels or more, so that one can be held out"
            raise InputError("noise", f"finite at {some.size}", allowed)
        count = min(max(1, round(self.share * some.size)), some.size - 1)
        held = np.zeros(pixels, bool)
        held[some[np.random.Generator(np.random.Philox(self.seed)).choice(some.size, count, replace=False)]] = True
        return held.reshape(shape[-2:])

    def smallest_good(self, squares: np.ndarray) -> int:
        """Return the place of the smallest tau among the good ones.

        Args:
            squares: (values of tau, held-out pixels) squared errors, summed over shots and channels.
        """
        totals = squares.sum(1)
        gap = squares - squares[int(totals.argmin())]
        chance = np.sqrt(squares.shape[1]) * gap.std(1, ddof=1) if squares.shape[1] > 1 else np.full(len(totals), np.inf)
        allowed = np.minimum(self.slack * totals.min(), chance)
        return int(np.flatnonzero(totals - totals.min() <= allowed)[-1])


def held_squares(problem: Problem, cube: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return (held-out pixels,) squared errors in the normalised problem's units."""
    gap = (problem.exact_frames - problem.photographed(cube))[..., held]
    return np.asarray((gap**2).reshape(-1, gap.shape[-1]).sum(0))


def _reason(fraction: float, errors: tuple[float, ...], best: int, pixels: int) -> str:
    said = f"tau = {fraction:g} of tau_max predicts {pixels} held-out detector pixels to {np.sqrt(errors[best]):.2e} of their signal"
    if len(errors) > 1 and best == len(errors) - 1:
        return said + "; smaller values may do better still: data without noise ask for tau -> 0, which is basis pursuit"
    if len(errors) > 1 and best == 0:
        return said + "; larger values may do better still"
    return said + f", the best of {len(errors)} values to {np.sqrt(min(errors)):.2e}"

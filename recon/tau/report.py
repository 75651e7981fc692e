"""One path of tau on all data, with the value found without ground truth and the value that the truth prefers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from recon.config import Config
from recon.errors import InputError
from recon.operator import Operator
from recon.problem import OnIteration
from recon.solution import Solution
from recon.tau.choice import Given, TauChoice
from recon.tau.held_out import AutoTau
from recon.tau.path import OnPoint


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
    operator: Operator,
    frames: np.ndarray,
    given: Given | None = None,
    *,
    auto: AutoTau | None = None,
    refine: Config | None = None,
    score: Callable[[np.ndarray], float] | None = None,
    on_point: OnPoint | None = None,
    on_iteration: OnIteration | None = None,
) -> TauReport:
    """Follow one path with pixels held out, and one on all data guided by it, and report both choices of tau.

    Args:
        operator: H.
        frames: measurements of its ``out_shape``, not all zero.
        given: prior, noise, sign and threads.
        auto: the automatic rule and the path's values; None: ``AutoTau()``.
        refine: solver of the path on all data, which starts close to its answers; None: the same as with pixels held out.
        score: figure of merit of a cube against the truth, higher is better; for the oracle only.
        on_point: called after every point of both paths, numbered through.
        on_iteration: called in every solve; what it raises ends the search.

    Raises:
        InputError: see :func:`recon.reconstruct`; ``frames`` when they are zero everywhere.
    """
    rule = AutoTau() if auto is None else auto
    count = len(rule.path.fractions)
    choice, guide = rule.try_all(operator, frames, given, on_point=on_point, on_iteration=on_iteration)
    if not guide:
        raise InputError("frames", 0.0, "different from zero somewhere: without light there is no tau to choose")
    path = rule.path if refine is None else rule.path.model_copy(update={"solver": refine})
    later = None if on_point is None else (lambda i, solution: on_point(count + i, solution))
    solutions = path.follow(operator, frames, given, guide=guide, on_point=later, on_iteration=on_iteration)
    scores = () if score is None else tuple(float(score(s.cube)) for s in solutions)
    return TauReport(solutions, path.fractions, choice, rule.path.fractions.index(choice.fraction), scores)

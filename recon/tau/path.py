"""Solving Eq. 4 for falling values of tau, each from what the solutions before predict (theory.md (S.38))."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import cast

import numpy as np
from pydantic import Field, SerializeAsAny, field_validator

from recon.admm import Admm
from recon.coded_aperture import CodedAperture
from recon.config import Config
from recon.errors import InputError
from recon.fista import Fista
from recon.gpsr import Gpsr
from recon.l1 import L1
from recon.operator import Operator
from recon.problem import OnIteration, Solver
from recon.solution import Solution
from recon.tau.choice import Given, as_given, tau_max

OnPoint = Callable[[int, Solution], None]
"""Called with the number of the finished point of a path, from 0, and its solution; what it raises ends the path."""


class TauPath(Config):
    """Solve Eq. 4 for falling values of tau, each from what the solutions before predict.

    The start is what keeps a small tau honest: from zero, the same number of iterations leaves it farther from its minimum, and
    the comparison of values of tau then measures the solver. The prediction (theory.md (S.38)) carries on the last change.

    Args:
        fractions: strictly falling values of tau / tau_max, each above 0 and below 1, 1 to 64 of them.
        solver: configuration of the solves; None: ``Admm`` where a ``CodedAperture`` makes its data step exact, else ``Gpsr`` for the
            l1 norm without weights and ``Fista`` for other priors.
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
        operator: Operator,
        frames: np.ndarray,
        given: Given | None = None,
        *,
        largest: float | None = None,
        guide: tuple[np.ndarray, ...] = (),
        on_point: OnPoint | None = None,
        on_iteration: OnIteration | None = None,
    ) -> tuple[Solution, ...]:
        """Solve along the path; one solution for each fraction.

        Args:
            operator: H.
            frames: measurements of its ``out_shape``.
            given: prior, noise, sign and threads.
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
        found = []
        for i, solution in enumerate(self.walk(operator, frames, given, largest=largest, guide=guide, on_iteration=on_iteration)):
            found.append(solution)
            if on_point is not None:
                on_point(i, solution)
        return tuple(found)

    def walk(
        self,
        operator: Operator,
        frames: np.ndarray,
        given: Given | None = None,
        *,
        largest: float | None = None,
        guide: tuple[np.ndarray, ...] = (),
        on_iteration: OnIteration | None = None,
    ) -> Iterator[Solution]:
        """Yield the solutions one by one, each solved when it is asked for; arguments as of ``follow``."""
        about = as_given(given)
        if largest is None:
            largest = tau_max(operator, frames, about)
        solver = self.solver_for(operator, about)
        found: list[Solution] = []
        for fraction in self.fractions:
            start = _followed(guide, found) if guide else self._predicted(found)
            solution = about.reconstruct(operator, frames, solver=solver, tau=fraction * largest, start=start, on_iteration=on_iteration)
            found.append(solution)
            yield solution

    def solver_for(self, operator: Operator, given: Given) -> Solver:
        """Return the solver given, or the one that suits the operator and the prior."""
        if self.solver is not None:
            return cast(Solver, self.solver)
        if isinstance(operator, CodedAperture):
            return Admm(max_iterations=200)
        plain = not given.nonnegative and (given.prior is None or (isinstance(given.prior, L1) and given.prior.weights is None))
        return Gpsr(max_iterations=160, tolerance=1e-4) if plain else Fista(max_iterations=160, tolerance=1e-4)

    def _predicted(self, found: list[Solution]) -> np.ndarray | None:
        """Continue the last change, in proportion to the step in log tau, at most in full (theory.md (S.38))."""
        i = len(found)
        if i < 2:
            return found[-1].cube if found else None
        far, near, next_one = np.log(self.fractions[i - 2 : i + 1])
        step = min(1.0, float((next_one - near) / (near - far)))
        return np.asarray(found[-1].cube + found[-1].cube.dtype.type(step) * (found[-1].cube - found[-2].cube))


def _followed(guide: tuple[np.ndarray, ...], found: list[Solution]) -> np.ndarray:
    """Add the guide's next change to the last solution."""
    i = len(found)
    return guide[0] if i == 0 else np.asarray(found[-1].cube + (guide[i] - guide[i - 1]))

"""Tau from known noise: the discrepancy principle (theory.md (S.80); Morozov 1966, Hall and Titterington 1987)."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from recon import threads as pool
from recon.config import Config
from recon.errors import InputError
from recon.operator import Operator
from recon.problem import Problem
from recon.solution import Solution
from recon.tau.choice import Given, TauChoice, as_given, dark_choice
from recon.tau.path import TauPath

PROBE = 0.3
"""Size of a probe's noise in standard deviations: large beside what solvers leave open, small beside the noise there is."""


class Discrepancy(Config):
    """Take the largest tau whose answer leaves no more of the frames unexplained than their noise would (theory.md (S.80)).

    tau falls along a path until the sum of ``(g - H f)^2 / variance`` is as large as the noise leaves it: the number of measurements
    less the degrees of freedom that the answer spends on them. Then tau is interpolated; smaller values are never solved.

    Args:
        path: values of tau to try and the solver to try them with.
        probes: solves a value by which the degrees of freedom are counted, 0 to 16: how the answer follows a little more noise.
            0 is Morozov's rule, which counts none and smooths more.
        target: factor on what the noise should leave, 0.01 to 100.
        seed: of the probes, 0 to 2^64 - 1.
    """

    path: TauPath = TauPath(fractions=(1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6))
    probes: int = Field(default=1, ge=0, le=16)
    target: float = Field(default=1.0, ge=0.01, le=100)
    seed: int = Field(default=0, ge=0, lt=2**64)

    def choose(self, operator: Operator, frames: np.ndarray, given: Given | None = None) -> TauChoice:
        """Return the tau that leaves as much as the noise would.

        Raises:
            InputError: ``noise`` when it is not given; else see :func:`recon.reconstruct`.
        """
        if given is None or as_given(given).noise is None:
            raise InputError("noise", None, "the variance of each measurement; without it take AutoTau(), which needs none")
        problem = given.pose(operator, frames)
        if problem is None:
            return dark_choice()
        with pool.use(given.threads):
            largest = problem.outer_tau(problem.reference_tau())
        ruler = _Ruler(self, operator, np.asarray(frames, np.float64), given, problem)
        ratios: list[float] = []
        made, last = 0, None
        for solution in self.path.walk(operator, frames, given, largest=largest):
            ratios.append(ruler.ratio(solution))
            made, last = made + solution.iterations, solution
            if ratios[-1] <= self.target:
                break
        assert last is not None
        fraction = self._crossing(ratios)
        reason = self._reason(fraction, ratios)
        return TauChoice(fraction * largest, fraction, reason, self._at_edge(ratios), tuple(ratios), made + ruler.made, last.cube)

    def _at_edge(self, ratios: list[float]) -> bool:
        return len(ratios) == 1 or ratios[-1] > self.target

    def _crossing(self, ratios: list[float]) -> float:
        """Interpolate log misfit over log tau to the target; the end of the path where it isn't crossed."""
        fractions = self.path.fractions[: len(ratios)]
        if self._at_edge(ratios):
            return fractions[-1]
        above, below = (math.log(max(ratio, 1e-300) / self.target) for ratio in ratios[-2:])
        part = above / (above - below)
        return float(math.exp((1 - part) * math.log(fractions[-2]) + part * math.log(fractions[-1])))

    def _reason(self, fraction: float, ratios: list[float]) -> str:
        wanted = "what the noise should" if self.target == 1 else f"{self.target:g} times what the noise should"
        if ratios[-1] > self.target:
            return (
                f"even the smallest tau of the path, {fraction:.3g} of tau_max, leaves {ratios[-1]:.3g} times what the noise should leave "
                f"of the frames (wanted: {self.target:g}): the operator or the variances are wrong, or smaller values are needed"
            )
        if len(ratios) == 1:
            return (
                f"the largest tau of the path, {fraction:.3g} of tau_max, leaves no more of the frames than {wanted} "
                f"({ratios[0]:.3g} times): larger values may do better still, or the variances are too large"
            )
        return f"tau = {fraction:.3g} of tau_max leaves {wanted} leave of the frames"


class _Ruler:
    """Measures what an estimate leaves of the frames in units of what noise alone would leave."""

    def __init__(self, rule: Discrepancy, operator: Operator, frames: np.ndarray, given: Given, problem: Problem) -> None:
        self._rule, self._operator, self._frames, self._given, self._problem = rule, operator, frames, given, problem
        variance = np.broadcast_to(np.asarray(given.noise, np.float64), frames.shape)
        self._counts = np.isfinite(variance)
        finite = variance[self._counts]
        self._sigma = np.sqrt(np.where(self._counts, variance, 0.0))
        self._unit = math.sqrt(1 / (1 / finite).mean()) / problem.light  # of W^(1/2) noise, the same in every measurement
        self._draw = np.random.Generator(np.random.Philox(rule.seed))
        self.made = 0

    def ratio(self, solution: Solution) -> float:
        """Return misfit / (measurements - degrees of freedom), in units of the noise."""
        seen = self._seen(solution)
        misfit = float(np.square((self._problem.exact_frames - seen)[self._counts] / self._unit).mean())
        freedom = [self._freedom(solution, seen) for _ in range(self._rule.probes)]
        return misfit / (1 - (float(np.clip(np.mean(freedom), 0.0, 0.999)) if freedom else 0.0))

    def _freedom(self, solution: Solution, seen: np.ndarray) -> float:
        """Return the share of a little added noise that the answer follows, by one random probe (theory.md (S.81))."""
        signs = self._draw.choice(np.array([-1.0, 1.0]), self._frames.shape)
        moved = self._given.reconstruct(
            self._operator,
            self._frames + PROBE * self._sigma * signs,
            solver=self._rule.path.solver_for(self._operator, self._given),
            tau=solution.tau,
            start=solution.cube,
        )
        self.made += moved.iterations
        return float((signs * (self._seen(moved) - seen))[self._counts].mean()) / (PROBE * self._unit)

    def _seen(self, solution: Solution) -> np.ndarray:
        """Return W^(1/2) H f of the normalised problem."""
        with pool.use(self._given.threads):
            return self._problem.photographed(solution.cube)

"""How a measurement is inverted: one factor of the readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from optsim.cube import Bands
from optsim.study.claims.captures import Taken
from optsim.study.library import quality

if TYPE_CHECKING:
    from recon.prior import Prior

Tick = Callable[..., None]
FRACTIONS = (3e-4, 6e-5, 1.3e-5, 3e-6)
"""Values of tau / tau_max for data without noise."""
MATCHED_FRACTIONS = (*FRACTIONS, 6e-7, 1.3e-7)
"""The same where data lie in the range of H: the less tau the better, most of all with a Foveon's layers."""
INTERPOLATED_FRACTIONS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4)
"""The same for frames that were interpolated: what interpolation added is like noise."""
NOISY_FRACTIONS = (2e-1, 4e-2, 8e-3, 1.6e-3, 3e-4, 6e-5, 1.2e-5)
"""The same for data with noise: tau is interpolated to where the misfit is the noise's."""
BENCH_FRACTIONS = (3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 3e-6)
QUALITY_FRACTIONS = (3e-2, 3e-3, 3e-4, 3e-5)
"""The same for the quality mode under noise: tau is interpolated between them."""
PATH_ITERATIONS = 100
"""Of each value of tau on the way to the chosen one; the final solve has the solver's own limit."""
PURSUIT_TOLERANCE = 1e-3
"""Leaves the PSNR within 0.01 dB of a tolerance twenty times smaller."""


@dataclass(frozen=True, eq=False)
class Inverted:
    """An estimate and how it was reached.

    Args:
        cube: (M, N, K).
        converged: whether the last solve met its tolerance.
        iterations: of the last solve.
        tau_fraction: of tau_max; None without a tau.
        at_edge: whether that is an end of its grid.
    """

    cube: np.ndarray
    converged: bool
    iterations: int
    tau_fraction: float | None = None
    at_edge: bool = False


class Method(Protocol):
    """A way to invert a measurement."""

    @property
    def name(self) -> str:
        """Return its name, unique among methods."""
        ...

    @property
    def cost(self) -> float:
        """Return its expected time over that of basis pursuit."""
        ...

    def invert(self, taken: Taken, truth: np.ndarray, tick: Tick) -> Inverted:
        """Estimate the cube with one kernel thread; only an oracle looks at ``truth``."""
        ...


@cache
def best_prior() -> Prior:
    """Return the quality mode's prior; its spectra are learned from samples that no scene of the study is painted with."""
    return quality(Bands.paper())


QUALITY_COST = 5.0
"""Time of a solve with the quality mode's prior over one with the l1 norm."""


@dataclass(frozen=True)
class Pursuit:
    """Basis pursuit: the cube of the least prior that explains the frames exactly.

    Args:
        quality: whether the prior is the quality mode's; else the paper's l1 norm of wavelet x DCT.
    """

    quality: bool = False

    @property
    def name(self) -> str:
        """Return its name."""
        return "quality-pursuit" if self.quality else "basis-pursuit"

    @property
    def cost(self) -> float:
        """Return its expected time over that of basis pursuit."""
        return QUALITY_COST if self.quality else 1.0

    def invert(self, taken: Taken, truth: np.ndarray, tick: Tick) -> Inverted:
        """Solve."""
        from recon import BasisPursuit, reconstruct

        solver = BasisPursuit(tolerance=PURSUIT_TOLERANCE)
        prior = best_prior() if self.quality else None
        solution = reconstruct(taken.operator, taken.signal, prior=prior, solver=solver, threads=1, on_iteration=tick)
        return Inverted(solution.cube, solution.stop.converged, solution.iterations)


@dataclass(frozen=True)
class BlindTau:
    """Eq. 4 by ADMM, its tau found from held-out detector pixels.

    Args:
        fractions: values of tau / tau_max to try, falling.
        quality: whether the prior is the quality mode's; else the paper's l1 norm.
    """

    fractions: tuple[float, ...] = FRACTIONS
    quality: bool = False

    @property
    def name(self) -> str:
        """Return its name."""
        return f"eq4-blind-{_ends(self.fractions)}{'-quality' * self.quality}"

    @property
    def cost(self) -> float:
        """Return its expected time over that of basis pursuit."""
        return (1.3 * len(self.fractions) + 1.5) * (QUALITY_COST if self.quality else 1.0)

    def invert(self, taken: Taken, truth: np.ndarray, tick: Tick) -> Inverted:
        """Choose and solve."""
        from recon import Admm, reconstruct
        from recon.tau import AutoTau, TauPath
        from recon.tau.choice import Given

        rule = AutoTau(path=TauPath(fractions=self.fractions, solver=Admm(max_iterations=PATH_ITERATIONS)))
        prior = best_prior() if self.quality else None
        choice, _ = rule.try_all(taken.operator, taken.signal, Given(prior=prior, threads=1), on_iteration=tick)
        more = {"prior": prior, "start": choice.start, "threads": 1, "on_iteration": tick}
        solution = reconstruct(taken.operator, taken.signal, solver=Admm(), tau=choice.tau, **more)
        return Inverted(solution.cube, solution.stop.converged, solution.iterations, choice.fraction, choice.at_edge)


@dataclass(frozen=True)
class KnownNoise:
    """Eq. 4 by ADMM at the largest tau that leaves no more unexplained than the noise (discrepancy principle).

    Args:
        weighted: whether the data term is weighted by the inverse variance of each measurement; else all weigh alike.
        quality: whether the prior is the quality mode's; else the paper's l1 norm.
    """

    weighted: bool = False
    quality: bool = False

    @property
    def name(self) -> str:
        """Return its name."""
        return f"eq4-noise{'-weighted' * self.weighted}{'-quality' * self.quality}"

    @property
    def cost(self) -> float:
        """Return its expected time over that of basis pursuit."""
        return 5.0 * QUALITY_COST if self.quality else 12.0

    def invert(self, taken: Taken, truth: np.ndarray, tick: Tick) -> Inverted:
        """Choose and solve."""
        from recon import Admm, reconstruct
        from recon.tau import Discrepancy, Given, TauPath

        assert taken.variance is not None
        noise = taken.variance if self.weighted else np.asarray(taken.variance.mean())
        prior = best_prior() if self.quality else None
        tick()
        fractions = QUALITY_FRACTIONS if self.quality else NOISY_FRACTIONS
        rule = Discrepancy(path=TauPath(fractions=fractions, solver=Admm(max_iterations=PATH_ITERATIONS)))
        choice = rule.choose(taken.operator, taken.signal, Given(prior, noise, threads=1))
        more = {"prior": prior, "noise": noise, "start": choice.start, "threads": 1, "on_iteration": tick}
        solution = reconstruct(taken.operator, taken.signal, solver=Admm(), tau=choice.tau, **more)
        return Inverted(solution.cube, solution.stop.converged, solution.iterations, choice.fraction, choice.at_edge)


@dataclass(frozen=True)
class OracleTau:
    """Eq. 4 by ADMM at the tau, of a grid, whose answer is nearest the truth.

    Args:
        fractions: values of tau / tau_max to try, falling.
    """

    fractions: tuple[float, ...] = FRACTIONS

    @property
    def name(self) -> str:
        """Return its name."""
        return "eq4-oracle" if self.fractions == FRACTIONS else f"eq4-oracle-{_ends(self.fractions)}"

    @property
    def cost(self) -> float:
        """Return its expected time over that of basis pursuit."""
        return 1.5 * len(self.fractions)

    def invert(self, taken: Taken, truth: np.ndarray, tick: Tick) -> Inverted:
        """Solve for every tau and take the best."""
        from recon import Admm
        from recon.metrics import psnr
        from recon.tau import Given, TauPath

        path = TauPath(fractions=self.fractions, solver=Admm())
        found = path.follow(taken.operator, taken.signal, Given(threads=1), on_iteration=tick)
        best = int(np.argmax([psnr(solution.cube, truth) for solution in found]))
        solution = found[best]
        return Inverted(solution.cube, solution.stop.converged, solution.iterations, self.fractions[best], best in (0, len(found) - 1))


def _ends(fractions: tuple[float, ...]) -> str:
    """Name a grid of tau by its ends; the two first ones by their start alone."""
    return f"{fractions[0]:g}" + ("" if fractions in (FRACTIONS, BENCH_FRACTIONS) else f"-to-{fractions[-1]:g}")


@cache
def settings() -> dict[str, Any]:
    """Return what decides the answers of all methods, for the keys of finished work."""
    prior = quality(Bands.paper()).model_dump(mode="json")
    return {"fractions": FRACTIONS, "noisy": NOISY_FRACTIONS, "bench": BENCH_FRACTIONS, "pursuit": PURSUIT_TOLERANCE, "quality": prior} | {
        "path": PATH_ITERATIONS,
        "quality_fractions": QUALITY_FRACTIONS,
    }

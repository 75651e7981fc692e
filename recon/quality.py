"""The quality mode: a prior that goes beyond the paper's, and a way to choose between priors without the truth (theory.md (S.65))."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field, field_validator

from recon import threads as pool
from recon.basis import DEFAULT_WAVELET, Kronecker
from recon.config import Config
from recon.errors import InputError
from recon.l1 import L1
from recon.mixture import Mixture, MixturePenalty
from recon.operator import Operator
from recon.prior import Prior
from recon.solution import Solution
from recon.solve import reconstruct
from recon.spectral_basis import Cosine
from recon.total_variation import SpectralTotalVariation

if TYPE_CHECKING:
    from recon.tau import TauRule

SWEEPS = 3
"""Dual iterations of the total variation a call: more change nothing but the time (26.40 dB against 26.38)."""


class Quality(Config):
    """Few edges and few wavelets at once, both in weighted spectral coefficients (theory.md (S.65)).

    ``R(f) = share sum_q w_q TV(q-th coefficient picture) + (1 - share) sum_q w_q ||its wavelet coefficients||_1``, convex, with
    ``w = spectral.weights(K, power)``. Like every prior it goes into :func:`recon.reconstruct`: without tau for data
    without noise (basis pursuit), with ``tau=Discrepancy()`` and ``noise=`` or with ``tau=AutoTau()`` for noisy ones.

    Args:
        spectral: the basis along wavelength; ``recon.learned(samples)`` of a library gives the best results.
        power: of the weights; 0 treats all coefficients alike.
        share: of total variation, 0 to 1; the rest is l1.
        wavelet: of the l1 part.
    """

    spectral: Any = Cosine()
    power: float = Field(default=0.5, ge=0, le=2)
    share: float = Field(default=0.5, ge=0, le=1)
    wavelet: str = DEFAULT_WAVELET

    @field_validator("spectral")
    @classmethod
    def _is_spectral(cls, spectral: Any) -> Any:
        if not (callable(getattr(spectral, "matrix", None)) and callable(getattr(spectral, "weights", None))):
            raise InputError("Quality.spectral", spectral, "a basis along wavelength: recon.Cosine() or recon.learned(samples)")
        return spectral

    def bind(self, shape: tuple[int, ...], dtype: Any) -> MixturePenalty:
        """See ``Prior.bind``."""
        return self.mixture(shape).bind(shape, dtype)

    def mixture(self, shape: tuple[int, ...]) -> Mixture:
        """Return the sum of priors that this stands for, for cubes of ``shape`` (M, N, K)."""
        weights = self.spectral.weights(shape[2], self.power)
        basis = Kronecker.for_shape(shape, wavelet=self.wavelet, spectral=self.spectral)
        every = (
            (SpectralTotalVariation(spectral=self.spectral, weights=weights, sweeps=SWEEPS), self.share),
            (L1(basis=basis, weights=weights), 1 - self.share),
        )
        used = [(part, share) for part, share in every if share > 0]
        return Mixture(parts=tuple(part for part, _ in used), shares=tuple(share for _, share in used))


@dataclass(frozen=True, eq=False)
class PriorChoice:
    """The prior that predicted held-out measurements best.

    Args:
        prior: the chosen one.
        errors: of each candidate, ``||g - H f||^2 / ||g||^2`` over the held-out detector pixels.
        reason: one sentence.
    """

    prior: Prior
    errors: tuple[float, ...]
    reason: str


def choose_prior(
    operator: Operator,
    frames: np.ndarray,
    priors: Sequence[Prior],
    *,
    tau: "float | TauRule | None" = None,
    noise: np.ndarray | None = None,
    nonnegative: bool = False,
    share: float = 0.05,
    seed: int = 0,
    threads: int | None = None,
) -> PriorChoice:
    """Choose between priors by detector pixels that the solves don't see; nothing about the scene enters (theory.md (S.66)).

    Args:
        operator: H.
        frames: g.
        priors: at least one candidate; the first wins a tie.
        tau, noise, nonnegative, threads: as for :func:`recon.reconstruct`; without tau every candidate is solved by basis pursuit.
            With noise the held-out errors are weighted as the misfit is, so that dead pixels (infinite variance) don't decide.
        share: part of the detector's pixels held out, with all shots and channels, above 0 and at most 0.5.
        seed: of the draw.

    Raises:
        InputError: ``priors`` without candidates; ``noise`` that is finite at fewer than two pixels; what
            :func:`recon.reconstruct` refuses.
    """
    from recon.tau import AutoTau, Given
    from recon.tau.held_out import held_squares

    if not priors:
        raise InputError("priors", tuple(priors), "at least one prior")
    given = Given(noise=noise, nonnegative=nonnegative, threads=threads)
    problem = given.pose(operator, frames)
    if problem is None:
        return PriorChoice(priors[0], (0.0,) * len(priors), "the frames are zero everywhere, so the prior does not matter")
    counts = problem.counting()
    held = AutoTau(share=share, seed=seed).held_out(counts.shape, counts)
    blind = given.without(held, counts.shape)
    energy = float((problem.exact_frames[..., held] ** 2).sum())
    errors = []
    for prior in priors:
        found = replace(blind, prior=prior).reconstruct(operator, frames, tau=tau)
        with pool.use(threads):
            squares = held_squares(problem, found.cube, held)
        errors.append(float(squares.sum()) / energy if energy > 0 else 0.0)
    best = int(np.argmin(errors))
    what = ", ".join(f"{type(prior).__name__} {np.sqrt(error):.3g}" for prior, error in zip(priors, errors))
    return PriorChoice(priors[best], tuple(errors), f"relative error on {int(counts[..., held].sum())} held-out measurements: {what}")


def never_below(
    operator: Operator,
    frames: np.ndarray,
    prior: Prior,
    *,
    than: Prior | None = None,
    tau: "float | TauRule | None" = None,
    noise: np.ndarray | None = None,
    nonnegative: bool = False,
    threads: int | None = None,
) -> Solution:
    """Reconstruct with ``prior``, or with ``than`` (None: ``L1()``) where that predicts held-out pixels better.

    It costs three solves. The note in the solution tells both errors.

    Args:
        operator, frames, tau, noise, nonnegative, threads: as for :func:`recon.reconstruct`.
        prior: usually a ``Quality``.
        than: the prior to fall back on.
    """
    rival = L1() if than is None else than
    choice = choose_prior(operator, frames, (prior, rival), tau=tau, noise=noise, nonnegative=nonnegative, threads=threads)
    found = reconstruct(operator, frames, prior=choice.prior, tau=tau, noise=noise, nonnegative=nonnegative, threads=threads)
    return replace(found, notes=(*found.notes, choice.reason))

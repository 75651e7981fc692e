"""Total variation as a prior: of every band, or of the pictures of spectral coefficients (theory.md (S.62))."""

from typing import Any

import numpy as np
from pydantic import Field, field_validator

from recon import threads
from recon.config import Config
from recon.errors import InputError
from recon.spectral_basis import Cosine
from recon.splitting import Levels
from recon.turning import turn

LEVELS = Levels(start=2.0, end=0.03, decay=0.96)
"""How a splitting's threshold should fall where weights differ: low enough at the end for the weakest coefficients (theory.md (S.65))."""


class TotalVariation(Config):
    """``R(f) = sum over bands of the isotropic total variation``: few edges, whatever their spectra (theory.md (S.62)).

    Args:
        accuracy: the proximal map stops at a duality gap of this part of its objective.
        sweeps: dual iterations at most, a call. The dual stays from one call to the next, so a solve needs few.
    """

    accuracy: float = Field(default=1e-6, ge=0, lt=1)
    sweeps: int = Field(default=8, ge=1, le=10**6)

    def bind(self, shape: tuple[int, ...], dtype: Any) -> "TvPenalty":
        """See ``Prior.bind``."""
        return TvPenalty(shape, dtype, None, np.ones(shape[2]), self.accuracy, self.sweeps)


class SpectralTotalVariation(Config):
    """``R(f) = sum over q of weight[q] TV(picture of the q-th spectral coefficient)`` (theory.md (S.62)).

    Neighbouring bands share their edges, so the few strong coefficients of a good spectral basis carry nearly all of a scene's
    edges, and the others can be held flat by a high weight.

    Args:
        spectral: an orthonormal basis along wavelength: ``Cosine()``, ``Learned``.
        weights: one positive factor a coefficient; None: all 1. ``spectral.weights(K)`` makes sensible ones.
        rank: how many coefficients a cube may use: the others are 0. None: all.
        accuracy: the proximal map stops at a duality gap of this part of its objective.
        sweeps: dual iterations at most, a call. The dual stays from one call to the next, so a solve needs few.
    """

    spectral: Any = Cosine()
    weights: tuple[float, ...] | None = None
    rank: int | None = Field(default=None, ge=1)
    accuracy: float = Field(default=1e-6, ge=0, lt=1)
    sweeps: int = Field(default=8, ge=1, le=10**6)

    @field_validator("spectral")
    @classmethod
    def _is_basis(cls, spectral: Any) -> Any:
        if not callable(getattr(spectral, "matrix", None)):
            raise InputError("SpectralTotalVariation.spectral", spectral, "a spectral basis, e.g. recon.Cosine() or recon.learned(samples)")
        return spectral

    @field_validator("weights")
    @classmethod
    def _positive(cls, weights: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if weights is not None and (not weights or min(weights) <= 0):
            raise InputError("SpectralTotalVariation.weights", weights, "positive numbers, one for each spectral coefficient")
        return weights

    def bind(self, shape: tuple[int, ...], dtype: Any) -> "TvPenalty":
        """See ``Prior.bind``.

        Raises:
            InputError: fields ``SpectralTotalVariation.weights`` or ``.rank`` that don't fit the number of bands.
        """
        bands = shape[2]
        weights = np.ones(bands) if self.weights is None else np.array(self.weights)
        if weights.size != bands:
            raise InputError("SpectralTotalVariation.weights", weights.size, f"as many numbers as bands, {bands}")
        rank = bands if self.rank is None else self.rank
        if rank > bands:
            raise InputError("SpectralTotalVariation.rank", rank, f"at most the number of bands, {bands}")
        matrix = np.ascontiguousarray(self.spectral.matrix(bands, dtype)[:rank])
        return TvPenalty(shape, dtype, matrix, weights[:rank], self.accuracy, self.sweeps)


class TvPenalty:
    """Total variation bound to one solve: it keeps the dual fields of all pictures between calls.

    Args:
        shape: (M, N, K) of the cubes.
        dtype: float32 or float64.
        matrix: (Q, K) orthonormal rows that make the pictures; None: the bands themselves.
        weights: (Q,) positive.
        accuracy, sweeps: as for ``TotalVariation``.
    """

    def __init__(
        self, shape: tuple[int, ...], dtype: Any, matrix: np.ndarray | None, weights: np.ndarray, accuracy: float, sweeps: int
    ) -> None:
        rows, columns, _ = shape
        self._matrix, self._weights = matrix, weights
        self._accuracy, self._sweeps = accuracy, sweeps
        self.levels = LEVELS if weights.max() > weights.min() else None
        self._dual = np.zeros((weights.size, 2, rows, columns), dtype)
        self._sums = np.zeros((weights.size, 3))
        self._pictures = None if matrix is None else np.empty((weights.size, rows, columns), dtype)

    def value(self, cube: np.ndarray) -> float:
        """See ``Penalty.value``."""
        from recon import tv_kernels as kernels

        pictures = np.ascontiguousarray(cube.transpose(2, 0, 1), self._dual.dtype)
        if self._matrix is not None:
            turn(self._matrix, pictures, self._kept())
            pictures = self._kept()
        sums = np.zeros(len(pictures))
        threads.run(kernels.weigh_pictures, len(pictures), pictures, sums)
        return float(self._weights @ sums)

    def shrink(self, cube: np.ndarray, threshold: float) -> float:
        """See ``Penalty.shrink``."""
        bands = cube.transpose(2, 0, 1)
        if self._matrix is None:
            return self._denoise(bands, threshold)
        turn(self._matrix, bands, self._kept())
        total = self._denoise(self._kept(), threshold)
        turn(np.ascontiguousarray(self._matrix.T), self._kept(), bands)
        return total

    def tau_max(self, correlation: np.ndarray) -> float | None:
        """Return None: constant cubes cost nothing, so no tau makes the answer zero."""
        return None

    def _kept(self) -> np.ndarray:
        assert self._pictures is not None
        return self._pictures

    def _denoise(self, pictures: np.ndarray, threshold: float) -> float:
        from recon import tv_kernels as kernels

        limits = (threshold * self._weights).astype(pictures.dtype)
        threads.run(kernels.denoise_pictures, len(pictures), pictures, limits, self._dual, self._sweeps, self._accuracy, self._sums)
        return float(self._weights @ self._sums[:, 0])
